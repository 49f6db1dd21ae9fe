//! Msgpack-rpc as CARLA's clients speak it: bounded values, fields that are read strictly, requests
//! and responses, and a server of connections. Nothing here knows what a method does.
//!
//! The gateway (`gantry-carla`) and the Traffic Manager (`gantry-drive --serve`) are built on it.
//! Modules in reading order: [`msgpack`] (values and their bytes), [`fields`] (reads what clients
//! send), [`message`] (requests and responses), [`budget`] (memory of each connection and of all), [`seats`] (who
//! makes room for whom), [`sock_diag`] and [`owner`] (whose process connects), [`connection`] (time-outs), [`door`]
//! (who comes in), [`server`] (requests and their threads), [`place`] (where gateways find a
//! Traffic Manager), and [`web`] (whether a browser's request may come in).
//!
//! ```
//! use consumer_rpc::fields::Fields;
//! use consumer_rpc::list;
//! use consumer_rpc::message::{self, Request};
//! use consumer_rpc::msgpack::Value;
//!
//! let request = message::parse(list![0u32, 7u32, "set_global_lane_offset", list![0.5f32]])?;
//! let mut args = Fields::new("the arguments", &request.args);
//! assert_eq!((request.id, args.f32()?), (7, 0.5));
//! assert_eq!(message::success(request.id, Value::Nil), [0x94, 1, 7, 0xc0, 0xc0]);
//! # Ok::<(), consumer_rpc::fields::Wrong>(())
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod budget;
pub mod connection;
pub mod door;
pub mod fields;
pub mod message;
pub mod msgpack;
pub mod owner;
pub mod place;
pub mod seats;
pub mod server;
pub mod sock_diag;
pub mod web;
