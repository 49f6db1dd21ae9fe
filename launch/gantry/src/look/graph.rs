//! `gantry graph`: who publishes and reads what, as text, picture, Graphviz file or JSON.

mod boxes;
mod dot;
mod svg;
pub mod tree;

use std::io::Write as _;
use std::path::Path;

use anyhow::Context as _;
use launch_cli::{CommonArgs, Exit};
use schema_bus::Bus;
use serde_json::{Value, json};

use crate::cli::GraphArgs;
use crate::look::census::{Census, Topic, nothing_runs};
use boxes::Graph;

pub fn run(args: &GraphArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    let bus = Bus::open(&common.domain, "gantry-graph")?;
    // Otherwise ports of killed processes would be drawn as alive.
    bus.clean_dead_nodes();
    let mut census = Census::take(&bus)?;
    let fits = |topic: &Topic| {
        let mut ends = topic.writers.iter().chain(&topic.readers);
        topic.name.contains(&args.filter)
            || topic.type_name.contains(&args.filter)
            || ends.any(|member| member.name.contains(&args.filter))
    };
    census.topics.retain(fits);
    if !args.filter.is_empty() {
        let topics = &census.topics;
        let mut ends = topics
            .iter()
            .flat_map(|topic| topic.writers.iter().chain(&topic.readers));
        census
            .processes
            .retain(|process| ends.any(|end| end.pid == process.pid));
    }
    if census.topics.is_empty() {
        match args.filter.as_str() {
            "" => eprintln!("{}", nothing_runs(&common.domain)),
            filter => eprintln!(
                "no topic of domain {:?} has {filter:?} in its name, type or processes",
                common.domain
            ),
        }
    }
    if args.json {
        println!("{}", as_json(&census));
    }
    if let Some(path) = &args.dot {
        write(path, &dot::dot(&Graph::of(&census, args.all)))?;
    }
    if let Some(path) = &args.svg {
        write(path, &svg::svg(&Graph::of(&census, args.all)))?;
    }
    if !args.json && args.dot.is_none() && args.svg.is_none() {
        let ends = census.topics.iter().map(|topic| tree::Ends {
            topic: &topic.name,
            type_name: &topic.type_name,
            note: String::new(),
            writers: &topic.writers,
            readers: &topic.readers,
        });
        for line in tree::lines(&ends.collect::<Vec<_>>()) {
            println!("{line}");
        }
    }
    Ok(Exit::Done)
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    if path == Path::new("-") {
        return std::io::stdout()
            .write_all(text.as_bytes())
            .context("cannot write to stdout");
    }
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// Processes, topics, and an arrow for every end of every topic.
fn as_json(census: &Census) -> Value {
    let topic = |topic: &Topic| json!({"topic": topic.name, "kind": topic.kind.name(), "type": topic.type_name, "written_by": topic.writers, "read_by": topic.readers});
    let arrows = census.topics.iter().flat_map(|topic| {
        let written = topic.writers.iter().map(
            |end| json!({"from": end.pid, "to": topic.name, "control": topic.kind.is_control()}),
        );
        let read = topic.readers.iter().map(
            |end| json!({"from": topic.name, "to": end.pid, "control": topic.kind.is_control()}),
        );
        written.chain(read)
    });
    json!({
        "domain": census.domain,
        "processes": census.processes,
        "topics": census.topics.iter().map(topic).collect::<Value>(),
        "arrows": arrows.collect::<Value>(),
    })
}
