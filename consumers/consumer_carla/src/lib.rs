//! A CARLA 0.9.16 server in front of Gantry: unmodified clients connect, look at its world and
//! drive in it.
//!
//! The crate is a consumer like any other: it knows only what snapshots, documents and frames on
//! the bus tell, and acts only through `control/world` and `control/vehicles`.
//! `docs/reference/carla-compatibility.md` lists what works.
//!
//! A client's call arrives at [`rpc_server`]; [`rpc`] looks up the function that serves the method;
//! that function reads its arguments with [`wire`], asks the simulator through the commander in
//! [`state`], and answers. Snapshots and frames go the other way: [`follower`] reads snapshots into
//! [`state`] and sends them over the world stream, and [`feeds`] sends the frames of sensors to the
//! connections that [`stream_server`] accepts.
//!
//! The modules in reading order; each uses only those above it:
//!
//! | Module | Holds |
//! |---|---|
//! | [`wire`] | CARLA's protocol: values, structures, messages, axes and units |
//! | [`state`] | the known world, its actors and blueprints, the commander, what clients have set |
//! | [`feeds`] | streams: readers, relays, expected clients, and waiting for readers |
//! | [`v2x`] | radio between vehicles, which the gateway simulates itself |
//! | [`spawn`] | from CARLA's descriptions of actors to commands that spawn them |
//! | [`recorder`] | writes recordings, reports about them and replays them |
//! | [`gateway`] | everything that calls work on |
//! | [`rpc`] | the calls, one module per area |
//! | [`follower`], [`rpc_server`], [`stream_server`] | the threads |
//!
//! A gateway serves calls without any connection, and those that need no simulator without a bus:
//!
//! ```
//! use std::sync::Arc;
//!
//! use consumer_carla::feeds::Feeds;
//! use consumer_carla::gateway::Gateway;
//! use consumer_carla::state::{commander::commander, known_world::World};
//! use consumer_carla::wire::requests::{Answer, parse};
//! use consumer_carla::{list, rpc};
//! use consumer_rpc::budget::Account;
//!
//! let world = Arc::new(World::default());
//! let (commander, _work) = commander();
//! let gateway = Gateway::new(world.clone(), commander, Arc::new(Feeds::new(world)), 2001);
//!
//! // What a client sends for `client.get_server_version()`, decoded from msgpack.
//! let request = parse(list![0u32, 7u32, "version", list![list![false]]])?;
//! let outcome = rpc::serve(&gateway, &Account::of(1), &request);
//! assert_eq!(outcome, Ok(Answer::Value("0.9.16".into())));
//! # Ok::<(), consumer_carla::wire::fields::Wrong>(())
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

/// A list of msgpack values: `list![1u32, "text", 0.5f32]`.
pub use consumer_rpc::list;

mod stages;
pub mod wire;

pub mod state;

pub mod feeds;

pub mod v2x;

pub mod spawn;

pub mod recorder;

pub mod gateway;

pub mod rpc;

pub mod follower;
mod program;
pub mod rpc_server;
pub mod stream_server;

pub use program::main;
