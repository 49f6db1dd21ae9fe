//! The truth of one tick, made ready once for all programs that are scored against it.

use std::sync::{Arc, OnceLock};

use consumer_truth::boxes::Seen;
use consumer_truth::ticks::{TickFrame, TickSet, World};
use consumer_truth::{Body, Camera, Images, bodies, box_truths, segments};
use nalgebra::{Isometry3, Vector3};
use schema_frames::Modality;

/// One tick.
pub struct Moment<'a> {
    /// Everything that was recorded of it.
    pub set: &'a TickSet,
    /// Actor that carries the rig; 0 without one.
    pub carrier_id: u32,
    /// Whether truth from snapshots alone is asked for at this tick.
    pub is_query: bool,
    /// Whether the sun is below the horizon.
    pub is_night: bool,
    bodies: OnceLock<Vec<Body>>,
    views: Vec<(Arc<str>, OnceLock<Option<View>>)>,
}

/// Exact images of one camera at one tick.
pub struct View {
    /// The camera.
    pub camera: Camera,
    /// Object ids.
    pub instance: Vec<u32>,
    /// Metres along the optical axis; empty if not recorded.
    pub depth: Vec<f32>,
    /// CARLA's classes; empty if not recorded.
    pub semantic: Vec<u8>,
    /// What its pixels show, by id and class.
    pub objects: Vec<Object>,
}

/// The pixels of one id and one class.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Object id, as in instance images.
    pub id: u32,
    /// CARLA's class.
    pub class: u8,
    /// First column and row, column and row behind the last.
    pub bounds: [u32; 4],
    /// Its pixels.
    pub n_pixels: u64,
    /// What can be seen of the whole body, and its truncation; `None` without a box in space.
    pub of_body: Option<(Seen, f64)>,
    /// From the camera to the middle of its box, metres; else to its nearest pixel; `None` without
    /// both.
    pub distance_m: Option<f64>,
}

/// The carrier of the rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ego {
    /// Its pose in the world.
    pub world_from_ego: Isometry3<f64>,
    /// Its velocity in the world, m/s.
    pub velocity_mps: Vector3<f64>,
}

impl<'a> Moment<'a> {
    /// The truth of a tick; `views` are the truth cameras, `rig/sensor`, that tasks look at.
    pub fn new(set: &'a TickSet, carrier_id: u32, views: &[Arc<str>]) -> Moment<'a> {
        Moment {
            set,
            carrier_id,
            is_query: false,
            is_night: false,
            bodies: OnceLock::new(),
            views: views
                .iter()
                .map(|name| (name.clone(), OnceLock::new()))
                .collect(),
        }
    }

    /// Simulated time, nanoseconds.
    pub fn sim_nanos(&self) -> u64 {
        self.set.sim_nanos
    }

    /// The world after the tick, if its snapshot was recorded.
    pub fn world(&self) -> Option<&World> {
        self.set.world.as_deref()
    }

    /// All bodies but the carrier.
    pub fn bodies(&self) -> &[Body] {
        self.bodies.get_or_init(|| {
            self.world()
                .map_or_else(Vec::new, |world| bodies(world, self.carrier_id))
        })
    }

    /// The carrier of the rig.
    pub fn ego(&self) -> Option<Ego> {
        let record = self.world()?.record(self.carrier_id)?;
        Some(Ego {
            world_from_ego: record.world_from_actor.isometry(),
            velocity_mps: Vector3::from(record.velocity_in_world_mps),
        })
    }

    /// The frame of a sensor, `rig/sensor`, and modality.
    pub fn frame(&self, sensor: &str, modality: Modality) -> Option<&'a TickFrame> {
        let name = modality.name();
        self.set.frames.iter().find(|frame| {
            frame.modality == modality
                && frame
                    .topic
                    .strip_suffix(name)
                    .and_then(|rest| rest.strip_suffix('/'))
                    == Some(sensor)
        })
    }

    /// Exact images of a truth camera; `None` if it did not fire in this tick.
    pub fn view(&self, sensor: &str) -> Option<&View> {
        let (_, view) = self.views.iter().find(|(name, _)| **name == *sensor)?;
        view.get_or_init(|| self.make_view(sensor)).as_ref()
    }

    fn make_view(&self, sensor: &str) -> Option<View> {
        let frame = self.frame(sensor, Modality::Instance)?;
        let size = (frame.header.width, frame.header.height);
        let other = |modality| {
            let other = self.frame(sensor, modality)?;
            ((other.header.width, other.header.height) == size).then_some(other)
        };
        let instance: Vec<u32> = frame.elements();
        let depth: Vec<f32> = other(Modality::Depth).map_or_else(Vec::new, TickFrame::elements);
        let semantic: Vec<u8> =
            other(Modality::Semantic).map_or_else(Vec::new, TickFrame::elements);
        let camera = Camera::of(&frame.header);
        let mut view = View {
            camera,
            instance,
            depth,
            semantic,
            objects: Vec::new(),
        };
        view.objects = self.objects(&view);
        Some(view)
    }

    fn objects(&self, view: &View) -> Vec<Object> {
        let bodies = self.bodies();
        let images = Images {
            instance: Some(&view.instance),
            depth: Some(&view.depth[..]).filter(|depth| !depth.is_empty()),
        };
        let truths = box_truths(&view.camera, bodies, images);
        let semantic = Some(&view.semantic[..]).filter(|classes| !classes.is_empty());
        let eye = view.camera.world_from_camera.translation.vector;
        let found = segments(&view.instance, semantic, view.camera.width);
        let own = found
            .into_iter()
            .filter(|segment| segment.id != self.carrier_id);
        own.filter_map(|segment| {
            let truth = truths.iter().find(|it| bodies[it.body].id == segment.id);
            let of_actor = || Some(self.world()?.record(segment.id)?.class);
            let of_body = truth.map(|truth| &bodies[truth.body]);
            let distance =
                of_body.map(|body| (body.world_from_box.translation.vector - eye).norm());
            Some(Object {
                id: segment.id,
                class: segment.class.or_else(of_actor)?,
                bounds: segment.bounds,
                n_pixels: segment.n_pixels,
                of_body: truth.and_then(|truth| Some((truth.seen?, truth.truncation))),
                distance_m: distance.or_else(|| view.nearest_m(segment.id, segment.bounds)),
            })
        })
        .collect()
    }
}

impl View {
    /// Least depth of an id's pixels within a rectangle; `None` without a depth image.
    fn nearest_m(&self, id: u32, [x0, y0, x1, y1]: [u32; 4]) -> Option<f64> {
        if self.depth.is_empty() {
            return None;
        }
        let width = self.camera.width as usize;
        let mut least = f32::INFINITY;
        for row in y0 as usize..y1 as usize {
            for column in x0 as usize..x1 as usize {
                let at = row * width + column;
                if self.instance[at] == id {
                    least = least.min(self.depth[at]);
                }
            }
        }
        least.is_finite().then_some(f64::from(least))
    }

    /// Median depth of a rectangle's pixels, metres: how far away is what a box without a truth
    /// shows. `None` if it shows nothing, or lies outside of the image.
    pub fn median_depth_m(&self, min_px: [f64; 2], max_px: [f64; 2]) -> Option<f64> {
        let (width, height) = (f64::from(self.camera.width), f64::from(self.camera.height));
        let clamp = |value: f64, limit: f64| value.clamp(0.0, limit) as usize;
        let (x0, x1) = (clamp(min_px[0], width), clamp(max_px[0].ceil(), width));
        let (y0, y1) = (clamp(min_px[1], height), clamp(max_px[1].ceil(), height));
        if self.depth.is_empty() || x0 >= x1 || y0 >= y1 {
            return None;
        }
        // Some hundred pixels are enough for a median.
        let step = (((x1 - x0) * (y1 - y0)) as f64 / 400.0).sqrt().max(1.0) as usize;
        let mut depths: Vec<f32> = Vec::new();
        for row in (y0..y1).step_by(step) {
            for column in (x0..x1).step_by(step) {
                depths.push(self.depth[row * self.camera.width as usize + column]);
            }
        }
        let middle = depths.len() / 2;
        let (_, median, _) = depths.select_nth_unstable_by(middle, f32::total_cmp);
        median.is_finite().then_some(f64::from(*median))
    }
}
