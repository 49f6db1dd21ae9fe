//! Real processes for tests: start them, wait for a line, pause or kill them, and prove that nothing
//! is left behind.
//!
//! Every test has a [`Sandbox`]: a working directory, a domain, and an iceoryx2 root and prefix of
//! its own. Tests can therefore run side by side, and a test can assert that its own processes left
//! nothing in shared memory. Only processes that a sandbox started are ever signalled. Nothing
//! depends on the speed of the machine: tests wait for conditions, and a limit that only a hang
//! reaches ends them.
//!
//! A test of a program of your own starts with a [`Simulator`], also outside this repository: it
//! steps the world, runs the program, and hands out frames, results and snapshots by tick.
//!
//! In reading order: [`sandbox`], [`process`], [`patience`], [`programs`], [`small_rig`], [`client`],
//! [`simulator`].
//!
//! ```no_run
//! use test_kit::{Setup, Simulator};
//!
//! let mut simulator = Simulator::start(Setup::file("launch.toml").set("scenario.vehicles=0"));
//! let program = simulator.run(env!("CARGO"), &["--version"]);
//! let mut boxes = simulator.results("my_detector/boxes");
//! let tick = simulator.step(3);
//! let found = simulator.result_of(&mut boxes, tick);
//! assert_eq!(found.inputs()[0].tick, tick);
//! drop(found);
//! program.stop().expect_code(0);
//! simulator.finish();
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod client;
pub mod patience;
pub mod process;
pub mod programs;
pub mod sandbox;
pub mod simulator;
pub mod small_rig;

pub use patience::{PATIENCE, eventually};
pub use process::{Ended, Process, output_within};
pub use sandbox::Sandbox;
pub use simulator::{Setup, Simulator};
