//! Strollers: walkers that go by themselves from place to place over the pavements.
//!
//! How they go is told in [`schema_roads::walkable::stroll`]; here they are told what the world
//! looks like, and their steps become controls.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Isometry2, Vector2, Vector3};
use schema_frames::{LightState, WalkerControl};
use schema_roads::walkable::Pavements;
use schema_roads::walkable::detour::Obstacle;
use schema_roads::walkable::stroll::{
    OnFoot, STANDS_MPS, SeenVehicle, Stroll, StrollStep, StrollView, draw_newcomer, draw_speed_mps,
};
use schema_types::noise::Noise;
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};

use super::model::{WalkerModel, walker_models};
use super::surroundings::Surroundings;
use super::walker::Walker;
use crate::serde_forms::StrollForm;
use crate::vehicles::Vehicle;

/// Random stream of the strollers: no other use of the seed has this number.
const STREAM: u64 = 0x77a1_4e20;

/// A walker that strolls.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Stroller {
    actor: ActorId,
    speed_mps: f32,
    #[serde(with = "StrollForm")]
    stroll: Stroll,
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
            stroll: Stroll::new(0),
        });
    }

    /// Whether the counts of a checkpoint leave room to count on.
    ///
    /// # Errors
    /// The count that does not.
    pub fn check(&self) -> Result<(), u64> {
        let mut ways = self.strollers.iter().map(|of| of.stroll.n_ways);
        ways.find(|ways| *ways >= 1 << 62).map_or(Ok(()), Err)
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
        let vehicles = seen_vehicles(around);
        let is_red = |id: &str| {
            let lights = around.lights.lights.iter();
            lights
                .filter(|light| *light.signal_id == *id)
                .all(|light| light.state == LightState::Red)
        };
        let view = StrollView {
            ground,
            vehicles: &vehicles,
            is_red: &is_red,
        };
        for stroller in &mut self.strollers {
            let Some(walker) = walkers.get_mut(&stroller.actor) else {
                continue;
            };
            let control = stroller.control(walker, &view, around.seed, dt_secs);
            if walker.led.is_none() {
                walker.control = control;
            }
        }
    }
}

impl Stroller {
    fn control(
        &mut self,
        walker: &Walker,
        view: &StrollView<'_>,
        seed: u64,
        dt_secs: f64,
    ) -> WalkerControl {
        let at = walker.feet_m;
        let me = OnFoot {
            at_m: at,
            radius_m: walker.model().radius_m(),
            crosses_anywhere: false,
        };
        let stream = STREAM + 1 + u64::from(self.actor.0);
        let lot = |n_ways: u64| Noise::new(seed, stream, n_ways).uniform(0);
        match view.step(&me, &mut self.stroll, dt_secs, lot) {
            StrollStep::Stand => WalkerControl {
                speed_mps: 0.0,
                ..walker.control
            },
            StrollStep::Ahead(to) | StrollStep::Around(to) => WalkerControl {
                direction: [(to.x - at[0]) as f32, (to.y - at[1]) as f32, 0.0],
                speed_mps: self.speed_mps,
                jump: false,
            },
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
    let models = walker_models();
    let half_height_m = |kind: usize| 0.5 * models[kind].shape.height_m;
    let newcomer = draw_newcomer(ground, draw, models.len(), half_height_m)?;
    let model = &models[newcomer.kind];
    Some(Candidate {
        model,
        pose: newcomer.pose,
        speed_mps: draw_speed_mps(model.speeds_mps[0], draw.uniform(3)) as f32,
    })
}

/// Every vehicle as strollers see it.
fn seen_vehicles(around: &Surroundings<'_>) -> Vec<SeenVehicle> {
    let seen = |vehicle: &Vehicle| {
        let pose = vehicle.pose(around.physics);
        let (velocity_mps, _) = vehicle.velocity(around.physics);
        let [length, width, _] = vehicle.model.solid_half_m();
        let forward = pose.rotation * Vector3::x();
        let obstacle = || Obstacle {
            world_from_box: Isometry2::new(
                pose.translation.vector.xy(),
                forward.y.atan2(forward.x),
            ),
            half_m: Vector2::new(length, width),
            moves: velocity_mps.norm() > STANDS_MPS,
        };
        SeenVehicle {
            middle_m: pose.translation.vector,
            velocity_mps,
            half_length_m: vehicle.model.half_m[0],
            obstacle: vehicle.switches.collides.then(obstacle),
        }
    };
    around.vehicles.by_id.values().map(seen).collect()
}
