//! Vehicles: the catalogue's models, one vehicle's physics, and the step of all of them.

mod ackermann;
mod attributes;
mod body_actions;
mod body_state;
mod curve;
mod doors;
mod engine_spec;
mod engines;
mod factory_data;
mod footing;
mod model;
mod model_list;
mod powertrain;
mod sub_step;
mod vehicle;
mod wheel;
mod wheel_forces;
mod wheel_solver;

use std::collections::BTreeMap;

use rapier3d::math::Pose as EnginePose;
use rapier3d::parry::query::intersection_test;
use rapier3d::parry::shape::{Cuboid, Shape};
use rayon::iter::{IntoParallelRefMutIterator as _, ParallelIterator as _};
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};

use crate::friction_areas::GroundGrip;
use crate::physics::Physics;

pub(crate) use attributes::{catalogue_entry, checked_attributes, color_text};
pub(crate) use body_actions::{Body, act, set_doors, set_physics, set_velocity};
pub use engine_spec::EngineSpec;
pub use model::VehicleModel;
pub use model_list::vehicle_models;
pub(crate) use sub_step::Around;
pub(crate) use vehicle::{MAX_WHEELS, Vehicle, WheelState, chassis_box, check_vehicle};

/// From this number on, vehicles are planned on several threads.
const SIDE_BY_SIDE: usize = 32;

/// All vehicles by rising id.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct Vehicles {
    pub by_id: BTreeMap<ActorId, Vehicle>,
}

impl Vehicles {
    pub fn get(&self, actor: ActorId) -> Option<&Vehicle> {
        self.by_id.get(&actor)
    }

    /// Adds a vehicle with a body in the engine; `attributes` were checked.
    pub fn add(
        &mut self,
        actor: ActorId,
        model: &'static VehicleModel,
        pose: &Pose,
        attributes: &BTreeMap<String, String>,
        physics: &mut Physics,
    ) {
        let mut vehicle = Vehicle::new(physics, model, actor.0, &pose.isometry());
        vehicle.tint_rgb = attributes
            .get("color")
            .and_then(|text| attributes::parse_color(text))
            .unwrap_or(model.colors[0]);
        vehicle.switches.sticky_control = attributes
            .get("sticky_control")
            .is_none_or(|value| value == "true");
        self.by_id.insert(actor, vehicle);
    }

    /// Removes a vehicle and its body, if `actor` is one.
    pub fn remove(&mut self, actor: ActorId, physics: &mut Physics) {
        if let Some(vehicle) = self.by_id.remove(&actor) {
            physics.engine.remove_body(vehicle.body);
        }
    }

    /// Before the sub-steps of a tick: controllers choose pedals and steering.
    pub fn begin_tick(&mut self, physics: &Physics, dt_secs: f32) {
        self.by_id
            .values_mut()
            .for_each(|vehicle| vehicle.begin_tick(physics, dt_secs));
    }

    /// Before the engine's sub-step: vehicles plan it side by side; the velocities that they plan
    /// are given to the engine in order, so the number of threads changes nothing.
    pub fn plan_sub_step(&mut self, physics: &mut Physics, ground: &GroundGrip<'_>, dt_secs: f32) {
        let around = Around {
            physics,
            ground: *ground,
            dt_secs,
        };
        let plan = |vehicle: &mut Vehicle| Some((vehicle.body, vehicle.plan(&around)?));
        let planned: Vec<_> = match self.by_id.len() >= SIDE_BY_SIDE {
            true => self
                .by_id
                .par_iter_mut()
                .map(|(_, vehicle)| plan(vehicle))
                .collect(),
            false => self.by_id.values_mut().map(plan).collect(),
        };
        for (body, velocities) in planned.into_iter().flatten() {
            let body = &mut physics.engine.bodies[body];
            body.set_linvel(velocities.linear, true);
            body.set_angvel(velocities.angular, true);
        }
    }

    /// After the engine's sub-step: takes vehicles whose state makes no sense out of the physics.
    pub fn finish_sub_step(&mut self, physics: &mut Physics) {
        for (id, vehicle) in &mut self.by_id {
            if vehicle.finish_step(physics) {
                tracing::error!(
                    actor = id.0,
                    type_id = vehicle.model.type_id,
                    "vehicle left every sensible state and was taken out of the physics; destroy it or set its pose"
                );
            }
        }
    }

    /// After the sub-steps of a tick: pushes end, doors move.
    pub fn end_tick(&mut self, physics: &Physics, dt_secs: f64) {
        self.by_id
            .values_mut()
            .for_each(|vehicle| vehicle.end_tick(physics, dt_secs));
    }

    /// Type and id of the first vehicle that a shape would touch.
    pub fn touching(
        &self,
        at: &EnginePose,
        shape: &dyn Shape,
        physics: &Physics,
    ) -> Option<String> {
        self.by_id.iter().find_map(|(id, vehicle)| {
            // A collider made since the last step has its pose only from the next step on; the
            // body's is always current.
            let (centre, half) = chassis_box(vehicle.model);
            let mut other_at = physics.engine_pose(&vehicle.pose(physics));
            other_at.translation += other_at.rotation * centre;
            // An error would mean that the two shapes cannot be tested against each other.
            intersection_test(at, shape, &other_at, &Cuboid::new(half))
                .is_ok_and(|hit| hit.intersecting)
                .then(|| format!("{} (actor {id})", vehicle.model.type_id))
        })
    }
}
