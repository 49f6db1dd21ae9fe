//! The truth pass: a scenario is simulated once, in lockstep and as fast as the machine allows, with
//! the inputs of all programs and the sensors that see the truth, and is recorded.
//!
//! Recordings are kept in a folder under the hash of everything that makes them. A file that is not
//! whole is never taken: its description is written last, under its final name.

mod cache;
mod found;
pub(crate) mod hidden;
mod read;
pub mod take;

use std::collections::BTreeMap;
use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use launch_cli::files::{MAX_NOTES_BYTES, open_plain, read_plain, read_text};
use schema_frames::Modality;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::capture::SentFrame;
use crate::scenario::{InputTopic, Scenario};
use crate::suite::{Suite, Task};

use hidden::{MAKING, private_folder};

use found::Found;
pub use found::{Options, RecordedFrame};

/// Number of the way in which recordings are made; it rises when they change.
const WAY: u32 = 1;

/// A recording of a scenario with its truth.
#[derive(Clone, Debug)]
pub struct TruthRecording {
    /// The MCAP file.
    pub path: PathBuf,
    /// What was recorded.
    pub scenario: Scenario,
    /// The rig that carries the sensors.
    pub rig: String,
    /// SHA-256 over all frames, snapshots and results of input programs.
    pub frames_hash: String,
    /// Simulated time of the first recorded tick, nanoseconds.
    pub begin_nanos: u64,
    /// Simulated time from which on frames and queries count, nanoseconds.
    pub scored_from_nanos: u64,
    /// Simulated time of the last recorded tick, nanoseconds.
    pub end_nanos: u64,
    /// The last recorded tick.
    pub last_tick: u64,
    /// Simulated time from one query to the next, nanoseconds.
    pub query_nanos: u64,
    /// Topics that programs may get.
    pub inputs: Vec<InputTopic>,
    /// Frames of these topics, in order; when they were published says each run.
    pub frames: BTreeMap<String, Vec<RecordedFrame>>,
    /// All topics of frames and results in the file.
    pub topics: Vec<String>,
    /// What rendered.
    pub adapter: String,
    /// Version of Gantry and hash of the programs that made it.
    pub build: String,
    /// While it is open, nobody removes the recording from the cache.
    in_use: Option<Arc<fs::File>>,
}

impl TruthRecording {
    /// The topic of a task's truth of one modality: that of the benchmark's own sensor, or in a
    /// recording of a user's that of the input sensor itself.
    pub fn truth_topic(&self, task: &Task, modality: Modality) -> String {
        let own = task.truth_topic(modality);
        if self.topics.contains(&own) {
            return own;
        }
        let sensor = task.sensor.as_deref().unwrap_or_default();
        format!("{}/{sensor}/{}", self.rig, modality.name())
    }

    /// Frames of an input topic as a run sends them, without times of publication.
    pub fn sent(&self, topic: &str) -> Vec<SentFrame> {
        let name: std::sync::Arc<str> = topic.into();
        let frames = self.frames.get(topic).map(Vec::as_slice);
        let sent = |frame: &RecordedFrame| SentFrame {
            topic: name.clone(),
            tick: frame.tick,
            seq: frame.seq,
            epoch: 0,
            sim_nanos: frame.sim_nanos,
            published_mono_nanos: 0,
        };
        frames.unwrap_or_default().iter().map(sent).collect()
    }
}

/// What lies beside a recording and makes it valid.
#[derive(Debug, Serialize, Deserialize)]
struct Description {
    key: String,
    n_bytes: u64,
    scenario: Scenario,
    found: Found,
    build: String,
}

/// The folder for recordings if none is given: `gantry/bench` in the XDG cache folder.
///
/// # Errors
/// If neither `XDG_CACHE_HOME` nor `HOME` is set.
pub fn cache_folder() -> anyhow::Result<PathBuf> {
    let from = |name: &str| {
        std::env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    let xdg = from("XDG_CACHE_HOME").or_else(|| Some(from("HOME")?.join(".cache")));
    Ok(xdg
        .context("neither XDG_CACHE_HOME nor HOME is set; give a folder with --cache")?
        .join("gantry/bench"))
}

/// Version and hash of the programs that make recordings: other ones may make other frames.
///
/// # Errors
/// If one of them is missing.
pub fn build() -> anyhow::Result<String> {
    let mut hash = Sha256::new();
    for name in ["simd", "gantry-drive", "gantry-record"] {
        let path = launch_cli::programs::find(name)?;
        let (mut file, _) =
            open_plain(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let mut piece = vec![0; 1 << 20];
        loop {
            match file.read(&mut piece)? {
                0 => break,
                n => hash.update(&piece[..n]),
            }
        }
    }
    let hash = format!("{:x}", hash.finalize());
    Ok(format!("{} {}", env!("CARGO_PKG_VERSION"), &hash[..16]))
}

/// The recording of a scenario: the one that is kept, or a new one. `progress` is told how many of
/// how many ticks are done.
///
/// # Errors
/// [`Stopped`](launch_run::RunError::Stopped) if `stop` says so, or what failed.
pub fn recording(
    suite: &Suite,
    scenario: &Scenario,
    options: &Options,
    stop: &dyn Fn() -> bool,
    progress: &dyn Fn(u64, u64),
) -> anyhow::Result<TruthRecording> {
    let launch = take::launch(suite, scenario, options).map_err(launch_cli::wrong_usage)?;
    let key = key(suite, &toml::to_string(&launch)?, options);
    let short = &key[..24];
    let path = options.cache.join(format!("{short}.mcap"));
    let described = options.cache.join(format!("{short}.json"));
    // In use before it is looked at: what is looked at then stays.
    let in_use = cache::use_it(&described).ok();
    if let Some(kept) = kept(&path, &described, &key) {
        tracing::debug!(scenario = scenario.name, path = %path.display(), "the truth is kept");
        let mut truth = kept.recording(path, suite);
        truth.in_use = in_use.map(Arc::new);
        return Ok(truth);
    }
    drop(in_use);
    private_folder(&options.cache).with_context(|| {
        format!(
            "cannot make the folder {}; choose another with --cache",
            options.cache.display()
        )
    })?;
    // Removed with all that is in it, unless this process is killed.
    let making = tempfile::Builder::new()
        .prefix(&format!("{short}{MAKING}"))
        .tempdir_in(&options.cache)
        .with_context(|| format!("cannot write into {}", options.cache.display()))?;
    let part = making.path().join("truth.mcap");
    let job = take::Job {
        suite,
        launch: &launch,
        folder: making.path(),
        recording: &part,
        stall: options.stall,
    };
    take::record(&job, stop, progress)
        .with_context(|| format!("the truth of {} could not be recorded", scenario.name))?;
    let found = read::found(&part, suite, scenario)?;
    let description = Description {
        key,
        n_bytes: fs::metadata(&part)?.len(),
        scenario: scenario.clone(),
        found,
        build: options.build.clone(),
    };
    launch_cli::files::rename(&part, &path)?;
    let text = serde_json::to_string(&description)?;
    launch_cli::files::replace(&described, text.as_bytes())?;
    let mut truth = description.recording(path, suite);
    truth.in_use = cache::use_it(&described).ok().map(Arc::new);
    let n_bytes = cache::keep_below(&options.cache, options.cache_limit_bytes);
    if n_bytes > options.cache_limit_bytes {
        tracing::warn!(
            "the recordings in use have {:.1} GiB, which is more than --cache-limit",
            n_bytes as f64 / f64::from(1 << 30)
        );
    }
    Ok(truth)
}

/// A user's own recording as the truth of a scenario.
///
/// # Errors
/// [`launch_cli::WrongUsage`] if it lacks inputs that the suite's rig has.
pub fn of_file(file: &Path, suite: &Suite, options: &Options) -> anyhow::Result<TruthRecording> {
    if !file.is_file() {
        return Err(launch_cli::wrong_usage(format!(
            "--recording {}: there is no such file",
            file.display()
        )));
    }
    let recorded = || "recorded".to_owned();
    let mut scenario = Scenario {
        name: consumer_truth::recording::scenario_name(file),
        rig: suite.rigs().into_iter().next().unwrap_or_default(),
        weather: recorded(),
        time: recorded(),
        density: recorded(),
        ..Scenario::default()
    };
    let found = read::found(file, suite, &scenario)?;
    (scenario.map, scenario.seed) = (found.map.clone(), found.seed);
    let description = Description {
        key: String::new(),
        n_bytes: 0,
        scenario,
        found,
        build: options.build.clone(),
    };
    Ok(description.recording(file.to_owned(), suite))
}

/// What a scenario is in which the program drives: nothing is recorded beforehand.
///
/// # Errors
/// [`launch_cli::WrongUsage`] if the rig is wrong.
pub fn of_closed_loop(
    suite: &Suite,
    scenario: &Scenario,
    options: &Options,
) -> anyhow::Result<TruthRecording> {
    let inputs = scenario.inputs(suite).map_err(launch_cli::wrong_usage)?;
    let nanos = |secs: f64| (secs * 1e9).round() as u64;
    let ticks = ((suite.settle_s + suite.warm_up_s + suite.secs) * suite.tick_hz).round();
    Ok(TruthRecording {
        path: PathBuf::new(),
        scenario: scenario.clone(),
        rig: "ego".into(),
        frames_hash: String::new(),
        begin_nanos: nanos(suite.settle_s),
        scored_from_nanos: nanos(suite.settle_s + suite.warm_up_s),
        end_nanos: nanos(suite.settle_s + suite.warm_up_s + suite.secs),
        last_tick: ticks as u64,
        query_nanos: (1e9 / suite.query_hz).round() as u64,
        topics: inputs.iter().map(|input| input.topic.clone()).collect(),
        inputs,
        frames: BTreeMap::new(),
        adapter: String::new(),
        build: options.build.clone(),
        in_use: None,
    })
}

impl Description {
    fn recording(self, path: PathBuf, suite: &Suite) -> TruthRecording {
        let found = self.found;
        TruthRecording {
            path,
            scenario: self.scenario,
            rig: found.rig,
            frames_hash: found.frames_hash,
            begin_nanos: found.begin_nanos,
            scored_from_nanos: found.begin_nanos + (suite.warm_up_s * 1e9).round() as u64,
            end_nanos: found.end_nanos,
            last_tick: found.last_tick,
            query_nanos: (1e9 / suite.query_hz).round() as u64,
            inputs: found.inputs,
            frames: found.frames,
            topics: found.topics,
            adapter: found.adapter,
            build: self.build,
            in_use: None,
        }
    }
}

/// What is kept under a key, if it is whole.
fn kept(path: &Path, described: &Path, key: &str) -> Option<Description> {
    let text = read_text(described, MAX_NOTES_BYTES).ok()?;
    let description: Description = serde_json::from_str(&text).ok()?;
    let n_bytes = fs::metadata(path).ok()?.len();
    (description.key == key && description.n_bytes == n_bytes).then_some(description)
}

/// The hash of everything that makes a recording.
fn key(suite: &Suite, launch: &str, options: &Options) -> String {
    let mut hash = Sha256::new();
    let lengths = [suite.settle_s, suite.warm_up_s, suite.secs];
    for part in [
        WAY.to_string().as_str(),
        launch,
        &format!("{lengths:?} {}", suite.drive),
        &options.build,
    ] {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    // What input programs say is recorded too, so their own files make it.
    for program in &suite.input_programs {
        let folder = program.cwd.as_deref().unwrap_or(Path::new(""));
        for word in &program.cmd {
            if let Ok(bytes) = read_plain(&folder.join(word), MAX_NOTES_BYTES) {
                hash.update((bytes.len() as u64).to_le_bytes());
                hash.update(bytes);
            }
        }
    }
    format!("{:x}", hash.finalize())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::scenarios;
    use crate::suite::tests::{SMALL, read};

    #[test]
    fn a_key_changes_with_the_frames_and_not_with_the_programs() {
        let options = Options {
            cache: PathBuf::new(),
            cache_limit_bytes: u64::MAX,
            adapter: None,
            stall: std::time::Duration::from_secs(1),
            build: "1".into(),
        };
        let key_of = |text: &str, options: &Options| {
            let suite = read(text).unwrap();
            let scenario = &scenarios(&suite).unwrap()[0];
            let launch = take::launch(&suite, scenario, options).unwrap();
            key(&suite, &toml::to_string(&launch).unwrap(), options)
        };
        let usual = key_of(SMALL, &options);
        assert_eq!(usual, key_of(&SMALL.replace("./free", "./other"), &options));
        for (from, to) in [
            ("secs = 2.0", "secs = 3.0"),
            ("secs = 2.0", "secs = 2.0\nseed = 5"),
            ("width_px = 96", "width_px = 98"),
            ("tick_hz = 20", "tick_hz = 20\nquery_hz = 20"),
        ] {
            assert_ne!(usual, key_of(&SMALL.replace(from, to), &options), "{to}");
        }
        let build = "2".into();
        assert_ne!(usual, key_of(SMALL, &Options { build, ..options }));
    }

    #[test]
    fn half_a_recording_is_not_taken() {
        let folder = tempfile::tempdir().unwrap();
        let (path, described) = (folder.path().join("a.mcap"), folder.path().join("a.json"));
        let description = Description {
            key: "k".into(),
            n_bytes: 3,
            scenario: Scenario::default(),
            found: Found::default(),
            build: String::new(),
        };
        fs::write(&described, serde_json::to_string(&description).unwrap()).unwrap();
        assert!(kept(&path, &described, "k").is_none());
        fs::write(&path, "ab").unwrap();
        assert!(kept(&path, &described, "k").is_none());
        fs::write(&path, "abc").unwrap();
        assert!(kept(&path, &described, "k").is_some());
        assert!(kept(&path, &described, "other").is_none());
    }
}
