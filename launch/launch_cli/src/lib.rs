//! What all binaries share: how they read their flags, log, react to signals and end.
//!
//! Every program of the workspace has the same common options, the same log lines on stderr, the
//! same exit codes and the same subcommands for completions and the man page, because all of them
//! start through this crate. Results go to stdout, everything else to stderr. The crate knows no
//! sensor, no topic and no world.
//!
//! In reading order: [`args`] (flags and subcommands), [`logging`], [`signals`] (Ctrl-C), [`exit`]
//! (exit codes and errors), [`data`] (the data folder), [`limits`] (open files),
//! [`accept`] (accept loops that do not spin), [`files`] (whole files, and only files),
//! [`heap`] (freed memory back to the system), [`values`] (numbers, sizes and times),
//! [`programs`] (where other programs are), [`progress`] (bars while users wait), [`man`] (man
//! pages).
//!
//! A binary derives its arguments, flattens [`CommonArgs`] and passes its work to [`run`]:
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
//! An error decides the exit code, and is printed once with its whole chain:
//!
//! ```
//! use launch_cli::{Exit, wrong_usage};
//!
//! let launch_file_is_wrong = || Err(wrong_usage("unknown key \"mapp\""));
//! assert_eq!(launch_cli::run_main(launch_file_is_wrong), Exit::WrongUsage.code().into());
//! ```

#![warn(missing_docs)]

pub mod accept;
pub mod args;
pub mod bench;
pub mod browser;
pub mod build_info;
pub mod data;
pub mod exit;
pub mod files;
pub mod heap;
pub mod limits;
pub mod logging;
pub mod machine;
pub mod man;
pub mod programs;
pub mod progress;
pub mod signals;
pub mod values;

pub use args::{BasicArgs, CommonArgs, DomainArgs, command, parse};
pub use data::{BadFileName, data_dir, file_in};
pub use exit::{Exit, GpuLost, WrongUsage, run, run_main, wrong_usage};
pub use limits::raise_file_limit;
pub use logging::{ColorWhen, LogFormat};
pub use machine::Machine;
pub use progress::Progress;
pub use signals::Shutdown;
