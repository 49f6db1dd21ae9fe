//! Computes a hash that names the layout of the world's state, so that a checkpoint of another
//! build is refused instead of misread.

use std::path::{Path, PathBuf};

/// Folders whose types are written into checkpoints, relative to this crate.
const SOURCES: [&str; 3] = [
    "src",
    "../../schemas/schema_frames/src",
    "../../schemas/schema_types/src",
];

fn main() {
    let mut files = Vec::new();
    for folder in SOURCES {
        println!("cargo:rerun-if-changed={folder}");
        collect(Path::new(folder), &mut files);
    }
    let lock = "../../Cargo.lock";
    println!("cargo:rerun-if-changed={lock}");
    files.sort();
    let mut sum = 0xcbf2_9ce4_8422_2325u64;
    for file in files {
        add(&mut sum, &std::fs::read(&file).unwrap_or_default());
    }
    add(
        &mut sum,
        engines(&std::fs::read_to_string(lock).unwrap_or_default()).as_bytes(),
    );
    println!("cargo:rustc-env=GANTRY_WORLD_LAYOUT={sum:016x}");
}

/// FNV-1a.
fn add(sum: &mut u64, bytes: &[u8]) {
    for byte in bytes {
        *sum = (*sum ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
    }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|kind| kind == "rs") {
            files.push(path);
        }
    }
}

/// The lock file's entries of the physics engine and its geometry.
fn engines(lock: &str) -> String {
    let is_engine = |package: &&str| {
        ["\"rapier3d\"", "\"parry3d\"", "\"postcard\""]
            .iter()
            .any(|name| package.contains(&format!("name = {name}")))
    };
    lock.split("[[package]]").filter(is_engine).collect()
}
