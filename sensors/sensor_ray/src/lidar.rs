//! Spinning lidar, plain and semantic: one full turn per frame, ending at the tick, or CARLA's
//! sweep of one tick.
//!
//! Columns of a turn run counter-clockwise from above, column `i` at azimuth −π + 2π·(i +
//! 1)/columns, so that the last one looks straight
//! back at the very tick; a narrower field of view is spread the same way about the front. Columns
//! of a sweep run clockwise, as CARLA's
//! head turns, from where it stood after the previous firing: of `h` the width of the turn, column
//! `i` looks at h/2 − mod(was + step·i, h).
//! Points come channel after channel, channel 0 on top, azimuth rising within each; rays without a
//! return leave no gap.
//! Losses are CARLA's, in CARLA's order: general drop-off, range noise, intensity exp(−a·d),
//! drop-off by intensity.
//! Bytes depend on scene, spec, path and noise key alone, not on the number of threads.

use nalgebra::{Isometry3, Matrix3, Point3};
use rayon::prelude::*;
use schema_frames::{LidarPoint, SemanticLidarPoint};
use schema_types::ActorId;
use schema_types::noise::Noise;
use sensor_core::lanes::{LaneWork, Lanes, in_lanes};
use sensor_spec::{LidarScan, LidarSpec};

use crate::beams::{Beams, Bunch};
use crate::bundle::{GROUP, Hits};
use crate::cast::{Caster, Stacks};
use crate::points::{Point, Returns};
use crate::scene::RayScene;

/// Bunches of rays that a thread takes at a time.
const TASK_BUNCHES: usize = 16;

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
        SensorPath {
            world_from_sensor_start: world_from_sensor,
            world_from_sensor,
        }
    }
}

/// Points of a turn, bunch after bunch, lost ones included.
#[derive(Debug)]
enum Points {
    Plain(Vec<LidarPoint>),
    Semantic(Vec<SemanticLidarPoint>),
}

/// One lidar: beam tables and the memory of its last turn.
#[derive(Debug)]
pub struct Lidar {
    spec: LidarSpec,
    /// The specification's own, without weather.
    clear_attenuation_per_m: f64,
    beams: Beams,
    /// Azimuths to which the head has turned since the last scan.
    turned_to_rad: Option<Vec<f64>>,
    /// Time that the head has swept, all firings together (scan `sweep`).
    swept_nanos: u64,
    points: Points,
    /// Returns per channel in the last turn.
    n_returns: Vec<u32>,
}

impl Lidar {
    /// A lidar after a spec that passed its check.
    pub fn new(spec: LidarSpec) -> Self {
        let mut lidar = Lidar {
            beams: Beams::new(&spec, std::iter::empty()),
            turned_to_rad: None,
            swept_nanos: 0,
            points: match spec.semantic {
                false => Points::Plain(Vec::new()),
                true => Points::Semantic(Vec::new()),
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

    /// What the air takes of the light, 1/m, on its way there and again on its way back; added to
    /// the specification's own attenuation.
    pub fn set_extinction(&mut self, extinction_per_m: f64) {
        self.spec.attenuation_per_m = self.clear_attenuation_per_m + 2.0 * extinction_per_m;
    }

    /// Turns the head as far as it gets in a tick of `tick_nanos`. Call it at every firing, read or
    /// not.
    ///
    /// At most `max_points` rays are aimed, whatever the length of the tick. Without effect on a
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
            LidarScan::Turn => 0.5 * self.spec.horizontal_fov_deg.to_radians(),
            LidarScan::Sweep => {
                (0.5 * self.spec.horizontal_fov_deg - self.turned_deg()).to_radians()
            }
        }
    }

    /// Begins anew: the head as when it was made.
    pub fn reset(&mut self) {
        self.swept_nanos = 0;
    }

    /// How far the head has turned clockwise from the left rim of its field of view, degrees, less
    /// whole turns.
    fn turned_deg(&self) -> f64 {
        self.spec.horizontal_fov_deg
            * (self.spec.rotation_hz * self.swept_nanos as f64 * 1e-9).fract()
    }

    /// Beams as the head stands now.
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
        }
    }

    /// The spec it was made after.
    pub fn spec(&self) -> &LidarSpec {
        &self.spec
    }

    /// Casts one frame on the current rayon pool and returns the number of points, which
    /// [`Lidar::write`] then puts into a frame.
    ///
    /// `noise` is the key (seed, sensor, tick); rays pass through the parts of `ignored` (CARLA's
    /// lidar sees its own car: `None`).
    pub fn scan(
        &mut self,
        scene: &RayScene,
        path: &SensorPath,
        noise: Noise,
        ignored: Option<ActorId>,
    ) -> u32 {
        self.aim();
        self.make_room();
        let turn = Turn {
            scene,
            spec: &self.spec,
            beams: &self.beams,
            poses: column_poses(&self.spec, path, self.beams.n_columns()),
            noise,
            ignored,
        };
        match &mut self.points {
            Points::Plain(points) => turn.cast(points),
            Points::Semantic(points) => turn.cast(points),
        }
        match &self.points {
            Points::Plain(points) => count(&self.beams, points, &mut self.n_returns),
            Points::Semantic(points) => count(&self.beams, points, &mut self.n_returns),
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
        let point_bytes = match &self.points {
            Points::Plain(_) => size_of::<LidarPoint>(),
            Points::Semantic(_) => size_of::<SemanticLidarPoint>(),
        };
        self.n_points() as usize * point_bytes
    }

    /// Writes the points of the last turn to the front of a frame and returns how many bytes that
    /// took.
    ///
    /// Panics if `payload` is shorter than [`Lidar::payload_bytes`].
    pub fn write(&self, payload: &mut [u8]) -> usize {
        let payload = &mut payload[..self.payload_bytes()];
        match &self.points {
            Points::Plain(points) => write(&self.beams, points, payload),
            Points::Semantic(points) => write(&self.beams, points, payload),
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

/// Azimuth of a column of a full turn, radians counter-clockwise from x.
pub fn azimuth_rad(spec: &LidarSpec, column: u32) -> f64 {
    0.5 * spec.horizontal_fov_deg.to_radians()
        * (2.0 * (column + 1) as f64 / spec.columns as f64 - 1.0)
}

/// Where rays leave from, and how the sensor's space is turned.
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
pub(crate) fn column_poses(spec: &LidarSpec, path: &SensorPath, n_columns: usize) -> Vec<Pose> {
    if !spec.motion_distortion {
        return vec![(&path.world_from_sensor).into()];
    }
    let (start, end) = (&path.world_from_sensor_start, &path.world_from_sensor);
    let pose = |column: usize| {
        let share = (column + 1) as f64 / n_columns as f64;
        (&start.try_lerp_slerp(end, share, 1e-9).unwrap_or(*end)).into()
    };
    (0..n_columns).map(pose).collect()
}

/// Everything the rays of a turn share.
struct Turn<'a> {
    scene: &'a RayScene,
    spec: &'a LidarSpec,
    beams: &'a Beams,
    poses: Vec<Pose>,
    noise: Noise,
    ignored: Option<ActorId>,
}

impl Turn<'_> {
    /// Casts all rays, some bunches per task.
    fn cast<P: Point>(&self, points: &mut [P]) {
        let n_slots = (TASK_BUNCHES * self.beams.bunch_rays).max(1);
        let bunches = self.beams.bunches.par_chunks(TASK_BUNCHES);
        points.par_chunks_mut(n_slots).zip(bunches).for_each_init(
            Stacks::default,
            |stacks, (points, bunches)| {
                let caster = Caster {
                    scene: self.scene,
                    ignored: self.ignored,
                    stacks: std::mem::take(stacks),
                };
                *stacks = in_lanes(Task {
                    turn: self,
                    caster,
                    bunches,
                    points,
                });
            },
        );
    }

    #[inline(always)]
    fn cast_bunch<L: Lanes, P: Point>(&self, caster: &mut Caster, bunch: &Bunch, points: &mut [P]) {
        let Bunch { bundle, rays } = bunch;
        let pose = &self.poses[if self.poses.len() == 1 {
            0
        } else {
            rays[0].1 as usize
        }];
        let mut hits = Hits::new(bundle, self.spec.range_m);
        if P::can_misfire(self.spec) {
            for (ray, beam) in rays.iter().enumerate() {
                if P::misfires(self.spec, self.noise, self.beams.number(*beam)) {
                    hits.switch_off(ray);
                }
            }
        }
        hits.begin::<L>();
        caster.cast::<L>(&pose.origin_m, &pose.world_from_sensor, bundle, &mut hits);
        for (group, (rays, points)) in rays
            .chunks_exact(GROUP)
            .zip(points.chunks_exact_mut(GROUP))
            .enumerate()
        {
            let mut returns = Returns {
                scene: self.scene,
                spec: self.spec,
                noise: self.noise,
                bundle,
                hits: &hits,
                group,
                origin_m: pose.origin_m,
                directions_in_world: [[0.0; GROUP]; 3],
                directions_in_sensor: [[0.0; GROUP]; 3],
                rays: [0; GROUP],
                channels: [0; GROUP],
            };
            self.aim(rays, &pose.world_from_sensor, &mut returns);
            P::write(&returns, points);
        }
    }

    #[inline(always)]
    fn aim(&self, rays: &[(u32, u32)], world_from_sensor: &Matrix3<f64>, returns: &mut Returns) {
        for (lane, beam) in rays.iter().enumerate().take(GROUP) {
            returns.rays[lane] = self.beams.number(*beam);
            returns.channels[lane] = beam.0 as u16;
            let direction = self.beams.direction(beam.0 as usize, beam.1 as usize);
            for axis in 0..3 {
                returns.directions_in_sensor[axis][lane] = direction[axis];
            }
        }
        let m = world_from_sensor;
        let [x, y, z] = &returns.directions_in_sensor;
        for axis in 0..3 {
            let (mx, my, mz) = (m[(axis, 0)], m[(axis, 1)], m[(axis, 2)]);
            for lane in 0..GROUP {
                returns.directions_in_world[axis][lane] =
                    mx * x[lane] + my * y[lane] + mz * z[lane];
            }
        }
    }
}

/// A few bunches and where their points go.
struct Task<'t, P> {
    turn: &'t Turn<'t>,
    caster: Caster<'t>,
    bunches: &'t [Bunch],
    points: &'t mut [P],
}

impl<P: Point> LaneWork for Task<'_, P> {
    type Out = Stacks;

    #[inline(always)]
    fn run<L: Lanes>(mut self) -> Stacks {
        let n_slots = self.turn.beams.bunch_rays;
        for (bunch, points) in self.bunches.iter().zip(self.points.chunks_mut(n_slots)) {
            self.turn
                .cast_bunch::<L, P>(&mut self.caster, bunch, points);
        }
        self.caster.stacks
    }
}
