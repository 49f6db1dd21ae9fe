//! Settings of the lidar: beams, rotation, losses, and the tables of lidars as they are sold.

use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};
use crate::mount::MountSpec;

/// Largest number of beams of a lidar.
pub const MAX_CHANNELS: u32 = 256;
/// Largest number of points per second of simulated time, for lidar and radar.
pub const MAX_POINTS_PER_SECOND: u32 = 50_000_000;

/// What one frame of a lidar holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LidarScan {
    /// One full turn of `columns` azimuths that ends at the tick, looking back.
    #[default]
    Turn,
    /// What the head sweeps in one tick, from `points_per_second` and `rotation_hz`: CARLA's lidar.
    /// The head turns clockwise seen from above and continues from where it stood at the previous
    /// firing.
    Sweep,
}

/// A spinning lidar.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LidarSpec {
    /// Frames per second.
    pub rate_hz: f64,
    /// Place on the vehicle.
    pub mount: MountSpec,
    /// Whether points carry class, object id and incidence instead of intensity; no losses then.
    pub semantic: bool,
    /// Whether points are returns as sold lidars give them: with time, ring, object, class and range.
    /// Losses and noise act as on plain points. Needs the scan `turn`.
    pub returns: bool,
    /// What one frame holds.
    pub scan: LidarScan,
    /// Beams.
    pub channels: u32,
    /// Azimuth steps of one frame (scan `turn`).
    pub columns: u32,
    /// Rays per second of simulated time, all channels together (scan `sweep`).
    pub points_per_second: u32,
    /// Turns per second of simulated time (scan `sweep`).
    pub rotation_hz: f64,
    /// Width of the turn, centred forward.
    pub horizontal_fov_deg: f64,
    /// Elevation of the highest beam.
    pub upper_fov_deg: f64,
    /// Elevation of the lowest beam.
    pub lower_fov_deg: f64,
    /// Elevation of each channel, degrees, the highest first. A list that is shorter repeats; an
    /// empty one spreads the channels evenly from `upper_fov_deg` to `lower_fov_deg`.
    pub elevations_deg: Vec<f64>,
    /// By how much each channel looks aside from its column, degrees, counter-clockwise seen from
    /// above. A list that is shorter repeats; an empty one is 0.
    pub azimuth_offsets_deg: Vec<f64>,
    /// When each channel fires after its column has begun, nanoseconds; the head turns on meanwhile.
    /// A list that is shorter repeats; an empty one is 0.
    pub fire_offsets_ns: Vec<f64>,
    /// Number of each channel as the maker counts. A list that is shorter repeats; an empty one
    /// counts from 0, the highest channel first.
    pub rings: Vec<u16>,
    /// Time from one column to the next, nanoseconds; 0 spreads the columns over the time between two
    /// frames.
    pub column_period_ns: f64,
    /// Whether the head turns clockwise, seen from above (scan `turn`).
    pub clockwise: bool,
    /// Distance of the beams' origin from the head's axis, metres, towards the column that fires. The
    /// range counts from the axis.
    pub origin_offset_m: f64,
    /// Distance of the nearest return, metres.
    pub min_range_m: f64,
    /// Distance of the farthest return, metres.
    pub range_m: f64,
    /// Steps of the measured range, metres; 0 measures without steps.
    pub range_resolution_m: f64,
    /// Intensity is exp(−rate · distance).
    pub attenuation_per_m: f64,
    /// Share of rays lost whatever they hit.
    pub dropoff_general_ratio: f64,
    /// Below this intensity more rays are lost …
    pub dropoff_intensity_limit: f64,
    /// … up to this share at intensity 0.
    pub dropoff_zero_intensity_ratio: f64,
    /// Standard deviation of the range, metres.
    pub noise_range_stddev_m: f64,
    /// Tells the noise of otherwise equal sensors apart.
    pub noise_seed: u64,
    /// Whether each ray has a time of its own: the sensor moves along its path while the head turns,
    /// and what moves is met where it was when the ray was fired.
    pub motion_distortion: bool,
}

impl Default for LidarSpec {
    fn default() -> Self {
        LidarSpec {
            rate_hz: 10.0,
            mount: MountSpec::default(),
            semantic: false,
            returns: false,
            scan: LidarScan::Turn,
            channels: 64,
            columns: 2000,
            points_per_second: 1_280_000,
            rotation_hz: 10.0,
            horizontal_fov_deg: 360.0,
            upper_fov_deg: 10.0,
            lower_fov_deg: -25.0,
            elevations_deg: Vec::new(),
            azimuth_offsets_deg: Vec::new(),
            fire_offsets_ns: Vec::new(),
            rings: Vec::new(),
            column_period_ns: 0.0,
            clockwise: false,
            origin_offset_m: 0.0,
            min_range_m: 0.0,
            range_m: 120.0,
            range_resolution_m: 0.0,
            attenuation_per_m: 0.004,
            dropoff_general_ratio: 0.0,
            dropoff_intensity_limit: 0.0,
            dropoff_zero_intensity_ratio: 0.0,
            noise_range_stddev_m: 0.0,
            noise_seed: 0,
            motion_distortion: false,
        }
    }
}

impl LidarSpec {
    /// Number of azimuths of a frame after a tick of `tick_secs`, which is rays per channel.
    pub fn columns_per_frame(&self, tick_secs: f64) -> u32 {
        match self.scan {
            LidarScan::Turn => self.columns,
            LidarScan::Sweep => {
                (self.points_per_second as f64 * tick_secs / self.channels as f64).round() as u32
            }
        }
    }

    /// Largest number of points of a frame after a tick of `tick_secs`.
    pub fn points_per_frame(&self, tick_secs: f64) -> u32 {
        self.channels
            .saturating_mul(self.columns_per_frame(tick_secs))
    }

    /// Elevation of a channel, radians; channel 0 is the highest.
    pub fn elevation_rad(&self, channel: u32) -> f64 {
        if let Some(elevation_deg) = of_channel(&self.elevations_deg, channel) {
            return elevation_deg.to_radians();
        }
        let steps = self.channels.saturating_sub(1).max(1) as f64;
        (self.upper_fov_deg - channel as f64 * (self.upper_fov_deg - self.lower_fov_deg) / steps)
            .to_radians()
    }

    /// Time from one column of a turn to the next, nanoseconds.
    pub fn column_nanos(&self) -> f64 {
        if self.column_period_ns > 0.0 {
            self.column_period_ns
        } else {
            1e9 / self.rate_hz / f64::from(self.columns.max(1))
        }
    }

    /// When a channel of a turn's column fires, nanoseconds from the turn's last firing: never
    /// positive.
    pub fn firing_nanos(&self, channel: u32, column: u32) -> f64 {
        let last = self.fire_offsets_ns.iter().copied().fold(0.0, f64::max);
        let offset = of_channel(&self.fire_offsets_ns, channel).unwrap_or(0.0);
        (f64::from(column) + 1.0 - f64::from(self.columns)) * self.column_nanos() + offset - last
    }

    /// By how much a channel of a turn looks aside from where its column begins, radians,
    /// counter-clockwise: its own offset, and what the head has turned when it fires.
    pub fn aside_rad(&self, channel: u32) -> f64 {
        let own_deg = of_channel(&self.azimuth_offsets_deg, channel).unwrap_or(0.0);
        let columns =
            of_channel(&self.fire_offsets_ns, channel).unwrap_or(0.0) / self.column_nanos();
        let turned_deg = columns * self.horizontal_fov_deg / f64::from(self.columns.max(1));
        let sign = if self.clockwise { -1.0 } else { 1.0 };
        (own_deg + sign * turned_deg).to_radians()
    }

    /// Number of a channel as the maker counts.
    pub fn ring(&self, channel: u32) -> u16 {
        of_channel(&self.rings, channel).unwrap_or(channel as u16)
    }

    /// Whether it has any property of a lidar as sold, which only the processor casts.
    pub fn is_as_sold(&self) -> bool {
        let plain = LidarSpec::default();
        let tables = [
            &self.elevations_deg,
            &self.azimuth_offsets_deg,
            &self.fire_offsets_ns,
        ];
        self.returns
            || self.clockwise
            || tables.iter().any(|table| !table.is_empty())
            || self.column_period_ns != plain.column_period_ns
            || self.origin_offset_m != plain.origin_offset_m
            || self.min_range_m != plain.min_range_m
            || self.range_resolution_m != plain.range_resolution_m
    }

    fn check_tables(&self, errors: &mut Vec<SpecError>) {
        let n = self.channels as usize;
        for (key, table, low, high) in [
            ("elevations_deg", &self.elevations_deg, -90.0, 90.0),
            (
                "azimuth_offsets_deg",
                &self.azimuth_offsets_deg,
                -180.0,
                180.0,
            ),
            ("fire_offsets_ns", &self.fire_offsets_ns, 0.0, 1e9),
        ] {
            let wrong = table.iter().find(|value| !(low..=high).contains(*value));
            if let Some(value) = wrong {
                let allowed = format!("its numbers are {low:?} to {high:?}");
                errors.push(SpecError {
                    key,
                    value: value.to_string(),
                    allowed,
                });
            }
            check_length(key, table.len(), n, errors);
        }
        if let Some(ring) = self.rings.iter().find(|ring| **ring >= MAX_CHANNELS as u16) {
            errors.push(SpecError {
                key: "rings",
                value: ring.to_string(),
                allowed: format!("its numbers are 0 to {}", MAX_CHANNELS - 1),
            });
        }
        check_length("rings", self.rings.len(), n, errors);
        check_range("column_period_ns", self.column_period_ns, 0.0, 1e9, errors);
        check_range("origin_offset_m", self.origin_offset_m, 0.0, 1.0, errors);
        check_range("min_range_m", self.min_range_m, 0.0, 10_000.0, errors);
        check_range(
            "range_resolution_m",
            self.range_resolution_m,
            0.0,
            1.0,
            errors,
        );
        if self.min_range_m > self.range_m {
            errors.push(SpecError {
                key: "min_range_m",
                value: self.min_range_m.to_string(),
                allowed: format!("must not lie beyond range_m {}", self.range_m),
            });
        }
    }

    /// What must fit together in a lidar as sold.
    fn check_firings(&self, errors: &mut Vec<SpecError>) {
        if self.returns && self.semantic {
            errors.push(SpecError {
                key: "returns",
                value: "true".into(),
                allowed: "semantic is true as well; one of them must be false".into(),
            });
        }
        if self.scan != LidarScan::Turn && self.is_as_sold() {
            errors.push(SpecError {
                key: "scan",
                value: "sweep".into(),
                allowed: "must be turn for a lidar with returns, tables of channels, a column period, a lever arm or steps of range".into(),
            });
        }
        let turn_ns = f64::from(self.columns) * self.column_nanos();
        let frame_ns = 1e9 / self.rate_hz;
        if turn_ns > frame_ns * (1.0 + 1e-9) {
            errors.push(SpecError {
                key: "column_period_ns",
                value: self.column_period_ns.to_string(),
                allowed: format!(
                    "must be at most {} for {} columns at {} Hz; lower columns or rate_hz",
                    frame_ns / f64::from(self.columns.max(1)),
                    self.columns,
                    self.rate_hz
                ),
            });
        }
        let last = self.fire_offsets_ns.iter().copied().fold(0.0, f64::max);
        if last > self.column_nanos() * (1.0 + 1e-9) {
            errors.push(SpecError {
                key: "fire_offsets_ns",
                value: last.to_string(),
                allowed: format!(
                    "must not exceed the time of a column, {} ns",
                    self.column_nanos()
                ),
            });
        }
        // The time of a firing is 32 bits of nanoseconds.
        if self.returns && turn_ns > 2e9 {
            errors.push(SpecError {
                key: "rate_hz",
                value: self.rate_hz.to_string(),
                allowed: "must be such that a turn with returns takes at most 2 s".into(),
            });
        }
    }

    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        self.check_tables(errors);
        self.check_firings(errors);
        check_range("channels", self.channels, 1, MAX_CHANNELS, errors);
        check_range("columns", self.columns, 1, 65_536, errors);
        check_range(
            "points_per_second",
            self.points_per_second,
            1,
            MAX_POINTS_PER_SECOND,
            errors,
        );
        check_range("rotation_hz", self.rotation_hz, 0.0, 1000.0, errors);
        check_range(
            "horizontal_fov_deg",
            self.horizontal_fov_deg,
            0.01,
            360.0,
            errors,
        );
        check_range("upper_fov_deg", self.upper_fov_deg, -90.0, 90.0, errors);
        check_range("lower_fov_deg", self.lower_fov_deg, -90.0, 90.0, errors);
        if self.lower_fov_deg > self.upper_fov_deg {
            errors.push(SpecError {
                key: "lower_fov_deg",
                value: self.lower_fov_deg.to_string(),
                allowed: format!("must not lie above upper_fov_deg {}", self.upper_fov_deg),
            });
        }
        check_range("range_m", self.range_m, 0.1, 10_000.0, errors);
        check_range(
            "attenuation_per_m",
            self.attenuation_per_m,
            0.0,
            10.0,
            errors,
        );
        check_range(
            "dropoff_general_ratio",
            self.dropoff_general_ratio,
            0.0,
            1.0,
            errors,
        );
        check_range(
            "dropoff_intensity_limit",
            self.dropoff_intensity_limit,
            0.0,
            1.0,
            errors,
        );
        check_range(
            "dropoff_zero_intensity_ratio",
            self.dropoff_zero_intensity_ratio,
            0.0,
            1.0,
            errors,
        );
        check_range(
            "noise_range_stddev_m",
            self.noise_range_stddev_m,
            0.0,
            100.0,
            errors,
        );
    }
}

/// The number of a channel in a table that may be shorter and repeats; `None` of an empty one.
fn of_channel<T: Copy>(table: &[T], channel: u32) -> Option<T> {
    table.get(channel as usize % table.len().max(1)).copied()
}

/// A table has as many numbers as there are channels, or repeats a whole number of times.
fn check_length(
    key: &'static str,
    n_numbers: usize,
    n_channels: usize,
    errors: &mut Vec<SpecError>,
) {
    if n_numbers > 0 && !n_channels.is_multiple_of(n_numbers) {
        errors.push(SpecError {
            key,
            value: format!("a list of {n_numbers}"),
            allowed: format!("must have as many numbers as channels {n_channels} or a divisor"),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn firings_end_at_zero_and_turn_the_head() {
        let spec = LidarSpec {
            channels: 2,
            columns: 1800,
            column_period_ns: 55_296.0,
            fire_offsets_ns: vec![0.0, 27_648.0],
            azimuth_offsets_deg: vec![1.0],
            clockwise: true,
            ..LidarSpec::default()
        };
        assert_eq!(spec.firing_nanos(1, 1799), 0.0);
        assert_eq!(spec.firing_nanos(0, 1798), -(27_648.0 + 55_296.0));
        // Half a column of 0.2 degrees, clockwise.
        assert!((spec.aside_rad(1).to_degrees() - 0.9).abs() < 1e-12);
        assert!((spec.aside_rad(0).to_degrees() - 1.0).abs() < 1e-12);
        assert!(spec.is_as_sold() && !LidarSpec::default().is_as_sold());
    }

    #[test]
    fn tables_that_do_not_fit_are_refused_with_what_is_allowed() {
        let spec = LidarSpec {
            channels: 4,
            columns: 2000,
            elevations_deg: vec![1.0, 2.0, 91.0],
            rings: vec![300],
            column_period_ns: 60_000.0,
            fire_offsets_ns: vec![70_000.0],
            returns: true,
            semantic: true,
            scan: LidarScan::Sweep,
            ..LidarSpec::default()
        };
        let mut errors = Vec::new();
        spec.check(&mut errors);
        let text: Vec<String> = errors.iter().map(ToString::to_string).collect();
        for wanted in [
            "elevations_deg is 91, but its numbers are -90.0 to 90.0",
            "elevations_deg is a list of 3, but must have as many numbers as channels 4 or a divisor",
            "rings is 300, but its numbers are 0 to 255",
            "column_period_ns is 60000, but must be at most 50000 for 2000 columns at 10 Hz; lower columns or rate_hz",
            "fire_offsets_ns is 70000, but must not exceed the time of a column, 60000 ns",
            "returns is true, but semantic is true as well; one of them must be false",
        ] {
            assert!(text.iter().any(|it| it == wanted), "{wanted}\n{text:#?}");
        }
        assert!(text.iter().any(|it| it.starts_with("scan is sweep")));
    }
}
