//! Records of results: what detectors, trackers and planners say.

use bytemuck::{Pod, Zeroable};
use schema_types::Pose;

use crate::result_type::ResultType;

/// A record that makes up the body of one type of result.
pub trait ResultRecord: Pod {
    /// The type of result whose body is a list of these.
    const TYPE: ResultType;
}

macro_rules! records {
    ($($name:ident = $kind:ident;)*) => {
        $(impl ResultRecord for $name { const TYPE: ResultType = ResultType::$kind; })*
    };
}

records! {
    Box2d = Boxes2d;
    Box3d = Boxes3d;
    Track = Tracks;
    MaskRecord = Masks;
    KeypointSet = Keypoints;
    PoseEstimate = Pose;
    Odometry = Odometry;
    PathPoint = Path;
    Scalar = Scalars;
}

impl ResultRecord for crate::VehicleControlRecord {
    const TYPE: ResultType = ResultType::Control;
}

/// One detected object in an image. 32 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Box2d {
    /// Corner with the smallest coordinates `[x, y]`, pixels from the outer corner of the top-left
    /// pixel.
    pub min_px: [f32; 2],
    /// Corner with the largest coordinates `[x, y]`, pixels.
    pub max_px: [f32; 2],
    /// Confidence, 0..=1.
    pub score: f32,
    /// Number in the topic's list of classes, or a CARLA class if it has none.
    pub class: u32,
    /// Number of the object that the writer gives; 0 if it gives none.
    pub id: u32,
    /// Zero.
    pub reserved: u32,
}
const _: () = assert!(size_of::<Box2d>() == 32);

/// One detected object in space. 104 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Box3d {
    /// Centre and axes of the box in the result's space; x is the object's forward axis.
    pub pose: Pose,
    /// Half of the box's length, width and height along its own axes, metres.
    pub half_m: [f32; 3],
    /// Velocity in the result's space, m/s; NaN if it was not estimated.
    pub velocity_mps: [f32; 3],
    /// Confidence, 0..=1.
    pub score: f32,
    /// Number in the topic's list of classes, or a CARLA class if it has none.
    pub class: u32,
    /// Number of the object that the writer gives; 0 if it gives none.
    pub id: u32,
    /// Points of the cloud inside the box; 0 if not counted.
    pub n_points: u32,
    /// Zero.
    pub reserved: [u32; 2],
}
const _: () = assert!(size_of::<Box3d>() == 104);

/// One tracked object: a box in the image, a box in space, or both. 152 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Track {
    /// Number of the track, from 1, the same for as long as it lives.
    pub id: u32,
    /// Number in the topic's list of classes, or a CARLA class if it has none.
    pub class: u32,
    /// 0 tentative, 1 confirmed, 2 lost and predicted, 3 ended with this result.
    pub state: u32,
    /// Bit 0: the box in the image holds; bit 1: the box in space holds.
    pub flags: u32,
    /// Confidence, 0..=1.
    pub score: f32,
    /// Results in which it was seen.
    pub n_hits: u32,
    /// Results since it was seen last; 0 if this one saw it.
    pub n_missed: u32,
    /// Time since it began, simulated seconds.
    pub age_secs: f32,
    /// Box in the image as in [`Box2d`], pixels.
    pub min_px: [f32; 2],
    /// Box in the image as in [`Box2d`], pixels.
    pub max_px: [f32; 2],
    /// Velocity of the box's centre in the image, pixels per second.
    pub velocity_pxps: [f32; 2],
    /// Zero.
    pub reserved0: [u32; 2],
    /// Box in space as in [`Box3d`].
    pub pose: Pose,
    /// Half of the box's length, width and height, metres.
    pub half_m: [f32; 3],
    /// Velocity in the result's space, m/s.
    pub velocity_mps: [f32; 3],
    /// Rate of turn about the result's z axis, rad/s.
    pub yaw_rate_radps: f32,
    /// Zero.
    pub reserved1: u32,
}
const _: () = assert!(size_of::<Track>() == 152);

impl Track {
    /// Flag: `min_px`, `max_px` and `velocity_pxps` hold.
    pub const IN_IMAGE: u32 = 1;
    /// Flag: `pose`, `half_m` and `velocity_mps` hold.
    pub const IN_SPACE: u32 = 2;
}

/// One mask. Its runs lie behind all records: lengths of background and object in turn, beginning
/// with background, column by column over the whole image as COCO counts them. 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct MaskRecord {
    /// Box round the mask as in [`Box2d`], pixels.
    pub min_px: [f32; 2],
    /// Box round the mask as in [`Box2d`], pixels.
    pub max_px: [f32; 2],
    /// Confidence, 0..=1.
    pub score: f32,
    /// Number in the topic's list of classes, or a CARLA class if it has none.
    pub class: u32,
    /// Number of the object that the writer gives; 0 if it gives none.
    pub id: u32,
    /// Index of its first run in the list of all runs.
    pub first_run: u32,
    /// Number of its runs.
    pub n_runs: u32,
    /// Zero.
    pub reserved: [u32; 3],
}
const _: () = assert!(size_of::<MaskRecord>() == 48);

/// The key points of one object. They lie behind all records. 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct KeypointSet {
    /// Confidence, 0..=1.
    pub score: f32,
    /// Number in the topic's list of classes, or a CARLA class if it has none.
    pub class: u32,
    /// Number of the object that the writer gives; 0 if it gives none.
    pub id: u32,
    /// Index of its first point in the list of all points.
    pub first_point: u32,
    /// Number of its points.
    pub n_points: u32,
    /// Zero.
    pub reserved: [u32; 3],
}
const _: () = assert!(size_of::<KeypointSet>() == 32);

/// One key point. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Keypoint {
    /// Place `[x, y]`, pixels.
    pub at_px: [f32; 2],
    /// Confidence, 0..=1.
    pub score: f32,
    /// 0 not labelled, 1 hidden, 2 visible, as COCO counts.
    pub visibility: u32,
}
const _: () = assert!(size_of::<Keypoint>() == 16);

/// A pose with its uncertainty. 344 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct PoseEstimate {
    /// The pose in the result's space.
    pub pose: Pose,
    /// Covariance of x, y, z and of the rotations about x, y, z, row after row, m² and rad²; all
    /// zero if not known.
    pub covariance: [f64; 36],
}
const _: () = assert!(size_of::<PoseEstimate>() == 344);

/// A pose and a motion with their uncertainty. 680 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Odometry {
    /// The pose in the result's space.
    pub pose: Pose,
    /// Covariance as in [`PoseEstimate`].
    pub pose_covariance: [f64; 36],
    /// Velocity along the body's own axes, m/s.
    pub velocity_mps: [f64; 3],
    /// Rates of turn about the body's own axes, rad/s.
    pub angular_velocity_radps: [f64; 3],
    /// Covariance of velocity and rates of turn, row after row; all zero if not known.
    pub twist_covariance: [f64; 36],
}
const _: () = assert!(size_of::<Odometry>() == 680);

/// One point of a planned path. 80 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct PathPoint {
    /// Place and heading in the result's space.
    pub pose: Pose,
    /// Time from the result's `sim_nanos` to the moment at this point, simulated seconds; NaN if
    /// the path has no times.
    pub after_secs: f32,
    /// Speed along the path, m/s; NaN if not planned.
    pub speed_mps: f32,
    /// Acceleration along the path, m/s²; NaN if not planned.
    pub acceleration_mps2: f32,
    /// Curvature, 1/m, positive to the left; NaN if not planned.
    pub curvature_pm: f32,
    /// Zero.
    pub reserved: [u32; 2],
}
const _: () = assert!(size_of::<PathPoint>() == 80);

/// A named number. 64 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Scalar {
    /// Its value.
    pub value: f64,
    /// Its name, UTF-8, padded with zeros; a unit belongs into the name (`speed_mps`).
    pub name: [u8; 56],
}
const _: () = assert!(size_of::<Scalar>() == 64);

impl Scalar {
    /// A value under a name, of which the first 56 bytes count.
    pub fn new(name: &str, value: f64) -> Self {
        let mut len = name.len().min(56);
        while !name.is_char_boundary(len) {
            len -= 1;
        }
        let mut bytes = [0; 56];
        bytes[..len].copy_from_slice(&name.as_bytes()[..len]);
        Scalar { value, name: bytes }
    }

    /// The name; bytes that are not UTF-8 become �.
    pub fn name(&self) -> String {
        padded_text(&self.name)
    }
}

/// The text before the padding; bytes that are not UTF-8 become �.
pub(crate) fn padded_text(bytes: &[u8]) -> String {
    let len = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..len]).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_name_is_cut_between_characters() {
        let scalar = Scalar::new(&"é".repeat(40), 1.5);
        assert_eq!(scalar.name(), "é".repeat(28));
        assert_eq!(Scalar::new("speed_mps", 2.0).name(), "speed_mps");
    }
}
