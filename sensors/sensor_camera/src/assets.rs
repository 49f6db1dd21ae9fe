//! The meshes of an episode, with their lamps and what culling needs of each instance, and the same
//! meshes on the GPU.

mod bounds;
mod emitter;
mod free_ranges;
mod gpu_assets;
mod mesh_draw;
mod meshes;
mod switched;

pub(crate) use bounds::{Bounds, Reach};
pub(crate) use emitter::Emitter;
pub(crate) use gpu_assets::GpuAssets;
pub(crate) use mesh_draw::{MeshDraw, Sphere, bounds_of, matrix_rows, quaternion};
pub(crate) use meshes::Meshes;
pub(crate) use switched::{StillLamp, words as switched_words};
