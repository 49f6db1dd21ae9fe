//! `gantry`: starts, watches and stops a set of processes, and looks at what they do.
//!
//! Six ideas, a folder each: `up` runs a launch file; `look` shows what is on the bus (`top`,
//! `graph`, `topic`); `doctor` examines the machine; `sensor` shows
//! and judges profiles of sensors; `new` makes projects; `carla` takes over what
//! users of CARLA bring (`map`, `carla-root`). None needs another, but that a server of `carla-root`
//! is run by `up`. Every other word runs the program `gantry-WORD` beside this one (`external`), as
//! `cargo` and `git` do.
//!
//! The tool reads topics like any consumer and sends the daemon no commands; it only starts and
//! stops it.

mod bus;
mod carla;
mod cli;
mod doctor;
mod external;
mod look;
mod new;
mod programs;
mod sensor;
mod up;

use std::process::ExitCode;

use carla::{carla_root, map};
use cli::{Args, TopicWord, Word};
use look::{graph, top, topic};

/// The program `gantry`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    if let Some(called) = carla_root::is_front() {
        return launch_cli::run_main(|| carla_root::run_front(&called));
    }
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
            doctor::run(doctor, &args.common, up::quickstart_bytes())
        }
        Word::Map(map) => {
            args.common.init_logging();
            map::run(map, &args.common)
        }
        Word::New(new) => {
            args.common.init_logging();
            new::run(new)
        }
        Word::Sensor(sensor) => {
            args.common.init_logging();
            sensor::run(sensor, &args.common)
        }
        Word::CarlaRoot(root) => {
            args.common.init_logging();
            carla_root::run(root)
        }
        Word::CarlaServer(server) => carla_root::run_server(server, &args.common),
        Word::External(words) => external::run(words, &args.common),
    })
}
