//! Where other programs are: beside this one, then on `PATH`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use anyhow::Context as _;

/// Name of this program where one file holds several of them.
static NAME: OnceLock<&str> = OnceLock::new();

/// Says which program of a file of several this process is, and has `ps` call it that too, which
/// else names the file.
pub fn take_name(name: &'static str) {
    let _ = NAME.set(name);
    if let Ok(name) = std::ffi::CString::new(name) {
        // Nothing depends on what `ps` shows.
        let _ = nix::sys::prctl::set_name(&name);
    }
}

/// The file by which this program is started once more: its own, or, where one file holds several
/// programs, what lies beside that by this one's name.
///
/// # Errors
/// When the kernel does not say where this program is.
pub fn own() -> std::io::Result<PathBuf> {
    let file = std::env::current_exe()?;
    Ok(match NAME.get() {
        Some(name) => file.with_file_name(name),
        None => file,
    })
}

/// Whether `program` is one of Gantry's, which understand the options that all have.
pub fn is_ours(program: &str) -> bool {
    let name = Path::new(program)
        .file_name()
        .map_or(program.into(), |name| name.to_string_lossy());
    name == "simd" || name.starts_with("gantry-")
}

/// Whether a command of ours can be given `--domain`: some programs meet nobody on the bus, or do so
/// in some subcommands only, which read the domain from their environment.
pub fn takes_domain(cmd: &[String]) -> bool {
    let Some((program, words)) = cmd.split_first() else {
        return false;
    };
    let name = Path::new(program).file_name().unwrap_or_default();
    match name.to_str() {
        Some("gantry-bench" | "gantry-dataset" | "gantry-export") => false,
        // All that it does but recording is a subcommand.
        Some("gantry-record") => words.first().is_some_and(|word| word.starts_with('-')),
        _ => is_ours(program),
    }
}

/// Where a program is looked for.
#[derive(Clone, Debug, Default)]
pub struct Search {
    /// Folder that comes before all others.
    pub first: Option<PathBuf>,
    /// `PATH`.
    pub path: OsString,
    /// Folder in which a relative path begins; `None`: the working folder.
    pub folder: Option<PathBuf>,
}

/// The file of `program`: a path is taken as it is, a name is looked for beside this binary and
/// then on `PATH`.
///
/// # Errors
/// When there is none, with what to do.
pub fn find(program: &str) -> anyhow::Result<PathBuf> {
    find_from(
        program,
        &Search {
            path: std::env::var_os("PATH").unwrap_or_default(),
            ..Default::default()
        },
    )
}

/// As [`find`], with places of one's own. The answer does not depend on the working folder.
///
/// # Errors
/// As [`find`].
pub fn find_from(program: &str, search: &Search) -> anyhow::Result<PathBuf> {
    if program.contains('/') {
        let path = match &search.folder {
            Some(folder) => folder.join(program),
            None => std::path::absolute(program)?,
        };
        anyhow::ensure!(
            is_program(&path),
            "there is no program {program:?}{}",
            if path.exists() {
                ": the file is not executable"
            } else {
                ""
            }
        );
        return Ok(path);
    }
    let own = std::env::current_exe().context("cannot tell where this program is")?;
    let beside = own.parent().map(|folder| folder.join(program));
    let on_path = |name: &str| {
        std::env::split_paths(&search.path)
            .map(|folder| folder.join(name))
            .find(|path| is_program(path))
    };
    let found = search
        .first
        .iter()
        .map(|folder| folder.join(program))
        .chain(beside)
        .find(|path| is_program(path))
        .or_else(|| on_path(program));
    found.with_context(|| {
        let hint = if is_ours(program) {
            if in_source_tree() {
                "; build it with `cargo build --release --workspace`"
            } else {
                "; it is part of the package gantry-sim: install that again"
            }
        } else if program == "python" && on_path("python3").is_some() {
            "; this machine calls it \"python3\""
        } else {
            "; install it or give its path"
        };
        format!(
            "there is no program {program:?} beside {} or on PATH{hint}",
            own.display()
        )
    })
}

/// Whether this program lies where cargo builds, and not where a package was installed: what a user
/// does about a missing program differs.
pub fn in_source_tree() -> bool {
    std::env::current_exe().is_ok_and(|own| is_below_cargo(&own))
}

/// Whether `file` lies in `release`, `release/deps` or such a folder of a target folder of cargo,
/// which marks it by a file.
fn is_below_cargo(file: &Path) -> bool {
    file.ancestors()
        .skip(2)
        .take(2)
        .any(|folder| folder.join("CACHEDIR.TAG").is_file())
}

/// Whether `path` is a file that can be started.
pub fn is_program(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt as _;
    path.metadata()
        .is_ok_and(|file| file.is_file() && file.permissions().mode() & 0o111 != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_are_found_on_the_path_and_missing_ones_are_named() {
        assert!(find("sh").unwrap().ends_with("sh"));
        let message = find("gantry-nothing").unwrap_err().to_string();
        assert!(
            message.contains("\"gantry-nothing\"") && message.contains("cargo build"),
            "{message}"
        );
        assert!(find("/etc/passwd").is_err(), "not executable");
    }

    #[test]
    fn programs_know_whether_cargo_built_them_here() {
        assert!(in_source_tree(), "tests are built by cargo");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("bin/gantry");
        assert!(!is_below_cargo(&file));
        std::fs::write(folder.path().join("CACHEDIR.TAG"), "x").unwrap();
        assert!(is_below_cargo(&file));
        assert!(is_below_cargo(&folder.path().join("release/deps/x")));
        assert!(!is_below_cargo(&folder.path().join("a/b/c/gantry")));
    }

    #[test]
    fn our_programs_are_known_by_name() {
        assert!(is_ours("simd") && is_ours("/opt/gantry-view") && !is_ours("sleep"));
        let takes = |cmd: &str| {
            let words: Vec<String> = cmd.split(' ').map(str::to_owned).collect();
            takes_domain(&words)
        };
        assert!(takes("simd") && takes("bin/gantry-record --out a.mcap") && takes("gantry-view"));
        for cmd in [
            "gantry-record info a.mcap",
            "gantry-export a.mcap",
            "sh -c x",
        ] {
            assert!(!takes(cmd), "{cmd}");
        }
    }
}
