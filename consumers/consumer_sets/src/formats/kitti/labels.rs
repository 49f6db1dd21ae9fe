//! KITTI's label lines.

use nalgebra::{Isometry3, Point3, Vector3};
use schema_frames::{FrameHeader, Modality};

use crate::classes;
use crate::formats::family::{Cloud, wrapped_rad};
use consumer_truth::scenario::{Scenario, Sensor};
use consumer_truth::ticks::TickSet;
use consumer_truth::{Body, Camera, Images, PointCounts, bodies, box_truths, segments};

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// Object id; `None` for a region that nobody cares about.
    pub id: Option<u32>,
    /// KITTI's type, or `DontCare`.
    pub kind: &'static str,
    /// Share of the hull outside of the image.
    pub truncation: f64,
    /// Share of the hull that is covered; `None` if not known.
    pub occlusion: Option<f64>,
    /// Left, top, right, bottom in pixels, counted from the middle of the first one.
    pub box_px: [f64; 4],
    /// Height, width, length, metres.
    pub size_m: [f64; 3],
    /// Middle of the bottom in the camera's space, metres.
    pub bottom_m: Point3<f64>,
    /// Turn about the camera's y axis.
    pub rotation_y_rad: f64,
}

/// Labels of a tick for a camera: bodies that it sees by rising id, then regions that show something
/// that cannot be labelled (what is too small, and cars of the map in recordings without their boxes).
pub fn labels(
    scenario: &Scenario,
    tick: &TickSet,
    camera: &Sensor,
    cloud: Option<&(FrameHeader, Cloud)>,
    min_pixels: u64,
) -> Vec<Label> {
    let (Some(colour), Some(world)) = (
        tick.frame(&camera.name, Modality::Rgb),
        tick.world.as_deref(),
    ) else {
        return Vec::new();
    };
    let view = Camera::of(&colour.header);
    let size = (view.width, view.height);
    let exact = |modality| {
        let frame = tick.frame(&camera.name, modality);
        frame.filter(|frame| (frame.header.width, frame.header.height) == size)
    };
    let ids: Option<Vec<u32>> = exact(Modality::Instance).map(|frame| frame.elements());
    let classes: Option<Vec<u8>> = exact(Modality::Semantic).map(|frame| frame.elements());
    let depth: Option<Vec<f32>> = exact(Modality::Depth).map(|frame| frame.elements());
    let all: Vec<Body> = bodies(world, scenario.carrier_id)
        .into_iter()
        .filter(|body| classes::kitti(body).is_some())
        .collect();
    let images = Images {
        instance: ids.as_deref(),
        depth: depth.as_deref(),
    };
    let n_points = cloud.map(|(header, cloud)| {
        let world_from_sensor = header.world_from_sensor.isometry();
        PointCounts::count(&cloud.points_m, None, &world_from_sensor, &all).in_box
    });
    let camera_from_world = view.world_from_camera.inverse();
    let mut labels = Vec::new();
    let mut regions = Vec::new();
    for truth in box_truths(&view, &all, images) {
        let body = &all[truth.body];
        // Without ids only the lidar can tell what is hidden.
        let pixels = truth.seen.map_or(u64::MAX, |seen| seen.pixels);
        let is_hit = n_points
            .as_ref()
            .is_none_or(|counts| counts[truth.body] > 0);
        if pixels == 0 || (truth.seen.is_none() && !is_hit) {
            continue;
        }
        if pixels < min_pixels {
            regions.extend(truth.seen.and_then(|seen| seen.bounds));
            continue;
        }
        labels.push(label(body, &truth, &camera_from_world, &view));
    }
    // Things of the map without a box in space look like labelled ones.
    if let (Some(ids), Some(classes)) = (&ids, &classes) {
        let is_thing = |class: u8| matches!(class, 12..=19);
        let of_map = segments(ids, Some(classes), view.width)
            .into_iter()
            .filter(|segment| segment.class.is_some_and(is_thing))
            .filter(|segment| segment.id != scenario.carrier_id)
            .filter(|segment| all.iter().all(|body| body.id != segment.id));
        regions.extend(of_map.map(|segment| segment.bounds));
    }
    regions.sort_unstable();
    labels.extend(regions.into_iter().map(dont_care));
    labels
}

fn label(
    body: &Body,
    truth: &consumer_truth::BoxTruth,
    camera_from_world: &Isometry3<f64>,
    view: &Camera,
) -> Label {
    let camera_from_box = camera_from_world * body.world_from_box;
    let bottom_m = camera_from_box * Point3::new(0.0, 0.0, -body.half_m.z);
    let ahead = camera_from_box.rotation * Vector3::x();
    let [length, width, height] = body.size_m();
    let [x0, y0, x1, y1] = truth.clipped_px;
    let (right, bottom) = (f64::from(view.width) - 1.0, f64::from(view.height) - 1.0);
    Label {
        id: Some(body.id),
        kind: classes::kitti(body).unwrap_or("Misc"),
        truncation: truth.truncation,
        occlusion: truth.seen.map(|seen| seen.occlusion),
        box_px: [
            (x0 - 0.5).clamp(0.0, right),
            (y0 - 0.5).clamp(0.0, bottom),
            (x1 - 0.5).clamp(0.0, right),
            (y1 - 0.5).clamp(0.0, bottom),
        ],
        size_m: [height, width, length],
        bottom_m,
        rotation_y_rad: wrapped_rad((-ahead.z).atan2(ahead.x)),
    }
}

fn dont_care(bounds: [u32; 4]) -> Label {
    let [x0, y0, x1, y1] = bounds.map(f64::from);
    Label {
        id: None,
        kind: "DontCare",
        truncation: -1.0,
        occlusion: None,
        box_px: [x0, y0, x1 - 1.0, y1 - 1.0],
        size_m: [-1.0; 3],
        bottom_m: Point3::new(-1000.0, -1000.0, -1000.0),
        rotation_y_rad: -10.0,
    }
}

impl Label {
    /// 0 in sight, 1 partly covered (from a tenth on), 2 largely (from a half on), 3 not known.
    fn occluded(&self) -> i32 {
        match (self.id, self.occlusion) {
            (None, _) => -1,
            (_, None) => 3,
            (_, Some(share)) if share < 0.1 => 0,
            (_, Some(share)) if share < 0.5 => 1,
            _ => 2,
        }
    }

    /// Direction in which the camera sees it.
    fn alpha_rad(&self) -> f64 {
        match self.id {
            Some(_) => wrapped_rad(self.rotation_y_rad - self.bottom_m.x.atan2(self.bottom_m.z)),
            None => -10.0,
        }
    }

    fn rest(&self) -> String {
        let [left, top, right, bottom] = self.box_px;
        let [height, width, length] = self.size_m;
        let at = self.bottom_m;
        format!(
            "{:.4} {left:.2} {top:.2} {right:.2} {bottom:.2} {height:.3} {width:.3} {length:.3} {:.4} {:.4} {:.4} {:.4}\n",
            self.alpha_rad(),
            at.x,
            at.y,
            at.z,
            self.rotation_y_rad
        )
    }

    /// The line of `object/training/label_2`.
    pub fn object_line(&self) -> String {
        format!(
            "{} {:.2} {} {}",
            self.kind,
            self.truncation,
            self.occluded(),
            self.rest()
        )
    }

    /// The line of `tracking/training/label_02`, where truncation has steps: 0 inside, 1 partly
    /// outside (from a hundredth on), 2 largely (from a half on).
    pub fn tracking_line(&self, frame: u64, track: Option<u32>) -> String {
        let truncated = match self.truncation {
            none if none < 0.0 => -1,
            small if small < 0.01 => 0,
            part if part < 0.5 => 1,
            _ => 2,
        };
        let track = track.map_or(-1, i64::from);
        format!(
            "{frame} {track} {} {truncated} {} {}",
            self.kind,
            self.occluded(),
            self.rest()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_car_ahead_that_drives_away_has_the_angles_of_the_devkit() {
        // Facing along the optical axis is −π/2 about y (down); alpha is the same straight ahead.
        let mut label = dont_care([0, 0, 2, 2]);
        (label.id, label.kind) = (Some(7), "Car");
        (label.truncation, label.occlusion) = (0.25, Some(0.3));
        label.bottom_m = Point3::new(0.0, 1.6, 20.0);
        label.rotation_y_rad = -std::f64::consts::FRAC_PI_2;
        assert!((label.alpha_rad() + std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        // To the right by 45°: the camera sees it turned by as much.
        label.bottom_m.x = 20.0;
        assert!((label.alpha_rad() + std::f64::consts::FRAC_PI_2 * 1.5).abs() < 1e-12);
        let line = label.object_line();
        let words: Vec<_> = line.split_whitespace().collect();
        assert_eq!(words.len(), 15);
        assert_eq!(&words[..3], ["Car", "0.25", "1"]);
        let line = label.tracking_line(3, Some(5));
        let words: Vec<_> = line.split_whitespace().collect();
        assert_eq!(
            (words.len(), words[0], words[1], words[3]),
            (17, "3", "5", "1")
        );
        let line = dont_care([10, 20, 30, 40]).object_line();
        assert!(
            line.starts_with("DontCare -1.00 -1 -10.0000 10.00 20.00 29.00 39.00 -1.000"),
            "{line}"
        );
    }
}
