//! Optical flow from one image of the input to the next: KITTI 2015's errors, of what moves, stands
//! still, was hidden and could be seen.
//!
//! - **Moving**: pixels of a body faster than [`MOVING_MPS`]; all others are static.
//! - **Occluded**: the pixel's point lay outside of the previous image, or that image showed something
//!   else there: of a moving body another object, of everything else a surface that is nearer than the
//!   point was by more than [`SLACK`]. The four pixels round the place are asked, and one that shows
//!   the point is enough.

use std::collections::HashSet;
use std::sync::Arc;

use consumer_metrics::flow::{Collector, Masks};
use consumer_truth::Camera;
use nalgebra::Point3;
use schema_frames::{FrameHeader, Modality};

use super::pixels::read_pixels;
use crate::evidence::moment::{Moment, View};
use crate::picture::Picture;
use crate::picture::pixels::Pixels;
use crate::tasks::Unreadable;
use crate::tasks::{Bad, Context, Drawn, Headline, Measure, Reading, Spec};

/// Speed from which a body moves, m/s: slower is what a standing vehicle's suspension does.
pub const MOVING_MPS: f64 = 0.3;

/// How much nearer a surface must be to hide a point, as a share of its depth.
pub const SLACK: f64 = 0.03;

/// The exact flow of a tick.
struct Truth {
    tick: u64,
    width: u32,
    height: u32,
    flow: Vec<[f32; 2]>,
    scored: Vec<bool>,
    /// Moving and occluded pixels, if the exact images for it were recorded.
    moving: Option<Vec<bool>>,
    occluded: Option<Vec<bool>>,
}

/// What the previous image showed.
struct Before {
    sim_nanos: u64,
    camera: Camera,
    instance: Vec<u32>,
    depth: Vec<f32>,
}

/// The measure.
pub struct Flow {
    spec: Spec,
    before: Option<Before>,
    now: Option<Arc<Truth>>,
}

/// Whether a frame of flow has a truth: not the first one of its sensor.
pub fn has_truth(header: &FrameHeader) -> bool {
    header.window_nanos > 0 && header.flags & FrameHeader::FIRST == 0
}

impl Flow {
    /// For a task.
    pub fn new(spec: &Spec) -> Flow {
        Flow {
            spec: spec.clone(),
            before: None,
            now: None,
        }
    }

    fn truth(&self, moment: &Moment<'_>) -> Option<Truth> {
        let frame = moment.frame(&self.spec.truth, Modality::Flow)?;
        if !has_truth(&frame.header) {
            return None;
        }
        let flow: Vec<[f32; 2]> = frame.elements();
        let (width, height) = (frame.header.width, frame.header.height);
        let view = moment.view(&self.spec.images);
        let view = view.filter(|view| view.instance.len() == flow.len());
        let fast = || -> HashSet<u32> {
            let bodies = moment.bodies().iter();
            bodies
                .filter(|body| body.speed_mps() > MOVING_MPS)
                .map(|body| body.id)
                .collect()
        };
        let moving = view.map(|view| {
            let fast = fast();
            let of = view.instance.iter();
            of.map(|id| fast.contains(id)).collect::<Vec<bool>>()
        });
        let then = frame.header.sim_nanos - frame.header.window_nanos;
        let before = self
            .before
            .as_ref()
            .filter(|before| before.sim_nanos == then);
        let occluded = match (view, before, &moving) {
            (Some(view), Some(before), Some(moving)) if !view.depth.is_empty() => {
                Some(occluded(view, before, &flow, moving))
            }
            _ => None,
        };
        let is_finite = |flow: &[f32; 2]| flow.iter().all(|part| part.is_finite());
        let mut scored: Vec<bool> = flow.iter().map(is_finite).collect();
        if let Some(view) = view {
            // What the camera sees of its own carrier neither moves nor stands still.
            for (scored, id) in scored.iter_mut().zip(&view.instance) {
                *scored &= *id != moment.carrier_id;
            }
        }
        Some(Truth {
            tick: moment.set.tick,
            width,
            height,
            scored,
            flow,
            moving,
            occluded,
        })
    }
}

/// Pixels whose points the previous image did not show.
fn occluded(view: &View, before: &Before, flow: &[[f32; 2]], moving: &[bool]) -> Vec<bool> {
    let (now, then) = (&view.camera, &before.camera);
    let (width, height) = (i64::from(then.width), i64::from(then.height));
    let then_from_now = then.world_from_camera.inverse() * now.world_from_camera;
    let is_hidden = |(at, flow): (usize, &[f32; 2])| {
        let x = (at % now.width as usize) as f64 + 0.5;
        let y = (at / now.width as usize) as f64 + 0.5;
        let (x_then, y_then) = (x - f64::from(flow[0]), y - f64::from(flow[1]));
        if !(0.0..width as f64).contains(&x_then) || !(0.0..height as f64).contains(&y_then) {
            return true;
        }
        let depth = f64::from(view.depth[at]);
        let point = Point3::new(
            (x - now.centre_px[0]) / now.focal_px[0] * depth,
            (y - now.centre_px[1]) / now.focal_px[1] * depth,
            depth,
        );
        let depth_then = (then_from_now * point).z;
        let shows = |column: i64, row: i64| {
            if !(0..width).contains(&column) || !(0..height).contains(&row) {
                return false;
            }
            let there = (row * width + column) as usize;
            match moving[at] {
                true => before.instance[there] == view.instance[at],
                // The sky is nowhere, and can be hidden by anything that is somewhere.
                false if !depth.is_finite() => !before.depth[there].is_finite(),
                false => f64::from(before.depth[there]) >= depth_then * (1.0 - SLACK),
            }
        };
        let (column, row) = ((x_then - 0.5).floor() as i64, (y_then - 0.5).floor() as i64);
        !(0..4).any(|corner| shows(column + corner % 2, row + corner / 2))
    };
    flow.iter().enumerate().map(is_hidden).collect()
}

/// Pixels of a result as pairs; NaN everywhere without one, or for one of another size.
pub fn pairs_of(estimate: Option<&Pixels<[f32; 2]>>, width: u32, height: u32) -> Vec<[f32; 2]> {
    let found = estimate.and_then(|found| found.of_size(width, height));
    let n_pixels = width as usize * height as usize;
    found.map_or_else(|| vec![[f32::NAN; 2]; n_pixels], <[[f32; 2]]>::to_vec)
}

impl Measure for Flow {
    type Estimate = Pixels<[f32; 2]>;
    type Part = Collector;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "Fl",
            unit: "%",
            higher_is_better: false,
        }
    }

    fn begin(&mut self, _: &Context<'_>) -> anyhow::Result<()> {
        (self.before, self.now) = (None, None);
        Ok(())
    }

    fn watch(&mut self, moment: &Moment<'_>) {
        let Some(frame) = moment.frame(&self.spec.truth, Modality::Flow) else {
            return;
        };
        self.now = self.truth(moment).map(Arc::new);
        let view = moment
            .view(&self.spec.images)
            .filter(|view| !view.depth.is_empty());
        self.before = view.map(|view| Before {
            sim_nanos: frame.header.sim_nanos,
            camera: view.camera,
            instance: view.instance.clone(),
            depth: view.depth.clone(),
        });
    }

    fn empty(&self) -> Collector {
        Collector::new()
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Self::Estimate, Unreadable> {
        read_pixels(reading)
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Self::Estimate>) -> Option<Collector> {
        let truth = self
            .now
            .as_ref()
            .filter(|truth| truth.tick == moment.set.tick)?;
        let found = pairs_of(estimate, truth.width, truth.height);
        let masks = Masks {
            scored: Some(&truth.scored),
            moving: truth.moving.as_deref(),
            occluded: truth.occluded.as_deref(),
        };
        let mut part = Collector::new();
        part.add(&truth.flow, &found, masks).ok()?;
        Some(part)
    }

    fn add(&self, total: &mut Collector, part: &Collector) {
        total.merge(part);
    }

    fn bad(&self, part: &Collector) -> Option<Bad> {
        let all = part.scores().all;
        let fl = all.fl?;
        Some(Bad {
            badness: fl + all.epe_px.unwrap_or(0.0),
            why: match all.epe_px {
                Some(epe) => format!("Fl {fl:.1} %, EPE {epe:.2} px"),
                None => "no flow".into(),
            },
        })
    }

    fn draw(&self, picture: &mut Picture, moment: &Moment<'_>, what: Drawn<'_, Self::Estimate>) {
        match what {
            Drawn::Truth => {
                if let Some(frame) = moment.frame(&self.spec.truth, Modality::Flow) {
                    picture.flow(&Pixels {
                        width: frame.header.width,
                        height: frame.header.height,
                        values: frame.elements(),
                    });
                }
            }
            Drawn::Result(found) => picture.flow(found),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;

    /// A camera that moved sideways in front of a wall, past a near post.
    #[test]
    fn what_the_post_hid_before_and_what_came_into_the_image_is_occluded() {
        let (width, height) = (40u32, 4u32);
        let camera = |x: f64| Camera {
            world_from_camera: Isometry3::translation(x, 0.0, 0.0),
            focal_px: [20.0, 20.0],
            centre_px: [20.0, 2.0],
            width,
            height,
            lens: None,
        };
        // Wall 20 m away, post 2 m away between x = −0.5 m and 0.5 m.
        let image = |camera: &Camera| -> Vec<f32> {
            let eye = camera.world_from_camera.translation.x;
            let depth = |at: u32| {
                let x = (f64::from(at % width) + 0.5 - 20.0) / 20.0 * 2.0 + eye;
                if x.abs() < 0.5 { 2.0 } else { 20.0 }
            };
            (0..width * height).map(depth).collect()
        };
        let (then, now) = (camera(0.0), camera(0.5));
        let depth = image(&now);
        // The camera moves to the right, so points move to the left by f · 0.5 m / depth.
        let flow: Vec<[f32; 2]> = depth.iter().map(|z| [-10.0 / z, 0.0]).collect();
        let n = depth.len();
        let before = Before {
            sim_nanos: 0,
            camera: then,
            instance: vec![1; n],
            depth: image(&then),
        };
        let view = View {
            camera: now,
            instance: vec![1; n],
            depth,
            semantic: Vec::new(),
            objects: Vec::new(),
        };
        let hidden = occluded(&view, &before, &flow, &vec![false; n]);
        // The post covers columns 15 to 24 before and 10 to 19 now. Wall pixels 20 to 24 were behind
        // it: they come from columns 20.5 to 24.5. The last column's half pixel came from outside.
        let row: Vec<usize> = (0..width as usize).filter(|at| hidden[*at]).collect();
        assert_eq!(row, [20, 21, 22, 23, 39]);
        // As a moving body of another number everything was hidden.
        let other = View {
            instance: vec![2; n],
            ..view
        };
        assert!(
            occluded(&other, &before, &flow, &vec![true; n])
                .iter()
                .all(|it| *it)
        );
    }
}
