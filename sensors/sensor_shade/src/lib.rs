//! Shading of surfaces on processors: eight pixels at a time, with the same bits on every one.
//!
//! WGSL of the cameras is the only description of what a pixel keeps of a surface and what it looks
//! like. [`resolving`] and [`shading`] are generated from it by a test of `sensor_camera`, which fails
//! when they differ; `./gantry bless` writes them anew. Everything else here is what the generated
//! code calls.
//!
//! - A value of WGSL is one per lane: `f32` is a [`Lanes`], `u32` and `i32` are its words, `bool` its
//!   mask, a vector is an array of these.
//! - A branch runs for the lanes that take it, and is left out if there are none; a loop runs until
//!   every lane has left it. Overrides are ordinary branches.
//! - Uniforms and lists are words, as a GPU gets them. Images belong to the caller, who implements
//!   [`shading::Maps`].
//! - Nothing is fused, reordered or taken from a mathematical library: see [`functions`].
//!
//! Modules in reading order: [`vectors`], [`functions`], [`packing`], [`memory`], [`images`],
//! [`resolving`], [`shading`].
//!
//! [`Lanes`]: sensor_core::vector_lanes::Lanes

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod functions;
pub mod images;
pub mod memory;
pub mod packing;
pub mod vectors;

#[rustfmt::skip]
#[allow(
    missing_docs,
    unused,
    clippy::all,
    reason = "generated; its names and its order are those of the shaders"
)]
pub mod resolving;

#[rustfmt::skip]
#[allow(
    missing_docs,
    unused,
    clippy::all,
    reason = "generated; its names and its order are those of the shaders"
)]
pub mod shading;
