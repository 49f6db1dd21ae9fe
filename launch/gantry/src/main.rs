//! `gantry`: starts, watches and stops a set of processes (`up`), shows topics (`topic`), and
//! examines the machine (`doctor`) and maps (`map`).
//!
//! Every other word runs the program `gantry-WORD` beside this one, as `cargo` and `git` do.
//! The tool reads topics like any consumer and sends the daemon no commands; it only starts and
//! stops it.

mod bus;
mod cli;
mod doctor;
mod external;
mod map;
mod programs;
mod topic;
mod up;

use std::process::ExitCode;

use cli::{Args, Word};

fn main() -> ExitCode {
    launch_cli::run(|args: Args| match &args.word {
        Word::Up(up) => up::run(up, &args.common),
        Word::Topic(topic) => {
            args.common.init_logging();
            topic::run(topic, &args.common)
        }
        Word::Doctor(doctor) => {
            args.common.init_logging();
            doctor::run(doctor, &args.common)
        }
        Word::Map(map) => {
            args.common.init_logging();
            map::run(map, &args.common)
        }
        Word::External(words) => external::run(words, &args.common),
    })
}
