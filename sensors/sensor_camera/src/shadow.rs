//! Shadow maps: one square map of the sun's view per 32 m cell of the ground in which a lit camera
//! stands.
//!
//! A map depends on the cell, the sun and the scene only, never on who else looks, so that readers
//! change no one's bytes.
//! What stands still is drawn once per cell and sun; what moves is drawn over a copy of it when it
//! has moved, and of that copy only those
//! parts are made good again that were drawn over before. High quality has a second, coarser map of
//! what stands still further away.
//!
//! Maps have a bounded memory. Views that need more of them than fit are lit in groups, one after
//! the other, which draw their maps over
//! those of the groups before: slower, and the same pictures.

mod cascade;
mod cascade_maps;
mod caster;
mod draw;
mod map;
mod shadow_maps;
mod sheet;

pub(crate) use cascade_maps::{Eye, MapLayout, ShadowLookup};
pub(crate) use draw::SHADOW_WGSL;
pub(crate) use shadow_maps::{Lit, ShadowMaps, ShadowPlans};
