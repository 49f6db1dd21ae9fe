//! Where a lidar was while its head turned.

use nalgebra::{Isometry3, Matrix3, Point3};
use sensor_spec::LidarSpec;

/// Where the sensor was while its head turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorPath {
    /// Pose at the start of the turn; used only with motion distortion.
    pub world_from_sensor_start: Isometry3<f64>,
    /// Pose at the tick.
    pub world_from_sensor: Isometry3<f64>,
}

impl SensorPath {
    /// A sensor that stands still.
    pub fn still(world_from_sensor: Isometry3<f64>) -> Self {
        SensorPath {
            world_from_sensor_start: world_from_sensor,
            world_from_sensor,
        }
    }
}

/// Origin of rays, and the rotation of the sensor's space.
pub(crate) struct Pose {
    pub origin_m: Point3<f64>,
    pub world_from_sensor: Matrix3<f64>,
}

impl From<&Isometry3<f64>> for Pose {
    fn from(pose: &Isometry3<f64>) -> Self {
        Pose {
            origin_m: pose.translation.vector.into(),
            world_from_sensor: *pose.rotation.to_rotation_matrix().matrix(),
        }
    }
}

/// Pose of the sensor at each column, or a single one for all.
pub(crate) fn column_poses(
    spec: &LidarSpec,
    path: &SensorPath,
    n_columns: usize,
    window_nanos: u64,
) -> Vec<Pose> {
    if !spec.motion_distortion {
        return vec![(&path.world_from_sensor).into()];
    }
    let (start, end) = (&path.world_from_sensor_start, &path.world_from_sensor);
    // A lidar as sold may turn faster than it sends frames, or fire less often than it could.
    let is_timed = spec.is_as_sold() && window_nanos > 0;
    let fires = (0..spec.channels).map(|channel| spec.firing_nanos(channel, 0));
    let (first, last) = fires.fold((0.0, f64::MIN), |(first, last): (f64, f64), nanos| {
        (first.min(nanos), last.max(nanos))
    });
    let pose = |column: usize| {
        let share = if is_timed {
            // The middle of the column's firings.
            let middle = 0.5 * (first + last) + column as f64 * spec.column_nanos();
            (1.0 + middle / window_nanos as f64).clamp(0.0, 1.0)
        } else {
            (column + 1) as f64 / n_columns as f64
        };
        (&start.try_lerp_slerp(end, share, 1e-9).unwrap_or(*end)).into()
    };
    (0..n_columns).map(pose).collect()
}
