//! `gantry`: starts, watches and stops a set of processes (`up`), shows what they do (`top`,
//! `graph`, `topic`), and examines the machine (`doctor`) and maps (`map`).
//!
//! Every other word runs the program `gantry-WORD` beside this one, as `cargo` and `git` do.
//! The tool reads topics like any consumer and sends the daemon no commands; it only starts and
//! stops it.

mod bus;
mod census;
mod cli;
mod doctor;
mod external;
mod graph;
mod map;
mod new;
mod programs;
mod reading;
mod top;
mod topic;
mod up;

use std::process::ExitCode;

use cli::{Args, TopicWord, Word};

fn main() -> ExitCode {
    launch_cli::run(|args: Args| match &args.word {
        Word::Up(up) => up::run(up, &args.common),
        Word::Topic(topic) => {
            // A screen has no room for log lines.
            if !matches!(topic.word, TopicWord::Top(_)) {
                args.common.init_logging();
            }
            topic::run(topic, &args.common)
        }
        Word::Top(top) => top::run(top, top::Tables::Both, &args.common),
        Word::Graph(graph) => {
            args.common.init_logging();
            graph::run(graph, &args.common)
        }
        Word::Doctor(doctor) => {
            args.common.init_logging();
            doctor::run(doctor, &args.common)
        }
        Word::Map(map) => {
            args.common.init_logging();
            map::run(map, &args.common)
        }
        Word::New(new) => {
            args.common.init_logging();
            new::run(new)
        }
        Word::External(words) => external::run(words, &args.common),
    })
}
