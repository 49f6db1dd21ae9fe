//! Cooperative awareness messages (CAM): when a station sends one, and its bytes.
//!
//! Fields and units follow ETSI EN 302 637-2 and TS 102 894-2; the record is the structure that the
//! 0.9.16 client reads.

use schema_frames::{ActorInfo, ActorRecord};
use schema_types::Class;

use crate::v2x::noise::Noise;
use crate::wire::axes;
use crate::wire::description::Attributes;
use crate::wire::fields::Wrong;
use crate::wire::geolocation::locate_deg;

/// Bytes of a message, including the received power in front.
pub const RECORD_BYTES: usize = 464;
/// Shortest interval of the low-frequency container.
const SLOW_NANOS: u64 = 500_000_000;
/// Interval of road-side units.
const ROADSIDE_NANOS: u64 = 500_000_000;
/// After this many messages without a change the longest interval applies again.
const MAX_QUIET: u32 = 3;
const TURN_RAD: f64 = 4.0 * std::f64::consts::PI / 180.0;
const MOVE_M: f64 = 4.0;
const SPEED_UP_MPS: f64 = 0.5;

const ROADSIDE: i64 = 15;
const PEDESTRIAN: i64 = 1;

/// The message service of one station.
#[derive(Clone, Debug)]
pub struct Service {
    min_nanos: u64,
    max_nanos: u64,
    fixed_rate: bool,
    interval_nanos: u64,
    n_quiet: u32,
    sent: Option<Sent>,
    slow_nanos: Option<u64>,
    errors: Errors,
}

/// What the last message contained.
#[derive(Clone, Copy, Debug)]
struct Sent {
    nanos: u64,
    position_m: [f64; 3],
    heading_rad: f64,
    speed_mps: f64,
}

/// Standard deviations and biases that are added to what is sent.
#[derive(Clone, Debug)]
struct Errors {
    accel_mps2: [f64; 3],
    speed_mps: f64,
    yaw_rate: [f64; 2],
    latitude_deg: [f64; 2],
    longitude_deg: [f64; 2],
    altitude_m: [f64; 2],
    heading_deg: [f64; 2],
}

/// The sender at a tick.
#[derive(Clone, Copy, Debug)]
pub struct Sender<'a> {
    /// Its record in the newest snapshot.
    pub record: &'a ActorRecord,
    /// Its entry in the list of actors.
    pub info: Option<&'a ActorInfo>,
    /// Nanoseconds since the episode began.
    pub nanos: u64,
    /// Latitude and longitude of the map's origin.
    pub geo_reference_deg: [f64; 2],
}

impl Service {
    /// Reads a station's attributes.
    ///
    /// # Errors
    /// If the intervals are impossible.
    pub fn of(given: &Attributes<'_>) -> Result<Service, Wrong> {
        let (min_secs, max_secs) = (
            given.float("gen_cam_min", 0.1),
            given.float("gen_cam_max", 1.0),
        );
        if !(0.0..=1e6).contains(&min_secs) || !(min_secs..=1e6).contains(&max_secs) {
            return Err(Wrong::Value(format!(
                "gen_cam_min is {min_secs} s and gen_cam_max {max_secs} s; give 0 ≤ gen_cam_min ≤ gen_cam_max ≤ 1000000"
            )));
        }
        let nanos = |secs: f64| (secs * 1e9).round() as u64;
        let both = |name: &str| {
            [
                given.float(&format!("noise_{name}_stddev"), 0.0),
                given.float(&format!("noise_{name}_bias"), 0.0),
            ]
        };
        Ok(Service {
            min_nanos: nanos(min_secs),
            max_nanos: nanos(max_secs),
            fixed_rate: given.bool("fixed_rate", false),
            interval_nanos: nanos(max_secs),
            n_quiet: 0,
            sent: None,
            slow_nanos: None,
            errors: Errors {
                accel_mps2: ["x", "y", "z"]
                    .map(|axis| given.float(&format!("noise_accel_stddev_{axis}"), 0.0)),
                speed_mps: given.float("noise_vel_stddev_x", 0.0),
                yaw_rate: both("yawrate"),
                latitude_deg: both("lat"),
                longitude_deg: both("lon"),
                altitude_m: both("alt"),
                heading_deg: both("head"),
            },
        })
    }

    /// The message that the station sends at this tick, if one is due; its power field stays 0.
    pub fn message(
        &mut self,
        sender: &Sender<'_>,
        noise: &mut Noise,
    ) -> Option<[u8; RECORD_BYTES]> {
        let now = Sent {
            nanos: sender.nanos,
            position_m: sender.record.world_from_actor.translation_m,
            heading_rad: sender.record.world_from_actor.yaw_rad(),
            speed_mps: forward_mps(sender.record),
        };
        if !self.is_due(&now, station_type(sender) == ROADSIDE) {
            return None;
        }
        self.sent = Some(now);
        Some(self.encode(sender, noise))
    }

    fn is_due(&mut self, now: &Sent, is_roadside: bool) -> bool {
        let Some(before) = self.sent else { return true };
        let elapsed_nanos = now.nanos.saturating_sub(before.nanos);
        if is_roadside {
            return elapsed_nanos >= ROADSIDE_NANOS;
        }
        if elapsed_nanos < self.min_nanos {
            return false;
        }
        let moved_m = (0..3)
            .map(|i| (now.position_m[i] - before.position_m[i]).powi(2))
            .sum::<f64>()
            .sqrt();
        let turned_rad = (now.heading_rad - before.heading_rad + std::f64::consts::PI)
            .rem_euclid(std::f64::consts::TAU)
            - std::f64::consts::PI;
        let has_changed = moved_m > MOVE_M
            || turned_rad.abs() > TURN_RAD
            || (now.speed_mps - before.speed_mps).abs() > SPEED_UP_MPS;
        if self.fixed_rate {
            return true;
        }
        if has_changed {
            (self.interval_nanos, self.n_quiet) = (elapsed_nanos.min(self.max_nanos), 0);
            return true;
        }
        if elapsed_nanos < self.interval_nanos {
            return false;
        }
        self.n_quiet += 1;
        if self.n_quiet >= MAX_QUIET {
            self.interval_nanos = self.max_nanos;
        }
        true
    }

    fn encode(&mut self, sender: &Sender<'_>, noise: &mut Noise) -> [u8; RECORD_BYTES] {
        let mut record = Record([0; RECORD_BYTES]);
        let station = station_type(sender);
        record.header(2, sender.record.id);
        // Milliseconds, as a 16-bit counter.
        record.put(32, (sender.nanos / 1_000_000 % 65_536) as i64);
        record.put(40, station);
        self.put_position(&mut record, sender, noise);
        if station == ROADSIDE {
            // The road-side unit's container, without protected zones.
            record.put(104, 2);
        }
        if sender.record.vehicle().is_some() {
            self.put_motion(&mut record, sender.record, noise);
            let is_slow_due = self
                .slow_nanos
                .is_none_or(|last| sender.nanos.saturating_sub(last) >= SLOW_NANOS);
            if is_slow_due {
                self.slow_nanos = Some(sender.nanos);
                put_slow(&mut record, sender, station);
            }
        }
        record.0
    }

    fn put_position(&self, record: &mut Record, sender: &Sender<'_>, noise: &mut Noise) {
        const UNKNOWN_AXIS: i64 = 4095;
        let [x, y, z] = sender.record.world_from_actor.translation_m;
        // As in the client's own projection, whose y axis points south.
        let [latitude, longitude] = locate_deg(x, -y, sender.geo_reference_deg);
        let [latitude, longitude] = [
            noise.with(latitude, self.errors.latitude_deg),
            noise.with(longitude, self.errors.longitude_deg),
        ];
        let altitude_m = noise.with(z, self.errors.altitude_m);
        for (at, value) in [
            (48, 10 * (latitude * 1e6).round() as i64),
            (56, 10 * (longitude * 1e6).round() as i64),
            (64, UNKNOWN_AXIS),
            (72, UNKNOWN_AXIS),
            (80, 3601),
            (88, (altitude_m * 100.0).round() as i64),
            (96, 15),
        ] {
            record.put(at, value);
        }
    }

    fn put_motion(&self, record: &mut Record, actor: &ActorRecord, noise: &mut Noise) {
        const UNKNOWN: i64 = 102;
        // The heading counts clockwise from north; CARLA's yaw counts clockwise from east.
        let heading_deg = noise
            .with(
                axes::transform(&actor.world_from_actor).rotation_deg[1] + 90.0,
                self.errors.heading_deg,
            )
            .rem_euclid(360.0);
        let speed_mps = noise
            .with(forward_mps(actor).abs(), [self.errors.speed_mps, 0.0])
            .max(0.0);
        let turning_deg = noise
            .with(
                actor.angular_velocity_in_world_radps[2],
                self.errors.yaw_rate,
            )
            .to_degrees();
        let acceleration = nalgebra::Vector3::from(actor.acceleration_in_world_mps2);
        let along = actor.world_from_actor.isometry().rotation.inverse() * acceleration;
        let decimetres = |i: usize, noise: &mut Noise| {
            let value = (noise.with(along[i], [self.errors.accel_mps2[i], 0.0]) * 10.0).round();
            if value.abs() <= 160.0 {
                value as i64
            } else {
                161
            }
        };
        let [ahead, left, up] = [
            decimetres(0, noise),
            decimetres(1, noise),
            decimetres(2, noise),
        ];
        let size =
            |half_m: f32, most: i64| ((f64::from(half_m) * 20.0).round() as i64).clamp(1, most);
        let yaw_rate = (turning_deg * 100.0).round();
        for (at, value) in [
            (104, 1),
            (112, (heading_deg * 10.0).round() as i64 % 3600),
            (120, 10),
            (
                128,
                if speed_mps >= 163.82 {
                    16_382
                } else {
                    (speed_mps * 100.0).round() as i64
                },
            ),
            (136, 3),
            (144, i64::from(forward_mps(actor) < 0.0)),
            (152, size(actor.half_box_m[0], 1022)),
            (160, 4),
            (168, size(actor.half_box_m[1], 61)),
            (176, ahead),
            (184, UNKNOWN),
            (192, 30_001),
            (200, 7),
            (208, 0),
            (
                216,
                if yaw_rate.abs() <= 32_766.0 {
                    yaw_rate as i64
                } else {
                    32_767
                },
            ),
            (224, 8),
            (272, 1),
            (280, left),
            (288, UNKNOWN),
            (296, 1),
            (304, up),
            (312, UNKNOWN),
        ] {
            record.put(at, value);
        }
    }
}

/// Writes the low-frequency container: role and lamps.
fn put_slow(record: &mut Record, sender: &Sender<'_>, station: i64) {
    let role = match station {
        6 => 1,
        10 => 6,
        _ => 0,
    };
    let lamps = sender.record.vehicle().map_or(0, |part| part.lamps);
    // Pairs of the standard's bit (counted from the left) and the bit of `VehicleLightState`.
    let bits = [(0, 1), (1, 2), (2, 5), (3, 4), (5, 6), (6, 7), (7, 0)];
    let shown = bits
        .iter()
        .filter(|(_, lamp)| lamps >> lamp & 1 != 0)
        .fold(0, |shown, (bit, _)| shown | 0x80u8 >> bit);
    record.put(408, 1);
    record.put(416, role);
    record.0[424] = shown;
}

/// The standard's type of a station: pedestrian, or a type of vehicle by class and special type;
/// every other carrier is a road-side unit.
fn station_type(sender: &Sender<'_>) -> i64 {
    if sender.record.walker().is_some() {
        return PEDESTRIAN;
    }
    if sender.record.vehicle().is_none() {
        return ROADSIDE;
    }
    let is_emergency = sender
        .info
        .and_then(|info| info.attributes.get("special_type"))
        .is_some_and(|special| special == "emergency");
    match Class(sender.record.class) {
        _ if is_emergency => 10,
        Class::BICYCLE => 2,
        Class::MOTORCYCLE => 4,
        Class::CAR => 5,
        Class::BUS => 6,
        Class::TRUCK => 7,
        Class::TRAIN => 11,
        _ => 0,
    }
}

/// Speed along the nose, m/s; negative backwards.
fn forward_mps(record: &ActorRecord) -> f64 {
    let nose = record.world_from_actor.isometry() * nalgebra::Vector3::x();
    nose.dot(&nalgebra::Vector3::from(record.velocity_in_world_mps))
}

/// The client's message structure, as bytes.
pub struct Record<const N: usize = RECORD_BYTES>(pub [u8; N]);

impl<const N: usize> Record<N> {
    /// Writes a 64-bit field.
    pub fn put(&mut self, at: usize, value: i64) {
        self.0[at..at + 8].copy_from_slice(&value.to_le_bytes());
    }

    /// Writes the header: protocol version, kind of message, station.
    pub fn header(&mut self, kind: i64, station: u32) {
        self.put(8, 1);
        self.put(16, kind);
        self.put(24, i64::from(station));
    }
}
