//! Learns what a recording holds: frames of inputs, the time that it covers, and the hash of
//! everything in it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context as _, bail};
use launch_cli::wrong_usage;
use schema_frames::header::HASHED_HEADER_BYTES;
use schema_frames::result::HASHED_RESULT_BYTES;
use schema_frames::{SnapshotHeader, WorldInfo};
use schema_recording::read::{RecordingFile, TopicKind, What};
use sha2::{Digest as _, Sha256};

use super::found::{Found, RecordedFrame};
use crate::scenario::{InputTopic, Scenario};
use crate::suite::Suite;

/// Bytes of a snapshot's header that take part in hashes.
const SNAPSHOT_BYTES: usize = std::mem::offset_of!(SnapshotHeader, epoch);
/// Chunks that are unpacked ahead.
const AHEAD: usize = 2;

/// Reads a whole recording once.
///
/// # Errors
/// [`wrong_usage`] if it is damaged, or lacks inputs that the suite's rig has.
pub(super) fn found(path: &Path, suite: &Suite, scenario: &Scenario) -> anyhow::Result<Found> {
    let shown = path.display();
    let file = RecordingFile::open(path)?;
    if !file.is_complete() {
        return Err(wrong_usage(format!(
            "{shown} is cut off or damaged; `gantry record recover` saves what is whole"
        )));
    }
    let holds = |kind| file.topics().iter().filter(move |topic| topic.kind == kind);
    let topics: Vec<String> = holds(TopicKind::Frame)
        .chain(holds(TopicKind::Result))
        .map(|topic| topic.name.to_string())
        .collect();
    let rig = rig(&topics);
    let mut inputs = inputs(suite, scenario, &rig, &topics).map_err(|what| {
        let all = topics.join(", ");
        wrong_usage(format!("{shown} {what}; it has {all}"))
    })?;
    inputs.extend(holds(TopicKind::Result).map(|topic| InputTopic {
        topic: topic.name.to_string(),
        sensor: String::new(),
        rate_hz: None,
    }));
    let wanted: BTreeSet<String> = inputs.iter().map(|input| input.topic.clone()).collect();
    let mut frames: BTreeMap<String, Vec<RecordedFrame>> = BTreeMap::new();
    // Files hold samples in no fixed order, so each has a hash of its own.
    let mut hashes: BTreeMap<(String, u64, u64), [u8; 32]> = BTreeMap::new();
    let (mut begin_nanos, mut end_nanos, mut last_tick) = (u64::MAX, 0, 0);
    let mut info = None;
    let mut samples = file
        .samples_of((0, u64::MAX), |topic| {
            matches!(
                topic.kind,
                TopicKind::Frame | TopicKind::Result | TopicKind::Snapshot | TopicKind::Document
            )
        })
        .read_ahead(AHEAD);
    while let Some(sample) = samples.next()? {
        let mut hash = Sha256::new();
        let (topic, tick, seq) = match sample.what {
            What::Frame {
                topic,
                header,
                mut payload,
            } => {
                hash.update(&bytemuck::bytes_of(&header)[..HASHED_HEADER_BYTES]);
                let bytes = payload
                    .to_vec()
                    .with_context(|| format!("{shown}: {topic} of tick {}", header.tick))?;
                hash.update(&bytes);
                if wanted.contains(&**topic) {
                    frames
                        .entry(topic.to_string())
                        .or_default()
                        .push(RecordedFrame {
                            tick: header.tick,
                            seq: header.seq,
                            sim_nanos: header.sim_nanos,
                        });
                }
                (topic.to_string(), header.tick, header.seq)
            }
            What::Result {
                topic,
                header,
                mut body,
                ..
            } => {
                hash.update(&bytemuck::bytes_of(&header)[..HASHED_RESULT_BYTES]);
                hash.update(body.to_vec()?);
                frames
                    .entry(topic.to_string())
                    .or_default()
                    .push(RecordedFrame {
                        tick: header.tick,
                        seq: header.seq,
                        sim_nanos: header.sim_nanos,
                    });
                (topic.to_string(), header.tick, header.seq)
            }
            What::Snapshot { header, records } => {
                begin_nanos = begin_nanos.min(header.sim_nanos);
                if header.tick >= last_tick {
                    (last_tick, end_nanos) = (header.tick, header.sim_nanos);
                }
                hash.update(&bytemuck::bytes_of(&header)[..SNAPSHOT_BYTES]);
                hash.update(bytemuck::cast_slice::<_, u8>(records));
                (String::new(), header.tick, 0)
            }
            What::Document { topic, text, .. } => {
                if &**topic == "world/info" && info.is_none() {
                    let read: WorldInfo = serde_json::from_str(text)
                        .with_context(|| format!("{shown}: world/info cannot be read"))?;
                    info = Some(read);
                }
                continue;
            }
            _ => continue,
        };
        hashes.insert((topic, tick, seq), hash.finalize().into());
    }
    let damage = samples.damage();
    if damage.total() > 0 {
        return Err(wrong_usage(format!(
            "{shown} is damaged: {}",
            damage.sentences().join("; ")
        )));
    }
    let info = info.with_context(|| format!("{shown} has no world/info"))?;
    if last_tick == 0 || frames.values().all(Vec::is_empty) {
        return Err(wrong_usage(format!(
            "{shown} holds no frames of {}",
            wanted.into_iter().collect::<Vec<_>>().join(", ")
        )));
    }
    for frames in frames.values_mut() {
        frames.sort_by_key(|frame| (frame.tick, frame.seq));
    }
    let mut whole = Sha256::new();
    for ((topic, tick, seq), hash) in &hashes {
        whole.update(topic);
        whole.update(tick.to_le_bytes());
        whole.update(seq.to_le_bytes());
        whole.update(hash);
    }
    Ok(Found {
        map: info.map,
        seed: info.seed,
        rig,
        frames_hash: format!("{:x}", whole.finalize()),
        begin_nanos,
        end_nanos,
        last_tick,
        inputs,
        frames,
        topics,
        adapter: info.adapter,
    })
}

/// The rig of a recording: `ego`, or the first one.
fn rig(topics: &[String]) -> String {
    let rigs: BTreeSet<&str> = topics
        .iter()
        .filter_map(|topic| topic.split('/').next())
        .collect();
    match rigs.contains("ego") {
        true => "ego".into(),
        false => rigs.into_iter().next().unwrap_or("ego").into(),
    }
}

/// The inputs of a scenario, as they are called in the recording.
fn inputs(
    suite: &Suite,
    scenario: &Scenario,
    rig: &str,
    topics: &[String],
) -> anyhow::Result<Vec<InputTopic>> {
    let mut inputs = scenario.rig_inputs(suite)?;
    for input in &mut inputs {
        if let Some(rest) = input.topic.strip_prefix("ego/") {
            input.topic = format!("{rig}/{rest}");
        }
    }
    // Sensors that speak only when something happens may have been silent.
    let lacks = |input: &&InputTopic| input.rate_hz.is_some() && !topics.contains(&input.topic);
    match inputs.iter().find(lacks) {
        Some(input) => bail!("lacks {}, which the suite shows", input.topic),
        None => Ok(inputs),
    }
}
