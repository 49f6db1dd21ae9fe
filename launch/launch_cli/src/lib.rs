//! How every binary starts, logs, hears a signal and ends: shared flags, logging, shutdown, exit
//! codes, completions, man page.
//!
//! A binary derives its arguments, flattens [`CommonArgs`] and hands its work to [`run`]:
//!
//! ```no_run
//! #[derive(clap::Parser)]
//! #[command(name = "gantry-example", version, about = "Reads frames and does nothing with them")]
//! struct Args {
//!     #[command(flatten)]
//!     common: launch_cli::CommonArgs,
//! }
//!
//! fn main() -> std::process::ExitCode {
//!     launch_cli::run(|args: Args| {
//!         args.common.init_logging();
//!         let shutdown = launch_cli::Shutdown::install()?;
//!         while !shutdown.wait(std::time::Duration::from_millis(100)) {}
//!         Ok(launch_cli::Exit::Done)
//!     })
//! }
//! ```
//!
//! Results go to stdout, everything else to stderr. Nothing here knows a sensor, a service or the
//! world.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod args;
pub mod bench;
pub mod data;
pub mod exit;
pub mod limits;
pub mod logging;
pub mod machine;
pub mod signals;

pub use args::{CommonArgs, command, parse};
pub use data::{data_dir, file_in};
pub use exit::{Exit, WrongUsage, run, run_main, wrong_usage};
pub use limits::raise_file_limit;
pub use logging::{ColorWhen, LogFormat};
pub use machine::Machine;
pub use signals::Shutdown;
