//! Every program in one file, which is what packages carry: fourteen files would each hold the bus,
//! the command line and the standard library once more.
//!
//! Which program a process is, the name by which it was called says. A package calls this file
//! `gantry`; the other names are links to it or scripts that start it, in the same folder
//! (`launch/package/package.py`). Under every other name it is `gantry` too, whose folders for CARLA
//! link to it by names of their own. Under cargo's name it lists its programs.

#![forbid(unsafe_code)]

use std::path::Path;
use std::process::ExitCode;

/// A program's name and where it begins.
type Program = (&'static str, fn() -> ExitCode);

const PROGRAMS: [Program; 14] = [
    ("gantry", gantry::main),
    ("gantry-bench", consumer_bench::main),
    ("gantry-bridge", consumer_bridge::main),
    ("gantry-carla", consumer_carla::main),
    ("gantry-dataset", consumer_dataset::main),
    ("gantry-desk", consumer_desk::main),
    ("gantry-drive", consumer_drive::main),
    ("gantry-export", consumer_export::main),
    ("gantry-record", consumer_record::main),
    ("gantry-render", simd_render::main),
    ("gantry-replay", consumer_replay::main),
    ("gantry-rerun", consumer_rerun::main),
    ("gantry-view", consumer_view::main),
    ("simd", simd::main),
];

fn main() -> ExitCode {
    let called = std::env::args_os().next().unwrap_or_default();
    let called = Path::new(&called).file_name().unwrap_or_default();
    if called == env!("CARGO_BIN_NAME") {
        PROGRAMS.iter().for_each(|(name, _)| println!("{name}"));
        return ExitCode::SUCCESS;
    }
    match PROGRAMS.into_iter().find(|(name, _)| called == *name) {
        Some((name, main)) => {
            launch_cli::programs::take_name(name);
            main()
        }
        None => gantry::main(),
    }
}
