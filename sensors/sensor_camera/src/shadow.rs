//! Shadow maps: one square depth map from the sun for each 32 m cell of ground in which a lit
//! camera stands.
//!
//! A map depends on the cell, the sun and the scene only, never on other cameras, so that a new
//! reader does not change another reader's bytes. Static casters are drawn once per cell and sun.
//! Moving casters are drawn over a copy of that map when they have moved, and only the parts of the
//! copy that they covered before are restored. High quality has a second, coarser map of static
//! casters further away.
//!
//! The memory of maps is bounded. If the views of a tick need more maps than fit, they are lit in
//! groups, each of which draws over the maps of the group before. That is slower, but the pictures
//! are the same.

mod cascade;
mod cascade_maps;
mod caster;
mod draw;
mod map;
mod shadow_maps;
mod sheet;
mod tile_maps;

pub(crate) use cascade_maps::{Eye, MapLayout, ShadowLookup};
pub(crate) use draw::SHADOW_WGSL;
pub(crate) use shadow_maps::{Lit, ShadowMaps, ShadowPlans};
pub(crate) use tile_maps::{CasterInput, TileMaps};
