//! Debug shapes: kept until their life is over, and passed to the renderer as strokes.

use std::collections::VecDeque;

use anyhow::{bail, ensure};
use nalgebra::{Isometry3, Point3, Vector3};
use schema_frames::query::MAX_DEBUG_SHAPES;
use schema_frames::{DebugDraw, DebugShape};
use schema_types::{Pose, SimTime};
use sensor_core::scene::DebugStroke;

/// Thickest stroke, metres.
const MAX_WIDTH_M: f64 = 100.0;

struct Kept {
    strokes: Vec<DebugStroke>,
    life_nanos: Option<u64>,
    first_seen: Option<SimTime>,
}

/// The debug shapes that are visible.
#[derive(Default)]
pub struct DebugShapes {
    kept: VecDeque<Kept>,
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
                strokes: strokes(shape)?,
                life_nanos: shape.life_nanos,
                first_seen: None,
            });
        }
        self.kept.extend(new);
        while self.kept.len() > MAX_DEBUG_SHAPES {
            self.kept.pop_front();
        }
        Ok(())
    }

    /// Removes all shapes.
    pub fn clear(&mut self) {
        self.kept.clear();
    }

    /// The strokes that are visible at a tick. A shape's life begins with the first tick that shows
    /// it.
    pub fn at(&mut self, now: SimTime) -> Vec<DebugStroke> {
        self.kept.retain_mut(|kept| {
            let first = *kept.first_seen.get_or_insert(now);
            kept.life_nanos
                .is_none_or(|life| now.0.saturating_sub(first.0) < life.max(1))
        });
        self.kept
            .iter()
            .flat_map(|kept| &kept.strokes)
            .copied()
            .collect()
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
    let place = |at: [f64; 3]| match at.iter().all(|x| x.is_finite() && x.abs() < 1e6) {
        true => Ok(Point3::from(at)),
        false => bail!("a debug shape lies at {at:?}, but must be finite and within 1000 km"),
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
    })
}

/// The outer ends of an arrow head's four strokes: back along the shaft by `head_m`, and aside by
/// half of it in four directions.
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
    [aside, -aside, up, -up]
        .map(|away| to - along * head_m + away * (0.5 * head_m))
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
        }
    }

    #[test]
    fn a_life_is_counted_from_the_first_tick_that_shows_it() {
        let mut shapes = DebugShapes::default();
        shapes
            .draw(&[line(Some(0)), line(Some(100)), line(None)])
            .unwrap();
        let seen: Vec<usize> = [1000, 1050, 1100, 1_000_000]
            .map(|now| shapes.at(SimTime(now)).len())
            .into();
        assert_eq!(
            seen,
            [3, 2, 1, 1],
            "0 is one tick, 100 ns are two ticks of 50 ns, none is until cleared"
        );
        shapes.clear();
        assert!(shapes.at(SimTime(2_000_000)).is_empty());
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
                    .all(|barb| ((barb - to).norm() - 0.5f64.hypot(0.25)).abs() < 1e-9)
            );
        }
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
        assert!(shapes.at(SimTime(1)).is_empty(), "all or none");
        shapes.draw(&vec![line(None); MAX_DEBUG_SHAPES]).unwrap();
        shapes.draw(&vec![line(Some(5)); 10]).unwrap();
        assert_eq!(shapes.at(SimTime(1)).len(), MAX_DEBUG_SHAPES);
    }
}
