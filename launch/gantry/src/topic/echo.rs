//! `gantry topic echo`: headers and records as text, or one JSON object per line.

use std::time::{Duration, Instant};

use launch_cli::{Exit, Shutdown};
use schema_bus::{Bus, ControlBatch, Document, Frame, Snapshot};
use schema_frames::{
    ActorRecord, CollisionEvent, DvsEvent, GnssSample, ImuSample, LaneCrossing, LidarPoint,
    Modality, ObstacleEvent, RadarDetection, SemanticLidarPoint,
};
use serde_json::{Value, json};

use super::source::{Sample, Source};
use crate::cli::EchoArgs;

/// Silence after which a hint is printed. A topic may be silent for good reason: a stepped world, or
/// a document that does not change.
const PATIENCE: Duration = Duration::from_secs(2);

pub fn run(bus: &Bus, topic: &str, args: &EchoArgs) -> anyhow::Result<Exit> {
    let shutdown = Shutdown::install()?;
    let mut source = Source::open(bus, topic)?;
    let start = Instant::now();
    let (mut printed, mut said) = (0, false);
    while !shutdown.requested() && args.count.is_none_or(|count| printed < count) {
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
        let value = as_value(&sample, args.elements);
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

fn as_value(sample: &Sample, n_elements: usize) -> Value {
    match sample {
        Sample::Frame(frame) => frame_value(frame, n_elements),
        Sample::Snapshot(snapshot) => snapshot_value(snapshot, n_elements),
        Sample::Document(document) => document_value(document),
        Sample::Controls(batch) => controls_value(batch, n_elements),
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
        "width": header.width, "height": header.height, "row_stride": header.row_stride, "payload_bytes": header.payload_bytes,
        "world_from_sensor": {"translation_m": pose.translation_m, "rotation_xyzw": pose.rotation_xyzw},
        "intrinsics_px": header.intrinsics_px, "range_limit_m": header.range_limit_m, "n_channels": header.n_channels,
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

fn first<T>(list: Option<&[T]>, n: usize, show: impl Fn(&T) -> Value) -> Value {
    list.unwrap_or_default().iter().take(n).map(show).collect()
}

/// A record's fields by name, from its `Debug` form `Name { a: 1, b: [2.0, inf] }`: numbers and
/// lists of numbers only.
fn debug_fields(record: &impl std::fmt::Debug) -> Value {
    let text = format!("{record:?}");
    let inside = text
        .split_once('{')
        .map_or("", |(_, rest)| rest.trim_end_matches('}').trim());
    let mut fields = serde_json::Map::new();
    let mut rest = inside;
    while let Some((name, after)) = rest.split_once(": ") {
        let end = if after.starts_with('[') {
            after.find(']').map_or(after.len(), |end| end + 1)
        } else {
            after.find(", ").unwrap_or(after.len())
        };
        let (value, tail) = after.split_at(end);
        // JSON has no infinity: such values stay text.
        let value = serde_json::from_str(value).unwrap_or_else(|_| Value::from(value.trim()));
        fields.insert(name.trim().to_owned(), value);
        rest = tail.trim_start_matches(", ");
    }
    fields.retain(|name, _| !name.starts_with("reserved"));
    Value::Object(fields)
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
    fn records_show_their_fields_by_name() {
        let point = LidarPoint {
            hit_in_sensor_m: [1.0, -2.5, 0.0],
            intensity: 7,
            channel: 3,
        };
        assert_eq!(
            debug_fields(&point),
            json!({"hit_in_sensor_m": [1.0, -2.5, 0.0], "intensity": 7, "channel": 3})
        );
        let wild = LidarPoint {
            hit_in_sensor_m: [f32::NAN, f32::INFINITY, 0.0],
            intensity: 0,
            channel: 0,
        };
        assert_eq!(
            debug_fields(&wild)["hit_in_sensor_m"],
            json!("[NaN, inf, 0.0]")
        );
        let event = DvsEvent {
            nanos_in_window: 5,
            x_px: 1,
            y_px: 2,
            object_id: 9,
            polarity: 1,
            class: 14,
            reserved: 0,
        };
        assert_eq!(debug_fields(&event)["class"], 14);
        assert!(debug_fields(&event).get("reserved").is_none());
    }

    #[test]
    fn text_is_indented_and_short_lists_stay_on_a_line() {
        let value = json!({"a": 1, "b": [1, 2], "c": {"d": "x"}, "e": [{"f": 1}]});
        assert_eq!(
            as_text(&value, 0),
            "a: 1\nb: [1,2]\nc:\n  d: x\ne:\n  -\n    f: 1\n"
        );
    }
}
