//! `gantry map import`: OpenDRIVE files of a CARLA installation, or of any folder, become maps of
//! the data folder.
//!
//! Every file is read as the simulator reads it, before any is written. A map is written beside its
//! place and then takes it in one step, so that a simulator that looks meanwhile sees the old map
//! or the new one.

mod find;
mod place;

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use launch_cli::{CommonArgs, Exit, Progress, data_dir, wrong_usage};
use schema_roads::RoadMap;
use serde_json::json;

use super::refusal::Refusal;
use super::report::Contents;
use super::source;
use crate::cli::ImportArgs;
use find::Found;
use place::{Placed, Wishes};

/// Warnings that are printed for each map unless all are wanted.
const SHOWN: usize = 3;

/// What became of one map.
struct Outcome {
    name: String,
    file: PathBuf,
    /// Where it is now, or why it is not imported.
    result: Result<(Placed, Contents), Refusal>,
    warnings: Vec<String>,
    /// What else there is to say about it.
    notes: Vec<String>,
}

/// A map that was read and may be written.
struct Sound {
    text: String,
    contents: Contents,
    warnings: Vec<String>,
}

/// Runs `gantry map import`.
pub fn run(args: &ImportArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    let folder = data_dir(args.data.as_deref())?.join("maps");
    let mut found = find::maps(&args.what)?;
    if let Some(name) = &args.name {
        rename(&mut found, name)?;
    }
    let progress = Progress::steps(common, "reading", found.len() as u64, "maps");
    let read: Vec<(Found, Result<Sound, Refusal>)> = found
        .into_iter()
        .map(|mut found| {
            progress.say(format!("reading {}", found.name));
            let sound = match found.refused.take() {
                Some(reason) => Err(reason),
                None => read(&found.file),
            };
            progress.add(1);
            (found, sound)
        })
        .collect();
    drop(progress);
    if !args.dry_run {
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("cannot make the map folder {}", folder.display()))?;
    }
    let outcomes: Vec<Outcome> = read
        .into_iter()
        .map(|(found, sound)| write(found, sound, &folder, args))
        .collect();
    report(&outcomes, &folder, args);
    let all_in = outcomes.iter().all(|outcome| outcome.result.is_ok());
    Ok(if all_in { Exit::Done } else { Exit::Failed })
}

/// Gives the only map another name.
fn rename(found: &mut [Found], name: &str) -> anyhow::Result<()> {
    let n = found.len();
    let [only] = found else {
        return Err(wrong_usage(format!(
            "--name gives one map a name, but {n} were found; name one file"
        )));
    };
    find::check_name(name).map_err(wrong_usage)?;
    name.clone_into(&mut only.name);
    only.refused = None;
    Ok(())
}

/// Reads a map as the simulator will.
fn read(file: &Path) -> Result<Sound, Refusal> {
    let text = source::text_of_file(file)?;
    let started = std::time::Instant::now();
    let roads = RoadMap::parse(&text)?;
    let contents = Contents::of(&roads, started.elapsed());
    if contents.n_spawn_points == 0 {
        return Err(Refusal::NoSpawnPoint);
    }
    let warnings = roads.warnings().iter().map(ToString::to_string).collect();
    Ok(Sound {
        text,
        contents,
        warnings,
    })
}

/// Writes a map that was read into the map folder.
fn write(found: Found, sound: Result<Sound, Refusal>, folder: &Path, args: &ImportArgs) -> Outcome {
    let (result, warnings) = match sound {
        Err(reason) => (Err(reason), Vec::new()),
        Ok(Sound {
            text,
            contents,
            warnings,
        }) => {
            let placed = place::place(folder, &found.name, &text, Wishes::of(args));
            (placed.map(|placed| (placed, contents)), warnings)
        }
    };
    Outcome {
        name: found.name,
        file: found.file,
        result,
        warnings,
        notes: found.notes,
    }
}

fn report(outcomes: &[Outcome], folder: &Path, args: &ImportArgs) {
    for outcome in outcomes {
        if args.json {
            println!("{}", as_json(outcome, folder));
        } else {
            print_text(outcome, args.all);
        }
    }
    if args.json {
        return;
    }
    let n_in = outcomes.iter().filter(|o| o.result.is_ok()).count();
    let n_refused = outcomes.len() - n_in;
    let verb = if args.dry_run {
        "would be in"
    } else {
        "are in"
    };
    println!(
        "\n{n_in} maps {verb} {}, {n_refused} refused",
        folder.display()
    );
    if let Some(first) = outcomes.iter().find(|o| o.result.is_ok()) {
        println!(
            "load one by its name: client.load_world(\"{0}\"), or gantry up --set 'scenario.map=\"{0}\"'",
            first.name
        );
    }
}

fn print_text(outcome: &Outcome, all: bool) {
    match &outcome.result {
        Ok((placed, contents)) => println!(
            "{:<10}{}: {}",
            placed.word(),
            outcome.name,
            contents.import_sentence()
        ),
        Err(reason) => println!(
            "{:<10}{}: {}: {reason}",
            "refused",
            outcome.name,
            outcome.file.display()
        ),
    }
    for note in &outcome.notes {
        println!("          {note}");
    }
    let shown = if all { usize::MAX } else { SHOWN }.min(outcome.warnings.len());
    for warning in &outcome.warnings[..shown] {
        println!("          warning: {warning}");
    }
    if shown < outcome.warnings.len() {
        println!(
            "          {} more warnings; --all prints them",
            outcome.warnings.len() - shown
        );
    }
}

fn as_json(outcome: &Outcome, folder: &Path) -> serde_json::Value {
    let (result, error, contents) = match &outcome.result {
        Ok((placed, contents)) => (placed.word(), None, Some(contents.as_json())),
        Err(reason) => ("refused", Some(reason.to_string()), None),
    };
    let place = error
        .is_none()
        .then(|| folder.join(format!("{}.xodr", outcome.name)));
    json!({
        "map": outcome.name, "file": outcome.file, "result": result, "error": error, "place": place,
        "contents": contents, "warnings": outcome.warnings, "notes": outcome.notes,
    })
}
