//! The folder of a set while it is made: what was begun, and which scenarios are done.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use launch_cli::files::{MAX_NOTES_BYTES, read_text};
use launch_cli::wrong_usage;
use serde::{Deserialize, Serialize};

use crate::matrix::Scenario;
use crate::recipe::Recipe;
use crate::statistics::Statistics;

/// Folder inside the set with everything that is gone when it is finished.
const WORK: &str = ".gantry-dataset";
/// The plan of a set that is not finished.
const PLAN: &str = ".gantry-dataset/plan.json";
/// The plan of a finished set.
pub const RECIPE: &str = "recipe.json";

/// What is made: the recipe and what follows from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Version of the program.
    pub version: String,
    /// The recipe.
    pub recipe: Recipe,
    /// Its scenarios.
    pub scenarios: Vec<Scenario>,
    /// Their launch files, in the same order.
    pub launches: Vec<String>,
}

/// The folder of a set.
#[derive(Clone, Debug)]
pub struct SetFolder {
    root: PathBuf,
}

/// What is in the folder of a set that is about to be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// Nothing.
    Fresh,
    /// The same set, not finished.
    Unfinished,
    /// The same set, finished.
    Finished,
}

impl SetFolder {
    /// The folder at `root`.
    pub fn new(root: &Path) -> anyhow::Result<SetFolder> {
        Ok(SetFolder {
            root: std::path::absolute(root)?,
        })
    }

    /// Its path.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// A path in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Where a scenario's recording goes.
    pub fn recording(&self, scenario: &Scenario) -> PathBuf {
        self.path(&format!("recordings/{}.mcap", scenario.name))
    }

    /// Folder for a scenario that runs.
    pub fn running(&self, name: &str) -> PathBuf {
        self.path(&format!("{WORK}/running/{name}"))
    }

    /// Folder with a file for each scenario that runs, which says what its processes are.
    pub fn registers(&self) -> PathBuf {
        self.path(&format!("{WORK}/registers"))
    }

    /// Looks what is there.
    ///
    /// # Errors
    /// [`wrong_usage`] if it holds anything else than this set.
    pub fn look(&self, plan: &Plan) -> anyhow::Result<Found> {
        let shown = self.root.display();
        let unfinished = self.path(PLAN);
        let finished = self.path(RECIPE);
        if let Ok(text) = read_text(&finished, MAX_NOTES_BYTES) {
            compare(&text, plan, &shown)?;
            return Ok(Found::Finished);
        }
        if let Ok(text) = read_text(&unfinished, MAX_NOTES_BYTES) {
            compare(&text, plan, &shown)?;
            return Ok(Found::Unfinished);
        }
        let is_empty = match fs::read_dir(&self.root) {
            Ok(mut entries) => entries.next().is_none(),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => true,
            Err(error) => {
                return Err(wrong_usage(format!(
                    "--out {shown} cannot be read: {error}; give a folder"
                )));
            }
        };
        if !is_empty {
            return Err(wrong_usage(format!(
                "{shown} is not empty and holds no set of this program; give another --out"
            )));
        }
        Ok(Found::Fresh)
    }

    /// Makes the folder, and writes down what is going to be in it.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn begin(&self, plan: &Plan) -> anyhow::Result<()> {
        for folder in ["recordings", WORK] {
            let folder = self.path(folder);
            fs::create_dir_all(&folder)
                .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        }
        replace(&self.path(PLAN), &serde_json::to_string_pretty(plan)?)
    }

    /// The statistics of a scenario that is done.
    pub fn done(&self, scenario: &Scenario) -> Option<Statistics> {
        let text = read_text(&self.statistics(scenario), MAX_NOTES_BYTES).ok()?;
        let found = serde_json::from_str(&text).ok()?;
        self.recording(scenario).exists().then_some(found)
    }

    /// A scenario is done.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn set_done(&self, scenario: &Scenario, found: &Statistics) -> anyhow::Result<()> {
        replace(&self.statistics(scenario), &serde_json::to_string(found)?)
    }

    fn statistics(&self, scenario: &Scenario) -> PathBuf {
        self.path(&format!("{WORK}/done/{}.json", scenario.name))
    }

    /// The set is finished: writes what it was made from and removes what is not needed any more.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn finish(&self, plan: &Plan) -> anyhow::Result<()> {
        // First, so that a kill from here on leaves a finished set.
        replace(&self.path(RECIPE), &serde_json::to_string_pretty(plan)?)?;
        if !plan.recipe.keep_recordings {
            remove(&self.path("recordings"))?;
        }
        remove(&self.path(WORK))
    }
}

fn compare(text: &str, plan: &Plan, shown: &std::path::Display<'_>) -> anyhow::Result<()> {
    let found: Plan = serde_json::from_str(text).map_err(|error| {
        wrong_usage(format!(
            "{shown} holds a set of another version of this program ({error}); give another --out"
        ))
    })?;
    if found.version != plan.version {
        return Err(wrong_usage(format!(
            "{shown} was begun with version {}, this is {}; give another --out",
            found.version, plan.version
        )));
    }
    if found != *plan {
        let name = &found.recipe.name;
        return Err(wrong_usage(format!(
            "{shown} holds the set {name:?} of another recipe, or of this one before it was changed; give another --out, or remove it"
        )));
    }
    Ok(())
}

/// Writes a file that is there as a whole or not at all.
///
/// # Errors
/// A sentence with the path.
pub fn replace(path: &Path, text: &str) -> anyhow::Result<()> {
    let cannot = || format!("cannot write {}", path.display());
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).with_context(cannot)?;
    }
    launch_cli::files::replace(path, text.as_bytes()).with_context(cannot)
}

fn remove(folder: &Path) -> anyhow::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}", folder.display()))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::scenarios;
    use crate::recipe::tests::SMALL;

    fn plan(text: &str) -> Plan {
        let recipe: Recipe = toml::from_str(text).unwrap();
        Plan {
            version: "1".into(),
            scenarios: scenarios(&recipe).unwrap(),
            launches: vec![],
            recipe,
        }
    }

    #[test]
    fn a_set_goes_on_where_it_was_and_is_never_mixed_with_another() {
        let folder = tempfile::tempdir().unwrap();
        let set = SetFolder::new(&folder.path().join("set")).unwrap();
        let small = plan(SMALL);
        assert_eq!(set.look(&small).unwrap(), Found::Fresh);
        assert!(!set.root().exists());
        set.begin(&small).unwrap();
        assert_eq!(set.look(&small).unwrap(), Found::Unfinished);
        let other = plan(&SMALL.replace("frames = 10", "frames = 11"));
        assert!(
            set.look(&other)
                .unwrap_err()
                .to_string()
                .contains("another recipe")
        );
        let scenario = &small.scenarios[0];
        set.set_done(scenario, &Statistics::default()).unwrap();
        assert_eq!(set.done(scenario), None, "its recording is not there");
        fs::write(set.recording(scenario), "x").unwrap();
        assert_eq!(set.done(scenario), Some(Statistics::default()));
        set.finish(&small).unwrap();
        assert_eq!(set.look(&small).unwrap(), Found::Finished);
        assert!(!set.recording(scenario).exists());
        fs::create_dir_all(folder.path().join("full/x")).unwrap();
        let full = SetFolder::new(&folder.path().join("full")).unwrap();
        assert!(
            full.look(&small)
                .unwrap_err()
                .to_string()
                .contains("not empty")
        );
    }
}
