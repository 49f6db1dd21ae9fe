//! People made from a few numbers: twelve rigid parts, and how they move.

pub mod bones;
mod gait;
mod meshes;
mod parts;
mod shape;
mod wheelchair;

pub use gait::{N_PARTS, Part, Posture, Skeleton, stride_m};
pub use meshes::{PersonMeshes, mesh_of, person_meshes};
pub use shape::{Age, Hair, Look, PersonShape};
