//! Words that are none, launch files that are built in, readers that leave early. The help texts themselves are compared by
//! `tests/test_e2e/tests/it/book.rs`.

use std::path::Path;
use std::process::Command;

#[test]
fn an_unknown_word_is_refused_with_the_known_ones() {
    let output = Command::new(env!("CARGO_BIN_EXE_gantry"))
        .arg("fly")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(
        message.starts_with("error: there is no program \"gantry-fly\"")
            && message.contains("up, new, topic, top, graph, doctor"),
        "{message}"
    );
}

/// What `gantry up FILE --dry-run` prints in this folder, or its error.
fn dry_run(folder: &Path, file: &str) -> Result<String, String> {
    let output = Command::new(env!("CARGO_BIN_EXE_gantry"))
        .args(["up", file, "--dry-run"])
        .current_dir(folder)
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    match output.status.code() {
        Some(0) => Ok(text(output.stdout)),
        _ => Err(text(output.stderr)),
    }
}

#[test]
fn launch_files_that_are_built_in_need_no_file_and_give_way_to_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for name in ["quickstart", "minimal", "two_rigs", "carla"] {
        let file = format!("launch/{name}.toml");
        let text = dry_run(folder, &file).unwrap();
        assert!(text.contains("[process.simd]"), "{text}");
    }
    let own = "version = 1\ninclude = [\"launch/minimal.toml\"]\n[scenario]\nseed = 77\n";
    std::fs::write(folder.join("own.toml"), own).unwrap();
    let text = dry_run(folder, "own.toml").unwrap();
    assert!(
        text.contains("seed = 77") && text.contains("width_px = 320"),
        "{text}"
    );

    // A path that leads elsewhere is no name, and a file of the user's own comes first.
    let error = dry_run(folder, "elsewhere/launch/minimal.toml").unwrap_err();
    assert!(
        error.contains("cannot read the launch file elsewhere/launch/minimal.toml"),
        "{error}"
    );
    std::fs::create_dir(folder.join("launch")).unwrap();
    let changed = "version = 1\n[scenario]\nseed = 5\n[process.simd]\ncmd = [\"simd\"]\n";
    std::fs::write(folder.join("launch/minimal.toml"), changed).unwrap();
    assert!(
        dry_run(folder, "launch/minimal.toml")
            .unwrap()
            .contains("seed = 5")
    );
}

#[test]
fn a_reader_that_leaves_early_is_no_failure() {
    let script = format!(
        "{} man | head -c 10 > /dev/null; exit ${{PIPESTATUS[0]}}",
        env!("CARGO_BIN_EXE_gantry")
    );
    assert_eq!(
        Command::new("bash")
            .args(["-c", &script])
            .status()
            .unwrap()
            .code(),
        Some(0)
    );
}
