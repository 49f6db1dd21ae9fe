//! Spawning: checks what is wanted and adds the actor to the parts of the world.

use std::collections::BTreeMap;

use schema_frames::ActorKind;
use schema_frames::document::Catalogue;
use schema_types::{ActorId, Pose};

use crate::actors::{Actor, Actors, Counts};
use crate::catalogue;
use crate::errors::SpawnError;
use crate::friction_areas::{self, FrictionAreas, FrictionBox};
use crate::obstacles::Obstacles;
use crate::physics::Physics;
use crate::pose_check::unit_pose;
use crate::props::{Props, prop_models};
use crate::vehicles::{self, VehicleModel, Vehicles, vehicle_models};
use crate::walkers::{self, Walkers, walker_models};

/// A request for an actor.
pub(crate) struct Wanted<'r> {
    /// Whether it is a sensor that is added to an old run.
    pub is_added: bool,
    pub type_id: &'r str,
    /// Pose in the world, or on the parent.
    pub pose: Pose,
    /// Pose of the parent.
    pub world_from_parent: Option<Pose>,
    pub parent: Option<ActorId>,
    pub role: &'r str,
    pub attributes: &'r BTreeMap<String, String>,
}

/// The parts of the world that a new actor enters.
pub(crate) struct Spawner<'w> {
    pub catalogue: &'w Catalogue,
    /// Origin of the map, metres.
    pub origin_m: [f64; 3],
    pub physics: &'w mut Physics,
    pub actors: &'w mut Actors,
    pub counts: &'w mut Counts,
    pub vehicles: &'w mut Vehicles,
    pub walkers: &'w mut Walkers,
    pub props: &'w mut Props,
    pub friction: &'w mut FrictionAreas,
}

impl Spawner<'_> {
    /// Makes an actor. On an error nothing changes.
    pub fn spawn(&mut self, wanted: Wanted<'_>) -> Result<ActorId, SpawnError> {
        let type_id = wanted.type_id;
        let catalogue_idx = catalogue::index_of(self.catalogue, type_id)
            .ok_or_else(|| SpawnError::UnknownType(type_id.to_owned()))?;
        self.actors
            .check_room(wanted.role, wanted.attributes)
            .and_then(|()| self.counts.check_ids(1))
            .map_err(|source| SpawnError::NoRoom {
                type_id: type_id.to_owned(),
                source,
            })?;
        let pose = unit_pose(wanted.pose, self.origin_m).map_err(|problem| SpawnError::Pose {
            type_id: type_id.to_owned(),
            problem,
        })?;
        let wanted = Wanted { pose, ..wanted };
        if let Some(parent) = wanted
            .parent
            .filter(|parent| !self.actors.contains(*parent))
        {
            return Err(SpawnError::Parent {
                type_id: type_id.to_owned(),
                parent,
            });
        }
        match vehicle_models().get(catalogue_idx as usize) {
            Some(model) => self.vehicle(model, catalogue_idx, wanted),
            None if type_id.starts_with("walker.") => self.walker(catalogue_idx, wanted),
            None if type_id.starts_with("static.prop.") => self.prop(catalogue_idx, wanted),
            None if type_id.starts_with("sensor.") => {
                Ok(self.bodiless(ActorKind::Sensor, catalogue_idx, wanted))
            }
            None if type_id.starts_with("controller.") || type_id.starts_with("util.") => {
                Ok(self.bodiless(ActorKind::Controller, catalogue_idx, wanted))
            }
            None if type_id == friction_areas::TYPE_ID => self.friction_area(catalogue_idx, wanted),
            None => Err(SpawnError::OfTheMap(type_id.to_owned())),
        }
    }

    fn vehicle(
        &mut self,
        model: &'static VehicleModel,
        catalogue_idx: u32,
        wanted: Wanted<'_>,
    ) -> Result<ActorId, SpawnError> {
        let attributes = vehicles::checked_attributes(model, wanted.attributes)
            .map_err(|bad| bad.of(wanted.type_id))?;
        if wanted.parent.is_none() {
            let obstacle = self.obstacles().of_vehicle(model, &wanted.pose);
            refuse_occupied(wanted.type_id, obstacle)?;
        }
        let id = self.counts.new_id();
        self.vehicles
            .add(id, model, &wanted.world_pose(), &attributes, self.physics);
        if wanted.parent.is_some()
            && let Some(vehicle) = self.vehicles.by_id.get_mut(&id)
        {
            vehicle.set_simulated(self.physics, false);
            vehicle.set_collides(self.physics, false);
        }
        let actor = wanted.actor(id, ActorKind::Vehicle, catalogue_idx);
        self.actors.add(Actor {
            attributes,
            ..actor
        });
        Ok(id)
    }

    fn walker(&mut self, catalogue_idx: u32, wanted: Wanted<'_>) -> Result<ActorId, SpawnError> {
        let model_idx = walker_models()
            .iter()
            .position(|model| model.type_id == wanted.type_id)
            .expect("the catalogue lists only these");
        let attributes =
            walkers::checked_attributes(&walker_models()[model_idx], wanted.attributes)
                .map_err(|bad| bad.of(wanted.type_id))?;
        let mut walker =
            walkers::new_walker(model_idx, &wanted.world_pose(), &attributes, self.physics);
        if wanted.parent.is_some() {
            (walker.simulated, walker.collides) = (false, false);
        } else {
            let obstacle = self.obstacles().of_walker(&walker);
            refuse_occupied(wanted.type_id, obstacle)?;
        }
        let id = self.counts.new_id();
        self.walkers.by_id.insert(id, walker);
        let actor = wanted.actor(id, ActorKind::Walker, catalogue_idx);
        self.actors.add(Actor {
            attributes,
            ..actor
        });
        Ok(id)
    }

    fn prop(&mut self, catalogue_idx: u32, wanted: Wanted<'_>) -> Result<ActorId, SpawnError> {
        let model_idx = prop_models()
            .iter()
            .position(|model| model.type_id == wanted.type_id)
            .expect("the catalogue lists only these");
        let model = &prop_models()[model_idx];
        let attributes = model
            .checked_attributes(wanted.attributes)
            .map_err(|bad| bad.of(wanted.type_id))?;
        let mass_kg = model.mass_kg(&attributes);
        let id = if wanted.parent.is_some() {
            let id = self.counts.new_id();
            self.props.add_attached(id, model_idx);
            id
        } else {
            // Nothing is in the way of an object, as in CARLA: debris lies under cars.
            let id = self.counts.new_id();
            self.props
                .add_standing(id, model_idx, mass_kg, &wanted.pose, self.physics);
            id
        };
        let actor = wanted.actor(id, ActorKind::Prop, catalogue_idx);
        self.actors.add(Actor {
            attributes,
            ..actor
        });
        Ok(id)
    }

    /// Sensors and controllers: they keep whatever attributes they are given.
    fn bodiless(&mut self, kind: ActorKind, catalogue_idx: u32, wanted: Wanted<'_>) -> ActorId {
        let id = match wanted.is_added {
            true => self.counts.new_added_id(),
            false => self.counts.new_id(),
        };
        self.actors.add(wanted.actor(id, kind, catalogue_idx));
        id
    }

    fn friction_area(
        &mut self,
        catalogue_idx: u32,
        wanted: Wanted<'_>,
    ) -> Result<ActorId, SpawnError> {
        FrictionBox::new(&wanted.pose, wanted.attributes).map_err(|bad| bad.of(wanted.type_id))?;
        let id = self.counts.new_id();
        let actor = wanted.actor(id, ActorKind::Prop, catalogue_idx);
        // An area is never attached, even if a parent was given.
        self.actors.add(Actor {
            parent: None,
            ..actor
        });
        self.friction.refresh(self.actors, self.catalogue);
        Ok(id)
    }

    fn obstacles(&self) -> Obstacles<'_> {
        Obstacles {
            physics: self.physics,
            vehicles: self.vehicles,
            walkers: self.walkers,
            props: self.props,
        }
    }
}

impl Wanted<'_> {
    fn world_pose(&self) -> Pose {
        match &self.world_from_parent {
            Some(parent) => (parent.isometry() * self.pose.isometry()).into(),
            None => self.pose,
        }
    }

    fn actor(&self, id: ActorId, kind: ActorKind, catalogue_idx: u32) -> Actor {
        Actor {
            id,
            kind,
            catalogue_idx,
            role: self.role.to_owned(),
            parent: self.parent,
            pose: self.pose,
            attributes: self.attributes.clone(),
            topics: Vec::new(),
        }
    }
}

fn refuse_occupied(type_id: &str, obstacle: Option<String>) -> Result<(), SpawnError> {
    match obstacle {
        Some(obstacle) => Err(SpawnError::Occupied {
            type_id: type_id.to_owned(),
            obstacle,
        }),
        None => Ok(()),
    }
}
