//! A recording as a file of rerun: every sample goes through the same drawing as live ones.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

use consumer_kit::items::ResultParts;
use rerun::RecordingStreamBuilder;
use schema_bus::names;
use schema_frames::{About, ActorList, WorldInfo};
use schema_recording::read::{RecordingFile, Selection, TopicKind, What};

use crate::layout::{APPLICATION, Place};
use crate::look::Look;
use crate::rerun;
use crate::rrd_file::record_into;
use crate::session::Shown;
use crate::stage::Stage;

/// How long sending the last data may take.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(60);

/// Writes `input` as the new rerun file `output`.
///
/// # Errors
/// If `input` cannot be read or holds nothing of ours, or `output` exists or cannot be written.
pub fn convert(input: &Path, output: &Path, look: &Look) -> anyhow::Result<Shown> {
    anyhow::ensure!(
        !output.exists(),
        "{} exists already; choose another name or remove it first",
        output.display()
    );
    let file = RecordingFile::open(input)?;
    anyhow::ensure!(
        file.is_gantry(),
        "{} was not recorded by Gantry; rerun itself opens MCAP files of other programs",
        input.display()
    );
    let (rec, health) = record_into(RecordingStreamBuilder::new(APPLICATION), output)?;
    let mut stage = Stage::new(rec, look.clone())?;
    let frames = file
        .topics()
        .iter()
        .filter(|topic| topic.kind == TopicKind::Frame && Place::new(&topic.name).is_some());
    let shown_topics: BTreeSet<&str> = frames.map(|topic| &*topic.name).collect();
    stage.set_topics(shown_topics.iter().copied())?;

    let mut shown = Shown {
        n_runs: 1,
        ..Shown::default()
    };
    let mut about: BTreeMap<String, About> = BTreeMap::new();
    let mut bytes = Vec::new();
    let mut n_unread = 0u64;
    let mut samples = file.samples(&Selection::default());
    while let Some(sample) = samples.next()? {
        health.check()?;
        match sample.what {
            What::Document { topic, text, .. } => match &**topic {
                names::WORLD_MAP => stage.set_map(text)?,
                names::WORLD_ACTORS => stage.set_actors(&serde_json::from_str::<ActorList>(text)?),
                names::WORLD_INFO => {
                    let info: WorldInfo = serde_json::from_str(text)?;
                    let sentence = format!("{}, seed {}, {} run", info.map, info.seed, info.source);
                    stage.say(rerun::TextLogLevel::INFO, &sentence)?;
                }
                other => {
                    if let Some(of) = other.strip_suffix("/about")
                        && let Ok(found) = serde_json::from_str::<About>(text)
                    {
                        about.insert(of.to_string(), found);
                    }
                }
            },
            What::Snapshot { header, records } => {
                stage.remember(&header, records);
                stage.show_snapshot(&header, records)?;
            }
            What::Frame {
                topic,
                header,
                mut payload,
            } if shown_topics.contains(&**topic) => {
                bytes.resize(payload.len(), 0);
                match payload.read_into(&mut bytes) {
                    Ok(()) => {
                        stage.show_frame(topic, &header, &bytes, 0)?;
                        *shown.frames.entry(topic.to_string()).or_insert(0) += 1;
                    }
                    Err(error) => {
                        if n_unread == 0 {
                            tracing::warn!(topic = &**topic, %error, "a frame is not drawn");
                        }
                        n_unread += 1;
                    }
                }
            }
            What::Result {
                topic,
                header,
                mut body,
                inputs,
            } => {
                let (Some(kind), Some(about)) = (header.kind(), about.get(&**topic)) else {
                    continue;
                };
                let body = body.to_vec()?;
                let parts = ResultParts {
                    topic,
                    header: &header,
                    kind,
                    body: &body,
                    inputs,
                    about,
                };
                stage.show_result(&parts, 0)?;
                *shown.results.entry(topic.to_string()).or_insert(0) += 1;
            }
            _ => {}
        }
    }
    for sentence in samples.damage().sentences() {
        tracing::warn!("{sentence}");
    }
    if n_unread > 0 {
        tracing::warn!(
            n_unread,
            "frames without a payload that can be read were not drawn"
        );
    }
    shown.bad_items = stage.bad_items().clone();
    let flushed = stage.flush(FLUSH_TIMEOUT);
    health.check()?;
    flushed?;
    Ok(shown)
}
