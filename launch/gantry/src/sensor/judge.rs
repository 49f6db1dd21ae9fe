//! Programs that judge what profiles measure: packages of Python, which a script asks.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::Context as _;
use launch_cli::wrong_usage;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Packs returns as the maker does, has them read, and compares; estimates parameters of noise.
const SCRIPT: &str = include_str!("judge.py");

/// What the judge says of a case, which it is told in a line before the data.
///
/// # Errors
/// If there is no Python, or it lacks a package.
pub fn ask<V: DeserializeOwned>(
    python: &Path,
    case: &impl Serialize,
    data: &[u8],
) -> anyhow::Result<V> {
    let mut told = serde_json::to_vec(case)?;
    told.push(b'\n');
    told.extend(data);
    let answer = run_script(python, &told)?;
    serde_json::from_str(&answer).with_context(|| format!("the script answered {answer:?}"))
}

/// What the script prints for a case and its data.
fn run_script(python: &Path, told: &[u8]) -> anyhow::Result<String> {
    let mut child = Command::new(python)
        .args(["-c", SCRIPT])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|error| {
            wrong_usage(format!(
                "cannot start {}: {error}; name a Python with --python",
                python.display()
            ))
        })?;
    let mut stdin = child.stdin.take().context("stdin is piped")?;
    // A script that ends early reads nothing; its own words say why.
    let _ = stdin.write_all(told);
    drop(stdin);
    let output = child.wait_with_output().context("cannot wait for Python")?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let last = said.lines().last().unwrap_or("nothing").to_owned();
        return Err(wrong_usage(format!(
            "{} cannot judge: {last}; pip install velodyne-decoder==3.1.0 ouster-sdk==1.0.1 allantools==2024.6, or name another Python with --python",
            python.display()
        )));
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
