//! Strollers: walkers that go by themselves from place to place over the walkable mesh, and cross
//! at crosswalks when the traffic's light is red.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Isometry2, Vector2, Vector3};
use schema_frames::{LightState, WalkerControl};
use schema_roads::walkable::detour::{self, Obstacle, Step};
use schema_roads::walkable::pavements::REACH_M;
use schema_roads::walkable::{Ground, Pavements};
use schema_types::noise::Noise;
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};

use super::model::{WalkerModel, walker_models};
use super::surroundings::Surroundings;
use super::walker::Walker;
use crate::vehicles::Vehicle;

/// Random stream of the strollers: no other use of the seed has this number.
const STREAM: u64 = 0x77a1_4e20;
/// A corner of the path counts as reached from this far, metres.
const ARRIVED_M: f64 = 0.35;
/// A stroller that gets no nearer for this long chooses another way, seconds.
const PATIENCE_SECS: f64 = 4.0;
/// A vehicle that could reach a crosswalk within this time keeps strollers from stepping on it,
/// seconds.
const GAP_SECS: f64 = 4.0;
/// A vehicle slower than this counts as standing, m/s.
const STANDS_MPS: f64 = 0.3;
/// Strollers ignore vehicles farther away than this, metres between the middles.
const SEES_M: f64 = 12.0;
/// A vehicle whose middle is this much higher or lower is on another level, metres.
const LEVEL_M: f64 = 4.0;

/// A walker that strolls.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Stroller {
    actor: ActorId,
    speed_mps: f32,
    /// Corners of the way, and the face that each leads into (`u32::MAX` for the end).
    path: Vec<([f64; 2], u32)>,
    next: usize,
    /// Number of strolls begun, and for how long it has not come nearer to its next corner.
    n_strolls: u64,
    stuck_secs: f64,
    nearest_m: f64,
}

/// All strollers, and the mesh on which they walk.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Crowd {
    strollers: Vec<Stroller>,
    #[serde(skip)]
    pub ground: Option<Arc<Pavements>>,
}

impl Crowd {
    /// Lets a walker stroll from now on.
    pub fn add(&mut self, actor: ActorId, speed_mps: f32) {
        self.strollers.push(Stroller {
            actor,
            speed_mps,
            path: Vec::new(),
            next: 0,
            n_strolls: 0,
            stuck_secs: 0.0,
            nearest_m: f64::MAX,
        });
    }

    /// Sets the controls of all strollers, before the walkers move.
    pub fn lead(
        &mut self,
        walkers: &mut BTreeMap<ActorId, Walker>,
        around: &Surroundings<'_>,
        dt_secs: f64,
    ) {
        if self.strollers.is_empty() {
            return;
        }
        if self.ground.is_none() {
            self.ground = around
                .roads
                .map(|roads| Arc::new(Pavements::new(roads, false)));
        }
        let Some(ground) = &self.ground else {
            return;
        };
        self.strollers
            .retain(|stroller| walkers.contains_key(&stroller.actor));
        let view = StrollersView {
            ground,
            around,
            vehicles: obstacles(around),
        };
        for stroller in &mut self.strollers {
            let Some(walker) = walkers.get_mut(&stroller.actor) else {
                continue;
            };
            let control = view.stroll(walker, stroller, dt_secs);
            if walker.led.is_none() {
                walker.control = control;
            }
        }
    }
}

/// A candidate for the crowd: model, place and speed.
pub(crate) struct Candidate {
    pub model: &'static WalkerModel,
    pub pose: Pose,
    pub speed_mps: f32,
}

/// The `attempt`-th candidate, drawn by lot; `None` if the map has no pavement.
pub(crate) fn draw_candidate(ground: &Pavements, seed: u64, attempt: u64) -> Option<Candidate> {
    let draw = Noise::new(seed, STREAM, attempt);
    let face = ground.place(draw.uniform(0))?;
    let models = walker_models();
    let model = &models[(draw.bits(1) % models.len() as u64) as usize];
    let [x, y, z] = ground.middles_m[face];
    let pose = Pose::from_xyz_yaw(
        x,
        y,
        z + 0.5 * model.shape.height_m + 0.2,
        std::f64::consts::TAU * draw.uniform(2),
    );
    Some(Candidate {
        model,
        pose,
        speed_mps: (model.speeds_mps[0] * (0.85 + 0.3 * draw.uniform(3))) as f32,
    })
}

/// What all strollers see when they decide where to go.
struct StrollersView<'s> {
    ground: &'s Pavements,
    around: &'s Surroundings<'s>,
    /// Every vehicle that can be touched, with its middle.
    vehicles: Vec<(Vector3<f64>, Obstacle)>,
}

impl StrollersView<'_> {
    fn stroll(&self, walker: &Walker, stroller: &mut Stroller, dt_secs: f64) -> WalkerControl {
        let at = walker.feet_m;
        if stroller.next >= stroller.path.len() || stroller.stuck_secs > PATIENCE_SECS {
            self.choose(stroller, at);
        }
        let away = |corner: &[f64; 2]| (corner[0] - at[0]).hypot(corner[1] - at[1]);
        while stroller
            .path
            .get(stroller.next)
            .is_some_and(|(corner, _)| away(corner) < ARRIVED_M)
        {
            let (_, into) = stroller.path[stroller.next];
            if !self.may_enter(at, into as usize) {
                return WalkerControl {
                    speed_mps: 0.0,
                    ..walker.control
                };
            }
            stroller.next += 1;
            stroller.nearest_m = f64::MAX;
        }
        let stands = WalkerControl {
            speed_mps: 0.0,
            ..walker.control
        };
        let Some(&(corner, into)) = stroller.path.get(stroller.next) else {
            return stands;
        };
        let left_m = away(&corner);
        if left_m < stroller.nearest_m - 0.05 {
            (stroller.nearest_m, stroller.stuck_secs) = (left_m, 0.0);
        } else {
            stroller.stuck_secs += dt_secs;
        }
        let is_near = |middle: &Vector3<f64>| {
            let (x, y, z) = (middle.x - at[0], middle.y - at[1], middle.z - at[2]);
            x * x + y * y < SEES_M * SEES_M && z.abs() < LEVEL_M
        };
        let near: Vec<Obstacle> = self
            .vehicles
            .iter()
            .filter(|(middle, _)| is_near(middle))
            .map(|(_, obstacle)| *obstacle)
            .collect();
        let is_walkable =
            |place: Vector2<f64>| self.ground.face_at([place.x, place.y, at[2]]).is_some();
        let here = Vector2::new(at[0], at[1]);
        let to = match detour::step(
            here,
            corner.into(),
            walker.model().radius_m(),
            &near,
            &is_walkable,
        ) {
            Step::Ahead => Vector2::from(corner),
            Step::Via(place) => place,
            Step::Wait => return stands,
            Step::Taken => {
                let beyond = stroller
                    .path
                    .get(stroller.next + 1)
                    .map(|(corner, _)| Vector2::from(*corner));
                let leads_on =
                    beyond.is_none_or(|beyond| detour::is_on_ground(here, beyond, &is_walkable));
                if leads_on && self.may_enter(at, into as usize) {
                    stroller.next += 1;
                    stroller.nearest_m = f64::MAX;
                }
                return stands;
            }
        };
        WalkerControl {
            direction: [(to.x - at[0]) as f32, (to.y - at[1]) as f32, 0.0],
            speed_mps: stroller.speed_mps,
            jump: false,
        }
    }

    /// Chooses a new way to a place within reach; leaves the stroller without a way if there is
    /// none.
    fn choose(&self, stroller: &mut Stroller, at: [f64; 3]) {
        (
            stroller.path,
            stroller.next,
            stroller.stuck_secs,
            stroller.nearest_m,
        ) = (Vec::new(), 0, 0.0, f64::MAX);
        let Some(from) = self.ground.face_near(at) else {
            return;
        };
        for _ in 0..8 {
            stroller.n_strolls += 1;
            let draw = Noise::new(
                self.around.seed,
                STREAM + 1 + u64::from(stroller.actor.0),
                stroller.n_strolls,
            );
            let Some(to) = self.ground.place(draw.uniform(0)) else {
                return;
            };
            let [x, y, _] = self.ground.middles_m[to];
            if to == from || (x - at[0]).hypot(y - at[1]) > REACH_M {
                continue;
            }
            if let Some(way) = self.ground.way(from, to, false) {
                stroller.path = self.ground.corners(&way, [at[0], at[1]]);
                return;
            }
        }
    }

    /// Whether a stroller may step into a face: onto a crosswalk only while the traffic over it has
    /// red or, where there are no lights, a gap.
    fn may_enter(&self, at: [f64; 3], into: usize) -> bool {
        let is_crosswalk = |face: usize| {
            self.ground
                .mesh
                .faces
                .get(face)
                .is_some_and(|face| face.ground == Ground::Crosswalk)
        };
        let here = self.ground.face_at(at);
        if !is_crosswalk(into) || here.is_some_and(is_crosswalk) {
            return true;
        }
        let guards = self.ground.guards.get(&into).map_or(&[][..], Vec::as_slice);
        let is_red = |id: &String| {
            self.around
                .lights
                .lights
                .iter()
                .filter(|light| light.signal_id == *id)
                .all(|light| light.state == LightState::Red)
        };
        if !guards.iter().all(is_red) {
            return false;
        }
        let [x, y, _] = self.ground.middles_m[into];
        let place = Vector3::new(x, y, at[2]);
        !self.around.vehicles.by_id.values().any(|vehicle| {
            let pose = vehicle.pose(self.around.physics);
            let (velocity, _) = vehicle.velocity(self.around.physics);
            let between = place - pose.translation.vector;
            let reach_m = vehicle.model.half_m[0]
                + 2.0
                + velocity.norm() * if guards.is_empty() { GAP_SECS } else { 1.0 };
            between.xy().norm() < reach_m
                && velocity.norm() > 0.3
                && (velocity.dot(&between) > 0.0 || between.xy().norm() < 6.0)
        })
    }
}

/// Every vehicle with its middle.
fn obstacles(around: &Surroundings<'_>) -> Vec<(Vector3<f64>, Obstacle)> {
    let obstacle = |vehicle: &Vehicle| {
        let pose = vehicle.pose(around.physics);
        let [length, width, _] = vehicle.model.solid_half_m();
        let forward = pose.rotation * Vector3::x();
        let world_from_box =
            Isometry2::new(pose.translation.vector.xy(), forward.y.atan2(forward.x));
        let moves = vehicle.velocity(around.physics).0.norm() > STANDS_MPS;
        (
            pose.translation.vector,
            Obstacle {
                world_from_box,
                half_m: Vector2::new(length, width),
                moves,
            },
        )
    };
    around
        .vehicles
        .by_id
        .values()
        .filter(|vehicle| vehicle.switches.collides)
        .map(obstacle)
        .collect()
}
