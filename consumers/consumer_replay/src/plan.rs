//! What a file has that can be published, and the shared memory that it needs.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use launch_cli::wrong_usage;
use schema_bus::{FrameTopic, ResultTopic};
use schema_frames::about::ABOUT;
use schema_frames::{About, FrameHeader, Modality, ResultType};
use schema_recording::read::{RecordingFile, Topic, TopicKind, What};

use crate::foreign::{self, Conversion};
use crate::options::Options;

/// Ticks that the frames of a recording may be late at most: a simulator has no more in flight.
pub const MAX_TICKS_LATE: usize = 4;

/// First slot of a list, bytes; it grows when a longer one comes.
const LEAST_LIST_BYTES: usize = 16 << 10;

/// A topic of frames to be published.
#[derive(Clone, Debug)]
pub struct PlannedFrames {
    /// Its name in the file.
    pub source: Arc<str>,
    /// Its name on the bus, without the domain.
    pub name: String,
    pub modality: Modality,
    pub spec: FrameTopic,
    /// Whether its frames have no fixed length.
    pub is_list: bool,
    /// How a message of another program becomes a frame.
    pub conversion: Option<Conversion>,
}

/// A topic of results to be published.
#[derive(Clone, Debug)]
pub struct PlannedResults {
    pub source: Arc<str>,
    pub name: String,
    pub spec: ResultTopic,
}

/// What is published.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    pub frames: Vec<PlannedFrames>,
    pub results: Vec<PlannedResults>,
    /// What is not, and why: a topic and a reason each.
    pub left_out: Vec<(String, String)>,
    /// Ticks by which frames come late in the file.
    pub ticks_late: usize,
    /// Whether it is a file of another program.
    pub is_foreign: bool,
}

impl Plan {
    /// Looks at the first sample of every topic that is asked for.
    ///
    /// # Errors
    /// If the file cannot be read, or has nothing to publish.
    pub fn of(file: &RecordingFile, options: &Options) -> anyhow::Result<Plan> {
        let mut plan = Plan {
            is_foreign: !file.is_gantry(),
            ..Plan::default()
        };
        let mut firsts: Vec<(PlannedFrames, FrameHeader)> = Vec::new();
        for topic in file.topics() {
            match topic.kind {
                TopicKind::Frame if options.has_frames_of(&topic.name) => {
                    firsts.extend(plan.frames_of(file, topic, options)?);
                }
                TopicKind::Result if options.has_results_of(&topic.name) => {
                    plan.results_of(file, topic, options)?;
                }
                TopicKind::Foreign if options.has_frames_of(&topic.name) => {
                    plan.foreign_of(file, topic, options)?;
                }
                _ => {}
            }
        }
        plan.ticks_late = firsts
            .iter()
            .map(|(_, first)| first.ticks_in_flight as usize)
            .max()
            .unwrap_or(0)
            .min(MAX_TICKS_LATE);
        plan.frames
            .extend(firsts.into_iter().map(|(planned, _)| planned));
        for planned in &mut plan.frames {
            // A tick is read into its slots while the one before is being sent, and late frames keep
            // more ticks open.
            planned.spec.frames_in_flight = plan.ticks_late.max(1).saturating_add(2);
        }
        plan.check(file, options)?;
        Ok(plan)
    }

    fn frames_of(
        &mut self,
        file: &RecordingFile,
        topic: &Topic,
        options: &Options,
    ) -> anyhow::Result<Option<(PlannedFrames, FrameHeader)>> {
        let mut samples = file.first_of(topic);
        let first = loop {
            match samples.next()?.map(|sample| sample.what) {
                Some(What::Frame { header, .. }) => break Some(header),
                Some(_) => {}
                None => break None,
            }
        };
        let found = first.and_then(|header| Some((header, header.modality()?)));
        let Some((header, modality)) = found else {
            let why = "it has no frame that can be read";
            self.left_out.push((topic.name.to_string(), why.into()));
            return Ok(None);
        };
        let planned = planned(topic, modality, header.payload_bytes as usize, options)?;
        Ok(Some((planned, header)))
    }

    fn results_of(
        &mut self,
        file: &RecordingFile,
        topic: &Topic,
        options: &Options,
    ) -> anyhow::Result<()> {
        let mut samples = file.first_of(topic);
        let first = loop {
            match samples.next()?.map(|sample| sample.what) {
                Some(What::Result { header, .. }) => break Some(header),
                Some(_) => {}
                None => break None,
            }
        };
        let found = first.and_then(|header| Some((header.body_bytes as usize, header.kind()?)));
        let Some((body_bytes, kind)) = found else {
            let why = "it has no result that can be read";
            self.left_out.push((topic.name.to_string(), why.into()));
            return Ok(());
        };
        let about = about(file, &topic.name, kind)?;
        let mut spec = ResultTopic::new(kind);
        spec.body_bytes = spec.body_bytes.max(body_bytes);
        spec.about = about;
        self.results.push(PlannedResults {
            source: topic.name.clone(),
            name: options.name_of(&topic.name),
            spec,
        });
        Ok(())
    }

    fn foreign_of(
        &mut self,
        file: &RecordingFile,
        topic: &Topic,
        options: &Options,
    ) -> anyhow::Result<()> {
        let mut samples = file.first_of(topic);
        let outcome = loop {
            match samples.next()?.map(|sample| sample.what) {
                Some(What::Foreign { bytes, .. }) => break foreign::plan(topic, bytes),
                Some(_) => {}
                None => break Err(foreign::ForeignError::NoMessage),
            }
        };
        match outcome {
            // What goes into the frames of others needs no topic of its own.
            Ok(None) => {}
            Ok(Some((conversion, payload_bytes))) => {
                let modality = conversion.modality();
                let mut planned = planned(topic, modality, payload_bytes, options)?;
                planned.name = options.name_of(&foreign::name(&topic.name, modality));
                planned.conversion = Some(conversion);
                self.frames.push(planned);
            }
            Err(why) => self
                .left_out
                .push((topic.name.to_string(), why.to_string())),
        }
        Ok(())
    }

    fn check(&self, file: &RecordingFile, options: &Options) -> anyhow::Result<()> {
        let has_world = file
            .topics()
            .iter()
            .any(|topic| topic.kind == TopicKind::Snapshot);
        if self.frames.is_empty() && self.results.is_empty() && !has_world {
            let why: Vec<String> = self
                .left_out
                .iter()
                .map(|(topic, why)| format!("{topic}: {why}"))
                .collect();
            let names: Vec<&str> = file.topics().iter().map(|topic| &*topic.name).collect();
            let because = match (why.is_empty(), names.is_empty()) {
                (false, _) => format!(": {}", why.join("; ")),
                (true, true) => ": it holds no topic".to_string(),
                (true, false) => format!("; it has {}", names.join(", ")),
            };
            return Err(wrong_usage(format!(
                "{} has nothing that can be replayed{because}",
                options.file.display()
            )));
        }
        let mut taken: BTreeMap<&str, &str> = BTreeMap::new();
        let frames = self.frames.iter().map(|of| (&of.name, &of.source));
        let results = self.results.iter().map(|of| (&of.name, &of.source));
        for (name, source) in frames.chain(results) {
            if let Some(other) = taken.insert(name, source) {
                return Err(wrong_usage(format!(
                    "{other} and {source} would both be called {name}; give one of them another name with --map-topics"
                )));
            }
        }
        for planned in &self.frames {
            let last = planned.name.rsplit('/').next().unwrap_or_default();
            if planned.name.split('/').count() < 3 || last != planned.modality.name() {
                return Err(wrong_usage(format!(
                    "{} cannot be called {}: a topic of frames is RIG/SENSOR/{}",
                    planned.source,
                    planned.name,
                    planned.modality.name()
                )));
            }
        }
        Ok(())
    }

    /// Checks that all topics together fit into the shared memory that is free, before the first is
    /// made.
    ///
    /// # Errors
    /// A sentence with how much is missing.
    pub fn check_memory(&self) -> anyhow::Result<()> {
        let frames = self
            .frames
            .iter()
            .map(|of| of.spec.segment_bytes(of.modality));
        let results = self.results.iter().map(|of| of.spec.segment_bytes());
        let need_bytes = schema_bus::shared_memory_needed(frames.chain(results));
        schema_bus::check_shared_memory(need_bytes, 0).map_err(|short| {
            let mib = |bytes: u64| bytes.div_ceil(1 << 20);
            wrong_usage(format!(
                "the recording's topics need {} MiB of shared memory, but /dev/shm has {} MiB free; free space, make it larger (Docker: --shm-size={}m) or replay fewer with --topics",
                mib(need_bytes),
                mib(short.free_bytes.unwrap_or(0)),
                mib(need_bytes).saturating_add(64)
            ))
        })
    }
}

fn planned(
    topic: &Topic,
    modality: Modality,
    payload_bytes: usize,
    options: &Options,
) -> anyhow::Result<PlannedFrames> {
    let is_list = !modality.is_image() && modality.element_bytes() != payload_bytes;
    let is_list = is_list
        || modality.is_event()
        || matches!(
            modality,
            Modality::Dvs
                | Modality::Lidar
                | Modality::SemanticLidar
                | Modality::LidarReturns
                | Modality::Radar
        );
    let max_payload_bytes = match is_list {
        true => payload_bytes.saturating_mul(2).max(LEAST_LIST_BYTES),
        false => payload_bytes.max(1),
    };
    ensure!(
        max_payload_bytes < 1 << 32,
        "{}: a frame of {payload_bytes} bytes is too long for shared memory",
        topic.name
    );
    // Sensors that a client spawned have fewer readers if they are large, as in the simulator.
    let of_run_time = topic.name.starts_with("actor_") || topic.name.starts_with("free/");
    let spec = match of_run_time {
        true => FrameTopic::of_run_time_sensor(modality, max_payload_bytes),
        false => FrameTopic::new(modality, max_payload_bytes),
    };
    Ok(PlannedFrames {
        source: topic.name.clone(),
        name: options.name_of(&topic.name),
        modality,
        spec,
        is_list,
        conversion: None,
    })
}

/// The description of a topic of results, as it was first recorded.
fn about(file: &RecordingFile, topic: &str, kind: ResultType) -> anyhow::Result<About> {
    let name = format!("{topic}/{ABOUT}");
    let Some(document) = file
        .topics()
        .iter()
        .find(|of| of.kind == TopicKind::Document && *of.name == *name)
    else {
        return Ok(About::default());
    };
    let mut samples = file.first_of(document);
    while let Some(sample) = samples.next()? {
        if let What::Document { text, .. } = sample.what {
            let about: About = serde_json::from_str(text)
                .with_context(|| format!("the description of {topic} cannot be read"))?;
            return match about.check(kind) {
                Ok(()) => Ok(about),
                Err(fault) => {
                    tracing::warn!("the description of {topic} is left out: {fault}");
                    Ok(About::default())
                }
            };
        }
    }
    Ok(About::default())
}
