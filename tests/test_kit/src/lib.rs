//! Real processes for tests: start them, wait for a line, pause or kill them, and prove that nothing
//! is left behind.
//!
//! Every test has a [`Sandbox`]: a working directory, a domain, and an iceoryx2 root and prefix of
//! its own. Tests can therefore run side by side, and a test can assert that its own processes left
//! nothing in shared memory. Only processes that a sandbox started are ever signalled. Nothing
//! depends on the speed of the machine: tests wait for conditions, and a limit that only a hang
//! reaches ends them.
//!
//! In reading order: [`sandbox`], [`process`], [`patience`].
//!
//! ```no_run
//! let sandbox = test_kit::Sandbox::new("example");
//! let mut daemon = sandbox.spawn("simd", &["--domain", sandbox.domain()]);
//! daemon.wait_line("ready");
//! daemon.stop().expect_code(0);
//! assert!(sandbox.leftovers().is_empty());
//! ```

#![forbid(unsafe_code)]

pub mod patience;
pub mod process;
pub mod sandbox;

pub use patience::{PATIENCE, eventually};
pub use process::{Ended, Process};
pub use sandbox::Sandbox;
