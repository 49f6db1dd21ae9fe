//! `docs/reference/carla-compatibility.md` says of each call of the client what the gateway does with it;
//! here it is held to that.

use std::collections::{BTreeMap, BTreeSet};

use consumer_carla::rpc;
use consumer_carla::state::blueprints;
use consumer_carla::wire::sensor_kinds;

/// What a row may say.
const VERDICTS: &[&str] = &["works", "differs", "no effect", "not there"];

fn document() -> String {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../docs/reference/carla-compatibility.md"
    );
    std::fs::read_to_string(path).expect("the document is part of the repository")
}

/// Rows of the tables of a chapter, name and verdict: ``| `name` | works | how |``.
fn rows(document: &str, chapter: &str) -> BTreeMap<String, String> {
    let (_, after) = document
        .split_once(&format!("\n## {chapter}\n"))
        .expect("the document has this chapter");
    let chapter = after.split("\n## ").next().unwrap_or_default();
    let mut rows = BTreeMap::new();
    for line in chapter.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let (name, verdict, how) = (cells[1].trim_matches('`'), cells[2], cells[3]);
        assert!(
            VERDICTS.contains(&verdict),
            "{name}: {verdict:?} is none of {VERDICTS:?}"
        );
        assert!(
            verdict != "differs" || !how.is_empty(),
            "{name} differs, but the row does not say how"
        );
        assert!(
            rows.insert(name.to_owned(), verdict.to_owned()).is_none(),
            "{name} has two rows"
        );
    }
    rows
}

#[test]
fn every_call_of_the_client_has_a_row_that_says_whether_it_is_served() {
    let rows = rows(&document(), "Calls");
    let known: BTreeSet<&str> = rpc::client_methods::BY_AREA
        .iter()
        .flat_map(|(_, methods)| *methods)
        .copied()
        .collect();
    let served: BTreeSet<&str> = rpc::methods().collect();
    let listed: BTreeSet<&str> = rows.keys().map(String::as_str).collect();
    assert_eq!(known, listed, "the rows are those of the client's calls");
    for (name, verdict) in &rows {
        let is_served = served.contains(name.as_str());
        assert_eq!(
            is_served,
            verdict != "not there",
            "{name} is {verdict:?} in the document, but served: {is_served}"
        );
    }
}

#[test]
fn every_command_of_a_batch_has_a_row_that_says_whether_it_is_run() {
    let rows = rows(&document(), "Batches");
    let served: BTreeSet<&str> = rpc::batch::served().collect();
    let all: BTreeSet<&str> = rpc::batch::NAMES.into_iter().collect();
    assert_eq!(all, rows.keys().map(String::as_str).collect());
    for (name, verdict) in &rows {
        assert_eq!(
            served.contains(name.as_str()),
            verdict != "not there",
            "{name}"
        );
    }
}

#[test]
fn every_sensor_has_a_row_that_says_whether_it_is_there() {
    let rows = rows(&document(), "Sensors");
    let kinds = sensor_kinds::KINDS
        .iter()
        .map(|kind| kind.type_id)
        .chain(sensor_kinds::CLIENT_SIDE.iter().copied());
    let there: BTreeSet<&str> = kinds.collect();
    let listed: BTreeSet<&str> = rows
        .iter()
        .filter(|(_, verdict)| *verdict != "not there")
        .map(|(name, _)| name.as_str())
        .collect();
    assert_eq!(there, listed);
}

/// Rows of the chapter about attributes: ``| sensors | `name`, `name` | works | how |``.
#[test]
fn every_attribute_of_a_sensor_has_exactly_one_row_that_says_what_it_does() {
    let document = document();
    let (_, after) = document
        .split_once("\n## Sensor attributes\n")
        .expect("the document has this chapter");
    let chapter = after.split("\n## ").next().unwrap_or_default();
    let mut listed: BTreeMap<(String, String), u32> = BTreeMap::new();
    for line in chapter
        .lines()
        .filter(|line| line.starts_with("| `") || line.starts_with("| all"))
    {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let (sensors, names, verdict, how) = (cells[1], cells[2], cells[3], cells[4]);
        assert!(
            VERDICTS.contains(&verdict) && verdict != "not there",
            "{names}: {verdict:?}"
        );
        assert!(
            verdict == "works" || !how.is_empty(),
            "{names} {verdict}, but the row does not say how or why"
        );
        let quoted = |text: &str| {
            text.split('`')
                .skip(1)
                .step_by(2)
                .map(str::to_owned)
                .collect::<Vec<_>>()
        };
        let is_meant = |type_id: &str| {
            let matches = |pattern: &String| match pattern.strip_suffix('*') {
                Some(start) => type_id.starts_with(&format!("sensor.{start}")),
                None => type_id == format!("sensor.{pattern}"),
            };
            sensors == "all" || quoted(sensors).iter().any(matches)
        };
        for kind in sensor_kinds::KINDS
            .iter()
            .filter(|kind| is_meant(kind.type_id))
        {
            for name in quoted(names) {
                *listed.entry((kind.type_id.to_owned(), name)).or_default() += 1;
            }
        }
    }
    let has = |type_id: &'static str| {
        blueprints::sensor_attributes(type_id)
            .map(move |name| (type_id.to_owned(), name.to_owned()))
    };
    let there: BTreeSet<(String, String)> = sensor_kinds::KINDS
        .iter()
        .flat_map(|kind| has(kind.type_id))
        .collect();
    for pair in &there {
        assert_eq!(listed.get(pair), Some(&1), "rows for {pair:?}");
    }
    // A row for several sensors may name what one of them lacks, but not what none has.
    let names: BTreeSet<&String> = there.iter().map(|(_, name)| name).collect();
    for (_, name) in listed.keys() {
        assert!(names.contains(name), "{name} is no sensor's attribute");
    }
}
