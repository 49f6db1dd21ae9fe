//! Bodies of actors as triangle meshes, made from a few numbers: vehicles, people and props.
//!
//! Everything is a pure function of a shape. No map, no physics, no GPU.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod person;
pub mod prop;
pub mod solid;
mod stack;
mod vector;
pub mod vehicle;

pub use person::{PersonMeshes, PersonShape, person_meshes};
pub use vehicle::door::{Door, DoorMeshes, DoorMotion, door_meshes, outfitted_door_meshes};
pub use vehicle::outfit::Outfit;
pub use vehicle::{
    BodyStyle, VehicleMeshes, VehicleShape, WheelSite, outfitted_meshes, vehicle_meshes,
};
