//! `gantry bench verify`: makes the frames of a report again, and compares their hashes.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context as _;
use launch_cli::{Exit, Shutdown, wrong_usage};
use schema_recording::pattern;

use crate::report::{Report, ScenarioInfo, read, suite_hash};
use crate::scenario::{Scenario, scenarios};
use crate::suite::Suite;
use crate::truth_pass::hidden::{MAKING, private_folder};
use crate::truth_pass::{self, Options};

const EXAMPLES: &str = "Examples:
  gantry bench verify cited                                       all scenarios of a report
  gantry bench verify cited --scenarios '*_night_*'               a part of them
  gantry bench verify elsewhere/report.json --suite launch/bench/standard.toml";

/// Makes the frames of a report again, and says whether they are the same
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct VerifyArgs {
    /// The report: report.json or its folder
    #[arg(value_name = "REPORT")]
    report: PathBuf,

    /// The suite's file, whose folder has what its input programs need; its text must be that of the
    /// report [default: the file that the report's command names]
    #[arg(long, value_name = "FILE")]
    suite: Option<PathBuf>,

    /// Make the frames of these scenarios only, with * and ?
    #[arg(long, value_name = "GLOB,…", value_delimiter = ',')]
    scenarios: Vec<String>,

    /// GPU for the simulator whose name contains this text [default: a real GPU if there is one]
    #[arg(long, value_name = "TEXT")]
    adapter: Option<String>,

    /// Folder in which recordings are made, and removed again [default: gantry/bench in the XDG cache
    /// folder]
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,

    /// Longest time without a finished tick before a simulator counts as hanging
    #[arg(long, value_name = "SECONDS", default_value_t = 300, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    stall: u64,
}

/// Why the frames of a report cannot be made again.
#[derive(Debug, thiserror::Error)]
enum VerifyError {
    #[error(
        "the report's suite hash does not fit its own suite, build and seed: one of them was changed after it was written"
    )]
    Changed,
    #[error(
        "the report's command names no suite that is here with the text of the report; name its file with --suite"
    )]
    NoSuite,
    #[error(
        "--suite {path}: its text is not that of the report, so that it shows other frames; use the file of the commit that the report names",
        path = path.display()
    )]
    OtherSuite { path: PathBuf },
    #[error(
        "the scenario {name:?} of the report is none of its suite: it was shown from a recording of its own (--recording), which cannot be made again"
    )]
    Recorded { name: String },
    #[error(
        "the programs of this report drove, so that no frames were made beforehand: there is nothing to compare"
    )]
    Driven,
    #[error("--scenarios {globs}: there is {names}")]
    NoScenario { globs: String, names: String },
}

/// Makes the frames again.
///
/// # Errors
/// [`launch_cli::WrongUsage`] if they cannot be made again, or if the simulator fails.
pub fn run(args: &VerifyArgs) -> anyhow::Result<Exit> {
    let report = read(&args.report)?;
    let suite = suite_of(&report, args.suite.as_deref())?;
    let wanted = wanted(&report, &suite, &args.scenarios).map_err(wrong_usage)?;
    let shutdown = Shutdown::install()?;
    launch_cli::raise_file_limit()?;
    let cache = match &args.cache {
        Some(cache) => std::path::absolute(cache)?,
        None => truth_pass::cache_folder()?,
    };
    let build = truth_pass::build()?;
    let mut n_others = 0;
    let mut adapter = String::new();
    for (info, scenario) in &wanted {
        let folder = folder_in(&cache)?;
        let options = Options {
            cache: folder.path().to_owned(),
            cache_limit_bytes: u64::MAX,
            adapter: args.adapter.clone(),
            stall: Duration::from_secs(args.stall),
            build: build.clone(),
        };
        let stop = || shutdown.requested();
        let truth = truth_pass::recording(&suite, scenario, &options, &stop, &|_, _| {})?;
        adapter.clone_from(&truth.adapter);
        let (then, now) = (&info.frames_hash, &truth.frames_hash);
        if then == now {
            println!("{}: the same frames, {now}", info.name);
        } else {
            n_others += 1;
            println!("{}: other frames, {now}; the report has {then}", info.name);
        }
    }
    if n_others == 0 {
        println!(
            "the frames of {} of {} scenarios are those of the report",
            wanted.len(),
            report.scenarios.len()
        );
        return Ok(Exit::Done);
    }
    println!("{}", why(&report, &build, &adapter));
    Ok(Exit::Failed)
}

/// A new folder for a recording: nothing that was kept is believed, so that this build makes every
/// frame. It goes with what is in it.
fn folder_in(cache: &Path) -> anyhow::Result<tempfile::TempDir> {
    let made = private_folder(cache).and_then(|()| {
        tempfile::Builder::new()
            .prefix(&format!("verify{MAKING}"))
            .tempdir_in(cache)
    });
    made.with_context(|| {
        format!(
            "cannot write into {}; choose another folder with --cache",
            cache.display()
        )
    })
}

/// What may have made other frames.
fn why(report: &Report, build: &str, adapter: &str) -> String {
    let mut reasons = Vec::new();
    if report.build != build {
        reasons.push(format!(
            "they were made by build {}, this one is {build}",
            report.build
        ));
    }
    if report.machine.adapter != adapter {
        reasons.push(format!(
            "they were rendered by {}, these by {adapter}",
            report.machine.adapter
        ));
    }
    match reasons.is_empty() {
        true => "build and adapter are those of the report: its hashes were changed, or the same build makes other frames on this machine".to_owned(),
        false => format!("the report's frames are others: {}", reasons.join("; ")),
    }
}

/// The suite of a report, with its seed.
fn suite_of(report: &Report, file: Option<&Path>) -> anyhow::Result<Suite> {
    let hash = suite_hash(
        &report.suite_text,
        &report.build,
        report.seed,
        report.has_drawn_seed,
    );
    if hash != report.suite_hash {
        return Err(wrong_usage(VerifyError::Changed));
    }
    let mut suite = match file {
        Some(path) => {
            let suite = Suite::read(path)?;
            if suite.text != report.suite_text {
                let path = path.to_owned();
                return Err(wrong_usage(VerifyError::OtherSuite { path }));
            }
            suite
        }
        None => {
            let words = report.command.iter().map(Path::new);
            let files = words.filter(|word| word.extension().is_some_and(|it| it == "toml"));
            let suites = files.filter_map(|path| Suite::read(path).ok());
            let mut of_report = suites.filter(|suite| suite.text == report.suite_text);
            let found = of_report.next();
            found.ok_or_else(|| wrong_usage(VerifyError::NoSuite))?
        }
    };
    if report.has_drawn_seed {
        suite.draw(report.seed);
    }
    Ok(suite)
}

/// The scenarios of a report that are made again.
fn wanted<'a>(
    report: &'a Report,
    suite: &Suite,
    globs: &[String],
) -> Result<Vec<(&'a ScenarioInfo, Scenario)>, VerifyError> {
    if suite.is_closed_loop() {
        return Err(VerifyError::Driven);
    }
    // A suite that was read has its scenarios checked.
    let all = scenarios(suite).unwrap_or_default();
    let mut wanted = Vec::new();
    for info in &report.scenarios {
        let is_wanted = globs.is_empty() || globs.iter().any(|it| pattern::matches(it, &info.name));
        if is_wanted {
            let scenario = all.iter().find(|scenario| scenario.name == info.name);
            let name = || info.name.clone();
            let scenario = scenario.ok_or_else(|| VerifyError::Recorded { name: name() })?;
            wanted.push((info, scenario.clone()));
        }
    }
    if wanted.is_empty() {
        let names: Vec<&str> = report.scenarios.iter().map(|it| it.name.as_str()).collect();
        return Err(VerifyError::NoScenario {
            globs: globs.join(","),
            names: names.join(", "),
        });
    }
    Ok(wanted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::tests::SMALL;

    /// A report of the small suite, which lies in `folder`, with one scenario.
    fn report(folder: &Path) -> Report {
        let path = folder.join("small.toml");
        std::fs::write(&path, SMALL).unwrap();
        let suite = Suite::read(&path).unwrap();
        Report {
            suite_hash: suite_hash(SMALL, "1", suite.seed, false),
            suite_text: SMALL.into(),
            build: "1".into(),
            seed: suite.seed,
            command: vec!["gantry".into(), path.display().to_string()],
            scenarios: vec![ScenarioInfo {
                name: scenarios(&suite).unwrap()[0].name.clone(),
                ..ScenarioInfo::default()
            }],
            ..Report::default()
        }
    }

    fn refusal(report: &Report, file: Option<&Path>) -> String {
        suite_of(report, file).unwrap_err().to_string()
    }

    #[test]
    fn the_suite_is_found_by_the_command_and_only_with_the_reports_own_text() {
        let folder = tempfile::tempdir().unwrap();
        let good = report(folder.path());
        assert_eq!(suite_of(&good, None).unwrap().text, SMALL);
        let away = Report {
            command: vec!["gantry".into(), "gone.toml".into()],
            ..good.clone()
        };
        assert!(refusal(&away, None).contains("name its file with --suite"));
        let other = folder.path().join("other.toml");
        std::fs::write(&other, format!("{SMALL}\n# another")).unwrap();
        assert!(refusal(&away, Some(&other)).contains("its text is not that of the report"));
        let path = folder.path().join("small.toml");
        assert!(suite_of(&away, Some(&path)).is_ok());
        for changed in [
            Report {
                seed: good.seed + 1,
                ..good.clone()
            },
            Report {
                build: "2".into(),
                ..good.clone()
            },
            Report {
                has_drawn_seed: true,
                ..good.clone()
            },
        ] {
            assert!(refusal(&changed, None).contains("was changed after it was written"));
        }
    }

    #[test]
    fn scenarios_that_no_suite_makes_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let mut report = report(folder.path());
        let suite = suite_of(&report, None).unwrap();
        assert_eq!(wanted(&report, &suite, &[]).unwrap().len(), 1);
        let none = wanted(&report, &suite, &["nowhere*".into()]);
        assert!(none.unwrap_err().to_string().contains("there is"));
        report.scenarios[0].name = "drive".into();
        let of_file = wanted(&report, &suite, &[]).unwrap_err().to_string();
        assert!(of_file.contains("--recording"), "{of_file}");
    }

    #[test]
    fn other_frames_are_explained_by_build_and_adapter() {
        let mut report = Report {
            build: "1".into(),
            ..Report::default()
        };
        report.machine.adapter = "llvmpipe".into();
        assert!(why(&report, "1", "llvmpipe").contains("its hashes were changed"));
        let both = why(&report, "2", "H200");
        assert!(both.contains("this one is 2") && both.contains("these by H200"));
    }
}
