//! `gantry topic list` and `info`.

use launch_cli::{Exit, wrong_usage};
use schema_bus::qos::{CONTROL, DOCUMENT, Qos, SNAPSHOT};
use schema_bus::{Bus, TopicDetails, TopicKind};

use crate::cli::Form;

pub fn list(bus: &Bus, form: Form) -> anyhow::Result<Exit> {
    let topics = bus.topics()?;
    if form == Form::Json {
        topics
            .iter()
            .for_each(|topic| println!("{}", as_json(bus, topic)));
        return Ok(Exit::Done);
    }
    if topics.is_empty() {
        eprintln!(
            "nothing is published on domain {:?}; start something with `gantry up`, or name another with --domain",
            bus.domain()
        );
        return Ok(Exit::Done);
    }
    let width = topics
        .iter()
        .map(|topic| topic.name.len())
        .max()
        .unwrap_or(0);
    println!(
        "{:width$}  {:<9}  {:>7}  {:>7}  {:>12}",
        "topic", "kind", "writers", "readers", "max bytes"
    );
    for topic in &topics {
        let name = kind_name(topic.kind);
        println!(
            "{:width$}  {name:<9}  {:>7}  {:>7}  {:>12}",
            topic.name, topic.publishers, topic.subscribers, topic.payload_bytes
        );
    }
    Ok(Exit::Done)
}

pub fn info(bus: &Bus, name: &str, form: Form) -> anyhow::Result<Exit> {
    let topics = bus.topics()?;
    let Some(topic) = topics.iter().find(|topic| topic.name == name) else {
        let known: Vec<&str> = topics.iter().map(|topic| topic.name.as_str()).collect();
        let known = if known.is_empty() {
            "nothing at all".to_owned()
        } else {
            known.join(", ")
        };
        return Err(wrong_usage(format!(
            "there is no topic {name:?} on domain {:?}; it has {known}",
            bus.domain()
        )));
    };
    if form == Form::Json {
        println!("{}", as_json(bus, topic));
        return Ok(Exit::Done);
    }
    let schema = if topic.schema.is_empty() {
        "none: not Gantry's"
    } else {
        &topic.schema
    };
    println!("topic          {}/{}", bus.domain(), topic.name);
    println!("kind           {}", kind_name(topic.kind));
    if let Some(modality) = topic.modality {
        println!(
            "modality       {} (encoding {}, {} bytes an element)",
            modality.name(),
            modality as u16,
            modality.element_bytes()
        );
    }
    println!("schema         {schema}");
    println!("writers        {}", topic.publishers);
    println!(
        "readers        {} of {}",
        topic.subscribers, topic.max_subscribers
    );
    println!("largest frame  {} bytes", topic.payload_bytes);
    if let Some(qos) = qos_of(topic) {
        println!(
            "per reader     {} waiting, {} held, {} from the past",
            qos.buffer, qos.borrowed, qos.history
        );
    }
    Ok(Exit::Done)
}

fn qos_of(topic: &TopicDetails) -> Option<Qos> {
    match topic.kind {
        TopicKind::Frames => topic.modality.map(Qos::of),
        TopicKind::Snapshot => Some(SNAPSHOT),
        TopicKind::Document => Some(DOCUMENT),
        TopicKind::Controls => Some(CONTROL),
        TopicKind::Other => None,
    }
}

fn kind_name(kind: TopicKind) -> &'static str {
    match kind {
        TopicKind::Frames => "frames",
        TopicKind::Snapshot => "snapshot",
        TopicKind::Document => "document",
        TopicKind::Controls => "controls",
        TopicKind::Other => "other",
    }
}

fn as_json(bus: &Bus, topic: &TopicDetails) -> serde_json::Value {
    serde_json::json!({
        "topic": topic.name,
        "domain": bus.domain(),
        "kind": kind_name(topic.kind),
        "modality": topic.modality.map(|modality| modality.name()),
        "schema": topic.schema,
        "writers": topic.publishers,
        "readers": topic.subscribers,
        "max_readers": topic.max_subscribers,
        "max_payload_bytes": topic.payload_bytes,
    })
}
