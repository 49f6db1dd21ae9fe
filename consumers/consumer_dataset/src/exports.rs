//! Runs `gantry-export` for every format of a recipe, on all recordings together.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::time::Duration;

use anyhow::Context as _;
use consumer_sets::manifest::MANIFEST;
use launch_run::{Ending, Output, Program, RunError};

use crate::matrix::Scenario;
use crate::recipe::{Export, Recipe};
use crate::state::SetFolder;

/// How often the program is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// How many lines are quoted when it fails.
const QUOTED_LINES: usize = 3;
/// Exit code of wrong usage: asking again will not help.
const WRONG_USAGE: i32 = 2;

/// One export to run.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The folder of the set.
    pub set: &'a SetFolder,
    /// The recipe.
    pub recipe: &'a Recipe,
    /// Its scenarios.
    pub scenarios: &'a [Scenario],
    /// The format.
    pub export: &'a Export,
    /// `gantry-export`.
    pub program: &'a Path,
}

impl Job<'_> {
    /// Words for the program.
    fn words(&self, resume: bool) -> Vec<String> {
        let export = self.export;
        let mut words: Vec<String> = self
            .scenarios
            .iter()
            .map(|scenario| self.set.recording(scenario).display().to_string())
            .collect();
        for scenario in self.scenarios {
            words.extend(["--scenario".into(), scenario.name.clone()]);
        }
        let mut add = |flag: &str, value: String| words.extend([flag.to_owned(), value]);
        add("--format", export.format.clone());
        add("--out", self.folder().display().to_string());
        add("--split", self.recipe.split.clone());
        add("--split-seed", self.recipe.split_seed.to_string());
        add("--every", export.every.to_string());
        if !export.cameras.is_empty() {
            add("--cameras", export.cameras.join(","));
        }
        let optional = [
            ("--rig", export.rig.clone()),
            ("--images", export.images.clone()),
            (
                "--jpeg-quality",
                export.jpeg_quality.map(|it| it.to_string()),
            ),
            ("--masks", export.masks.clone()),
            ("--min-pixels", export.min_pixels.map(|it| it.to_string())),
        ];
        for (flag, value) in optional {
            if let Some(value) = value {
                add(flag, value);
            }
        }
        if resume {
            words.push("--resume".into());
        }
        words.push("--quiet".into());
        words
    }

    fn folder(&self) -> PathBuf {
        self.set.path(self.export.folder())
    }

    /// Exports; goes on with what a stopped run left, and begins anew if that does not fit.
    ///
    /// # Errors
    /// [`RunError::Stopped`], or what the program said.
    pub fn run(&self, stop: &dyn Fn() -> bool) -> anyhow::Result<()> {
        let folder = self.folder();
        let resume = folder.exists();
        let (mut status, mut last) = self.start(resume, stop)?;
        if resume && status.code() == Some(WRONG_USAGE) {
            fs::remove_dir_all(&folder)
                .with_context(|| format!("cannot remove {}", folder.display()))?;
            (status, last) = self.start(false, stop)?;
        }
        // One that is asked to stop ends well and leaves its set unfinished.
        if status.success() && folder.join(MANIFEST).exists() {
            return Ok(());
        }
        let format = &self.export.format;
        let sentence = format!("the export to {format} ended ({status}); it said last:\n  {last}");
        if status.code() == Some(WRONG_USAGE) {
            return Err(launch_cli::wrong_usage(sentence));
        }
        anyhow::bail!("{sentence}")
    }

    /// Runs the program; returns how it ended and its last lines.
    fn start(
        &self,
        resume: bool,
        stop: &dyn Fn() -> bool,
    ) -> Result<(ExitStatus, String), RunError> {
        let log = self.set.running(&format!("{}.log", self.export.folder()));
        if let Some(folder) = log.parent() {
            fs::create_dir_all(folder)?;
        }
        let mut process = Program::new("gantry-export", self.program)
            .words(self.words(resume))
            .with_parent()
            .in_own_group()
            .quotes_lines(QUOTED_LINES)
            .start(Output::Log(&log))?;
        loop {
            if let Some(status) = process.wait(LOOK_EVERY)? {
                return Ok((status, process.last_words()));
            }
            if stop() {
                // It finishes the file that it writes, which takes as long as it takes.
                process.end_by(&Ending::term(Duration::MAX))?;
                return Err(RunError::Stopped);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::scenarios;
    use crate::recipe::tests::SMALL;

    #[test]
    fn words_name_every_recording_and_only_what_was_asked() {
        let recipe: Recipe = toml::from_str(&format!("{SMALL}min_pixels = 4\n")).unwrap();
        let scenarios = scenarios(&recipe).unwrap();
        let set = SetFolder::new(Path::new("/sets/a")).unwrap();
        let job = Job {
            set: &set,
            recipe: &recipe,
            scenarios: &scenarios[..2],
            export: &recipe.export[0],
            program: Path::new("gantry-export"),
        };
        let words = job.words(true).join(" ");
        assert_eq!(
            words,
            "/sets/a/recordings/Town01_clear_noon_s5.mcap /sets/a/recordings/Town01_clear_noon_s6.mcap \
             --scenario Town01_clear_noon_s5 --scenario Town01_clear_noon_s6 --format kitti --out /sets/a/kitti \
             --split train=1 --split-seed 0 --every 1 --min-pixels 4 --resume --quiet"
        );
    }
}
