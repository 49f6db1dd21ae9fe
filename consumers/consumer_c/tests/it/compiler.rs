//! Building programs with the machine's C++ compiler against the library that was built.

use std::path::{Path, PathBuf};
use std::process::Command;

use test_kit::sandbox::{binary_path, repository};

/// The folder of the headers.
pub fn include() -> PathBuf {
    repository().join("consumers/consumer_c/include")
}

/// Runs the compiler, and returns what it says if it fails.
pub fn compile(compiler: &str, words: &[&str]) -> Result<(), String> {
    let output = Command::new(compiler)
        .arg("-I")
        .arg(include())
        .args(words)
        .output()
        .unwrap_or_else(|error| panic!("{compiler}, of the package build-essential: {error}"));
    let said = || String::from_utf8_lossy(&output.stderr).into_owned();
    output.status.success().then_some(()).ok_or_else(said)
}

/// Builds a program in C++ into a folder of its own, with every warning as an error.
pub fn program(source: &Path, flags: &[&str]) -> PathBuf {
    let name = source.file_stem().expect("a source has a name");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).expect("a folder for the program");
    // A program finds the library by its name of this interface.
    let link = folder.join("libgantry.so.1");
    let _ = std::fs::remove_file(&link);
    std::os::unix::fs::symlink(binary_path("libgantry.so"), link).expect("a link");
    let made = folder.join(name);
    let folder = folder.to_str().expect("paths are text");
    let rpath = format!("-Wl,-rpath,{folder}");
    let mut words = vec![
        "-std=c++17",
        "-O1",
        "-g",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Wconversion",
        "-Wshadow",
        "-Werror",
        "-o",
        made.to_str().expect("paths are text"),
        source.to_str().expect("paths are text"),
        "-L",
        folder,
        "-l:libgantry.so.1",
        &rpath,
    ];
    words.extend(flags);
    compile("c++", &words).unwrap_or_else(|said| panic!("{}:\n{said}", source.display()));
    made
}
