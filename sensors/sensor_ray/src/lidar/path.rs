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
    let shares = Shares::new(spec, n_columns, window_nanos);
    let pose = |column: usize| {
        let share = shares.of_column(column);
        (&start.try_lerp_slerp(end, share, 1e-9).unwrap_or(*end)).into()
    };
    (0..n_columns).map(pose).collect()
}

/// How far along its path a lidar is at each column.
struct Shares {
    n_columns: usize,
    /// The middle of the first column's firings and the time from column to column, nanoseconds, and
    /// the time of the path: of a lidar as sold, which may turn faster than it sends frames, or fire
    /// less often than it could.
    timed: Option<(f64, f64, f64)>,
}

impl Shares {
    fn new(spec: &LidarSpec, n_columns: usize, window_nanos: u64) -> Shares {
        let fires = (0..spec.channels).map(|channel| spec.firing_nanos(channel, 0));
        let (first, last) = fires.fold((0.0, f64::MIN), |(first, last): (f64, f64), nanos| {
            (first.min(nanos), last.max(nanos))
        });
        let is_timed = spec.is_as_sold() && window_nanos > 0;
        Shares {
            n_columns,
            timed: is_timed.then(|| {
                (
                    0.5 * (first + last),
                    spec.column_nanos(),
                    window_nanos as f64,
                )
            }),
        }
    }

    fn of_column(&self, column: usize) -> f64 {
        match self.timed {
            Some((first, column_nanos, window_nanos)) => {
                let middle = first + column as f64 * column_nanos;
                (1.0 + middle / window_nanos).clamp(0.0, 1.0)
            }
            None => (column + 1) as f64 / self.n_columns as f64,
        }
    }
}

/// When the rays of a frame are fired.
pub(crate) struct Times {
    shares: Shares,
    past_nanos: f64,
}

impl Times {
    /// Of a lidar whose path begins `past_nanos` before the tick; `None` if it looks from one place,
    /// and sees all at one time.
    pub fn new(spec: &LidarSpec, n_columns: usize, past_nanos: u64) -> Option<Times> {
        (spec.motion_distortion && past_nanos > 0).then(|| Times {
            shares: Shares::new(spec, n_columns, past_nanos),
            past_nanos: past_nanos as f64,
        })
    }

    /// How long before the tick the middle of a column's firings is, nanoseconds.
    pub fn age_of_column(&self, column: u32) -> f64 {
        (1.0 - self.shares.of_column(column as usize)) * self.past_nanos
    }

    /// Whether the rays of a column are fired one after the other.
    pub fn differ_in_columns(&self) -> bool {
        self.shares.timed.is_some()
    }

    /// How long before the tick a ray of a lidar as sold is fired, nanoseconds.
    pub fn age_of_ray(&self, fired_nanos: f64) -> f64 {
        (-fired_nanos).clamp(0.0, self.past_nanos)
    }
}
