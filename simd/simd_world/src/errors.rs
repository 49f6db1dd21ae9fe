//! Why an actor was not made, not removed or not changed.

use std::collections::BTreeMap;

use schema_frames::limits::{MAX_ACTOR_TEXT_BYTES, MAX_ACTORS, TextLimit};
use schema_types::ActorId;

/// Why a world cannot hold an actor more, or the actors of a map.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoRoom {
    /// There are as many as there may be.
    #[error(
        "a world has at most {MAX_ACTORS} actors, those of its map included; destroy some first"
    )]
    Actors,
    /// Every id has been given to an actor before.
    #[error(
        "all ids of actors, some thousand million, have been used since the simulator started; start it anew"
    )]
    Ids,
    /// One of its texts is too long.
    #[error(transparent)]
    Text(#[from] TextLimit),
    /// All texts together are.
    #[error(
        "the roles and attributes of all actors together are longer than {} MiB, which is the most; destroy some actors, or use shorter texts",
        MAX_ACTOR_TEXT_BYTES >> 20
    )]
    Texts,
}

/// Why an actor was not made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SpawnError {
    /// There is no such type in the catalogue.
    #[error("unknown type {0:?}; world/catalogue lists what can be spawned")]
    UnknownType(String),
    /// Actors of this type come with the map.
    #[error("{0:?} belongs to the map and cannot be spawned")]
    OfTheMap(String),
    /// The pose cannot be used.
    #[error("cannot spawn {type_id:?}: its pose {problem}")]
    Pose {
        /// Catalogue id.
        type_id: String,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// The world has no room for it.
    #[error("cannot spawn {type_id:?}: {source}")]
    NoRoom {
        /// Catalogue id.
        type_id: String,
        /// Of what there is too much.
        source: NoRoom,
    },
    /// The parent does not exist.
    #[error("cannot attach {type_id:?}: there is no actor {parent}")]
    Parent {
        /// Catalogue id.
        type_id: String,
        /// The id asked for.
        parent: ActorId,
    },
    /// The place is taken.
    #[error(
        "spawn failed because of collision at spawn position: {type_id:?} would touch {obstacle}"
    )]
    Occupied {
        /// Catalogue id.
        type_id: String,
        /// What it would touch.
        obstacle: String,
    },
    /// The attribute is unknown or its value cannot be used.
    #[error("cannot spawn {type_id:?}: attribute {name:?} is {value:?}, but {allowed}")]
    Attribute {
        /// Catalogue id.
        type_id: String,
        /// Name of the attribute.
        name: String,
        /// Its value.
        value: String,
        /// What is allowed.
        allowed: String,
    },
    /// The map does not have this spawn point.
    #[error("spawn point {idx} does not exist: map {map:?} has {n_points}, counted from 0")]
    SpawnPoint {
        /// Index asked for.
        idx: usize,
        /// Name of the map.
        map: String,
        /// Number of spawn points.
        n_points: usize,
    },
}

/// An attribute that cannot have the value it was given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct BadAttribute {
    pub name: String,
    pub value: String,
    /// What is allowed instead, as the end of a sentence.
    pub allowed: String,
}

/// The attributes of a type with the `given` ones in their place. `refusal` is told name, value and all
/// attributes, and says what is allowed instead.
///
/// # Errors
/// The first given attribute that is refused.
pub(crate) fn checked_attributes(
    mut attributes: BTreeMap<String, String>,
    given: &BTreeMap<String, String>,
    refusal: impl Fn(&str, &str, &BTreeMap<String, String>) -> Option<String>,
) -> Result<BTreeMap<String, String>, BadAttribute> {
    for (name, value) in given {
        if let Some(allowed) = refusal(name, value, &attributes) {
            return Err(BadAttribute {
                name: name.clone(),
                value: value.clone(),
                allowed,
            });
        }
        attributes.insert(name.clone(), value.clone());
    }
    Ok(attributes)
}

impl BadAttribute {
    /// The error of spawning a `type_id` with it.
    pub fn of(self, type_id: &str) -> SpawnError {
        SpawnError::Attribute {
            type_id: type_id.to_owned(),
            name: self.name,
            value: self.value,
            allowed: self.allowed,
        }
    }
}

/// Why an actor was not removed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DestroyError {
    /// The actor does not exist.
    #[error("unable to destroy actor {0}: not found")]
    Unknown(ActorId),
    /// Actors of this type come with the map.
    #[error("unable to destroy actor {actor}: {type_id:?} belongs to the map")]
    OfTheMap {
        /// The actor.
        actor: ActorId,
        /// Catalogue id.
        type_id: String,
    },
}

/// Why something could not be done to an actor.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ActorError {
    /// The actor does not exist.
    #[error("actor {0} not found; it may have been destroyed")]
    Unknown(ActorId),
    /// The actor is of another kind.
    #[error("actor {actor} is a {type_id}, but this needs a {needed}")]
    WrongKind {
        /// The actor.
        actor: ActorId,
        /// What it is.
        type_id: String,
        /// Which kinds would have been right.
        needed: &'static str,
    },
    /// A value cannot be used.
    #[error("{what} of actor {actor} {problem}")]
    Value {
        /// The actor.
        actor: ActorId,
        /// Which quantity.
        what: &'static str,
        /// What is wrong with it.
        problem: &'static str,
    },
}

/// Why an action on an actor's body was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ActionError {
    /// The actor cannot be acted on.
    #[error(transparent)]
    Actor(#[from] ActorError),
    /// A number of the vehicle's data cannot be used.
    #[error(transparent)]
    Physics(#[from] PhysicsError),
    /// A value cannot be used; the sentence names it and what is allowed.
    #[error("{0}")]
    Value(String),
}

/// A number outside the range that is allowed for it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name} is {value}, but must be {low} to {high}")]
pub struct OutOfRange {
    /// Which quantity, with its unit.
    pub name: &'static str,
    /// The refused number.
    pub value: f32,
    /// Least allowed number.
    pub low: f32,
    /// Greatest allowed number.
    pub high: f32,
}

impl OutOfRange {
    /// Checks a number against its range, both ends included.
    ///
    /// # Errors
    /// If the number lies outside or is not a number.
    pub fn check(name: &'static str, value: f32, low: f32, high: f32) -> Result<(), OutOfRange> {
        match value >= low && value <= high {
            true => Ok(()),
            false => Err(OutOfRange {
                name,
                value,
                low,
                high,
            }),
        }
    }
}

/// Why a vehicle cannot get the physical data that a client sends.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PhysicsError {
    /// A number lies outside its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The vehicle has another number of wheels.
    #[error("number of wheels is {found}, but must stay {needed}")]
    Wheels {
        /// Number of wheels in the data.
        found: usize,
        /// Number of wheels of the vehicle.
        needed: usize,
    },
    /// A curve has too few or too many points.
    #[error("{curve} has {found} points, but must have {least} to {most}")]
    PointCount {
        /// Name of the curve.
        curve: &'static str,
        /// Number of its points.
        found: usize,
        /// Least number of points.
        least: usize,
        /// Greatest number of points.
        most: usize,
    },
    /// A point of a curve lies outside the allowed rectangle.
    #[error("{curve} has the point ({}, {}), but points must be 0 to {} and 0 to {}", point[0], point[1], most[0], most[1])]
    Point {
        /// Name of the curve.
        curve: &'static str,
        /// The refused point.
        point: [f32; 2],
        /// Greatest allowed coordinates.
        most: [f32; 2],
    },
    /// A curve goes back along its first axis.
    #[error("{curve} goes from {from} back to {to}, but must rise")]
    Falling {
        /// Name of the curve.
        curve: &'static str,
        /// First coordinate of a point.
        from: f32,
        /// First coordinate of the next point.
        to: f32,
    },
}

/// Why a traffic light was not changed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum LightError {
    #[error("actor {0} is not a traffic light")]
    NotALight(ActorId),
    #[error(transparent)]
    Actor(#[from] ActorError),
    #[error("state is {0:?}, but must be red, yellow, green, off or unknown")]
    UnknownState(String),
    #[error("state is {0:?}, but only red, yellow and green last for a set time")]
    UntimedState(&'static str),
    #[error("secs is {secs}, but must be {low} to {high}")]
    Secs { secs: f64, low: f64, high: f64 },
}

/// Why objects or lamps of the scenery were not changed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum SceneryError {
    #[error("object {object} is not in map {map:?}; the command scenery lists those that are")]
    UnknownObject { object: u32, map: String },
    #[error("lamp {lamp} is not in map {map:?}, which has {n_lamps}")]
    UnknownLamp {
        lamp: u32,
        map: String,
        n_lamps: usize,
    },
    #[error("intensity_lm of lamp {lamp} is {lumen}, but must be 0 to 1e9")]
    Intensity { lamp: u32, lumen: f32 },
    #[error("group of lamp {lamp} is {group}, but must be 0 to 4")]
    Group { lamp: u32, group: u8 },
}

/// Why a walker's bones were not held.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum SkeletonError {
    #[error("there is no bone {0:?}; `read` lists them")]
    UnknownBone(String),
    #[error(
        "bone {bone:?} needs a place within {max_offset_m} m of its parent and a unit quaternion"
    )]
    BonePose { bone: String, max_offset_m: f64 },
    #[error("a pose cannot be blended by {0}; give 0 (the gait) to 1 (the own pose)")]
    Blend(f64),
}
