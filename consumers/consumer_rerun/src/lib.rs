//! `gantry-rerun`: steps a simulator through a recorded run again and compares every frame with the
//! recording, byte by byte.
//!
//! In reading order: `cli` (what is asked), `script` (what the recording says of the run), `plan`
//! and `children` (the simulator, and a recorder), `live` (the run that is made now), `recorded`
//! (the run of the file), `compare` and `fields` (where two frames differ), `session` (both runs
//! side by side), `report`.

#![forbid(unsafe_code)]

mod children;
mod cli;
mod compare;
mod fields;
mod live;
mod plan;
mod recorded;
mod report;
mod script;
mod session;

use std::process::ExitCode;

/// The program `gantry-rerun`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    launch_cli::run(|args: cli::Args| {
        args.common.init_logging();
        let shutdown = launch_cli::Shutdown::install()?;
        session::run(&args, &shutdown)
    })
}
