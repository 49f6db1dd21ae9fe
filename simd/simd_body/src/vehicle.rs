//! Vehicle bodies made from a few numbers.

mod bodywork;
mod car;
pub mod door;
mod equipment;
mod fittings;
mod heavy;
mod loft;
mod meshes;
mod microbus;
pub mod outfit;
mod outline;
mod shape;
mod two_wheeler;
mod wheel;

pub use meshes::{VehicleMeshes, WheelSite, outfitted_meshes, vehicle_meshes};
pub use shape::{BodyStyle, VehicleShape};
