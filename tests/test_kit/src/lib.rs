//! Real processes for tests: start, wait for a line, pause, kill −9, and prove that nothing is
//! left.
//!
//! Every test has a [`Sandbox`]: a working directory, a domain and an iceoryx2 root and prefix of
//! its own, so that tests can run
//! side by side and "nothing left behind" is a fact. Only processes that a sandbox started are ever
//! signalled.
//! Nothing here depends on the speed of the machine: conditions are waited for, and a watchdog ends
//! what hangs.

#![forbid(unsafe_code)]

pub mod patience;
pub mod process;
pub mod sandbox;

pub use patience::{PATIENCE, eventually};
pub use process::{Ended, Process};
pub use sandbox::Sandbox;
