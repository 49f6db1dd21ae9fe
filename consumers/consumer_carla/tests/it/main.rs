//! Tests of `consumer_carla`: one program for all of them, so that it is linked once.

mod calls;
mod carla_logs;
mod compatibility;
mod memory;
mod recordings;
mod sockets;
