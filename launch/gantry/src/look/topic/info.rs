//! `gantry topic list` and `info`.

use std::time::{Duration, Instant};

use launch_cli::{Exit, wrong_usage};
use schema_bus::Bus;
use schema_bus::names::{WORLD_INFO, about, is_batch, is_gpu_topic};
use schema_frames::{About, BatchCamera, BatchInfo, Modality, WorldInfo};
use serde::de::DeserializeOwned;

use crate::cli::Form;
use crate::look::census::{Census, Kind, Member, Topic, names, nothing_runs};

/// How long the description of a topic is waited for.
const DESCRIPTION: Duration = Duration::from_secs(1);

pub fn list(bus: &Bus, form: Form) -> anyhow::Result<Exit> {
    let census = Census::take(bus)?;
    if form == Form::Json {
        let lines = census.topics.iter().map(|topic| as_json(&census, topic));
        lines.for_each(|line| println!("{line}"));
        return Ok(Exit::Done);
    }
    if census.topics.is_empty() {
        eprintln!("{}", nothing_runs(&census.domain));
        return Ok(Exit::Done);
    }
    let width = |cell: fn(&Topic) -> usize, least: usize| {
        census.topics.iter().map(cell).max().unwrap_or(0).max(least)
    };
    let name = width(|topic| topic.name.len(), 5);
    let kind = width(|topic| topic.type_name.len(), 4);
    println!(
        "{:name$}  {:kind$}  {:<9}  {:>7}  {:>7}  {:>12}  written by",
        "topic", "type", "kind", "writers", "readers", "max bytes"
    );
    // The GPU's side of a topic is told by `info`.
    let of_their_own = |topic: &&Topic| !is_gpu_topic(&topic.name);
    for topic in census.topics.iter().filter(of_their_own) {
        let readers = topic.service.readers.len();
        let line = format!(
            "{:name$}  {:kind$}  {:<9}  {:>7}  {:>7}  {:>12}  {}",
            topic.name,
            topic.type_name,
            topic.kind.name(),
            topic.service.writers.len(),
            format!("{readers}/{}", topic.service.max_readers),
            topic.max_payload_bytes(),
            names(&topic.writers)
        );
        println!("{}", line.trim_end());
    }
    Ok(Exit::Done)
}

pub fn info(bus: &Bus, name: &str, form: Form) -> anyhow::Result<Exit> {
    let census = Census::take(bus)?;
    let Some(topic) = census.topic(name) else {
        let known: Vec<&str> = census
            .topics
            .iter()
            .map(|topic| topic.name.as_str())
            .collect();
        let known = match known.is_empty() {
            true => "nothing at all".to_owned(),
            false => known.join(", "),
        };
        return Err(wrong_usage(format!(
            "there is no topic {name:?} on domain {:?}; it has {known}",
            bus.domain()
        )));
    };
    let description = (topic.kind == Kind::Results)
        .then(|| description(bus, &topic.name))
        .flatten();
    if form == Form::Json {
        let mut object = as_json(&census, topic);
        object["about"] = serde_json::to_value(&description)?;
        object["cameras"] = serde_json::to_value(cameras(bus, topic))?;
        println!("{object}");
        return Ok(Exit::Done);
    }
    let service = &topic.service;
    let schema = match service.schema.as_str() {
        "" => "none: not Gantry's",
        schema => schema,
    };
    let ends = match topic.kind {
        Kind::Requests => ["clients", "servers"],
        _ => ["writers", "readers"],
    };
    println!("topic          {}/{}", bus.domain(), topic.name);
    println!("kind           {}", topic.kind.name());
    println!("type           {}", type_line(topic));
    println!("schema         {schema}");
    for (end, ports, max, members) in [
        (
            ends[0],
            service.writers.len(),
            service.max_writers,
            &topic.writers,
        ),
        (
            ends[1],
            service.readers.len(),
            service.max_readers,
            &topic.readers,
        ),
    ] {
        println!("{end:<14} {ports} of {max}{}", processes(members));
    }
    println!("largest sample {} bytes", topic.max_payload_bytes());
    if let Some(qos) = &service.qos {
        println!(
            "per reader     {} waiting, {} held, {} from the past",
            qos.buffer, qos.borrowed, qos.history
        );
    }
    if let Some(cameras) = cameras(bus, topic) {
        println!("images         {}: {}", cameras.len(), cameras.join(", "));
    }
    if let Some(line) = on_gpu(bus, topic)? {
        println!("on the GPU     {line}");
    }
    if let Some(about) = description {
        describe(&about);
    }
    Ok(Exit::Done)
}

/// Cameras of a batch in the order of its images; `None` for any other topic, or if nobody says it.
fn cameras(bus: &Bus, topic: &Topic) -> Option<Vec<String>> {
    if !is_batch(&topic.name) {
        return None;
    }
    let info: WorldInfo = document(bus, WORLD_INFO)?;
    let has_it = |batch: &BatchInfo| batch.topics.iter().any(|it| it.topic == topic.name);
    let batch = info.batches.into_iter().find(has_it);
    let name = |camera: BatchCamera| camera.name;
    batch.map(|batch| batch.cameras.into_iter().map(name).collect())
}

/// What there is of a topic on the GPU, beside its own service; `None` if nobody asked for it.
fn on_gpu(bus: &Bus, topic: &Topic) -> anyhow::Result<Option<String>> {
    let mut topics = bus.topics()?.into_iter();
    let side = topics.find(|found| found.name == topic.name);
    Ok(side.and_then(|found| found.on_gpu).map(|side| {
        let memory = match side.publishers {
            0 => "no memory while nobody reads",
            _ => "has memory",
        };
        format!(
            "{} of {} readers, {memory}",
            side.subscribers, side.max_subscribers
        )
    }))
}

/// `: simd (4242), gantry-view (4243)`, or nothing.
fn processes(members: &[Member]) -> String {
    let one = |member: &Member| match member.pid {
        Some(pid) => format!("{} ({pid})", member.name),
        None => member.name.clone(),
    };
    let all: Vec<String> = members.iter().map(one).collect();
    match all.is_empty() {
        true => String::new(),
        false => format!(": {}", all.join(", ")),
    }
}

fn type_line(topic: &Topic) -> String {
    match modality_of(topic) {
        Some(modality) => format!(
            "{} (encoding {}, {} bytes an element)",
            modality.name(),
            modality as u16,
            modality.element_bytes()
        ),
        None => topic.type_name.clone(),
    }
}

fn modality_of(topic: &Topic) -> Option<Modality> {
    let name = topic.name.rsplit('/').next()?;
    Modality::from_name(name).filter(|_| topic.kind == Kind::Frames)
}

/// What the writer of a topic of results says about it.
pub fn description(bus: &Bus, topic: &str) -> Option<About> {
    document(bus, &about(topic))
}

/// The newest text of a document.
pub fn document<T: DeserializeOwned>(bus: &Bus, name: &str) -> Option<T> {
    if !bus.exists(name) {
        return None;
    }
    let mut reader = bus.document_reader(name).ok()?;
    let start = Instant::now();
    while start.elapsed() < DESCRIPTION {
        if let Ok(Some(document)) = reader.latest() {
            return document.json().ok();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    None
}

fn describe(about: &About) {
    if !about.classes.is_empty() {
        println!("classes        {}", about.classes.join(", "));
    }
    let fields: Vec<String> = about
        .fields
        .iter()
        .map(|field| format!("{} {} at {}", field.name, field.element, field.offset))
        .collect();
    if !fields.is_empty() {
        println!("fields         {}", fields.join(", "));
    }
    if let Some(schema) = &about.schema {
        println!(
            "message        {} ({}, schema {})",
            schema.name, schema.message_encoding, schema.schema_encoding
        );
    }
    if !about.note.is_empty() {
        println!("note           {}", about.note);
    }
}

fn as_json(census: &Census, topic: &Topic) -> serde_json::Value {
    let service = &topic.service;
    serde_json::json!({
        "topic": topic.name,
        "domain": census.domain,
        "kind": topic.kind.name(),
        "type": topic.type_name,
        "modality": modality_of(topic).map(|modality| modality.name()),
        "schema": service.schema,
        "writers": service.writers.len(),
        "max_writers": service.max_writers,
        "written_by": topic.writers,
        "readers": service.readers.len(),
        "max_readers": service.max_readers,
        "read_by": topic.readers,
        "max_payload_bytes": topic.max_payload_bytes(),
    })
}
