//! From text to a checked [`Launch`].

use toml::Value as Toml;

use crate::error::{Errors, LaunchError, LaunchErrors, Place, Source};
use crate::fill::{fill_entry, refuse_unknown};
use crate::model::{Ego, Launch};
use crate::tree::{Table, merge, read, set_as_toml};

mod processes;
mod rigs;
mod scenario;
mod sections;
mod sensors;

/// Version of the launch file format.
pub const VERSION: i64 = 1;
const TOP: [&str; 8] = [
    "version",
    "scenario",
    "ego",
    "rig",
    "sensor",
    "defaults",
    "process",
    "description",
];

impl Launch {
    /// Reads and checks the text of a launch file; `file_name` is only used in messages.
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
    /// Everything that is wrong with the file or the settings.
    pub fn parse_with(
        text: &str,
        file_name: &str,
        sets: &[String],
    ) -> Result<Launch, LaunchErrors> {
        let mut errors = Errors::default();
        let mut wrong_sets = Vec::new();
        let mut set_texts = Vec::new();
        for set in sets {
            match set_as_toml(set) {
                Ok(typed) => set_texts.push((format!("--set {set}"), typed)),
                Err(message) => wrong_sets.push(LaunchError {
                    message,
                    place: "the command line".into(),
                }),
            }
        }
        let mut sources = vec![Source {
            name: file_name.to_owned(),
            text,
            is_file: true,
        }];
        sources.extend(set_texts.iter().map(|(name, text)| Source {
            name: name.clone(),
            text,
            is_file: false,
        }));
        let launch = read_all(&sources, &mut errors);
        let mut all = errors.finish(&sources).0;
        all.extend(wrong_sets);
        match launch {
            Some(launch) if all.is_empty() => Ok(launch),
            _ => Err(LaunchErrors(all)),
        }
    }
}

fn read_all(sources: &[Source<'_>], errors: &mut Errors) -> Option<Launch> {
    let mut file = read(sources[0].text, 0, errors)?;
    for (i, set) in sources.iter().enumerate().skip(1) {
        merge(&mut file, read(set.text, i, errors)?);
    }
    let launch = launch(&file, errors);
    Some(launch)
}

fn launch(file: &Table, errors: &mut Errors) -> Launch {
    check_version(file, errors);
    refuse_unknown(file, &TOP, "", errors);
    if let Some(entry) = file
        .get("description")
        .filter(|entry| !entry.node.plain().is_str())
    {
        errors.push(entry.node.at, "description is no text; write it in quotes");
    }
    let scenario = scenario::read(file, errors);
    let ego = fill_entry(&Ego::default(), file.get("ego"), "ego", &[], errors);
    let rigs = rigs::read(file, &scenario, errors);
    let sensors = sensors::read(file, &scenario, &rigs, errors);
    sensors::check_ego(&ego, file, &rigs, &sensors, errors);
    let processes = processes::read(file, errors);
    Launch {
        scenario,
        ego,
        rigs,
        sensors,
        processes,
    }
}

fn check_version(file: &Table, errors: &mut Errors) {
    match file.get("version") {
        None => errors.push(
            Place::default(),
            format!("version is missing; begin the file with version = {VERSION}"),
        ),
        Some(entry) if entry.node.plain() == Toml::Integer(VERSION) => {}
        Some(entry) => errors.push(
            entry.node.at,
            format!(
                "version is {}, but this program reads {VERSION}",
                entry.node.plain()
            ),
        ),
    }
}
