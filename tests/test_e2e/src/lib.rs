//! What the end-to-end tests share: a daemon in a sandbox, and the test itself as a client on the
//! same private bus ([`test_kit::client`]).
//!
//! In reading order: [`small_rig`] (the launch file), [`processes`], [`recording`], [`exports`], [`carla`],
//! [`benchmark`], [`judged`], [`kept`], [`stage`] and [`laboratory`].

#![forbid(unsafe_code)]

pub mod benchmark;
pub mod carla;
pub mod exports;
pub mod judged;
pub mod kept;
pub mod laboratory;
pub mod processes;
pub mod recording;
pub mod small_rig;
pub mod stage;

pub use processes::{
    mount_namespace, not_tested, python_package, spawn_consumer, spawn_daemon, start_daemon,
    venv_program,
};
pub use small_rig::{SMALL_RIG, SMALL_RIG_TOPICS};
pub use stage::Stage;
pub use test_kit::client::{
    ask, assert_nothing_left, counter, document, join_bus, reader, step, wait_readers,
};
