//! What the end-to-end tests share: a daemon in a sandbox, and the test itself as a client on the
//! same private bus ([`test_kit::client`]).
//!
//! In reading order: [`small_rig`] (the launch file), [`processes`], [`recording`], [`exports`], [`carla`],
//! [`benchmark`] and [`judged`].

#![forbid(unsafe_code)]

pub mod benchmark;
pub mod carla;
pub mod exports;
pub mod judged;
pub mod processes;
pub mod recording;
pub mod small_rig;

pub use processes::{python_package, spawn_consumer, spawn_daemon, start_daemon, venv_program};
pub use small_rig::{SMALL_RIG, SMALL_RIG_TOPICS};
pub use test_kit::client::{
    ask, assert_nothing_left, counter, document, join_bus, reader, step, wait_readers,
};
