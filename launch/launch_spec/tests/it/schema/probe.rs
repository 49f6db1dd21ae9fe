//! Asks the reader of launch files, with values that it refuses, which it would accept.

use launch_spec::Launch;
use regex::Regex;
use serde_json::{Value as Json, json};
use toml::{Table, Value as Toml};

/// A launch with one of everything.
const EVERYTHING: &str = "version = 1
[rig.pole]
pose = { position_m = [0.0, 0.0, 6.0] }
[batch.b]
cameras = [\"ego/camera\"]
[topic.\"a/b\"]
type = \"boxes2d\"
[process.p]
cmd = [\"p\"]
ready = { line = \"up\" }
";

/// What else a file can say that changes what a key may be.
const CONTEXTS: [&[&str]; 2] = [&[], &["sensor.camera.dvs.use_log=false"]];

/// The reader, with a launch that has one of everything.
pub struct Probe {
    text: String,
    /// That launch with all its defaults.
    pub full: Table,
}

impl Probe {
    pub fn new() -> Self {
        let sensors = sensor_spec::SensorSpec::KINDS
            .map(|kind| format!("[sensor.{kind}]\nkind = \"{kind}\"\n"))
            .concat();
        let text = format!("{EVERYTHING}{sensors}");
        let launch = Launch::parse(&text, "x").unwrap_or_else(|errors| panic!("{errors}"));
        let full = launch.to_toml_with_defaults().parse().unwrap();
        Probe { text, full }
    }

    /// Default of the key at a dotted path.
    pub fn default(&self, path: &str) -> &Toml {
        path.split('.')
            .skip(1)
            .fold(&self.full[path.split('.').next().unwrap()], |value, key| {
                &value[key]
            })
    }

    /// The schema of a key that is no table.
    pub fn leaf(&self, path: &str, default: &Toml) -> Json {
        let mut schema = match default {
            Toml::Boolean(_) => json!({ "type": "boolean" }),
            Toml::String(_) => self.text(path),
            Toml::Integer(_) => {
                let sentences =
                    self.refusals(path, &["9223372036854775807", "4294967295", "-1", "-99"]);
                limited(json!({ "type": "integer" }), &sentences)
            }
            Toml::Float(_) => {
                let sentences = self.refusals(path, &["1e300", "-1e300"]);
                limited(json!({ "type": "number" }), &sentences)
            }
            Toml::Array(list) => self.list(path, list),
            other => panic!("{path}: no launch file has {other}"),
        };
        schema["default"] = json_of(default);
        schema
    }

    fn text(&self, path: &str) -> Json {
        let sentences = self.refusals(path, &["\"no such word\""]);
        let one_of = Regex::new(r"but must be one of (.*?)(, did you mean .*)?$").unwrap();
        for sentence in &sentences {
            if let Some(found) = one_of.captures(sentence) {
                let words: Vec<&str> = found[1].split(", ").collect();
                return json!({ "enum": words });
            }
            if sentence.contains("must be a time such as") {
                return json!({ "type": "string", "pattern": r"^[0-9]*\.?[0-9]*\s*(ms|s|m|min|h)\s*$" });
            }
        }
        json!({ "type": "string" })
    }

    fn list(&self, path: &str, default: &[Toml]) -> Json {
        if matches!(default.first(), Some(Toml::Float(_))) {
            let all = |value: &str| format!("[{}]", vec![value; default.len()].join(", "));
            let (high, low) = (all("1e300"), all("-1e300"));
            let items = limited(
                json!({ "type": "number" }),
                &self.refusals(path, &[&high, &low]),
            );
            let n = default.len();
            return json!({ "type": "array", "items": items, "minItems": n, "maxItems": n });
        }
        let sentences = self.refusals(path, &["[\"no such word\"]", "[5000]", "[-1e10]"]);
        let only = Regex::new(r"must name only (.*?); ").unwrap();
        for sentence in &sentences {
            if let Some(found) = only.captures(sentence) {
                let words: Vec<&str> = found[1].split(", ").collect();
                return json!({ "type": "array", "items": { "enum": words }, "minItems": 1, "uniqueItems": true });
            }
        }
        let fractions = Regex::new(r"numbers are (-?\d+\.\d+) to (-?\d+\.\d+)$").unwrap();
        let found = sentences.iter().find_map(|text| fractions.captures(text));
        if let Some(found) = found {
            let bound = |i: usize| found[i].parse::<f64>().unwrap();
            return json!({ "type": "array", "items": { "type": "number", "minimum": bound(1), "maximum": bound(2) } });
        }
        let numbers = Regex::new(r"are (\d+) to (\d+)$").unwrap();
        match sentences
            .iter()
            .find_map(|sentence| numbers.captures(sentence))
        {
            Some(found) => {
                let bound = |i: usize| found[i].parse::<u32>().unwrap();
                json!({ "type": "array", "items": { "type": "integer", "minimum": bound(1), "maximum": bound(2) } })
            }
            None => json!({ "type": "array", "items": { "type": "string" } }),
        }
    }

    /// The sentences about the key at `path` for these values, without their places.
    fn refusals(&self, path: &str, values: &[&str]) -> Vec<String> {
        let mut sentences = Vec::new();
        for context in CONTEXTS {
            for value in values {
                let sets: Vec<String> = context
                    .iter()
                    .map(|set| (*set).to_owned())
                    .chain([format!("{path}={value}")])
                    .collect();
                let Err(errors) = Launch::parse_with(&self.text, "x", &sets) else {
                    continue;
                };
                let about = errors.0.into_iter().map(|error| error.message);
                sentences.extend(about.filter(|message| message.starts_with(path)));
            }
        }
        sentences
    }
}

/// A number's schema with the ranges that the sentences name; of several, what any of them allows.
fn limited(mut schema: Json, sentences: &[String]) -> Json {
    let closed =
        Regex::new(r"must be (?:a whole number from )?(-?[0-9.]+) to (-?[0-9.]+)$").unwrap();
    let open = Regex::new(r"must lie between (-?[0-9.]+) and (-?[0-9.]+), both excluded$").unwrap();
    let number = |text: &str| text.parse::<f64>().unwrap();
    let bound = |number: f64| match number.fract() {
        0.0 => Json::from(number as i64),
        _ => Json::from(number),
    };
    let mut ranges = Vec::new();
    for sentence in sentences {
        if let Some(found) = closed.captures(sentence) {
            ranges.push((number(&found[1]), number(&found[2])));
        } else if let Some(found) = open.captures(sentence) {
            schema["exclusiveMinimum"] = bound(number(&found[1]));
            schema["exclusiveMaximum"] = bound(number(&found[2]));
        } else if sentence.contains("must be above 0") {
            schema["exclusiveMinimum"] = 0.into();
        } else if sentence.ends_with("a whole number from 0 up") {
            schema["minimum"] = 0.into();
        }
    }
    // What a type can hold is named too; the range of the setting lies inside.
    let holds = (0.0, f64::from(u32::MAX));
    if ranges.iter().any(|range| *range != holds) {
        ranges.retain(|range| *range != holds);
    }
    if let (Some(low), Some(high)) = (
        ranges.iter().map(|(low, _)| *low).reduce(f64::min),
        ranges.iter().map(|(_, high)| *high).reduce(f64::max),
    ) {
        schema["minimum"] = bound(low);
        schema["maximum"] = bound(high);
    }
    schema
}

fn json_of(value: &Toml) -> Json {
    serde_json::to_value(value).unwrap()
}
