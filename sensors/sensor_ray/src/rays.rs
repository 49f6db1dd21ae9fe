//! Rays on the CPU: bundles of neighbouring rays, how they walk a hierarchy, and what they hit in a
//! scene.

mod bundle;
mod cast;
mod caster;
mod hit;
mod outline;
mod walk;

pub(crate) use bundle::{Bundle, GROUP, GROUPS, Hits, RAYS, Sides};
pub(crate) use caster::{Caster, Stacks};
pub use hit::Hit;
pub(crate) use hit::{WorldRay, distances_m, smooth_normal, surface};
