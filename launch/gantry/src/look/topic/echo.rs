//! `gantry topic echo`: headers and records as text, or one JSON object per line.

use std::time::{Duration, Instant};

use launch_cli::{Exit, Shutdown};
use schema_bus::{Ack, AnySample, Bus, ControlBatch, Document, Frame, Snapshot};
use schema_frames::{
    About, ActorRecord, CollisionEvent, DvsEvent, GnssSample, ImuSample, LaneCrossing, LidarPoint,
    LidarReturn, Modality, ObstacleEvent, RadarDetection, SemanticLidarPoint,
};
use serde_json::{Value, json};

use super::echo_result::result_value;
use super::fields::{debug_fields, first, hex};
use super::info::description;
use crate::cli::EchoArgs;
use crate::look::reading::source::{Sample, Source};

/// Silence after which a hint is printed. A topic may be silent for good reason: a stepped world, or
/// a document that does not change.
const PATIENCE: Duration = Duration::from_secs(2);

pub fn run(bus: &Bus, topic: &str, args: &EchoArgs) -> anyhow::Result<Exit> {
    let shutdown = Shutdown::install()?;
    let about = description(bus, topic).unwrap_or_default();
    let mut source = Source::open(bus, topic)?;
    let start = Instant::now();
    let (mut printed, mut said) = (0, false);
    let count = if args.once { Some(1) } else { args.count };
    while !shutdown.requested() && count.is_none_or(|count| printed < count) {
        let Some(sample) = source.next()? else {
            if printed == 0 && !said && start.elapsed() > PATIENCE {
                said = true;
                eprintln!(
                    "nothing has come on {topic} for {} s; waiting (Ctrl-C ends this)",
                    PATIENCE.as_secs()
                );
            }
            source.nap()?;
            continue;
        };
        let value = as_value(&sample, &about, args.elements);
        // The sample is given back before a terminal, which may be slow, is written to.
        drop(sample);
        if args.json {
            println!("{value}");
        } else {
            print!(
                "{}{}",
                if printed > 0 { "---\n" } else { "" },
                as_text(&value, 0)
            );
        }
        printed += 1;
    }
    Ok(Exit::Done)
}

fn as_value(sample: &Sample, about: &About, n_elements: usize) -> Value {
    match sample {
        Sample::Frame(frame) => frame_value(frame, n_elements),
        Sample::Result(result) => result_value(result, about, n_elements),
        Sample::Snapshot(snapshot) => snapshot_value(snapshot, n_elements),
        Sample::Document(document) => document_value(document),
        Sample::Controls(batch) => controls_value(batch, n_elements),
        Sample::Ack(ack) => ack_value(ack),
        Sample::Other(sample) => other_value(sample),
    }
}

fn frame_value(frame: &Frame, n_elements: usize) -> Value {
    let header = frame.header();
    let pose = &header.world_from_sensor;
    json!({
        "modality": frame.modality().name(),
        "tick": header.tick, "sim_nanos": header.sim_nanos, "seq": header.seq,
        "episode": header.episode, "epoch": header.epoch.to_string(),
        "sensor_id": header.sensor_id, "parent_id": header.parent_id, "flags": header.flags, "window_nanos": header.window_nanos,
        "width": header.width, "height": header.height, "n_images": header.n_images, "row_stride": header.row_stride, "payload_bytes": header.payload_bytes,
        "world_from_sensor": {"translation_m": pose.translation_m, "rotation_xyzw": pose.rotation_xyzw},
        "intrinsics_px": header.intrinsics_px, "optics": header.optics, "calibration_crc": header.calibration_crc, "range_limit_m": header.range_limit_m, "n_channels": header.n_channels,
        "rendered_mono_nanos": header.rendered_mono_nanos, "published_mono_nanos": header.published_mono_nanos,
        "cpu_copies": header.cpu_copies, "ticks_in_flight": header.ticks_in_flight,
        "elements": elements(frame, n_elements),
    })
}

/// The first elements of a list. Pixels of images are not printed.
fn elements(frame: &Frame, n: usize) -> Value {
    match frame.modality() {
        Modality::Imu => first(frame.elements(), n, |sample: &ImuSample| {
            debug_fields(sample)
        }),
        Modality::Gnss => first(frame.elements(), n, |sample: &GnssSample| {
            debug_fields(sample)
        }),
        Modality::Lidar => first(frame.elements(), n, |point: &LidarPoint| {
            debug_fields(point)
        }),
        Modality::SemanticLidar => first(frame.elements(), n, |point: &SemanticLidarPoint| {
            debug_fields(point)
        }),
        Modality::LidarReturns => first(frame.elements(), n, |point: &LidarReturn| {
            debug_fields(point)
        }),
        Modality::Radar => first(frame.elements(), n, |detection: &RadarDetection| {
            debug_fields(detection)
        }),
        Modality::Collision => first(frame.elements(), n, |event: &CollisionEvent| {
            debug_fields(event)
        }),
        Modality::LaneInvasion => first(frame.elements(), n, |event: &LaneCrossing| {
            debug_fields(event)
        }),
        Modality::Obstacle => first(frame.elements(), n, |event: &ObstacleEvent| {
            debug_fields(event)
        }),
        Modality::Dvs => first(frame.elements(), n, |event: &DvsEvent| debug_fields(event)),
        _ => Value::Null,
    }
}

fn snapshot_value(snapshot: &Snapshot, n_elements: usize) -> Value {
    let header = snapshot.header();
    let actors: Value = snapshot
        .records()
        .iter()
        .take(n_elements)
        .map(actor_value)
        .collect();
    json!({
        "tick": header.tick, "sim_nanos": header.sim_nanos, "period_nanos": header.period_nanos,
        "episode": header.episode, "epoch": header.epoch.to_string(), "actors_revision": header.actors_revision, "flags": header.flags,
        "published_mono_nanos": header.published_mono_nanos, "n_actors": header.n_actors, "actors": actors,
    })
}

fn actor_value(record: &ActorRecord) -> Value {
    let pose = &record.world_from_actor;
    let kind = record.kind().map_or_else(
        || record.kind.to_string(),
        |kind| format!("{kind:?}").to_lowercase(),
    );
    json!({
        "id": record.id, "parent_id": record.parent_id, "kind": kind, "class": record.class, "flags": record.flags,
        "world_from_actor": {"translation_m": pose.translation_m, "rotation_xyzw": pose.rotation_xyzw},
        "speed_mps": record.speed_mps(), "velocity_in_world_mps": record.velocity_in_world_mps,
        "acceleration_in_world_mps2": record.acceleration_in_world_mps2,
    })
}

fn document_value(document: &Document) -> Value {
    let header = &document.header;
    // The map is XML and stays text; all other documents are JSON.
    let content = serde_json::from_str(&document.text)
        .unwrap_or_else(|_| Value::from(document.text.as_str()));
    json!({"revision": header.revision, "epoch": header.epoch.to_string(), "tick": header.tick, "bytes": header.payload_bytes, "content": content})
}

fn controls_value(batch: &ControlBatch, n_elements: usize) -> Value {
    let record = |record: &schema_frames::VehicleControlRecord| debug_fields(record);
    let records: Value = batch.records.iter().take(n_elements).map(record).collect();
    json!({"writer": batch.writer, "seq": batch.seq, "tick": batch.tick, "n_records": batch.records.len(), "records": records})
}

fn ack_value(ack: &Ack) -> Value {
    json!({"participant": ack.participant, "name": ack.origin.port, "pid": ack.origin.pid, "epoch": ack.epoch.to_string(), "tick": ack.tick})
}

fn other_value(sample: &AnySample) -> Value {
    let payload = sample.payload();
    json!({"bytes": payload.len(), "first_bytes": hex(payload), "header_bytes": sample.header().len(), "header": hex(sample.header())})
}

/// Indented `key: value` lines; lists of plain values stay on one line.
fn as_text(value: &Value, depth: usize) -> String {
    let pad = "  ".repeat(depth);
    let is_flat = |value: &Value| match value {
        Value::Object(_) => false,
        Value::Array(list) => list
            .iter()
            .all(|element| !element.is_object() && !element.is_array()),
        _ => true,
    };
    let plain = |value: &Value| {
        value
            .as_str()
            .map_or_else(|| value.to_string(), str::to_owned)
    };
    match value {
        Value::Object(fields) => fields
            .iter()
            .map(|(key, value)| {
                if is_flat(value) {
                    format!("{pad}{key}: {}\n", plain(value))
                } else {
                    format!("{pad}{key}:\n{}", as_text(value, depth + 1))
                }
            })
            .collect(),
        Value::Array(list) => {
            let entry = |value: &Value| {
                if is_flat(value) {
                    format!("{pad}- {}\n", plain(value))
                } else {
                    format!("{pad}-\n{}", as_text(value, depth + 1))
                }
            };
            list.iter().map(entry).collect()
        }
        other => format!("{pad}{}\n", plain(other)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_indented_and_short_lists_stay_on_a_line() {
        let value = json!({"a": 1, "b": [1, 2], "c": {"d": "x"}, "e": [{"f": 1}]});
        assert_eq!(
            as_text(&value, 0),
            "a: 1\nb: [1,2]\nc:\n  d: x\ne:\n  -\n    f: 1\n"
        );
    }
}
