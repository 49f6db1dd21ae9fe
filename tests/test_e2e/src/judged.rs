//! Figures that an independent implementation in Python judges.

use std::time::Duration;

use test_kit::Sandbox;
use test_kit::sandbox::repository;

use crate::processes::venv_program;

/// Lets a script of `python/` judge cases, one of JSON a line, and compare at least so many figures.
/// It gets the file's name, and its last line says `compared N figures …`.
///
/// # Panics
/// With all that the script said, if it finds a difference, or compares less.
pub fn judge(script: &str, cases: &[String], at_least: u64) {
    let sandbox = Sandbox::new("judged");
    let file = sandbox.write("cases.jsonl", &cases.join("\n"));
    let script = repository().join("tests/test_e2e/python").join(script);
    let words = [&script, &file].map(|path| path.to_str().expect("paths are text"));
    let judged = sandbox.spawn_program("python", &venv_program("python"), &words, &[]);
    let judged = judged.wait_longer(Duration::from_secs(1800)).expect_code(0);
    let said = judged.lines.last().map_or("", String::as_str);
    let n = said.strip_prefix("compared ").and_then(|rest| {
        let n = rest.split(' ').next()?;
        n.parse::<u64>().ok()
    });
    assert!(n.is_some_and(|n| n >= at_least), "{:#?}", judged.lines);
    println!("{said}");
}
