//! Python: the environment that the viewer, the reader package and the tests use.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::finding::Finding;
use super::install;
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
/// Version of the viewer that speaks to `gantry-view`; its protocol changes with every version.
const VIEWER: &str = "0.36.3";
const SOURCE_FIX: &str = "./gantry up sets up .venv; or: python3 -m venv .venv && .venv/bin/pip install -r requirements.txt";

/// What to do about a part of Gantry itself that is missing.
pub fn reinstall() -> String {
    if programs::in_source_tree() {
        "cargo build --release --workspace".into()
    } else {
        "python3 -m pip install --force-reinstall gantry_sim-*.whl".into()
    }
}

/// What installs the packages that Gantry's tools use: in a source tree by the script, else by pip,
/// and where the system manages its Python, which refuses pip then, into an environment of one's own.
fn fix(program: &str, missing: &[&str], is_managed: bool) -> String {
    if programs::in_source_tree() || missing.is_empty() {
        return SOURCE_FIX.into();
    }
    let names = missing.iter().map(|name| match *name {
        "gantry" => "gantry_sim-*.whl".into(),
        "rerun" => format!("rerun-sdk=={VIEWER}"),
        other => other.to_owned(),
    });
    let names = names.collect::<Vec<_>>().join(" ");
    if is_managed {
        format!("python3 -m venv gantry-env && . gantry-env/bin/activate && pip install {names}")
    } else {
        format!("{program} -m pip install {names}")
    }
}

pub fn look() -> Vec<Finding> {
    const WHAT: &str = "python";
    let Some(python) = find() else {
        return vec![Finding::warn(
            WHAT,
            "there is no .venv here and no python3 on PATH",
            install::as_root("apt-get install -y python3 python3-venv"),
        )];
    };
    let names: Vec<String> = MODULES
        .iter()
        .map(|(module, _)| format!("{module:?}"))
        .collect();
    let script = format!(
        "import importlib.util as u, importlib.metadata as v, os, platform, sys, sysconfig\n\
         print(platform.python_version())\n\
         mark = os.path.join(sysconfig.get_path('stdlib'), 'EXTERNALLY-MANAGED')\n\
         print(sys.prefix == sys.base_prefix and os.path.exists(mark))\n\
         try: print(v.version('rerun-sdk'))\n\
         except v.PackageNotFoundError: print('none')\n\
         for m in [{}]:\n if u.find_spec(m) is None: print(m)",
        names.join(", ")
    );
    let answer = match programs::output_of(&python, &["-c", &script], PATIENCE) {
        Ok(answer) => answer,
        Err(error) => return vec![Finding::warn(WHAT, format!("{error:#}"), SOURCE_FIX)],
    };
    let mut lines = answer.lines();
    let version = lines.next().unwrap_or("?");
    let is_managed = lines.next() == Some("True");
    let viewer = lines.next().unwrap_or("none");
    let missing: Vec<&str> = lines.collect();
    let program = python.display().to_string();
    std::iter::once(judge(&program, version, &missing, is_managed))
        .chain(judge_viewer(&program, viewer))
        .collect()
}

/// A viewer of another version starts, and shows nothing.
fn judge_viewer(program: &str, version: &str) -> Option<Finding> {
    (version != "none" && version != VIEWER).then(|| {
        Finding::warn(
            "viewer",
            format!("rerun-sdk is {version}, but gantry-view speaks to {VIEWER}"),
            format!("{program} -m pip install rerun-sdk=={VIEWER}"),
        )
    })
}

fn judge(program: &str, version: &str, missing: &[&str], is_managed: bool) -> Finding {
    let python = format!("{program} ({version})");
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
        fix(program, missing, is_managed),
    )
}

/// The Python of the working folder's environment, of the environment that this program is installed
/// in, or the first on the search path.
fn find() -> Option<PathBuf> {
    let here = PathBuf::from(".venv/bin/python");
    let path = std::env::var_os("PATH").unwrap_or_default();
    let own = std::env::current_exe().ok();
    let installed = own.as_deref().and_then(environment_of);
    std::iter::once(here)
        .chain(installed.map(|folder| folder.join("bin/python3")))
        .chain(std::env::split_paths(&path).map(|folder| folder.join("python3")))
        .find(|python| python.exists())
}

/// The virtual environment in whose `bin` a program lies.
fn environment_of(program: &Path) -> Option<&Path> {
    let folder = program.parent()?.parent()?;
    folder.join("pyvenv.cfg").is_file().then_some(folder)
}

#[cfg(test)]
mod tests {
    use super::super::Grade;
    use super::*;

    #[test]
    fn missing_modules_are_named_with_their_use() {
        assert_eq!(judge("python", "3.11", &[], false).grade, Grade::Ok);
        let finding = judge("python", "3.11", &["rerun"], false);
        assert!(
            finding.grade == Grade::Warn && finding.text.contains("rerun (the viewer)"),
            "{finding:?}"
        );
        assert!(judge_viewer("p", "none").is_none() && judge_viewer("p", VIEWER).is_none());
        let finding = judge_viewer("p", "0.41.0").unwrap();
        assert!(finding.fix.ends_with("rerun-sdk==0.36.3"), "{finding:?}");
    }

    #[test]
    fn a_program_knows_the_environment_that_it_is_installed_in() {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("bin/gantry");
        assert_eq!(environment_of(&program), None);
        std::fs::write(folder.path().join("pyvenv.cfg"), "").unwrap();
        assert_eq!(environment_of(&program), Some(folder.path()));
    }

    #[test]
    fn the_viewers_version_is_the_one_that_is_installed() {
        let wanted = include_str!("../../../../requirements.txt");
        assert!(wanted.contains(&format!("rerun-sdk=={VIEWER}")));
    }
}
