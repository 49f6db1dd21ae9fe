//! `gantry map check`: reads, describes and compares every map. The exit code says whether all of
//! them are sound.

use std::path::{Path, PathBuf};
use std::time::Instant;

use launch_cli::{CommonArgs, Exit, Progress, wrong_usage};
use schema_roads::RoadMap;

use super::client::{self, Client, ClientError};
use super::report::{Contents, Report};
use super::source;
use crate::cli::{CheckArgs, WithCarla};

/// Warnings that are printed for each map unless all are wanted.
const SHOWN: usize = 12;

/// A map to check.
enum Target {
    File(PathBuf),
    Name(String),
}

/// Checks every map that was named.
pub fn run(args: &CheckArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    let targets = targets(args)?;
    let client = match args.carla {
        WithCarla::Never => Err(ClientError::NotAsked),
        _ => client::find(args.python.as_deref()),
    };
    if let (WithCarla::Always, Err(missing)) = (args.carla, &client) {
        return Err(wrong_usage(format!(
            "no comparison with CARLA's client: {missing}"
        )));
    }
    let (mut n_broken, mut n_differ) = (0, 0);
    let progress = Progress::steps(common, "reading", targets.len() as u64, "maps");
    for target in &targets {
        let report = look(target, args, client.as_ref().ok());
        progress.add(1);
        progress.hidden_while(|| {
            if args.json {
                println!("{}", report.as_json());
            } else {
                let max_warnings = if args.all { usize::MAX } else { SHOWN };
                print!("{}", report.as_text(max_warnings));
            }
        });
        n_broken += usize::from(report.is_broken());
        n_differ += usize::from(report.differs());
    }
    drop(progress);
    if !args.json {
        let n = targets.len();
        println!(
            "\n{n} maps: {} sound, {n_broken} broken, {n_differ} read otherwise than by CARLA's client",
            n - n_broken
        );
        if let Err(missing) = &client {
            println!("without the comparison with CARLA's client: {missing}");
        }
    }
    Ok(if n_broken + n_differ > 0 {
        Exit::Failed
    } else {
        Exit::Done
    })
}

/// The maps that the arguments name: `.xodr` files of folders, files, and maps by name.
fn targets(args: &CheckArgs) -> anyhow::Result<Vec<Target>> {
    let mut targets = Vec::new();
    for what in &args.what {
        let path = Path::new(what);
        if path.is_dir() {
            let entries = std::fs::read_dir(path)
                .map_err(|error| wrong_usage(format!("cannot read the folder {what}: {error}")))?;
            let mut files: Vec<PathBuf> = entries
                .flatten()
                .map(|entry| entry.path())
                .filter(|p| p.extension().is_some_and(|e| e == "xodr"))
                .collect();
            if files.is_empty() {
                return Err(wrong_usage(format!("the folder {what} has no .xodr files")));
            }
            files.sort();
            targets.extend(files.into_iter().map(Target::File));
        } else if path.is_file() {
            targets.push(Target::File(path.to_owned()));
        } else if what.ends_with(".xodr") || what.contains('/') {
            return Err(wrong_usage(format!("there is no file or folder {what:?}")));
        } else {
            targets.push(Target::Name(what.clone()));
        }
    }
    Ok(targets)
}

fn look(target: &Target, args: &CheckArgs, client: Option<&Client>) -> Report {
    let (name, text) = match target {
        Target::File(path) => (
            path.display().to_string(),
            source::text_of_file(path).map_err(|error| error.to_string()),
        ),
        Target::Name(name) => (
            name.clone(),
            source::text_of_name(name, args.data.as_deref(), args.seed)
                .map_err(|error| format!("{error:#}")),
        ),
    };
    let text = match text {
        Ok(text) => text,
        Err(error) => return Report::failed(name, error),
    };
    let started = Instant::now();
    let map = match RoadMap::parse(&text) {
        Ok(map) => map,
        Err(error) => return Report::failed(name, error.to_string()),
    };
    let contents = Contents::of(&map, started.elapsed());
    let comparison = client.map(|client| super::compare::compare(client, &map, &text));
    Report {
        name,
        error: None,
        warnings: map.warnings().to_vec(),
        contents: Some(contents),
        comparison,
    }
}
