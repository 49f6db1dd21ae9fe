//! `docs/reference/launch-files.md` against the reader: its examples are launch files, and it leaves no key
//! out.

use std::io;
use std::path::{Path, PathBuf};

use launch_spec::{FileText, Launch};
use serde_json::Value as Json;

const PAGE: &str = include_str!("../../../../docs/reference/launch-files.md");
const SCHEMA: &str = include_str!("../../../launch.schema.json");

#[test]
fn the_examples_of_the_page_are_launch_files() {
    let examples: Vec<&str> = PAGE
        .split("```toml\n")
        .skip(1)
        .map(|rest| rest.split("```").next().unwrap())
        .collect();
    assert!(examples.len() >= 2);
    for example in examples {
        let mut read = |path: &Path| {
            let text = match path.to_str() {
                Some("example.toml") => example,
                Some("quickstart.toml") => include_str!("../../../quickstart.toml"),
                _ => return Err(io::ErrorKind::NotFound.into()),
            };
            Ok(FileText {
                identity: path.to_owned(),
                folder: PathBuf::from("/project"),
                text: text.to_owned(),
            })
        };
        Launch::load(&["example.toml".into()], &[], &mut read)
            .unwrap_or_else(|errors| panic!("{errors}\n{example}"));
    }
}

/// All keys below a schema, without those of sensors, which have a page of their own.
fn keys(schema: &Json, found: &mut Vec<String>) {
    let Some(map) = schema.as_object() else {
        return;
    };
    if let Some(properties) = map.get("properties").and_then(Json::as_object) {
        for (key, inside) in properties {
            found.push(key.clone());
            if key != "sensor" {
                keys(inside, found);
            }
        }
    }
    if let Some(patterns) = map.get("patternProperties").and_then(Json::as_object) {
        patterns.values().for_each(|inside| keys(inside, found));
    }
}

#[test]
fn the_page_leaves_no_key_and_no_type_out() {
    let schema: Json = SCHEMA.parse().unwrap();
    let mut wanted = Vec::new();
    keys(&schema, &mut wanted);
    assert!(wanted.len() > 50, "{wanted:?}");
    wanted.extend(
        schema_frames::ResultType::ALL
            .iter()
            .map(|kind| kind.name().to_owned()),
    );
    let words: Vec<&str> = PAGE
        .split('`')
        .flat_map(|part| part.split(|c: char| !c.is_alphanumeric() && c != '_'))
        .collect();
    let missing: Vec<_> = wanted
        .iter()
        .filter(|key| !words.contains(&key.as_str()))
        .collect();
    assert!(
        missing.is_empty(),
        "docs/reference/launch-files.md lacks {missing:?}"
    );
}
