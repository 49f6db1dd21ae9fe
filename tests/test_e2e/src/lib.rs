//! What the end-to-end tests share: a daemon in a sandbox, and the test itself as a client on the
//! same private bus ([`test_kit::client`]).
//!
//! In reading order: [`processes`], [`workers`], [`recording`], [`exports`], [`carla`], [`benchmark`],
//! [`judged`], [`kept`], [`stage`] and [`laboratory`].

#![forbid(unsafe_code)]

pub mod benchmark;
pub mod carla;
pub mod exports;
pub mod judged;
pub mod kept;
pub mod laboratory;
pub mod processes;
pub mod recording;
pub mod stage;
pub mod workers;

pub use processes::{mount_namespace, not_tested, python_package, venv_program};
pub use stage::Stage;
pub use test_kit::client::{
    ask, assert_nothing_left, counter, document, join_bus, reader, step, wait_readers,
};
pub use test_kit::programs::{spawn_consumer, spawn_daemon, start_daemon};
pub use test_kit::small_rig::{SMALL_RIG, SMALL_RIG_TOPICS};
