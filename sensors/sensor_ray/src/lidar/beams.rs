//! The rays of a frame in the lidar's own space, grouped into bundles.

use nalgebra::Vector3;
use sensor_spec::LidarSpec;

use crate::rays::{Bundle, GROUP, GROUPS, RAYS};

/// Channels of a bundle with motion distortion or a lever arm: only the rays of one column share an
/// origin then.
const DISTORTED_CHANNELS: usize = 2 * GROUP;

/// Neighbouring rays of a frame.
#[derive(Debug)]
pub(crate) struct Bunch {
    pub bundle: Bundle,
    /// Channel and column of each ray of the bundle; unused lanes repeat another ray.
    pub rays: Vec<(u32, u32)>,
}

/// All rays of a frame.
#[derive(Debug, Default)]
pub(crate) struct Beams {
    /// Cosine and sine of each channel's elevation.
    pub elevations: Vec<(f64, f64)>,
    /// Cosine and sine of each column's azimuth.
    pub azimuths: Vec<(f64, f64)>,
    /// Cosine and sine of the angle by which each channel looks aside from its column; empty if none
    /// does.
    pub asides: Vec<(f64, f64)>,
    /// When each channel fires after its column's last firing, nanoseconds; never positive.
    fires_nanos: Vec<f64>,
    /// Time from one column to the next, nanoseconds.
    column_nanos: f64,
    pub bunches: Vec<Bunch>,
    /// Largest number of rays of a bunch: the points of bunch `i` begin at `i · bunch_rays`.
    pub bunch_rays: usize,
    /// By ray, channel after channel: the index of its point.
    pub slots: Vec<u32>,
}

impl Beams {
    /// Beams of a specification whose columns look at these azimuths, not yet in bunches.
    pub fn new(spec: &LidarSpec, azimuths_rad: impl Iterator<Item = f64>) -> Self {
        Beams {
            elevations: (0..spec.channels)
                .map(|channel| cos_sin(spec.elevation_rad(channel)))
                .collect(),
            azimuths: azimuths_rad.map(cos_sin).collect(),
            fires_nanos: (0..spec.channels)
                .map(|channel| spec.firing_nanos(channel, spec.columns.saturating_sub(1)))
                .collect(),
            column_nanos: spec.column_nanos(),
            asides: if spec.azimuth_offsets_deg.is_empty() && spec.fire_offsets_ns.is_empty() {
                Vec::new()
            } else {
                let asides = (0..spec.channels).map(|channel| spec.aside_rad(channel));
                asides.map(cos_sin).collect()
            },
            ..Default::default()
        }
    }

    /// Puts the rays into bunches, once.
    pub fn bunch(&mut self, spec: &LidarSpec) {
        let (n_channels, n_columns) = (self.elevations.len(), self.azimuths.len());
        if !self.bunches.is_empty() || n_columns == 0 {
            return;
        }
        // The origin moves from column to column with the sensor, or about the head's axis.
        let is_by_column = spec.motion_distortion || spec.origin_offset_m > 0.0;
        let [channels, columns] = if is_by_column {
            [DISTORTED_CHANNELS, 1]
        } else {
            shape(spec, n_columns)
        };
        self.bunch_rays = if is_by_column {
            DISTORTED_CHANNELS
        } else {
            RAYS
        };
        // In upright strips, so that consecutive bunches visit the same triangles while those are
        // in the cache.
        for column in (0..n_columns).step_by(columns) {
            for channel in (0..n_channels).step_by(channels) {
                self.add(
                    [channel, (channel + channels).min(n_channels)],
                    [column, (column + columns).min(n_columns)],
                );
            }
        }
        self.slots = vec![0; n_channels * n_columns];
        for (i, bunch) in self.bunches.iter().enumerate() {
            // In reverse: unused lanes repeat an earlier ray, which must win.
            for (ray, (channel, column)) in bunch.rays.iter().enumerate().rev() {
                self.slots[*channel as usize * n_columns + *column as usize] =
                    (i * self.bunch_rays + ray) as u32;
            }
        }
    }

    /// Number of a ray in the frame, channel after channel.
    #[inline(always)]
    pub fn number(&self, (channel, column): (u32, u32)) -> u64 {
        channel as u64 * self.azimuths.len() as u64 + column as u64
    }

    /// When a ray of a turn is fired, nanoseconds from the turn's last firing.
    #[inline(always)]
    pub fn fired_nanos(&self, (channel, column): (u32, u32)) -> f64 {
        let columns_left = (self.azimuths.len() as u32 - 1 - column) as f64;
        self.fires_nanos[channel as usize] - columns_left * self.column_nanos
    }

    pub fn n_columns(&self) -> usize {
        self.azimuths.len()
    }

    /// Unit vector of a ray in the sensor's space.
    #[inline(always)]
    pub fn direction(&self, channel: usize, column: usize) -> Vector3<f64> {
        let ((cos_e, sin_e), (mut cos_a, mut sin_a)) =
            (self.elevations[channel], self.azimuths[column]);
        if let Some((cos, sin)) = self.asides.get(channel) {
            (cos_a, sin_a) = (cos_a * cos - sin_a * sin, sin_a * cos + cos_a * sin);
        }
        Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e)
    }

    /// Adds the rays of a block of channels and columns: as one bunch, or split where they spread
    /// too far for a bundle.
    fn add(&mut self, channels: [usize; 2], columns: [usize; 2]) {
        let [n_channels, n_columns] = [channels[1] - channels[0], columns[1] - columns[0]];
        let mut rays: Vec<Option<(u32, u32)>> = Vec::new();
        // A single column fills its groups along the channels.
        let by_column = n_columns == 1;
        let (outer, inner) = if by_column {
            (columns, channels)
        } else {
            (channels, columns)
        };
        for i in outer[0]..outer[1] {
            for j in inner[0]..inner[1] {
                rays.push(Some(if by_column {
                    (j as u32, i as u32)
                } else {
                    (i as u32, j as u32)
                }));
            }
            rays.resize(rays.len().next_multiple_of(GROUP), None);
        }
        let directions: Vec<_> = rays
            .iter()
            .map(|ray| {
                ray.map(|(channel, column)| self.direction(channel as usize, column as usize))
            })
            .collect();
        match Bundle::new(&directions) {
            Some(bundle) => {
                let first = rays.iter().flatten().next().copied().unwrap_or_default();
                self.bunches.push(Bunch {
                    bundle,
                    rays: rays.into_iter().map(|ray| ray.unwrap_or(first)).collect(),
                });
            }
            None if n_columns >= n_channels => {
                let middle = columns[0] + n_columns / 2;
                self.add(channels, [columns[0], middle]);
                self.add(channels, [middle, columns[1]]);
            }
            None => {
                let middle = channels[0] + n_channels / 2;
                self.add([channels[0], middle], columns);
                self.add([middle, channels[1]], columns);
            }
        }
    }
}

/// Azimuth of a column of a full turn, radians counter-clockwise from x.
pub fn azimuth_rad(spec: &LidarSpec, column: u32) -> f64 {
    let counter_clockwise = 0.5
        * spec.horizontal_fov_deg.to_radians()
        * (2.0 * (column + 1) as f64 / spec.columns as f64 - 1.0);
    if spec.clockwise {
        -counter_clockwise
    } else {
        counter_clockwise
    }
}

/// Channels and columns of a bundle: eight groups of eight neighbours, as near to a square as
/// possible.
fn shape(spec: &LidarSpec, n_columns: usize) -> [usize; 2] {
    let between_channels =
        (spec.upper_fov_deg - spec.lower_fov_deg) / spec.channels.saturating_sub(1).max(1) as f64;
    let between_columns = spec.horizontal_fov_deg / n_columns.max(1) as f64;
    let squareness = |n_channels: &usize| {
        let (height, width) = (
            *n_channels as f64 * between_channels,
            (RAYS / n_channels) as f64 * between_columns,
        );
        (height.max(1e-6) / width.max(1e-6)).ln().abs()
    };
    let n_channels = [1, 2, 4, GROUPS]
        .into_iter()
        .min_by(|a, b| squareness(a).total_cmp(&squareness(b)))
        .unwrap_or(GROUPS);
    [n_channels, RAYS / n_channels]
}

fn cos_sin(angle_rad: f64) -> (f64, f64) {
    (angle_rad.cos(), angle_rad.sin())
}
