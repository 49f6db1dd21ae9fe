//! Compares the help text with `tests/golden/help/gantry-export.txt` in the root of the repository.
//! `./gantry bless` sets `GANTRY_BLESS=1`, which writes it anew.

use std::path::Path;
use std::process::Command;

#[test]
fn the_help_text_is_the_one_that_was_reviewed() {
    let golden =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/help/gantry-export.txt");
    let output = Command::new(env!("CARGO_BIN_EXE_gantry-export"))
        .arg("--help")
        .env("COLUMNS", "110")
        .env_remove("RUST_LOG")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0));
    let help = String::from_utf8(output.stdout).unwrap();
    if std::env::var_os("GANTRY_BLESS").is_some() {
        std::fs::write(&golden, &help).unwrap();
    }
    let reviewed = std::fs::read_to_string(&golden).unwrap_or_default();
    assert!(
        reviewed == help,
        "help changed; look at it, then run ./gantry bless\n{help}"
    );
}
