//! Spinning lidar, plain and semantic: a frame holds one full turn that ends at the tick, or the
//! sweep of one tick as in CARLA.
//!
//! Columns of a turn run counter-clockwise seen from above. Column `i` looks at azimuth
//! `−π + 2π·(i + 1)/columns`, so the last one looks straight back at the time of the tick; a
//! narrower field of view is spread in the same way about the front. Columns of a sweep run
//! clockwise, as CARLA's head turns, from where the head stood after the previous firing: with `h`
//! the width of the turn, column `i` looks at `h/2 − mod(was + step·i, h)`.
//!
//! A lidar as sold looks along tables of its own: elevation, azimuth offset and time of firing of each
//! channel. It may turn clockwise, and its beams may begin beside the head's axis.
//!
//! Points come channel after channel, channel 0 on top, in the order of columns within each; rays
//! without a return leave no gap. Losses are CARLA's, in CARLA's order: general drop-off, range
//! noise, intensity exp(−a·d), drop-off by intensity. The bytes depend on scene, spec, path and
//! noise key alone, not on the number of threads.
//!
//! With motion distortion a ray also has a time of its own: what moves is met where it was then,
//! between its poses at the ticks before and after.

use schema_frames::{LidarPoint, LidarReturn, SemanticLidarPoint};
use schema_types::ActorId;
use schema_types::noise::Noise;
use sensor_spec::{LidarScan, LidarSpec};

use crate::ray_scene::RayScene;
use beams::Beams;
use points::Point;
use turn::Turn;

mod beams;
mod path;
mod points;
mod turn;

pub use beams::azimuth_rad;
pub use path::SensorPath;
pub(crate) use path::{Times, column_poses};
pub(crate) use points::keep_limit;

/// Points of the last frame, bunch after bunch, lost ones included.
#[derive(Debug)]
enum Points {
    Plain(Vec<LidarPoint>),
    Semantic(Vec<SemanticLidarPoint>),
    Returns(Vec<LidarReturn>),
}

/// One lidar: its beams and the points of its last frame.
#[derive(Debug)]
pub struct Lidar {
    spec: LidarSpec,
    /// Attenuation in clear air: the specification's own.
    clear_attenuation_per_m: f64,
    beams: Beams,
    /// Azimuths of the next frame, if the beams were not yet built for them.
    turned_to_rad: Option<Vec<f64>>,
    /// Time for which the head has turned since it was made or reset (scan `sweep`).
    swept_nanos: u64,
    /// Time from the frame before to the next one; 0 is that of the specification's rate.
    window_nanos: u64,
    /// Time from the beginning of the next frame's path to the tick; 0 without motion.
    past_nanos: u64,
    points: Points,
    /// Returns per channel in the last frame.
    n_returns: Vec<u32>,
}

impl Lidar {
    /// A lidar; `spec` must have passed its check.
    pub fn new(spec: LidarSpec) -> Self {
        let mut lidar = Lidar {
            beams: Beams::new(&spec, std::iter::empty()),
            turned_to_rad: None,
            swept_nanos: 0,
            window_nanos: 0,
            past_nanos: 0,
            points: match (spec.returns, spec.semantic) {
                (true, _) => Points::Returns(Vec::new()),
                (false, false) => Points::Plain(Vec::new()),
                (false, true) => Points::Semantic(Vec::new()),
            },
            n_returns: vec![0; spec.channels as usize],
            clear_attenuation_per_m: spec.attenuation_per_m,
            spec,
        };
        if lidar.spec.scan == LidarScan::Turn {
            lidar.turned_to_rad = Some(
                (0..lidar.spec.columns)
                    .map(|column| azimuth_rad(&lidar.spec, column))
                    .collect(),
            );
        }
        lidar
    }

    /// Sets the extinction of the air, 1/m. It acts on the way there and on the way back, so twice
    /// its value is added to the specification's attenuation.
    pub fn set_extinction(&mut self, extinction_per_m: f64) {
        self.spec.attenuation_per_m = self.clear_attenuation_per_m + 2.0 * extinction_per_m;
    }

    /// Sets the time between the two poses of the next frame's path, nanoseconds: a lidar as sold turns
    /// by its own clock within it.
    pub fn set_window(&mut self, nanos: u64) {
        self.window_nanos = nanos;
    }

    /// Sets how long before the tick the next frame's path begins, nanoseconds. With motion distortion
    /// its rays then see what moves where it was when they were fired, as far as the scene knows
    /// ([`RayScene::update_moving`]); with 0 they see everything as it is at the tick.
    pub fn set_past(&mut self, nanos: u64) {
        self.past_nanos = nanos;
    }

    /// Turns the head by one tick of `tick_nanos`. Call it at every firing, whether or not anybody
    /// reads the frame.
    ///
    /// The frame has at most `max_points` rays, whatever the length of the tick. Does nothing for a
    /// lidar of full turns.
    pub fn turn_head(&mut self, tick_nanos: u64, max_points: u32) {
        if self.spec.scan == LidarScan::Turn {
            return;
        }
        let fov_deg = self.spec.horizontal_fov_deg;
        let was_deg = self.turned_deg();
        self.swept_nanos += tick_nanos;
        let tick_secs = tick_nanos as f64 * 1e-9;
        let n_columns = self
            .spec
            .columns_per_frame(tick_secs)
            .min(max_points / self.spec.channels.max(1));
        let step_deg = self.spec.rotation_hz * fov_deg * tick_secs / n_columns.max(1) as f64;
        let azimuth = |column: u32| {
            (0.5 * fov_deg - (was_deg + step_deg * column as f64) % fov_deg).to_radians()
        };
        self.turned_to_rad = Some((0..n_columns).map(azimuth).collect());
    }

    /// Azimuth of the head at the end of the frame, radians counter-clockwise from x.
    pub fn head_rad(&self) -> f64 {
        match self.spec.scan {
            LidarScan::Turn => azimuth_rad(&self.spec, self.spec.columns.saturating_sub(1)),
            LidarScan::Sweep => {
                (0.5 * self.spec.horizontal_fov_deg - self.turned_deg()).to_radians()
            }
        }
    }

    /// Time for which the head has turned, nanoseconds; 0 for a lidar of full turns.
    pub fn turned_nanos(&self) -> u64 {
        self.swept_nanos
    }

    /// Turns the head to where it stands after this time.
    pub fn set_turned(&mut self, nanos: u64) {
        self.swept_nanos = nanos;
    }

    /// Turns the head back to where it stood when the lidar was made.
    pub fn reset(&mut self) {
        self.swept_nanos = 0;
    }

    /// How far the head has turned clockwise from the left edge of its field of view, degrees,
    /// without whole turns.
    fn turned_deg(&self) -> f64 {
        self.spec.horizontal_fov_deg
            * (self.spec.rotation_hz * self.swept_nanos as f64 * 1e-9).fract()
    }

    /// Beams of the next frame.
    pub(crate) fn aim(&mut self) -> &Beams {
        if let Some(azimuths_rad) = self.turned_to_rad.take() {
            self.beams = Beams::new(&self.spec, azimuths_rad.into_iter());
        }
        &self.beams
    }

    fn make_room(&mut self) {
        self.beams.bunch(&self.spec);
        let n_slots = self.beams.bunches.len() * self.beams.bunch_rays;
        match &mut self.points {
            Points::Plain(points) => points.resize(n_slots, LidarPoint::lost()),
            Points::Semantic(points) => points.resize(n_slots, SemanticLidarPoint::lost()),
            Points::Returns(points) => points.resize(n_slots, LidarReturn::lost()),
        }
    }

    /// Time from the beginning of the next frame's path to the tick, nanoseconds.
    pub(crate) fn past_nanos(&self) -> u64 {
        self.past_nanos
    }

    /// Its specification; the attenuation includes the weather's.
    pub fn spec(&self) -> &LidarSpec {
        &self.spec
    }

    /// Casts one frame on the current rayon pool and returns the number of points, which
    /// [`Lidar::write`] then puts into a frame.
    ///
    /// `noise` is the key (seed, sensor, tick). Rays pass through the parts of the actor `ignored`;
    /// CARLA's lidar sees its own car, which is `None`.
    pub fn scan(
        &mut self,
        scene: &RayScene,
        path: &SensorPath,
        noise: Noise,
        ignored: Option<ActorId>,
    ) -> u32 {
        self.aim();
        self.make_room();
        let window_nanos = match self.window_nanos {
            0 => (1e9 / self.spec.rate_hz) as u64,
            nanos => nanos,
        };
        let n_columns = self.beams.n_columns();
        let turn = Turn {
            scene,
            spec: &self.spec,
            beams: &self.beams,
            poses: column_poses(&self.spec, path, n_columns, window_nanos),
            times: Times::new(&self.spec, n_columns, self.past_nanos),
            noise,
            ignored,
        };
        match &mut self.points {
            Points::Plain(points) => turn.cast(points),
            Points::Semantic(points) => turn.cast(points),
            Points::Returns(points) => turn.cast(points),
        }
        match &self.points {
            Points::Plain(points) => count(&self.beams, points, &mut self.n_returns),
            Points::Semantic(points) => count(&self.beams, points, &mut self.n_returns),
            Points::Returns(points) => count(&self.beams, points, &mut self.n_returns),
        }
        self.n_points()
    }

    /// Number of points of the last frame.
    pub fn n_points(&self) -> u32 {
        self.n_returns.iter().sum()
    }

    /// Returns per channel in the last frame.
    pub fn n_returns(&self) -> &[u32] {
        &self.n_returns
    }

    /// Bytes that [`Lidar::write`] will write.
    pub fn payload_bytes(&self) -> usize {
        let point_bytes = match &self.points {
            Points::Plain(_) => size_of::<LidarPoint>(),
            Points::Semantic(_) => size_of::<SemanticLidarPoint>(),
            Points::Returns(_) => size_of::<LidarReturn>(),
        };
        self.n_points() as usize * point_bytes
    }

    /// Writes the points of the last frame to the front of `payload` and returns the number of
    /// bytes written.
    ///
    /// Panics if `payload` is shorter than [`Lidar::payload_bytes`].
    pub fn write(&self, payload: &mut [u8]) -> usize {
        let payload = &mut payload[..self.payload_bytes()];
        match &self.points {
            Points::Plain(points) => write(&self.beams, points, payload),
            Points::Semantic(points) => write(&self.beams, points, payload),
            Points::Returns(points) => write(&self.beams, points, payload),
        }
        payload.len()
    }
}

/// Counts the returns of each channel.
fn count<P: Point>(beams: &Beams, points: &[P], n_returns: &mut [u32]) {
    n_returns.fill(0);
    let rows = beams.slots.chunks(beams.n_columns().max(1));
    for (row, n) in rows.zip(n_returns) {
        *n = row
            .iter()
            .map(|slot| !points[*slot as usize].is_lost() as u32)
            .sum();
    }
}

/// Writes the points that are not lost, channel after channel.
fn write<P: Point + bytemuck::Pod>(beams: &Beams, points: &[P], payload: &mut [u8]) {
    let kept = beams
        .slots
        .iter()
        .map(|slot| &points[*slot as usize])
        .filter(|point| !point.is_lost());
    for (bytes, point) in payload.chunks_exact_mut(size_of::<P>()).zip(kept) {
        bytes.copy_from_slice(bytemuck::bytes_of(point));
    }
}
