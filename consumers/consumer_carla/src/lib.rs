//! A CARLA 0.9.16 server's front: stock clients connect, look at Gantry's world and drive in it.
//!
//! A consumer like any other: everything it knows comes from snapshots and documents, everything it
//! does goes over `control/world` and
//! `control/vehicles`. `docs/carla-compatibility.md` says what works.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod axes;
pub mod blueprints;
pub mod commander;
pub mod episode;
pub mod feeds;
pub mod fields;
pub mod gateway;
pub mod msgpack;
pub mod navigation;
pub mod recorder;
pub mod relay;
pub mod rpc;
pub mod sensors;
pub mod server;
pub mod shapes;
pub mod stream;
pub mod v2x;
pub mod world;
