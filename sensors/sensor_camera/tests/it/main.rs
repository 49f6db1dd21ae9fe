//! Tests of `sensor_camera`: one program for all of them, so that it is linked once.

mod beside;
mod blur;
mod common;
mod cost;
mod debug;
mod event_model;
mod events;
mod events_gpu;
mod exact;
mod faces;
mod hiding;
mod lanes;
mod layout;
mod lens;
mod lists;
mod optics;
mod rasteriser;
mod shadow_memory;
mod shadows;
mod tiles;
mod together;
