//! What the formats of KITTI's family share: clouds of four floats, matrices as text, which lidar
//! and which cameras.

use std::fmt::Write as _;

use nalgebra::{Isometry3, Matrix4};
use schema_frames::{ImuSample, LidarPoint, LidarReturn, Modality, SemanticLidarPoint};

use launch_cli::wrong_usage;

use crate::exporter::{Format, missing};
use crate::options::Options;
use consumer_truth::scenario::{Scenario, Sensor, Topic};
use consumer_truth::ticks::{TickFrame, TickSet, World};

/// A cloud with what its sensor tells about each point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// Points in the sensor's space, metres.
    pub points_m: Vec<[f32; 3]>,
    /// Received over emitted energy, 0..=1; of semantic lidars, which measure none, the cosine of
    /// incidence.
    pub intensities: Vec<f32>,
    /// Object ids; of plain lidars `None`.
    pub ids: Option<Vec<u32>>,
    /// Classes; of plain lidars `None`.
    pub classes: Option<Vec<u8>>,
    /// Beam numbers, 0 is the top; of returns, the maker's.
    pub channels: Vec<u16>,
}

impl Cloud {
    /// The cloud of a frame; empty for a frame that is none.
    pub fn of(frame: &TickFrame) -> Cloud {
        match frame.modality {
            Modality::Lidar => {
                let points = frame.elements::<LidarPoint>();
                Cloud {
                    points_m: points.iter().map(|p| p.hit_in_sensor_m).collect(),
                    intensities: points
                        .iter()
                        .map(|p| f32::from(p.intensity) / 65535.0)
                        .collect(),
                    ids: None,
                    classes: None,
                    channels: points.iter().map(|p| p.channel).collect(),
                }
            }
            Modality::SemanticLidar => {
                let points = frame.elements::<SemanticLidarPoint>();
                Cloud {
                    points_m: points.iter().map(|p| p.hit_in_sensor_m).collect(),
                    intensities: points.iter().map(|p| p.cos_incidence).collect(),
                    ids: Some(points.iter().map(|p| p.object_id).collect()),
                    classes: Some(points.iter().map(|p| p.class).collect()),
                    channels: points.iter().map(|p| p.channel).collect(),
                }
            }
            Modality::LidarReturns => {
                let points = frame.elements::<LidarReturn>();
                let intensity = |p: &LidarReturn| f32::from(p.intensity) / 65535.0;
                Cloud {
                    points_m: points.iter().map(|p| p.hit_in_sensor_m).collect(),
                    intensities: points.iter().map(intensity).collect(),
                    ids: Some(points.iter().map(|p| p.object_id).collect()),
                    classes: Some(points.iter().map(|p| p.class).collect()),
                    channels: points.iter().map(|p| p.ring).collect(),
                }
            }
            _ => Cloud::default(),
        }
    }

    /// `x y z intensity` as little-endian `f32`, point after point: a Velodyne file of KITTI.
    pub fn velodyne(&self) -> Vec<u8> {
        let points = self.points_m.iter().zip(&self.intensities);
        points
            .flat_map(|([x, y, z], intensity)| [*x, *y, *z, *intensity])
            .flat_map(f32::to_le_bytes)
            .collect()
    }
}

/// Points of two lidars at one place are the same if they are not farther apart, metres: a plain
/// lidar works its points out from its distances, which rounds.
const SAME_M: f32 = 0.01;

/// A semantic cloud with the intensities of a plain lidar that has the same points in the same tick; the cloud as it is if there is none.
pub fn with_intensities(mut cloud: Cloud, frame: &TickFrame, tick: &TickSet) -> Cloud {
    if frame.modality != Modality::SemanticLidar {
        return cloud;
    }
    let plain = tick
        .frames
        .iter()
        .filter(|other| other.modality == Modality::Lidar);
    for other in plain.filter(|other| other.header.width == frame.header.width) {
        let other = Cloud::of(other);
        let same = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).all(|i| (a[i] - b[i]).abs() < SAME_M);
        if other.points_m.iter().zip(&cloud.points_m).all(same) {
            cloud.intensities = other.intensities;
            break;
        }
    }
    cloud
}

/// The first topic of these modalities, earlier ones first, sensors by name.
pub fn first_topic<'a>(
    scenario: &'a Scenario,
    any: &[Modality],
) -> Option<(&'a Sensor, &'a Topic)> {
    any.iter().find_map(|modality| {
        let sensor = scenario.with(*modality).next()?;
        Some((sensor, sensor.topic(*modality)?))
    })
}

/// The colour camera that is the left one, and if there is one with parallel axes that fires with it,
/// the right one: those that were asked for, else `front` or the first by name.
///
/// # Errors
/// A sentence if there is none, or the cameras that were asked for are no pair.
pub fn camera_pair<'a>(
    format: Format,
    scenario: &'a Scenario,
    options: &Options,
) -> anyhow::Result<Vec<&'a Sensor>> {
    let name = format.name();
    let asked = !options.cameras.is_empty();
    let has_colour = |camera: &&Sensor| camera.has(Modality::Rgb);
    let cameras = scenario.cameras(&options.cameras)?;
    if let Some(other) = cameras.iter().find(|camera| asked && !has_colour(camera)) {
        return Err(wrong_usage(format!(
            "{name} needs colour images, and camera {:?} of {} has none",
            other.name, scenario.name
        )));
    }
    let mut cameras: Vec<&Sensor> = cameras.into_iter().filter(has_colour).collect();
    if !asked {
        cameras.sort_by_key(|camera| camera.name != "front");
    }
    let Some(first) = cameras.first().copied() else {
        let any = [Modality::Rgb];
        return Err(missing(format, scenario, "a colour camera", &any));
    };
    let parallel = |camera: &&Sensor| {
        let turn = &first.carrier_from_sensor.rotation;
        turn.angle_to(&camera.carrier_from_sensor.rotation) < 1e-6
    };
    if asked && cameras.len() > 2 {
        return Err(wrong_usage(format!(
            "{name} holds one camera or a pair, --cameras names {}",
            cameras.len()
        )));
    }
    if let Some(other) = cameras.iter().find(|camera| asked && !parallel(camera)) {
        return Err(wrong_usage(format!(
            "the pair of {name} has parallel axes, and {:?} looks elsewhere than {:?}; export it on its own",
            other.name, first.name
        )));
    }
    let fires = |camera: &&Sensor| camera.first().sim_nanos == first.first().sim_nanos;
    cameras.retain(|camera| asked || (parallel(camera) && fires(camera)));
    // Of several parallel ones nobody can tell which is the right one.
    cameras.truncate(if asked || cameras.len() == 2 { 2 } else { 1 });
    Ok(cameras)
}

/// A 3 × 4 matrix, row after row, as numbers between blanks.
pub fn row34(matrix: &Matrix4<f64>) -> String {
    numbers((0..3).flat_map(|row| (0..4).map(move |column| matrix[(row, column)])))
}

/// Numbers between blanks, in the shortest exponential form that reads back to twelve digits.
pub fn numbers(values: impl IntoIterator<Item = f64>) -> String {
    let mut text = String::new();
    for value in values {
        let blank = if text.is_empty() { "" } else { " " };
        // Adding zero turns a negative zero into zero.
        let _ = write!(text, "{blank}{:.12e}", value + 0.0);
    }
    text
}

/// A pose as a matrix.
pub fn matrix(pose: &Isometry3<f64>) -> Matrix4<f64> {
    pose.to_homogeneous()
}

/// Projection `[K | K·t]` of a camera whose optical axes are parallel to those of a reference camera;
/// KITTI counts from the middle of the first pixel.
pub fn projection(camera: &Sensor, reference_from_camera: &Isometry3<f64>) -> Matrix4<f64> {
    let [fx, fy, cx, cy] = camera.first().intrinsics_px;
    let mut k = Matrix4::identity();
    (k[(0, 0)], k[(1, 1)]) = (fx, fy);
    (k[(0, 2)], k[(1, 2)]) = (cx - 0.5, cy - 0.5);
    k * matrix(&reference_from_camera.inverse())
}

/// Pose of the rig's carrier at a tick; that of the world for rigs without one.
pub fn world_from_carrier(scenario: &Scenario, world: &World) -> Isometry3<f64> {
    let carrier = world.record(scenario.carrier_id);
    carrier.map_or_else(Isometry3::identity, |carrier| {
        carrier.world_from_actor.isometry()
    })
}

/// The last IMU and GNSS frames up to a tick.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// IMU.
    pub imu: Option<ImuSample>,
    /// GNSS.
    pub gnss: Option<schema_frames::GnssSample>,
}

impl Motion {
    /// Takes over what a tick has; the first sensor by name of each kind counts.
    pub fn update(&mut self, tick: &TickSet) {
        let first = |modality| tick.frames.iter().find(|frame| frame.modality == modality);
        if let Some(frame) = first(Modality::Imu) {
            self.imu = frame.elements().first().copied().or(self.imu);
        }
        if let Some(frame) = first(Modality::Gnss) {
            self.gnss = frame.elements().first().copied().or(self.gnss);
        }
    }
}

/// An angle in (−π, π].
pub fn wrapped_rad(angle: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let angle = angle.rem_euclid(turn);
    if angle > std::f64::consts::PI {
        angle - turn
    } else {
        angle
    }
}
