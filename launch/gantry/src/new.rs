//! `gantry new`: makes a project outside this repository that builds, runs and is tested at once.

mod name;
mod origin;
mod project;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use launch_cli::Exit;

use crate::cli::{ConsumerArgs, Lang, NewArgs, NewWord};
use crate::programs;
use origin::Origin;

/// What a project's tests do.
const TESTS: &str = "runs it against a simulator of its own";

/// Runs the word.
///
/// # Errors
/// A sentence if the name cannot be, the folder is in use, or it is not known where the libraries
/// are.
pub fn run(args: &NewArgs) -> anyhow::Result<Exit> {
    let NewWord::Consumer(wanted) = &args.word;
    let name = name::checked(&wanted.path, wanted.lang)?;
    let origin = Origin::of(wanted)?;
    let folder = std::path::absolute(&wanted.path)?;
    check_place(&folder, &origin)?;
    for (path, text) in project::files(&name, wanted.lang, &origin)? {
        let path = folder.join(path);
        let parent = path.parent().unwrap_or(&folder);
        std::fs::create_dir_all(parent)
            .with_context(|| format!("cannot make the folder {}", parent.display()))?;
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    say_what_next(wanted, &name, &origin);
    Ok(Exit::Done)
}

/// The folder is new or empty, and lies outside the checkout, whose workspace would claim it.
fn check_place(folder: &Path, origin: &Origin) -> anyhow::Result<()> {
    let shown = folder.display();
    ensure!(
        !folder.exists() || folder.is_dir(),
        "{shown} is a file; give a folder that does not exist yet"
    );
    let is_empty = |folder: &Path| folder.read_dir().map(|mut all| all.next().is_none());
    ensure!(
        !folder.exists() || is_empty(folder).with_context(|| format!("cannot read {shown}"))?,
        "the folder {shown} exists and is not empty; give another name, or empty it"
    );
    // The folder itself need not exist, so that links are followed from the first one that does.
    let real = folder.ancestors().find_map(|at| at.canonicalize().ok());
    if let (Some(checkout), Some(real)) = (origin.checkout(), real) {
        ensure!(
            !real.starts_with(checkout),
            "{shown} lies in Gantry's own checkout, whose workspace would claim it; give a path outside, e.g. ../{}",
            folder.file_name().unwrap_or_default().to_string_lossy()
        );
    }
    Ok(())
}

fn say_what_next(wanted: &ConsumerArgs, name: &str, origin: &Origin) {
    let gantry = how_to_call_gantry(origin);
    let (language, steps): (_, &[(&str, &str)]) = match wanted.lang {
        Lang::Rust => ("Rust", &[("cargo test", TESTS)]),
        Lang::Python => ("Python", &[("python -m pytest", TESTS)]),
        Lang::Cpp => (
            "C++",
            &[
                ("cmake -S . -B build && cmake --build build", "builds it"),
                ("ctest --test-dir build", TESTS),
            ],
        ),
    };
    println!("made {name} ({language}), which gets Gantry from {origin}");
    let prefix = origin.prefix().filter(|_| wanted.lang == Lang::Cpp);
    if prefix.is_some_and(|prefix| !prefix.join("lib/libgantry.so.1").exists()) {
        println!("  first, there: ./gantry build   builds the library that it is linked with");
    }
    println!("  cd {}", wanted.path.display());
    let up = format!("{gantry} up launch.toml");
    let widths = steps.iter().map(|(command, _)| command.len());
    let width = widths.chain([up.len()]).max().unwrap_or(0);
    for (command, what) in steps {
        println!("  {command:<width$}   {what}");
    }
    println!("  {up:<width$}   runs it with simulator and viewer");
}

/// `gantry` if that is this program, else the script of the checkout, else the path of this program.
fn how_to_call_gantry(origin: &Origin) -> String {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let own = std::env::current_exe()
        .and_then(|own| own.canonicalize())
        .ok();
    let is_own = |folder: PathBuf| {
        let found = folder.join("gantry").canonicalize().ok();
        found.is_some() && found == own
    };
    if std::env::split_paths(&path).any(is_own) {
        return "gantry".into();
    }
    let script = origin.checkout().map(|checkout| checkout.join("gantry"));
    script
        .filter(|script| programs::is_program(script))
        .or(own)
        .map_or("gantry".into(), |program| program.display().to_string())
}
