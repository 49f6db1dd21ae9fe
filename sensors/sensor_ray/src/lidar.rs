//! Spinning lidar, plain and semantic: one full turn per frame, ending at the tick, or CARLA's sweep of one tick.
//!
//! Columns of a turn run counter-clockwise from above, column `i` at azimuth −π + 2π·(i + 1)/columns, so that the last one looks straight
//! back at the very tick; a narrower field of view is spread the same way about the front. Columns of a sweep run clockwise, as CARLA's
//! head turns, from where it stood after the previous firing: of `h` the width of the turn, column `i` looks at h/2 − mod(was + step·i, h).
//! Points come channel after channel, channel 0 on top, azimuth rising within each; rays without a return leave no gap.
//! Losses are CARLA's, in CARLA's order: general drop-off, range noise, intensity exp(−a·d), drop-off by intensity.
//! Bytes depend on scene, spec, path and noise key alone, not on the number of threads.

use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;
use schema_frames::{LidarPoint, SemanticLidarPoint};
use schema_types::ActorId;
use schema_types::noise::Noise;
use sensor_core::vector::{VectorWork, vectorised};
use sensor_spec::{LidarScan, LidarSpec};

use crate::scene::{Hit, RayScene, Rays, Stacks};

/// Channels of a packet.
const PACKET_CHANNELS: usize = 1;
/// Columns of a packet: neighbours side by side. CPU ms per turn in `examples/turn_bench.rs` (channels × columns):
/// 1×1 92, 1×8 43, 2×4 44, 2×8 43, 4×4 48, 4×8 47, 8×4 53.
const PACKET_COLUMNS: usize = 8;
const LANES: usize = PACKET_CHANNELS * PACKET_COLUMNS;

/// Channel number of a ray without a return; real ones are below 256.
const LOST: u16 = u16::MAX;

/// Where the sensor was during the turn.
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
        SensorPath { world_from_sensor_start: world_from_sensor, world_from_sensor }
    }
}

/// Points of a turn, a row per channel, returns at the front of each row.
#[derive(Debug)]
enum Rows {
    Plain(Vec<LidarPoint>),
    Semantic(Vec<SemanticLidarPoint>),
}

/// One lidar: beam tables and the memory of its last turn.
#[derive(Debug)]
pub struct Lidar {
    spec: LidarSpec,
    /// The specification's own, without weather.
    clear_attenuation_per_m: f64,
    /// Cosine and sine of each channel's elevation.
    elevations: Vec<(f64, f64)>,
    /// Cosine and sine of each column's azimuth.
    azimuths: Vec<(f64, f64)>,
    /// Time that the head has swept, all firings together (scan `sweep`).
    swept_nanos: u64,
    rows: Rows,
    /// Returns per channel in the last turn.
    n_returns: Vec<u32>,
}

impl Lidar {
    /// A lidar after a spec that passed its check.
    pub fn new(spec: LidarSpec) -> Self {
        let mut lidar = Lidar {
            elevations: (0..spec.channels).map(|channel| cos_sin(spec.elevation_rad(channel))).collect(),
            azimuths: Vec::new(),
            swept_nanos: 0,
            rows: match spec.semantic {
                false => Rows::Plain(Vec::new()),
                true => Rows::Semantic(Vec::new()),
            },
            n_returns: vec![0; spec.channels as usize],
            clear_attenuation_per_m: spec.attenuation_per_m,
            spec,
        };
        if lidar.spec.scan == LidarScan::Turn {
            lidar.set_azimuths((0..lidar.spec.columns).map(|column| azimuth_rad(&lidar.spec, column)).collect());
        }
        lidar
    }

    /// What the air takes of the light, 1/m, on its way there and again on its way back; added to the specification's own attenuation.
    pub fn set_extinction(&mut self, extinction_per_m: f64) {
        self.spec.attenuation_per_m = self.clear_attenuation_per_m + 2.0 * extinction_per_m;
    }

    /// Turns the head as far as it gets in a tick of `tick_nanos`. Call it at every firing, read or not.
    ///
    /// At most `max_points` rays are aimed, whatever the length of the tick. Without effect on a lidar of full turns.
    pub fn turn_head(&mut self, tick_nanos: u64, max_points: u32) {
        if self.spec.scan == LidarScan::Turn {
            return;
        }
        let fov_deg = self.spec.horizontal_fov_deg;
        let was_deg = self.turned_deg();
        self.swept_nanos += tick_nanos;
        let tick_secs = tick_nanos as f64 * 1e-9;
        let n_columns = self.spec.columns_per_frame(tick_secs).min(max_points / self.spec.channels.max(1));
        let step_deg = self.spec.rotation_hz * fov_deg * tick_secs / n_columns.max(1) as f64;
        let azimuth = |column: u32| (0.5 * fov_deg - (was_deg + step_deg * column as f64) % fov_deg).to_radians();
        self.set_azimuths((0..n_columns).map(azimuth).collect());
    }

    /// Azimuth of the head at the end of the frame, radians counter-clockwise from x.
    pub fn head_rad(&self) -> f64 {
        match self.spec.scan {
            LidarScan::Turn => 0.5 * self.spec.horizontal_fov_deg.to_radians(),
            LidarScan::Sweep => (0.5 * self.spec.horizontal_fov_deg - self.turned_deg()).to_radians(),
        }
    }

    /// Begins anew: the head as when it was made.
    pub fn reset(&mut self) {
        self.swept_nanos = 0;
    }

    /// How far the head has turned clockwise from the left rim of its field of view, degrees, less whole turns.
    fn turned_deg(&self) -> f64 {
        self.spec.horizontal_fov_deg * (self.spec.rotation_hz * self.swept_nanos as f64 * 1e-9).fract()
    }

    fn set_azimuths(&mut self, azimuths_rad: Vec<f64>) {
        self.azimuths = azimuths_rad.into_iter().map(cos_sin).collect();
        let n_points = self.spec.channels as usize * self.azimuths.len();
        match &mut self.rows {
            Rows::Plain(points) => points.resize(n_points, bytemuck::Zeroable::zeroed()),
            Rows::Semantic(points) => points.resize(n_points, bytemuck::Zeroable::zeroed()),
        }
    }

    /// The spec it was made after.
    pub fn spec(&self) -> &LidarSpec {
        &self.spec
    }

    /// Casts one frame on the current rayon pool and returns the number of points, which [`Lidar::write`] then puts into a frame.
    ///
    /// `noise` is the key (seed, sensor, tick); rays pass through the parts of `ignored` (CARLA's lidar sees its own car: `None`).
    pub fn scan(&mut self, scene: &RayScene, path: &SensorPath, noise: Noise, ignored: Option<ActorId>) -> u32 {
        if self.azimuths.is_empty() {
            self.n_returns.fill(0);
            return 0;
        }
        let turn = Turn {
            scene,
            spec: &self.spec,
            elevations: &self.elevations,
            azimuths: &self.azimuths,
            poses: column_poses(&self.spec, path, self.azimuths.len()),
            noise,
            ignored,
        };
        match &mut self.rows {
            Rows::Plain(points) => turn.cast_rows(points, &mut self.n_returns),
            Rows::Semantic(points) => turn.cast_rows(points, &mut self.n_returns),
        }
        self.n_points()
    }

    /// Points of the last turn.
    pub fn n_points(&self) -> u32 {
        self.n_returns.iter().sum()
    }

    /// Returns per channel in the last turn.
    pub fn n_returns(&self) -> &[u32] {
        &self.n_returns
    }

    /// Bytes that [`Lidar::write`] will write.
    pub fn payload_bytes(&self) -> usize {
        self.channel_bytes().map(<[u8]>::len).sum()
    }

    /// Writes the points of the last turn to the front of a frame and returns how many bytes that took.
    ///
    /// Panics if `payload` is shorter than [`Lidar::payload_bytes`].
    pub fn write(&self, payload: &mut [u8]) -> usize {
        let mut at = 0;
        for bytes in self.channel_bytes() {
            payload[at..at + bytes.len()].copy_from_slice(bytes);
            at += bytes.len();
        }
        at
    }

    fn channel_bytes(&self) -> impl Iterator<Item = &[u8]> {
        let n_columns = self.azimuths.len();
        self.n_returns.iter().enumerate().map(move |(channel, n)| {
            let row = channel * n_columns..channel * n_columns + *n as usize;
            match &self.rows {
                Rows::Plain(points) => bytemuck::cast_slice(&points[row]),
                Rows::Semantic(points) => bytemuck::cast_slice(&points[row]),
            }
        })
    }
}

fn cos_sin(angle_rad: f64) -> (f64, f64) {
    (angle_rad.cos(), angle_rad.sin())
}

/// Azimuth of a column of a full turn, radians counter-clockwise from x.
pub fn azimuth_rad(spec: &LidarSpec, column: u32) -> f64 {
    0.5 * spec.horizontal_fov_deg.to_radians() * (2.0 * (column + 1) as f64 / spec.columns as f64 - 1.0)
}

/// Pose of the sensor at each column, or a single one for all.
fn column_poses(spec: &LidarSpec, path: &SensorPath, n_columns: usize) -> Vec<Isometry3<f64>> {
    if !spec.motion_distortion {
        return vec![path.world_from_sensor];
    }
    let (start, end) = (&path.world_from_sensor_start, &path.world_from_sensor);
    let pose = |column: usize| {
        let share = (column + 1) as f64 / n_columns as f64;
        start.try_lerp_slerp(end, share, 1e-9).unwrap_or(*end)
    };
    (0..n_columns).map(pose).collect()
}

/// A point format: how a return becomes one.
trait Point: Copy + Send {
    const LOSES_RAYS: bool;
    /// Whether class, object and incidence matter.
    const NEEDS_SURFACE: bool;
    fn lost() -> Self;
    fn is_lost(&self) -> bool;
    /// The point of a return, or a lost one. `ray` is its number in the turn, for noise.
    fn of(hit: &Hit, beam: &Beam, spec: &LidarSpec, noise: Noise) -> Self;
}

/// One ray of the turn.
struct Beam {
    ray: u64,
    channel: u16,
    direction_in_sensor: Vector3<f64>,
    direction_in_world: Vector3<f64>,
}

impl Beam {
    /// The point `distance_m` along the beam in the sensor's space.
    fn at(&self, distance_m: f64) -> [f32; 3] {
        (self.direction_in_sensor * distance_m).cast::<f32>().into()
    }
}

impl Point for LidarPoint {
    const LOSES_RAYS: bool = true;
    const NEEDS_SURFACE: bool = false;

    fn lost() -> Self {
        LidarPoint { hit_in_sensor_m: [0.0; 3], intensity: 0, channel: LOST }
    }

    fn is_lost(&self) -> bool {
        self.channel == LOST
    }

    fn of(hit: &Hit, beam: &Beam, spec: &LidarSpec, noise: Noise) -> Self {
        let mut distance_m = hit.distance_m;
        if spec.noise_range_stddev_m > 0.0 {
            distance_m = (distance_m + spec.noise_range_stddev_m * noise.gaussian(beam.ray)).max(0.0);
        }
        let intensity = (-spec.attenuation_per_m * distance_m).exp();
        if intensity < keep_limit(spec) && noise.uniform(2 * beam.ray + 1) >= keep_ratio(spec, intensity) {
            return Self::lost();
        }
        LidarPoint { hit_in_sensor_m: beam.at(distance_m), intensity: (intensity * 65535.0).round() as u16, channel: beam.channel }
    }
}

/// Intensity from which on every return is kept.
fn keep_limit(spec: &LidarSpec) -> f64 {
    if spec.dropoff_zero_intensity_ratio > 0.0 { spec.dropoff_intensity_limit } else { 0.0 }
}

/// Share of returns kept at an intensity below the limit: from 1 − zero at 0 up to 1 at the limit.
fn keep_ratio(spec: &LidarSpec, intensity: f64) -> f64 {
    1.0 - spec.dropoff_zero_intensity_ratio * (1.0 - intensity / spec.dropoff_intensity_limit)
}

impl Point for SemanticLidarPoint {
    const LOSES_RAYS: bool = false;
    const NEEDS_SURFACE: bool = true;

    fn lost() -> Self {
        SemanticLidarPoint { channel: LOST, ..bytemuck::Zeroable::zeroed() }
    }

    fn is_lost(&self) -> bool {
        self.channel == LOST
    }

    fn of(hit: &Hit, beam: &Beam, _: &LidarSpec, _: Noise) -> Self {
        SemanticLidarPoint {
            hit_in_sensor_m: beam.at(hit.distance_m),
            cos_incidence: hit.cos_incidence(&beam.direction_in_world) as f32,
            object_id: hit.object.0,
            class: hit.class.0,
            reserved: 0,
            channel: beam.channel,
        }
    }
}

/// Everything the rays of a turn share.
struct Turn<'a> {
    scene: &'a RayScene,
    spec: &'a LidarSpec,
    elevations: &'a [(f64, f64)],
    azimuths: &'a [(f64, f64)],
    poses: Vec<Isometry3<f64>>,
    noise: Noise,
    ignored: Option<ActorId>,
}

impl Turn<'_> {
    /// Casts all rays, a band of channels per task, and moves each row's returns to its front.
    fn cast_rows<P: Point>(&self, points: &mut [P], n_returns: &mut [u32]) {
        let n_columns = self.azimuths.len();
        let bands = points.par_chunks_mut(PACKET_CHANNELS * n_columns).zip(n_returns.par_chunks_mut(PACKET_CHANNELS));
        bands.enumerate().for_each_init(Stacks::default, |stacks, (band, (rows, n_returns))| {
            vectorised(Band { turn: self, first_channel: band * PACKET_CHANNELS, rows, stacks });
            for (row, n) in rows.chunks_mut(n_columns).zip(n_returns) {
                *n = compact(row);
            }
        });
    }

    /// Casts a block of `PACKET_CHANNELS` × `PACKET_COLUMNS` rays into the band's rows.
    #[inline(always)]
    fn cast_packet<P: Point>(&self, first_channel: usize, first_column: usize, rows: &mut [P], stacks: &mut Stacks) {
        let n_columns = self.azimuths.len();
        let beams: [Option<Beam>; LANES] = std::array::from_fn(|lane| {
            let (channel, column) = (first_channel + lane / PACKET_COLUMNS, first_column + lane % PACKET_COLUMNS);
            (channel < self.elevations.len() && column < n_columns).then(|| self.beam(channel, column))
        });
        let fires = |beam: &Beam| {
            !(P::LOSES_RAYS && self.spec.dropoff_general_ratio > 0.0 && self.noise.uniform(2 * beam.ray) < self.spec.dropoff_general_ratio)
        };
        let rays = Rays::<LANES> {
            origins_m: std::array::from_fn(|lane| {
                self.pose((first_column + lane % PACKET_COLUMNS).min(n_columns - 1)).translation.vector.into()
            }),
            directions: std::array::from_fn(|lane| beams[lane].as_ref().map_or(Vector3::x(), |beam| beam.direction_in_world)),
            active: std::array::from_fn(|lane| beams[lane].as_ref().is_some_and(fires)),
            max_m: self.spec.range_m,
        };
        let hits = match P::NEEDS_SURFACE {
            true => self.scene.cast_packet::<LANES, true>(&rays, self.ignored, stacks),
            false => self.scene.cast_packet::<LANES, false>(&rays, self.ignored, stacks),
        };
        for (lane, (beam, hit)) in beams.iter().zip(&hits).enumerate() {
            if let Some(beam) = beam {
                let at = lane / PACKET_COLUMNS * n_columns + first_column + lane % PACKET_COLUMNS;
                rows[at] = hit.as_ref().map_or(P::lost(), |hit| P::of(hit, beam, self.spec, self.noise));
            }
        }
    }

    #[inline(always)]
    fn beam(&self, channel: usize, column: usize) -> Beam {
        let ((cos_e, sin_e), (cos_a, sin_a)) = (self.elevations[channel], self.azimuths[column]);
        let direction_in_sensor = Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e);
        Beam {
            ray: (channel * self.azimuths.len() + column) as u64,
            channel: channel as u16,
            direction_in_world: self.pose(column).rotation * direction_in_sensor,
            direction_in_sensor,
        }
    }

    #[inline(always)]
    fn pose(&self, column: usize) -> &Isometry3<f64> {
        if self.poses.len() == 1 { &self.poses[0] } else { &self.poses[column] }
    }
}

/// The rays of a few neighbouring channels.
struct Band<'b, P> {
    turn: &'b Turn<'b>,
    first_channel: usize,
    rows: &'b mut [P],
    stacks: &'b mut Stacks,
}

impl<P: Point> VectorWork for Band<'_, P> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        let Band { turn, first_channel, rows, stacks } = self;
        for column in (0..turn.azimuths.len()).step_by(PACKET_COLUMNS) {
            turn.cast_packet(first_channel, column, rows, stacks);
        }
    }
}

/// Moves the returns of a row to its front, in order, and counts them.
fn compact<P: Point>(row: &mut [P]) -> u32 {
    let mut n = 0;
    for i in 0..row.len() {
        if !row[i].is_lost() {
            row[n] = row[i];
            n += 1;
        }
    }
    n as u32
}
