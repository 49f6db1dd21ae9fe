//! Debug shapes: kept until their life is over, and passed to the renderer as strokes and texts.

use std::collections::VecDeque;

use anyhow::{bail, ensure};
use nalgebra::{Isometry3, Point3, Vector3};
use schema_frames::query::{MAX_DEBUG_SHAPES, MAX_DEBUG_TEXT_BYTES};
use schema_frames::{DebugDraw, DebugKind, DebugShape};
use schema_types::{ActorId, Pose, SimTime};
use sensor_core::scene::{DebugStroke, DebugText, Overlay};

/// Thickest stroke, metres.
const MAX_WIDTH_M: f64 = 100.0;

struct Kept {
    drawn: Drawn,
    life_nanos: Option<u64>,
    first_seen: Option<SimTime>,
}

/// How a shape is drawn.
enum Drawn {
    /// Between the surfaces of the world.
    InWorld(Vec<DebugStroke>),
    /// On the spectator's screen.
    OnScreen(Vec<DebugStroke>),
    /// A text there.
    Text(DebugText),
}

/// What is visible at a tick.
#[derive(Debug, Default)]
pub struct Visible {
    /// What every colour image shows.
    pub strokes: Vec<DebugStroke>,
    /// What only the spectator's shows.
    pub overlay: Overlay,
}

/// The debug shapes that are visible.
#[derive(Default)]
pub struct DebugShapes {
    kept: VecDeque<Kept>,
    /// Vehicle whose telemetry is shown.
    telemetry_of: Option<ActorId>,
    /// Count of changes by commands.
    revision: u64,
}

impl DebugShapes {
    /// Adds shapes, or none of them if one is wrong. Beyond the limit the oldest are removed.
    pub fn draw(&mut self, shapes: &[DebugShape]) -> anyhow::Result<()> {
        ensure!(
            shapes.len() <= MAX_DEBUG_SHAPES,
            "{} shapes are drawn at once, at most {MAX_DEBUG_SHAPES} are kept",
            shapes.len()
        );
        let mut new = Vec::with_capacity(shapes.len());
        for shape in shapes {
            new.push(Kept {
                drawn: drawn(shape)?,
                life_nanos: shape.life_nanos,
                first_seen: None,
            });
        }
        self.revision += 1;
        self.kept.extend(new);
        while self.kept.len() > MAX_DEBUG_SHAPES {
            self.kept.pop_front();
        }
        Ok(())
    }

    /// Removes shapes of a kind.
    pub fn clear(&mut self, what: DebugKind) {
        self.revision += 1;
        let is_text = |kept: &Kept| matches!(kept.drawn, Drawn::Text(_));
        match what {
            DebugKind::All => self.kept.clear(),
            DebugKind::Shapes => self.kept.retain(is_text),
            DebugKind::Texts => self.kept.retain(|kept| !is_text(kept)),
        }
    }

    /// Shows a vehicle's telemetry in place of another's, or hides it if it is shown.
    pub fn show_telemetry(&mut self, vehicle: ActorId, shown: bool) {
        self.revision += 1;
        if shown {
            self.telemetry_of = Some(vehicle);
        } else if self.telemetry_of == Some(vehicle) {
            self.telemetry_of = None;
        }
    }

    /// The vehicle whose telemetry is shown.
    pub fn telemetry_of(&self) -> Option<ActorId> {
        self.telemetry_of
    }

    /// Count of changes by commands.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// What is visible at a tick. A shape's life begins with the first tick that shows it.
    pub fn at(&mut self, now: SimTime) -> Visible {
        self.kept.retain_mut(|kept| {
            let first = *kept.first_seen.get_or_insert(now);
            kept.life_nanos
                .is_none_or(|life| now.0.saturating_sub(first.0) < life.max(1))
        });
        self.all()
    }

    /// All shapes, those that no tick has shown yet among them; nobody's life begins with it.
    pub fn all(&self) -> Visible {
        let mut visible = Visible::default();
        for kept in &self.kept {
            match &kept.drawn {
                Drawn::InWorld(strokes) => visible.strokes.extend(strokes),
                Drawn::OnScreen(strokes) => visible.overlay.strokes.extend(strokes),
                Drawn::Text(text) => visible.overlay.texts.push(text.clone()),
            }
        }
        visible
    }
}

fn drawn(shape: &DebugShape) -> anyhow::Result<Drawn> {
    if let DebugDraw::Text { at_m, text, shadow } = &shape.draw {
        ensure!(
            text.len() <= MAX_DEBUG_TEXT_BYTES,
            "a debug text is {} bytes long, but must be {MAX_DEBUG_TEXT_BYTES} at most",
            text.len()
        );
        return Ok(Drawn::Text(DebugText {
            at_m: place(*at_m)?.into(),
            text: text.clone(),
            color_rgb: shape.color_rgb,
            shadow: *shadow,
        }));
    }
    let strokes = strokes(shape)?;
    Ok(match shape.on_screen {
        true => Drawn::OnScreen(strokes),
        false => Drawn::InWorld(strokes),
    })
}

/// A place that can be drawn at.
fn place(at: [f64; 3]) -> anyhow::Result<Point3<f64>> {
    match at.iter().all(|x| x.is_finite() && x.abs() < 1e6) {
        true => Ok(Point3::from(at)),
        false => bail!("a debug shape lies at {at:?}, but must be finite and within 1000 km"),
    }
}

fn strokes(shape: &DebugShape) -> anyhow::Result<Vec<DebugStroke>> {
    let color_rgb = shape.color_rgb;
    let stroke = |from: Point3<f64>, to: Point3<f64>, width_m: f64| DebugStroke {
        from_m: from.coords.into(),
        to_m: to.coords.into(),
        width_m: width_m as f32,
        color_rgb,
    };
    let width = |width_m: f64| match (0.0..=MAX_WIDTH_M).contains(&width_m) {
        true => Ok(width_m),
        false => bail!("a debug shape is {width_m} m thick, but must be 0 to {MAX_WIDTH_M} m"),
    };
    Ok(match &shape.draw {
        DebugDraw::Point { at_m, size_m } => {
            vec![stroke(place(*at_m)?, place(*at_m)?, width(*size_m)?)]
        }
        DebugDraw::Line {
            from_m,
            to_m,
            width_m,
        } => vec![stroke(place(*from_m)?, place(*to_m)?, width(*width_m)?)],
        DebugDraw::Arrow {
            from_m,
            to_m,
            width_m,
            head_m,
        } => {
            let (from, to, width_m) = (place(*from_m)?, place(*to_m)?, width(*width_m)?);
            let mut all = vec![stroke(from, to, width_m)];
            all.extend(
                barbs(&from, &to, width(*head_m)?)
                    .into_iter()
                    .map(|barb| stroke(to, barb, width_m)),
            );
            all
        }
        DebugDraw::Box { edges_of, width_m } => {
            place(edges_of.pose.translation_m)?;
            place(edges_of.half_m)?;
            let (centre, width_m) = (Pose::from(edges_of.pose).isometry(), width(*width_m)?);
            edges(&centre, edges_of.half_m)
                .into_iter()
                .map(|[from, to]| stroke(from, to, width_m))
                .collect()
        }
        DebugDraw::Text { .. } => Vec::new(),
    })
}

/// The outer ends of an arrow head's four strokes: back along the shaft by `head_m`, and by as much
/// aside and up or down, as CARLA has them.
fn barbs(from: &Point3<f64>, to: &Point3<f64>, head_m: f64) -> Vec<Point3<f64>> {
    let Some(along) = (to - from).try_normalize(1e-9) else {
        return Vec::new();
    };
    let upright = if along.z.abs() < 0.99 {
        Vector3::z()
    } else {
        Vector3::x()
    };
    let aside = along.cross(&upright).normalize();
    let up = aside.cross(&along);
    [aside + up, aside - up, up - aside, -aside - up]
        .map(|away| to - along * head_m + away * head_m)
        .to_vec()
}

/// The twelve edges of a box.
fn edges(centre: &Isometry3<f64>, half_m: [f64; 3]) -> Vec<[Point3<f64>; 2]> {
    let corner = |i: usize| {
        let side = |axis: usize| {
            if i >> axis & 1 == 1 {
                half_m[axis]
            } else {
                -half_m[axis]
            }
        };
        centre * Point3::new(side(0), side(1), side(2))
    };
    let mut edges = Vec::with_capacity(12);
    for axis in 0..3 {
        edges.extend(
            (0..8)
                .filter(|i| i >> axis & 1 == 0)
                .map(|i| [corner(i), corner(i | 1 << axis)]),
        );
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(life_nanos: Option<u64>) -> DebugShape {
        let draw = DebugDraw::Line {
            from_m: [0.0; 3],
            to_m: [1.0, 0.0, 0.0],
            width_m: 0.1,
        };
        DebugShape {
            draw,
            color_rgb: [255, 0, 0],
            life_nanos,
            on_screen: false,
        }
    }

    #[test]
    fn a_life_is_counted_from_the_first_tick_that_shows_it() {
        let mut shapes = DebugShapes::default();
        shapes
            .draw(&[line(Some(0)), line(Some(100)), line(None)])
            .unwrap();
        let seen: Vec<usize> = [1000, 1050, 1100, 1_000_000]
            .map(|now| shapes.at(SimTime(now)).strokes.len())
            .into();
        assert_eq!(
            seen,
            [3, 2, 1, 1],
            "0 is one tick, 100 ns are two ticks of 50 ns, none is until cleared"
        );
        shapes.clear(DebugKind::All);
        assert!(shapes.at(SimTime(2_000_000)).strokes.is_empty());
    }

    #[test]
    fn a_box_has_twelve_edges_as_long_as_its_sides_and_an_arrow_four_barbs() {
        let lengths: Vec<f64> = edges(&Isometry3::translation(5.0, 5.0, 5.0), [1.0, 2.0, 3.0])
            .iter()
            .map(|[a, b]| (b - a).norm())
            .collect();
        assert_eq!(lengths, [[2.0; 4], [4.0; 4], [6.0; 4]].concat());
        for to in [Point3::new(0.0, 0.0, 4.0), Point3::new(3.0, -2.0, 1.0)] {
            let barbs = barbs(&Point3::origin(), &to, 0.5);
            assert_eq!(barbs.len(), 4);
            assert!(
                barbs
                    .iter()
                    .all(|barb| ((barb - to).norm() - 0.5 * 3f64.sqrt()).abs() < 1e-9)
            );
        }
    }

    #[test]
    fn texts_and_shapes_on_the_screen_are_for_the_spectator_and_are_cleared_by_kind() {
        let text = DebugShape {
            draw: DebugDraw::Text {
                at_m: [1.0, 2.0, 3.0],
                text: "hello".into(),
                shadow: true,
            },
            ..line(None)
        };
        let on_screen = DebugShape {
            on_screen: true,
            ..line(None)
        };
        let counts = |shapes: &mut DebugShapes| {
            let seen = shapes.at(SimTime(1));
            let overlay = seen.overlay;
            [
                seen.strokes.len(),
                overlay.strokes.len(),
                overlay.texts.len(),
            ]
        };
        for (what, left) in [
            (DebugKind::Texts, [1, 1, 0]),
            (DebugKind::Shapes, [0, 0, 1]),
            (DebugKind::All, [0, 0, 0]),
        ] {
            let mut shapes = DebugShapes::default();
            shapes
                .draw(&[line(None), on_screen.clone(), text.clone()])
                .unwrap();
            assert_eq!(counts(&mut shapes), [1, 1, 1]);
            shapes.clear(what);
            assert_eq!(counts(&mut shapes), left, "{what:?}");
        }
        let long = DebugShape {
            draw: DebugDraw::Text {
                at_m: [0.0; 3],
                text: "x".repeat(MAX_DEBUG_TEXT_BYTES + 1),
                shadow: false,
            },
            ..line(None)
        };
        assert!(DebugShapes::default().draw(&[long]).is_err());
    }

    #[test]
    fn telemetry_is_that_of_the_vehicle_asked_for_last_until_it_is_hidden() {
        let mut shapes = DebugShapes::default();
        shapes.show_telemetry(ActorId(5), true);
        shapes.show_telemetry(ActorId(6), true);
        shapes.show_telemetry(ActorId(5), false);
        assert_eq!(shapes.telemetry_of(), Some(ActorId(6)));
        shapes.show_telemetry(ActorId(6), false);
        assert_eq!(shapes.telemetry_of(), None);
    }

    #[test]
    fn odd_shapes_are_refused_and_the_oldest_go_first() {
        let mut shapes = DebugShapes::default();
        let odd = DebugShape {
            draw: DebugDraw::Point {
                at_m: [f64::NAN, 0.0, 0.0],
                size_m: 0.1,
            },
            ..line(None)
        };
        assert!(shapes.draw(&[line(None), odd]).is_err());
        assert!(shapes.at(SimTime(1)).strokes.is_empty(), "all or none");
        shapes.draw(&vec![line(None); MAX_DEBUG_SHAPES]).unwrap();
        shapes.draw(&vec![line(Some(5)); 10]).unwrap();
        assert_eq!(shapes.at(SimTime(1)).strokes.len(), MAX_DEBUG_SHAPES);
    }
}
