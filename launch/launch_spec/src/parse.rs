//! From text to a checked [`Launch`].

use std::io;
use std::path::{Path, PathBuf};

use crate::error::{Errors, LaunchErrors, Source};
use crate::files::{FileText, ReadFile, Texts};
use crate::fill::{fill_entry, refuse_unknown};
use crate::model::{Ego, Launch};
use crate::profiles;
use crate::tree::Table;

mod batches;
mod params;
mod processes;
mod ready;
mod rigs;
mod scenario;
mod sections;
mod sensors;
mod spectator;
mod topics;

const TOP: [&str; 12] = [
    "version",
    "include",
    "scenario",
    "ego",
    "spectator",
    "rig",
    "sensor",
    "batch",
    "topic",
    "defaults",
    "process",
    "description",
];

impl Launch {
    /// Reads and checks the text of a launch file; `file_name` is only used in messages and for the
    /// folder in which the file's relative paths begin.
    ///
    /// # Errors
    /// Everything that is wrong with it. If the text is not valid TOML, only that is reported.
    pub fn parse(text: &str, file_name: &str) -> Result<Launch, LaunchErrors> {
        Self::parse_with(text, file_name, &[])
    }

    /// As [`Launch::parse`], with `key=value` settings laid over the file (`scenario.seed=7`,
    /// `sensor.front.width_px=640`).
    ///
    /// Values are typed as in TOML. What is not a TOML value counts as a string, so
    /// `scenario.map=Town02` needs no quotes.
    ///
    /// # Errors
    /// Everything that is wrong with the file or the settings. A text cannot include files.
    pub fn parse_with(
        text: &str,
        file_name: &str,
        sets: &[String],
    ) -> Result<Launch, LaunchErrors> {
        let path = Path::new(file_name);
        let file = FileText {
            identity: path.to_owned(),
            folder: path.parent().unwrap_or(path).to_owned(),
            text: text.to_owned(),
        };
        let mut no_files = |_: &Path| Err(io::ErrorKind::Unsupported.into());
        let mut texts = Texts::new(&mut no_files);
        texts.lay_file(path, file);
        finish(texts, sets, Path::new(""))
    }

    /// Reads files, what they include, and `key=value` settings, each laid over those before it:
    /// tables merge key by key, everything else is replaced. An included file comes before the file
    /// that includes it. A file that is named again is not read again.
    ///
    /// `read_file` is [`FileText::read`], except in tests.
    ///
    /// # Errors
    /// Everything that is wrong with the files or the settings, also where two files contradict
    /// one another about what a thing is.
    pub fn load(
        files: &[PathBuf],
        sets: &[String],
        read_file: &mut ReadFile<'_>,
    ) -> Result<Launch, LaunchErrors> {
        let mut texts = Texts::new(read_file);
        for file in files {
            texts.add_file(file);
        }
        let here = std::env::current_dir().unwrap_or_default();
        finish(texts, sets, &here)
    }
}

fn finish(mut texts: Texts<'_>, sets: &[String], here: &Path) -> Result<Launch, LaunchErrors> {
    for set in sets {
        texts.add_set(set, here);
    }
    if !texts.is_broken {
        profiles::lay(&mut texts);
    }
    if texts.is_broken {
        return Err(texts.finish());
    }
    let launch = launch(&texts.tree, &texts.sources, &mut texts.errors);
    let errors = texts.finish();
    if errors.0.is_empty() {
        Ok(launch)
    } else {
        Err(errors)
    }
}

fn launch(file: &Table, sources: &[Source], errors: &mut Errors) -> Launch {
    refuse_unknown(file, &TOP, "", errors);
    if let Some(entry) = file
        .get("description")
        .filter(|entry| !entry.node.plain().is_str())
    {
        errors.push(entry.node.at, "description is no text; write it in quotes");
    }
    let scenario = scenario::read(file, errors);
    let ego = fill_entry(&Ego::default(), file.get("ego"), "ego", &[], errors);
    let spectator = spectator::read(file, errors);
    let rigs = rigs::read(file, &scenario, errors);
    let sensors = sensors::read(file, &scenario, &rigs, errors);
    sensors::check_ego(&ego, file, &rigs, &sensors, errors);
    let processes = processes::read(file, sources, errors);
    let mut launch = Launch {
        scenario,
        ego,
        spectator,
        rigs,
        sensors,
        batches: Default::default(),
        topics: Default::default(),
        processes,
    };
    launch.batches = batches::read(file, &launch, errors);
    launch.topics = topics::read(file, &launch, errors);
    launch
}
