//! Render targets: what views are drawn into, and the textures that hold it.

mod image;
mod kind;
mod pool;
mod targets;

pub(crate) use image::{Image, image, layered_image};
pub(crate) use kind::{Surfaces, Target, TargetSet};
pub(crate) use pool::{PoolKey, TargetPool, Turns};
pub(crate) use targets::{TargetLayer, Targets};
