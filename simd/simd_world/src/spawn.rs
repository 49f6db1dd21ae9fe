//! Making and removing actors.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use rapier3d::math::Pose as EnginePose;
use rapier3d::parry::query::intersection_test;
use rapier3d::parry::shape::Cuboid;
use schema_frames::ActorKind;
use schema_types::{ActorId, Pose};

use crate::catalogue::{self, FIXED_ATTRIBUTES};
use crate::friction::{self, FrictionBox};
use crate::models::{VehicleModel, vehicle_models};
use crate::physics::Physics;
use crate::vehicle::{Vehicle, chassis_box};
use crate::walkers::{Walker, walker_models};
use crate::world::{Actor, World};

/// Why an actor was not made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SpawnError {
    /// Unknown type.
    #[error("unknown type {0:?}; world/catalogue lists what can be spawned")]
    UnknownType(String),
    /// The map brings these.
    #[error("{0:?} belongs to the map and cannot be spawned")]
    OfTheMap(String),
    /// The pose is not a pose.
    #[error("cannot spawn {type_id:?}: its pose {problem}")]
    Pose {
        /// Catalogue id.
        type_id: String,
        /// What is wrong.
        problem: &'static str,
    },
    /// No such parent.
    #[error("cannot attach {type_id:?}: there is no actor {parent}")]
    Parent {
        /// Catalogue id.
        type_id: String,
        /// The id asked for.
        parent: ActorId,
    },
    /// Only sensors ride on others.
    #[error(
        "cannot attach {0:?} to an actor: only sensors, controllers and props can be attached; leave parent_id out"
    )]
    Attached(String),
    /// Something is there already.
    #[error(
        "spawn failed because of collision at spawn position: {type_id:?} would touch {obstacle}"
    )]
    Occupied {
        /// Catalogue id.
        type_id: String,
        /// What it would touch.
        obstacle: String,
    },
    /// Unknown or unusable attribute.
    #[error("cannot spawn {type_id:?}: attribute {name:?} is {value:?}, but {allowed}")]
    Attribute {
        /// Catalogue id.
        type_id: String,
        /// Attribute.
        name: String,
        /// Its value.
        value: String,
        /// What is allowed.
        allowed: String,
    },
    /// A spawn point that the map does not have.
    #[error("spawn point {idx} does not exist: map {map:?} has {n_points}, counted from 0")]
    SpawnPoint {
        /// Index asked for.
        idx: usize,
        /// Map.
        map: String,
        /// How many there are.
        n_points: usize,
    },
}

/// Why an actor was not removed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DestroyError {
    /// No such actor.
    #[error("unable to destroy actor {0}: not found")]
    Unknown(ActorId),
    /// The map brings these.
    #[error("unable to destroy actor {actor}: {type_id:?} belongs to the map")]
    OfTheMap {
        /// The actor.
        actor: ActorId,
        /// Catalogue id.
        type_id: String,
    },
}

impl World {
    /// Makes an actor. `pose` is in the world, or on `parent` for a sensor that rides on it.
    ///
    /// Vehicles take the attributes `color` (`r,g,b`, each 0–255) and `sticky_control` (`false`: a
    /// control is for one tick); sensors keep whatever attributes they are given.
    /// The pose is used as it is: a vehicle above the ground falls onto it.
    pub fn spawn(
        &mut self,
        type_id: &str,
        pose: Pose,
        parent: Option<ActorId>,
        role: &str,
        attributes: &BTreeMap<String, String>,
    ) -> Result<ActorId, SpawnError> {
        let catalogue_idx = self
            .catalogue_idx(type_id)
            .ok_or_else(|| SpawnError::UnknownType(type_id.to_owned()))?;
        let pose = unit_pose(pose, self.map.origin_m).map_err(|problem| SpawnError::Pose {
            type_id: type_id.to_owned(),
            problem,
        })?;
        if let Some(parent) = parent.filter(|parent| !self.actors.contains_key(parent)) {
            return Err(SpawnError::Parent {
                type_id: type_id.to_owned(),
                parent,
            });
        }
        let id = match vehicle_models().get(catalogue_idx as usize) {
            Some(_) if parent.is_some() => return Err(SpawnError::Attached(type_id.to_owned())),
            Some(model) => self.spawn_vehicle(model, catalogue_idx, pose, role, attributes)?,
            None if type_id.starts_with("walker.") && parent.is_some() => {
                return Err(SpawnError::Attached(type_id.to_owned()));
            }
            None if type_id.starts_with("walker.") => {
                self.spawn_walker(type_id, catalogue_idx, pose, role, attributes)?
            }
            None if type_id.starts_with("static.prop.") => {
                self.spawn_prop(type_id, catalogue_idx, pose, parent, role, attributes)?
            }
            None if ["sensor.", "controller.", "util."]
                .iter()
                .any(|family| type_id.starts_with(family)) =>
            {
                let id = self.new_id();
                let role = role.to_owned();
                let attributes = attributes.clone();
                let kind = if type_id.starts_with("sensor.") {
                    ActorKind::Sensor
                } else {
                    ActorKind::Controller
                };
                self.actors.insert(
                    id,
                    Actor {
                        id,
                        kind,
                        catalogue_idx,
                        role,
                        parent,
                        pose,
                        attributes,
                        topics: Vec::new(),
                    },
                );
                id
            }
            None if type_id == friction::TYPE_ID => {
                self.spawn_friction(catalogue_idx, pose, role, attributes)?
            }
            None => return Err(SpawnError::OfTheMap(type_id.to_owned())),
        };
        self.changed();
        Ok(id)
    }

    fn spawn_vehicle(
        &mut self,
        model: &'static VehicleModel,
        catalogue_idx: u32,
        pose: Pose,
        role: &str,
        given: &BTreeMap<String, String>,
    ) -> Result<ActorId, SpawnError> {
        let mut attributes = self.catalogue.entries[catalogue_idx as usize]
            .attributes
            .clone();
        for (name, value) in given {
            check_attribute(model, name, value, &attributes)?;
            attributes.insert(name.clone(), value.clone());
        }
        let tint_rgb = attributes
            .get("color")
            .and_then(|text| catalogue::parse_color(text))
            .unwrap_or(model.colors[0]);
        if let Some(obstacle) = self.obstacle(model, &pose) {
            return Err(SpawnError::Occupied {
                type_id: model.type_id.to_owned(),
                obstacle,
            });
        }
        let id = self.new_id();
        let mut vehicle = Vehicle::new(&mut self.physics, model, id.0, &pose.isometry());
        vehicle.tint_rgb = tint_rgb;
        vehicle.switches.sticky_control = attributes
            .get("sticky_control")
            .is_none_or(|value| value == "true");
        self.vehicles.insert(id, vehicle);
        let role = role.to_owned();
        self.actors.insert(
            id,
            Actor {
                id,
                kind: ActorKind::Vehicle,
                catalogue_idx,
                role,
                parent: None,
                pose,
                attributes,
                topics: Vec::new(),
            },
        );
        Ok(id)
    }

    fn spawn_friction(
        &mut self,
        catalogue_idx: u32,
        pose: Pose,
        role: &str,
        attributes: &BTreeMap<String, String>,
    ) -> Result<ActorId, SpawnError> {
        let type_id = friction::TYPE_ID.to_owned();
        FrictionBox::new(&pose, attributes).map_err(|(name, value, allowed)| {
            SpawnError::Attribute {
                type_id,
                name,
                value,
                allowed,
            }
        })?;
        let id = self.new_id();
        let (role, attributes) = (role.to_owned(), attributes.clone());
        let actor = Actor {
            id,
            kind: ActorKind::Prop,
            catalogue_idx,
            role,
            parent: None,
            pose,
            attributes,
            topics: Vec::new(),
        };
        self.actors.insert(id, actor);
        self.refresh_friction();
        Ok(id)
    }

    /// Reads the friction areas from the actors, after one came, went or moved.
    pub(crate) fn refresh_friction(&mut self) {
        let Some(kind) = self.catalogue_idx(friction::TYPE_ID) else {
            return;
        };
        let areas = self
            .actors
            .values()
            .filter(|actor| actor.catalogue_idx == kind);
        self.friction_boxes = areas
            .filter_map(|actor| FrictionBox::new(&actor.pose, &actor.attributes).ok())
            .collect();
    }

    fn spawn_walker(
        &mut self,
        type_id: &str,
        catalogue_idx: u32,
        pose: Pose,
        role: &str,
        given: &BTreeMap<String, String>,
    ) -> Result<ActorId, SpawnError> {
        let model_idx = walker_models()
            .iter()
            .position(|model| model.type_id == type_id)
            .expect("the catalogue lists only these");
        let mut attributes = self.catalogue.entries[catalogue_idx as usize]
            .attributes
            .clone();
        for (name, value) in given {
            check_walker_attribute(type_id, name, value, &attributes)?;
            attributes.insert(name.clone(), value.clone());
        }
        let height_m = walker_models()[model_idx].shape.height_m;
        let [x, y, z] = pose.translation_m;
        let feet_m = self.lifted(Vector3::new(x, y, z - 0.5 * height_m), height_m);
        let is = |name: &str| attributes.get(name).is_some_and(|value| value == "true");
        let walker = Walker {
            invincible: is("is_invincible"),
            seated: is("use_wheelchair"),
            ..Walker::new(model_idx as u16, feet_m.into(), pose.yaw_rad())
        };
        if let Some(obstacle) = self.walker_obstacle(&walker) {
            return Err(SpawnError::Occupied {
                type_id: type_id.to_owned(),
                obstacle,
            });
        }
        let id = self.new_id();
        self.walkers.insert(id, walker);
        let role = role.to_owned();
        self.actors.insert(
            id,
            Actor {
                id,
                kind: ActorKind::Walker,
                catalogue_idx,
                role,
                parent: None,
                pose,
                attributes,
                topics: Vec::new(),
            },
        );
        Ok(id)
    }

    /// What a new walker would touch.
    fn walker_obstacle(&self, walker: &Walker) -> Option<String> {
        let standing = walker.standing();
        let (body, at) = standing.whole_body(&self.physics);
        for (id, other) in &self.vehicles {
            let (centre, half) = chassis_box(other.model);
            let mut other_at = self.physics.engine_pose(&other.pose(&self.physics));
            other_at.translation += other_at.rotation * centre;
            if intersection_test(&at, &body, &other_at, &Cuboid::new(half))
                .is_ok_and(|hit| hit.intersecting)
            {
                return Some(format!("{} (actor {id})", other.model.type_id));
            }
        }
        for (id, other) in &self.walkers {
            let (other_body, other_at) = other.standing().whole_body(&self.physics);
            if intersection_test(&at, &body, &other_at, &other_body)
                .is_ok_and(|hit| hit.intersecting)
            {
                return Some(format!("{} (actor {id})", other.model().type_id));
            }
        }
        standing
            .is_stuck(&self.physics)
            .then(|| "scenery".to_owned())
    }

    /// What a body of this model would touch at `pose`.
    fn obstacle(&self, model: &VehicleModel, pose: &Pose) -> Option<String> {
        let physics: &Physics = &self.physics;
        let (centre, half) = chassis_box(model);
        let shape = Cuboid::new(half);
        let mut at = physics.engine_pose(&pose.isometry());
        at.translation += at.rotation * centre;
        self.someone_in(&at, &shape).or_else(|| {
            physics
                .touches_scenery(&at, &shape)
                .then(|| "scenery".to_owned())
        })
    }

    /// The vehicle, walker or prop that a box would touch.
    pub(crate) fn someone_in(&self, at: &EnginePose, shape: &Cuboid) -> Option<String> {
        let physics = &self.physics;
        for (id, other) in &self.vehicles {
            // A collider made since the last step has its pose only from the next step on; the
            // body's is always current.
            let (other_centre, other_half) = chassis_box(other.model);
            let mut other_at = physics.engine_pose(&other.pose(physics));
            other_at.translation += other_at.rotation * other_centre;
            // An error would mean that two boxes cannot be tested against each other.
            if intersection_test(at, shape, &other_at, &Cuboid::new(other_half))
                .is_ok_and(|hit| hit.intersecting)
            {
                return Some(format!("{} (actor {id})", other.model.type_id));
            }
        }
        for (id, walker) in &self.walkers {
            let (body, body_at) = walker.standing().whole_body(physics);
            if walker.collides
                && intersection_test(at, shape, &body_at, &body).is_ok_and(|hit| hit.intersecting)
            {
                return Some(format!("{} (actor {id})", walker.model().type_id));
            }
        }
        self.props
            .values()
            .find_map(|prop| self.prop_in(prop, at, shape))
    }

    /// Removes an actor and what is attached to it; returns everything that went, by rising id.
    pub fn destroy(&mut self, actor: ActorId) -> Result<Vec<ActorId>, DestroyError> {
        let target = self
            .actors
            .get(&actor)
            .ok_or(DestroyError::Unknown(actor))?;
        if !matches!(
            target.kind,
            ActorKind::Vehicle
                | ActorKind::Walker
                | ActorKind::Prop
                | ActorKind::Sensor
                | ActorKind::Controller
        ) {
            let type_id = self.catalogue.entries[target.catalogue_idx as usize]
                .type_id
                .clone();
            return Err(DestroyError::OfTheMap { actor, type_id });
        }
        let mut gone = vec![actor];
        // Parents have smaller ids, so one pass finds whole chains.
        for other in self.actors.values() {
            if other.parent.is_some_and(|parent| gone.contains(&parent)) {
                gone.push(other.id);
            }
        }
        for id in &gone {
            self.actors.remove(id);
            self.speed_limits.remove(id);
            self.booms.remove(id);
            self.walkers.remove(id);
            self.drop_prop(*id);
            if let Some(vehicle) = self.vehicles.remove(id) {
                self.physics.engine.remove_body(vehicle.body);
            }
        }
        self.refresh_friction();
        self.changed();
        Ok(gone)
    }
}

/// Only attributes the model has, and of those only the ones that may differ.
fn check_attribute(
    model: &VehicleModel,
    name: &str,
    value: &str,
    known: &BTreeMap<String, String>,
) -> Result<(), SpawnError> {
    let refuse = |allowed: String| SpawnError::Attribute {
        type_id: model.type_id.to_owned(),
        name: name.to_owned(),
        value: value.to_owned(),
        allowed,
    };
    if FIXED_ATTRIBUTES.contains(&name) {
        return if known.get(name).is_some_and(|is| is == value) {
            Ok(())
        } else {
            Err(refuse(format!("it is fixed at {:?}", known[name])))
        };
    }
    match name {
        "color" if catalogue::parse_color(value).is_none() => {
            Err(refuse("it must be \"r,g,b\" with each 0 to 255".to_owned()))
        }
        "sticky_control" if !["true", "false"].contains(&value) => {
            Err(refuse("it must be true or false".to_owned()))
        }
        // Who rides: every rider looks alike.
        "driver_id" if known.contains_key(name) => match value.parse::<u32>() {
            Ok(_) => Ok(()),
            Err(_) => Err(refuse("it must be a whole number from 0".to_owned())),
        },
        "color" | "sticky_control" => Ok(()),
        _ => Err(refuse(format!(
            "a vehicle has only {}",
            known.keys().cloned().collect::<Vec<_>>().join(", ")
        ))),
    }
}

/// A walker's attributes: which may be set, and to what.
fn check_walker_attribute(
    type_id: &str,
    name: &str,
    value: &str,
    known: &BTreeMap<String, String>,
) -> Result<(), SpawnError> {
    let refuse = |allowed: String| SpawnError::Attribute {
        type_id: type_id.to_owned(),
        name: name.to_owned(),
        value: value.to_owned(),
        allowed,
    };
    let Some(is) = known.get(name) else {
        return Err(refuse(format!(
            "this walker has only {}",
            known.keys().cloned().collect::<Vec<_>>().join(", ")
        )));
    };
    match name {
        "is_invincible" | "use_wheelchair" if value != "true" && value != "false" => {
            Err(refuse("it must be true or false".to_owned()))
        }
        // What scripts read; the walker's speed is that of its control.
        "is_invincible" | "use_wheelchair" | "speed" => Ok(()),
        _ if is == value => Ok(()),
        _ => Err(refuse(format!("it is fixed at {is:?}"))),
    }
}

/// The pose with a quaternion of unit length; one that already is keeps its bits.
pub(crate) fn unit_pose(pose: Pose, origin_m: [f64; 3]) -> Result<Pose, &'static str> {
    if !pose
        .translation_m
        .iter()
        .chain(&pose.rotation_xyzw)
        .all(|x| x.is_finite())
    {
        return Err("has a value that is not finite");
    }
    // Maps in national grids lie thousands of kilometres from zero; what counts is the map's own
    // middle.
    if pose
        .translation_m
        .iter()
        .zip(origin_m)
        .any(|(x, origin)| (x - origin).abs() > 1e5)
    {
        return Err("lies more than 100 km from the middle of the map");
    }
    let norm = pose.rotation_xyzw.iter().map(|x| x * x).sum::<f64>().sqrt();
    if !(0.5..=2.0).contains(&norm) {
        return Err("has a rotation that is not a unit quaternion");
    }
    if (norm - 1.0).abs() < 1e-12 {
        return Ok(pose);
    }
    Ok(Pose {
        rotation_xyzw: pose.rotation_xyzw.map(|x| x / norm),
        ..pose
    })
}
