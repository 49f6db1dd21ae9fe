//! Bodies of actors as triangle meshes: vehicles, people and props.
//!
//! Every mesh is a pure function of a few numbers (a *shape*), fits the shape's box to 1 cm and has
//! levels of detail. Nothing here knows maps, physics or GPUs.
//!
//! | Module | What it holds |
//! |---|---|
//! | [`vehicle`] | ten styles of bodies, wheels, [doors](vehicle::door), [outfits](vehicle::outfit) |
//! | [`person`] | twelve rigid parts, their gait, [bones](person::bones) with CARLA's names |
//! | [`prop`] | objects that are actors (`static.prop.*`) |
//! | [`solid`], `stack`, `vector` | the simple solids of which the others are made |
//!
//! ```
//! use simd_body::{BodyStyle, VehicleShape, vehicle_meshes};
//!
//! let shape = VehicleShape {
//!     style: BodyStyle::Saloon,
//!     half_m: [2.4, 1.05, 0.75],
//!     wheel_radius_m: 0.34,
//!     wheelbase_m: 2.9,
//! };
//! let meshes = vehicle_meshes(&shape);
//! assert_eq!(meshes.wheels.len(), 4);
//! assert_eq!(meshes.body.lods.len(), 4);
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod vehicle;

pub mod person;

pub mod prop;

pub mod solid;
mod stack;
mod vector;

pub use person::{PersonMeshes, PersonShape, person_meshes};
pub use vehicle::door::{Door, DoorMeshes, DoorMotion, door_meshes, outfitted_door_meshes};
pub use vehicle::outfit::Outfit;
pub use vehicle::{
    BodyStyle, VehicleMeshes, VehicleShape, WheelSite, outfitted_meshes, vehicle_meshes,
};
