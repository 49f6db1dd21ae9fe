//! What one run needs: the program, what it is shown, and how.

use std::path::{Path, PathBuf};

use schema_recording::pattern;

use crate::capture::Mode;
use crate::suite::{Program, Suite};
use crate::truth_pass::TruthRecording;

/// The recording of a run in which the program drives.
pub(super) fn drive_recording(job: &Job<'_>) -> PathBuf {
    job.folder.join("drive.mcap")
}

/// Where the frames come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Source {
    /// The recording of the truth pass is replayed: nothing is rendered beside the program.
    #[default]
    Replay,
    /// The simulator runs the recorded run again, and renders beside the program.
    Live,
}

/// How a program is driven.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// Every frame is waited for.
    Offline,
    /// Real time, or a multiple of it.
    Streaming {
        /// Simulated seconds per second of the wall clock.
        speed: f64,
    },
    /// A constant stream: frames at one rate, whatever the program does.
    Constant {
        /// Frames that are sent.
        n_frames: u64,
        /// Simulated seconds per second of the wall clock.
        speed: f64,
    },
    /// A single stream: the next frame comes when the last one was answered.
    Single {
        /// Frames that are sent.
        n_frames: u64,
    },
}

impl Drive {
    /// The mode under which it is reported.
    pub fn mode(self) -> Mode {
        match self {
            Drive::Offline => Mode::Offline,
            Drive::Streaming { .. } => Mode::Streaming,
            Drive::Constant { .. } | Drive::Single { .. } => Mode::Stress,
        }
    }

    /// Simulated seconds per second of the wall clock; 0 if frames are waited for.
    pub fn speed(self) -> f64 {
        match self {
            Drive::Streaming { speed } | Drive::Constant { speed, .. } => speed,
            Drive::Offline | Drive::Single { .. } => 0.0,
        }
    }

    /// Frames that are sent in a stream without end.
    pub(super) fn n_frames(self) -> Option<u64> {
        match self {
            Drive::Constant { n_frames, .. } | Drive::Single { n_frames } => Some(n_frames),
            Drive::Offline | Drive::Streaming { .. } => None,
        }
    }

    pub(super) fn is_in_lockstep(self) -> bool {
        matches!(self, Drive::Offline | Drive::Single { .. })
    }
}

/// Settings of all runs.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Where the frames come from.
    pub source: Source,
    /// Added to the time at which every result counts as available.
    pub added_delay_nanos: u64,
    /// Processor cores of the simulator or the replay; empty: all.
    pub cores_world: Vec<u32>,
    /// Processor cores of programs that name none; empty: all.
    pub cores_program: Vec<u32>,
    /// GPU for the simulator, as `simd --adapter` takes it.
    pub adapter: Option<String>,
}

/// What one run needs.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The suite.
    pub suite: &'a Suite,
    /// The program.
    pub program: &'a Program,
    /// What it is shown.
    pub truth: &'a TruthRecording,
    /// How.
    pub drive: Drive,
    /// Settings of all runs.
    pub options: &'a Options,
    /// Folder for logs; it is made.
    pub folder: &'a Path,
}

/// Topics of a recording that a program gets.
pub(super) fn inputs_of(program: &Program, truth: &TruthRecording) -> Vec<String> {
    let all = topics(truth);
    let is_wanted = |topic: &String| {
        program.inputs.is_empty()
            || program
                .inputs
                .iter()
                .any(|wanted| pattern::matches(wanted, topic))
    };
    all.into_iter().filter(is_wanted).collect()
}

/// All topics of a recording that programs may get.
pub(super) fn topics(truth: &TruthRecording) -> Vec<String> {
    let all = truth.inputs.iter().map(|input| input.topic.clone());
    all.collect()
}

/// Frames of these topics.
pub(super) fn n_frames(truth: &TruthRecording, inputs: &[String]) -> usize {
    let frames = inputs.iter().filter_map(|topic| truth.frames.get(topic));
    frames.map(Vec::len).sum()
}

/// The topic whose frames a stream counts: of the first task that the program is about.
pub(super) fn streamed(job: &Job<'_>, inputs: &[String]) -> Option<String> {
    let results = &job.program.results;
    let mut tasks = job.suite.tasks.iter();
    let task = tasks.find(|task| results.is_empty() || results.values().any(|it| *it == task.name));
    let of_task = |topic: &&String| {
        let sensor = task.and_then(|task| task.sensor.as_deref());
        topic.split('/').nth(1) == sensor
    };
    inputs.iter().find(of_task).or(inputs.first()).cloned()
}
