//! Python: the environment that the viewer, the reader package and the tests use.

use std::path::PathBuf;
use std::time::Duration;

use super::finding::Finding;
use crate::programs;

/// Import name and what it is for.
const MODULES: [(&str, &str); 5] = [
    ("gantry", "reading and publishing topics"),
    ("numpy", "reading and publishing topics"),
    ("rerun", "the viewer"),
    ("mcap", "reading recordings"),
    ("carla", "CARLA scripts"),
];
const PATIENCE: Duration = Duration::from_secs(60);
const FIX: &str = "./gantry up sets up .venv; or: python3 -m venv .venv && .venv/bin/pip install -r requirements.txt";

pub fn look() -> Vec<Finding> {
    const WHAT: &str = "python";
    let Some(python) = find() else {
        return vec![Finding::warn(
            WHAT,
            "there is no .venv here and no python3 on PATH",
            FIX,
        )];
    };
    let names: Vec<String> = MODULES
        .iter()
        .map(|(module, _)| format!("{module:?}"))
        .collect();
    let script = format!(
        "import importlib.util as u, platform; print(platform.python_version()); [print(m) for m in [{}] if u.find_spec(m) is None]",
        names.join(", ")
    );
    let answer = match programs::output_of(&python, &["-c", &script], PATIENCE) {
        Ok(answer) => answer,
        Err(error) => return vec![Finding::warn(WHAT, format!("{error:#}"), FIX)],
    };
    let mut lines = answer.lines();
    let version = lines.next().unwrap_or("?");
    let missing: Vec<&str> = lines.collect();
    vec![judge(
        &format!("{} ({version})", python.display()),
        &missing,
    )]
}

fn judge(python: &str, missing: &[&str]) -> Finding {
    if missing.is_empty() {
        return Finding::ok("python", format!("{python} has what Gantry's tools use"));
    }
    let with_use: Vec<String> = missing
        .iter()
        .map(|module| {
            MODULES
                .iter()
                .find(|(name, _)| name == module)
                .map_or((*module).to_owned(), |(name, purpose)| {
                    format!("{name} ({purpose})")
                })
        })
        .collect();
    Finding::warn(
        "python",
        format!("{python} lacks {}", with_use.join(", ")),
        FIX,
    )
}

fn find() -> Option<PathBuf> {
    let own = PathBuf::from(".venv/bin/python");
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::iter::once(own)
        .chain(std::env::split_paths(&path).map(|folder| folder.join("python3")))
        .find(|python| python.exists())
}

#[cfg(test)]
mod tests {
    use super::super::Grade;
    use super::*;

    #[test]
    fn missing_modules_are_named_with_their_use() {
        assert_eq!(judge("python", &[]).grade, Grade::Ok);
        let finding = judge("python", &["rerun"]);
        assert!(
            finding.grade == Grade::Warn && finding.text.contains("rerun (the viewer)"),
            "{finding:?}"
        );
    }
}
