//! What strangers hand to Gantry, as functions over any bytes: whatever comes, a function returns.
//!
//! `fuzz/` runs the same functions under libFuzzer, which looks for new paths through the code for as
//! long as it may; `tests/seeded.rs` runs them on seeds changed at random, the same every time.
//!
//! In reading order: [`targets`], [`gpu_peers`], [`seeds`], [`crafted`], [`mutate`].

#![forbid(unsafe_code)]

pub mod crafted;
pub mod gpu_peers;
pub mod mutate;
pub mod seeds;
pub mod targets;

/// One kind of foreign bytes.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Its name, that of its file in `fuzz/fuzz_targets`.
    pub name: &'static str,
    /// Reads the bytes as far as they can be read.
    pub run: fn(&[u8]),
    /// Examples that can be read.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Whether the bytes are a text.
    pub is_text: bool,
}

/// All of them.
pub const TARGETS: [Target; 14] = [
    Target {
        name: "rpc",
        run: targets::rpc,
        seeds: seeds::rpc,
        is_text: false,
    },
    Target {
        name: "managers",
        run: targets::managers,
        seeds: seeds::managers,
        is_text: false,
    },
    Target {
        name: "browsers",
        run: targets::browsers,
        seeds: seeds::browsers,
        is_text: true,
    },
    Target {
        name: "streams",
        run: targets::streams,
        seeds: seeds::streams,
        is_text: false,
    },
    Target {
        name: "opendrive",
        run: targets::opendrive,
        seeds: seeds::opendrive,
        is_text: true,
    },
    Target {
        name: "launch_files",
        run: targets::launch_files,
        seeds: seeds::launch_files,
        is_text: true,
    },
    Target {
        name: "calibrations",
        run: targets::calibrations,
        seeds: seeds::calibrations,
        is_text: true,
    },
    Target {
        name: "recordings",
        run: targets::recordings,
        seeds: seeds::recordings,
        is_text: false,
    },
    Target {
        name: "carla_logs",
        run: targets::carla_logs,
        seeds: seeds::carla_logs,
        is_text: false,
    },
    Target {
        name: "checkpoints",
        run: targets::checkpoints,
        seeds: seeds::checkpoints,
        is_text: false,
    },
    Target {
        name: "results",
        run: targets::results,
        seeds: seeds::results,
        is_text: false,
    },
    Target {
        name: "journals",
        run: targets::journals,
        seeds: seeds::journals,
        is_text: true,
    },
    Target {
        name: "bridges",
        run: targets::bridges,
        seeds: seeds::bridges,
        is_text: false,
    },
    Target {
        name: "gpu_socket",
        run: targets::gpu_socket,
        seeds: seeds::gpu_socket,
        is_text: false,
    },
];
