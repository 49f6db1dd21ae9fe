//! What a benchmark that is stopped leaves behind, so that it can go on: each finished run, and what
//! made it.

use std::fs;
use std::path::{Path, PathBuf};

use launch_cli::wrong_usage;
use schema_types::files::read_text;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use super::kept::KeptError;
use crate::capture::Capture;
use crate::run::Source;
use crate::suite::Suite;
use crate::truth_pass::TruthRecording;
use crate::truth_pass::hidden::Hidden;

/// What was run, beside the runs.
const STATE: &str = "stopped.json";
/// Most bytes of it.
const MAX_STATE_BYTES: u64 = 1 << 20;
/// The folder of the finished runs.
const RUNS: &str = "finished";

/// What makes the runs of a benchmark what they are, besides program and scenario.
#[derive(Clone, Copy, Debug)]
pub struct Makings<'a> {
    pub suite: &'a Suite,
    pub build: &'a str,
    pub source: Source,
    pub added_delay_nanos: u64,
    /// Frames of a stream.
    pub n_frames: u64,
    pub recording: Option<&'a Path>,
}

/// Runs that have finished. While programs run they lie where no program is led: their names tell
/// the seed.
#[derive(Debug)]
pub struct FinishedRuns {
    hidden: Hidden,
    /// The folder of the report.
    out: PathBuf,
    state: State,
}

/// `stopped.json`.
#[derive(Debug, Serialize, Deserialize)]
struct State {
    /// Hash of the [`Makings`].
    key: String,
    /// The seed that was drawn.
    seed: Option<u64>,
}

/// Why a benchmark cannot be gone on with.
#[derive(Debug, thiserror::Error)]
pub enum ResumeError {
    /// Nothing was stopped there.
    #[error(
        "--resume {folder}: there is no benchmark that was stopped ({source}); name the folder that the stopped one named",
        folder = folder.display()
    )]
    Nothing {
        /// The folder.
        folder: PathBuf,
        /// Why it could not be read.
        source: std::io::Error,
    },
    /// Its state cannot be read.
    #[error("--resume {folder}: {STATE} is damaged: {source}; begin anew", folder = folder.display())]
    Damaged {
        /// The folder.
        folder: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// It is of another benchmark.
    #[error(
        "--resume {folder}: that was another suite, seed, build, --source, --added-delay, --frames or --recording; say what was said then, or begin anew",
        folder = folder.display()
    )]
    Other {
        /// The folder.
        folder: PathBuf,
    },
}

impl Makings<'_> {
    fn key(&self) -> String {
        let mut hash = Sha256::new();
        for part in [
            self.suite.text.as_str(),
            self.build,
            &format!("{} {}", self.suite.seed, self.suite.is_drawn),
            &format!(
                "{:?} {} {}",
                self.source, self.added_delay_nanos, self.n_frames
            ),
            &format!("{:?}", self.recording),
        ] {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        format!("{:x}", hash.finalize())
    }
}

/// The seed that a stopped benchmark drew.
///
/// # Errors
/// [`launch_cli::WrongUsage`] if nothing was stopped there.
pub fn drawn_seed(folder: &Path) -> anyhow::Result<Option<u64>> {
    Ok(state(folder).map_err(wrong_usage)?.seed)
}

fn state(folder: &Path) -> Result<State, ResumeError> {
    let owned = || folder.to_owned();
    let text =
        read_text(&folder.join(STATE), MAX_STATE_BYTES).map_err(|source| ResumeError::Nothing {
            folder: owned(),
            source,
        })?;
    serde_json::from_str(&text).map_err(|source| ResumeError::Damaged {
        folder: owned(),
        source,
    })
}

impl FinishedRuns {
    /// None yet. They are kept in `cache` until the benchmark stops, and then in `out`.
    ///
    /// # Errors
    /// If the folders cannot be written.
    pub fn begin(out: &Path, cache: &Path, makings: &Makings<'_>) -> anyhow::Result<FinishedRuns> {
        Ok(FinishedRuns {
            hidden: Hidden::new(cache, &out.join(RUNS))?,
            out: out.to_owned(),
            state: State {
                key: makings.key(),
                seed: makings.suite.is_drawn.then_some(makings.suite.seed),
            },
        })
    }

    /// Those of a benchmark that was stopped.
    ///
    /// # Errors
    /// [`launch_cli::WrongUsage`] if it was made otherwise.
    pub fn resume(out: &Path, cache: &Path, makings: &Makings<'_>) -> anyhow::Result<FinishedRuns> {
        if state(out).map_err(wrong_usage)?.key != makings.key() {
            let folder = out.to_owned();
            return Err(wrong_usage(ResumeError::Other { folder }));
        }
        FinishedRuns::begin(out, cache, makings)
    }

    /// Takes up a finished run; `None` if it has not finished, or not on these frames.
    ///
    /// # Errors
    /// [`KeptError`] if its file is damaged.
    pub fn take(&self, truth: &TruthRecording, label: &str) -> Result<Option<Capture>, KeptError> {
        Capture::kept(&self.out.join(RUNS).join(name(truth, label)))
    }

    /// Keeps a run that has finished.
    ///
    /// # Errors
    /// [`KeptError`] if the disk refuses.
    pub fn put(
        &self,
        truth: &TruthRecording,
        label: &str,
        capture: &Capture,
    ) -> Result<(), KeptError> {
        capture.keep(&self.hidden.folder().join(name(truth, label)))
    }

    /// Whether a run has finished since this benchmark began or went on.
    pub fn has_any(&self) -> bool {
        fs::read_dir(self.hidden.folder()).is_ok_and(|mut all| all.next().is_some())
    }

    /// The benchmark was stopped: lets it be gone on with.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn stop(self) -> anyhow::Result<()> {
        self.hidden.reveal()?;
        let text = serde_json::to_string(&self.state)?;
        Ok(launch_cli::files::replace(
            &self.out.join(STATE),
            text.as_bytes(),
        )?)
    }

    /// The benchmark is over: nothing is left to be gone on with.
    pub fn end(self) {
        let _ = fs::remove_file(self.out.join(STATE));
        let _ = fs::remove_dir_all(self.out.join(RUNS));
    }
}

/// Name of the file of a run.
fn name(truth: &TruthRecording, label: &str) -> String {
    let frames = truth.frames_hash.get(..16).unwrap_or_default();
    format!("{}-{label}-{frames}", truth.scenario.name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::tests::{SMALL, read};

    #[test]
    fn only_the_same_benchmark_is_gone_on_with() {
        let folder = tempfile::tempdir().unwrap();
        let mut suite = read(SMALL).unwrap();
        suite.draw(77);
        let makings = |suite: &'static Suite| Makings {
            suite,
            build: "1",
            source: Source::Replay,
            added_delay_nanos: 0,
            n_frames: 10,
            recording: None,
        };
        let suite: &'static Suite = Box::leak(Box::new(suite));
        let error = drawn_seed(folder.path()).unwrap_err().to_string();
        assert!(error.contains("no benchmark that was stopped"), "{error}");
        let (out, cache) = (folder.path().join("out"), folder.path().join("cache"));
        fs::create_dir(&out).unwrap();
        let runs = FinishedRuns::begin(&out, &cache, &makings(suite)).unwrap();
        // Until it is stopped, nothing beside the program tells the seed.
        assert_eq!(fs::read_dir(&out).unwrap().count(), 0);
        runs.stop().unwrap();
        assert_eq!(drawn_seed(&out).unwrap(), Some(77));
        FinishedRuns::resume(&out, &cache, &makings(suite)).unwrap();
        let other = Makings {
            n_frames: 11,
            ..makings(suite)
        };
        let error = FinishedRuns::resume(&out, &cache, &other).unwrap_err();
        assert!(error.to_string().contains("that was another"), "{error}");
        FinishedRuns::resume(&out, &cache, &makings(suite))
            .unwrap()
            .end();
        assert!(drawn_seed(&out).is_err());
    }
}
