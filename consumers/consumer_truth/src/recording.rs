//! Opens a recording: what it holds before its first tick, and its ticks one after the other.

use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use launch_cli::wrong_usage;
use nalgebra::Isometry3;
use schema_frames::{ActorInfo, ActorList, FrameHeader, Modality, SensorKind, WorldInfo};
use schema_recording::read::{RecordedDocument, RecordingFile, Samples, TopicKind, What};
use schema_recording::scenery::{self, SceneryList};

use crate::scenario::{Scenario, Sensor, Topic};
use crate::ticks::{TickFrame, TickJoiner, TickSet};

/// Which rig of the recording is exported.
///
/// # Errors
/// [`wrong_usage`] if there is no such rig, or several and none was chosen.
fn choose_rig(name: &str, rigs: &[&str], asked: Option<&str>) -> anyhow::Result<String> {
    let list = || rigs.join(", ");
    match (asked, rigs) {
        (_, []) => Err(wrong_usage(format!(
            "{name} holds no frames of any rig, so there is nothing to export; record with sensors"
        ))),
        (Some(asked), _) if rigs.contains(&asked) => Ok(asked.into()),
        (Some(asked), _) => Err(wrong_usage(format!(
            "{name} has no rig {asked:?}; it has {}",
            list()
        ))),
        (None, _) if rigs.contains(&"ego") => Ok("ego".into()),
        (None, [only]) => Ok((*only).into()),
        (None, _) => Err(wrong_usage(format!(
            "{name} has several rigs ({}); choose one with --rig",
            list()
        ))),
    }
}

/// Rig, sensor and modality of a frame's topic.
fn parts(topic: &str) -> Option<(&str, &str, Modality)> {
    let mut words = topic.split('/');
    let (rig, sensor, modality) = (words.next()?, words.next()?, words.next()?);
    let modality = Modality::from_name(modality)?;
    words.next().is_none().then_some((rig, sensor, modality))
}

/// Learns what a recording holds. Only its summary, its documents and the first frame of each topic
/// of the rig are read.
///
/// # Errors
/// A sentence if it is no recording of ours, or lacks the rig.
pub fn scenario(
    file: &RecordingFile,
    name: &str,
    index: u32,
    split: &str,
    rig: Option<&str>,
) -> anyhow::Result<Scenario> {
    let frames = || {
        let topics = file
            .topics()
            .iter()
            .filter(|topic| topic.kind == TopicKind::Frame);
        topics.filter_map(|topic| Some((topic, parts(&topic.name)?)))
    };
    let mut rigs: Vec<&str> = frames().map(|(_, (rig, ..))| rig).collect();
    rigs.sort_unstable();
    rigs.dedup();
    let rig = choose_rig(name, &rigs, rig)?;
    let Some((start_nanos, end_nanos)) = file.span() else {
        return Err(wrong_usage(format!("{name} holds no messages")));
    };
    let documents = first_documents(file, &["world/info", "world/actors", "world/map"])?;
    let document = |topic: &str| documents.iter().find(|document| *document.topic == *topic);
    let Some(text) = document("world/info") else {
        return Err(wrong_usage(format!(
            "{name} has no document world/info; only recordings of gantry-record can be exported"
        )));
    };
    let info: WorldInfo = serde_json::from_str(&text.text)
        .with_context(|| format!("world/info of {name} is not what this version understands"))?;
    let actors: ActorList = match document("world/actors") {
        Some(document) => serde_json::from_str(&document.text)
            .with_context(|| format!("world/actors of {name} is broken"))?,
        None => ActorList::default(),
    };
    let opendrive = document("world/map").map(|document| document.text.as_str().into());
    let mut found: Vec<(Topic, Isometry3<f64>)> = Vec::new();
    for (topic, (_, sensor, modality)) in frames().filter(|(_, (r, ..))| *r == rig) {
        let Some(first) = first_header(file.first_of(topic), modality)? else {
            continue;
        };
        if first.lens_model() != 0 {
            return Err(wrong_usage(format!(
                "{name} has {}, images through a calibrated lens, and exports know pinhole cameras only; record the others alone with --topics",
                topic.name
            )));
        }
        let place = place(file, &actors.actors, &topic.name, &first)?;
        found.push((
            Topic {
                name: topic.name.clone(),
                sensor: sensor.into(),
                modality,
                first,
            },
            place,
        ));
    }
    found.sort_by(|(a, _), (b, _)| a.sensor.cmp(&b.sensor).then(a.modality.cmp(&b.modality)));
    let mut sensors: Vec<Sensor> = Vec::new();
    for (topic, carrier_from_sensor) in found {
        if sensors
            .last()
            .is_none_or(|last| *last.name != *topic.sensor)
        {
            sensors.push(Sensor {
                name: topic.sensor.to_string(),
                kind: topic.first.sensor_kind().unwrap_or(SensorKind::Event),
                carrier_from_sensor,
                topics: Vec::new(),
            });
        }
        sensors
            .last_mut()
            .expect("one was just added")
            .topics
            .push(topic);
    }
    let carrier_id = sensors.first().map_or(0, |sensor| sensor.first().parent_id);
    Ok(Scenario {
        name: name.into(),
        index,
        split: split.into(),
        rig,
        carrier_id,
        info,
        start_nanos,
        end_nanos,
        sensors,
        opendrive,
    })
}

/// The first document of each of these topics. A recorder may file those that were there before it
/// some ticks after its first snapshot.
fn first_documents(file: &RecordingFile, topics: &[&str]) -> anyhow::Result<Vec<RecordedDocument>> {
    let has = |topic: &&&str| file.topics().iter().any(|there| *there.name == ***topic);
    let n_there = topics.iter().filter(has).count();
    let mut found: Vec<RecordedDocument> = Vec::new();
    let mut samples = file.samples_of((0, u64::MAX), |topic| {
        topic.kind == TopicKind::Document && topics.contains(&&*topic.name)
    });
    while found.len() < n_there
        && let Some(sample) = samples.next()?
    {
        let log_nanos = sample.log_nanos;
        if let What::Document {
            topic,
            header,
            text,
        } = sample.what
            && found.iter().all(|document| document.topic != *topic)
        {
            let (topic, text) = (topic.clone(), text.to_string());
            found.push(RecordedDocument {
                topic,
                header,
                text,
                log_nanos,
            });
        }
    }
    Ok(found)
}

/// Header of the first frame that can be read; `None` if there is none.
fn first_header(mut samples: Samples, modality: Modality) -> anyhow::Result<Option<FrameHeader>> {
    while let Some(sample) = samples.next()? {
        if let What::Frame { header, .. } = sample.what
            && header.modality() == Some(modality)
        {
            return Ok(Some(header));
        }
    }
    Ok(None)
}

/// Place of a sensor on its carrier: from the list of actors, else from the snapshot of its first
/// frame; of a sensor without a carrier its place in the world.
fn place(
    file: &RecordingFile,
    actors: &[ActorInfo],
    topic: &str,
    first: &FrameHeader,
) -> anyhow::Result<Isometry3<f64>> {
    if first.parent_id == 0 {
        return Ok(first.world_from_sensor.isometry());
    }
    let is_its = |actor: &&ActorInfo| actor.topics.iter().any(|own| own.topic == topic);
    if let Some(mount) = actors.iter().find(is_its).and_then(|actor| actor.mount) {
        return Ok(schema_types::Pose::from(mount).isometry());
    }
    let times = (first.sim_nanos, u64::MAX);
    let mut samples = file.samples_of(times, |topic| topic.kind == TopicKind::Snapshot);
    while let Some(sample) = samples.next()? {
        let What::Snapshot { header, records } = sample.what else {
            continue;
        };
        if header.tick > first.tick {
            break;
        }
        let carrier = records.iter().find(|record| record.id == first.parent_id);
        if let Some(carrier) = carrier.filter(|_| header.tick == first.tick) {
            let world_from_carrier = carrier.world_from_actor.isometry();
            return Ok(world_from_carrier.inverse() * first.world_from_sensor.isometry());
        }
    }
    anyhow::bail!(
        "{}: neither world/actors nor a snapshot of tick {} tells where {topic} is mounted",
        file.path().display(),
        first.tick
    )
}

/// Reads ticks.
pub struct TickReader {
    samples: Samples,
    joiner: TickJoiner,
    at_end: bool,
    /// Payloads that could not be read.
    n_bad_payloads: u64,
    first_bad: Option<String>,
    /// A sentence for each list of the map's objects that could not be read.
    bad_scenery: Vec<String>,
}

impl TickReader {
    /// Reads ticks filed from the first time on and before the second, with frames of these topics.
    ///
    /// # Errors
    /// A sentence if the file cannot be read.
    pub fn new(
        file: &RecordingFile,
        (from_nanos, to_nanos): (u64, u64),
        topics: &HashSet<Arc<str>>,
    ) -> anyhow::Result<TickReader> {
        let mut joiner = TickJoiner::default();
        let is_list = |document: &RecordedDocument| &*document.topic == "world/actors";
        let mut lists = file.documents_at(from_nanos)?;
        lists.retain(is_list);
        if lists.is_empty() {
            lists = first_documents(file, &["world/actors"])?;
        }
        for list in lists {
            joiner.actors(list.header.revision, &list.text)?;
        }
        let mut bad_scenery = Vec::new();
        for name in file.attachment_names() {
            let Some(tick) = scenery::tick_of(name) else {
                continue;
            };
            let list = scenery_list(file, name).unwrap_or_else(|error| {
                bad_scenery.push(format!("{error:#}"));
                // What stands there from then on is not known.
                SceneryList {
                    tick,
                    ..SceneryList::default()
                }
            });
            joiner.scenery(list);
        }
        let samples = file.samples_of((from_nanos, to_nanos), |topic| match topic.kind {
            TopicKind::Frame => topics.contains(&topic.name),
            TopicKind::Snapshot => true,
            TopicKind::Document => &*topic.name == "world/actors",
            _ => false,
        });
        Ok(TickReader {
            samples,
            joiner,
            at_end: false,
            n_bad_payloads: 0,
            first_bad: None,
            bad_scenery,
        })
    }

    /// The next tick; `None` at the end.
    ///
    /// # Errors
    /// A sentence if the disk cannot be read.
    pub fn next_tick(&mut self) -> anyhow::Result<Option<TickSet>> {
        loop {
            if let Some(set) = self.joiner.next(self.at_end) {
                return Ok(Some(set));
            }
            if self.at_end {
                return Ok(None);
            }
            let Some(sample) = self.samples.next()? else {
                self.at_end = true;
                continue;
            };
            match sample.what {
                What::Frame {
                    topic,
                    header,
                    mut payload,
                } => {
                    let Some(modality) = header.modality() else {
                        continue;
                    };
                    match payload.to_vec() {
                        Ok(payload) => {
                            let topic = topic.clone();
                            self.joiner.frame(TickFrame {
                                topic,
                                modality,
                                header,
                                payload,
                            });
                        }
                        Err(error) => {
                            self.n_bad_payloads += 1;
                            let tick = header.tick;
                            self.first_bad
                                .get_or_insert(format!("{topic} of tick {tick}: {error}"));
                        }
                    }
                }
                What::Snapshot { header, records } => {
                    self.joiner.snapshot(header, records.to_vec())
                }
                What::Document { header, text, .. } => {
                    self.joiner
                        .actors(header.revision, text)
                        .context("the recording is damaged")?;
                }
                _ => {}
            }
        }
    }

    /// What could not be read so far: how many things, and a sentence for each of the first few.
    pub fn losses(&self) -> (u64, Vec<String>) {
        let damage = self.samples.damage();
        let n_bad = self.n_bad_payloads + self.bad_scenery.len() as u64;
        let n = damage.total() + n_bad + self.joiner.n_late;
        let mut sentences = damage.sentences().to_vec();
        sentences.extend(self.first_bad.clone());
        sentences.extend(self.bad_scenery.first().cloned());
        if self.joiner.n_late > 0 {
            let n = self.joiner.n_late;
            sentences.push(format!(
                "{n} frames or snapshots stand too far from their tick"
            ));
        }
        (n, sentences)
    }
}

/// The list of the map's objects in an attachment.
fn scenery_list(file: &RecordingFile, name: &str) -> anyhow::Result<SceneryList> {
    let bytes = file.attachment(name)?.unwrap_or_default();
    serde_json::from_slice(&bytes).with_context(|| format!("the attachment {name} is broken"))
}

/// A recording's name as a scenario: the file's without `.mcap` and `.part`.
pub fn scenario_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.strip_suffix(".part").unwrap_or(&name);
    let name = name.strip_suffix(".mcap").unwrap_or(name);
    let tame = |c: char| {
        if c.is_ascii_alphanumeric() || "-_.".contains(c) {
            c
        } else {
            '_'
        }
    };
    let name: String = name.chars().map(tame).collect();
    let name = name.trim_start_matches('.');
    if name.is_empty() {
        "scenario".into()
    } else {
        name.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_gives_its_scenario_a_tame_name() {
        let named = |path: &str| scenario_name(Path::new(path));
        assert_eq!(named("runs/town 1.mcap"), "town_1");
        assert_eq!(named("drive.2.mcap.part"), "drive.2");
        assert_eq!(named("/.mcap"), "scenario");
    }

    #[test]
    fn the_rig_is_the_asked_one_or_ego_or_the_only_one() {
        assert_eq!(choose_rig("f", &["a", "ego"], None).expect("ego"), "ego");
        assert_eq!(choose_rig("f", &["a"], None).expect("the only one"), "a");
        assert_eq!(choose_rig("f", &["a", "b"], Some("b")).expect("asked"), "b");
        for (rigs, asked) in [(&["a", "b"][..], None), (&[], None), (&["a"], Some("b"))] {
            assert!(choose_rig("f", rigs, asked).is_err());
        }
    }
}
