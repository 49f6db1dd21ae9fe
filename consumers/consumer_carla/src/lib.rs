//! A CARLA 0.9.16 server's front: stock clients connect, look at Gantry's world and drive in it.
//!
//! A consumer like any other: everything it knows comes from snapshots and documents, everything it
//! does goes over `control/world` and `control/vehicles`. `docs/carla-compatibility.md` says what
//! works.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod lock;
pub mod wire;

pub mod state;

pub mod feeds;

pub mod spawn;
pub mod v2x;

pub mod recorder;

pub mod gateway;

pub mod rpc;

pub mod follower;
pub mod rpc_server;
pub mod stream_server;
