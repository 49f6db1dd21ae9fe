//! Goal: `launch/launch.schema.json` says what the reader of launch files accepts.
//! Method: the schema is made here, from the outside. Keys and defaults are those of a launch that
//! the reader writes out; types, ranges and choices are those that it names when it refuses a value;
//! descriptions are the documentation of the Rust fields. `./gantry bless` writes it anew.

mod describe;
mod probe;

use std::path::Path;

use describe::Descriptions;
use probe::Probe;
use serde_json::{Map, Value as Json, json};
use toml::{Table, Value as Toml};

/// Names of sections, as the reader checks them.
const NAME: &str = "^[a-z][a-z0-9_]{0,31}$";
/// Names of topics.
const TOPIC: &str = "^[A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*$";

struct Maker {
    probe: Probe,
    descriptions: Descriptions,
}

impl Maker {
    /// The schema of a table whose keys and defaults are those of `table`; `of` is the Rust struct
    /// that it is read into.
    fn table(&self, path: &str, of: &str, table: &Table) -> Map<String, Json> {
        let mut properties = Map::new();
        for (key, default) in table {
            properties.insert(key.clone(), self.value(path, of, key, default));
        }
        properties
    }

    fn value(&self, path: &str, of: &str, key: &str, default: &Toml) -> Json {
        let here = format!("{path}.{key}");
        let mut schema = match default {
            Toml::Table(inner) => {
                let inside = self.descriptions.type_of(of, key);
                closed(self.table(&here, &inside, inner))
            }
            leaf => self.probe.leaf(&here, leaf),
        };
        schema["description"] = self.descriptions.of(of, key).into();
        schema
    }

    /// A key that has no default.
    fn bare(&self, path: &str, of: &str, key: &str, example: &str) -> Json {
        let example: Table = format!("x = {example}").parse().unwrap();
        let mut schema = self.value(path, of, key, &example["x"]);
        schema.as_object_mut().unwrap().remove("default");
        schema
    }

    fn schema(&self) -> Json {
        let full = &self.probe.full;
        let section = |name: &str| full[name].as_table().unwrap();
        let mut top = Map::new();
        top.insert(
            "version".into(),
            json!({ "const": 1, "description": "Version of the format." }),
        );
        top.insert(
            "description".into(),
            json!({ "type": "string", "description": "A sentence for people." }),
        );
        top.insert(
            "include".into(),
            json!({ "type": "array", "items": { "type": "string", "minLength": 1 }, "description": "Files that lie beneath this one; paths begin in its folder." }),
        );
        let scenario = closed(self.table("scenario", "Scenario", section("scenario")));
        top.insert("scenario".into(), self.described(scenario, "scenario"));
        let ego = closed(self.table("ego", "Ego", section("ego")));
        top.insert("ego".into(), self.described(ego, "ego"));
        let spectator = closed(self.table("spectator", "Spectator", section("spectator")));
        top.insert("spectator".into(), self.described(spectator, "spectator"));
        let rigs = named(NAME, self.rig());
        top.insert("rig".into(), self.described(rigs, "rigs"));
        let sensors = named(NAME, self.sensor());
        top.insert("sensor".into(), self.described(sensors, "sensors"));
        let batches = named(NAME, self.batch());
        top.insert("batch".into(), self.described(batches, "batches"));
        let topics = named(TOPIC, self.topic());
        top.insert("topic".into(), self.described(topics, "topics"));
        let process = self.process();
        let mut defaults = Map::new();
        for key in ["env", "restart", "stop"] {
            defaults.insert(key.into(), process["properties"][key].clone());
        }
        let mut defaults = closed(defaults);
        defaults["description"] = "What every process has unless it says otherwise.".into();
        top.insert("defaults".into(), defaults);
        let processes = named(NAME, process);
        top.insert("process".into(), self.described(processes, "processes"));
        let mut schema = closed(top);
        schema["$schema"] = "https://json-schema.org/draft/2020-12/schema".into();
        schema["title"] = "Gantry launch file".into();
        schema["required"] = json!(["version"]);
        schema
    }

    fn described(&self, mut schema: Json, field: &str) -> Json {
        schema["description"] = self.descriptions.of("Launch", field).into();
        schema
    }

    fn rig(&self) -> Json {
        let full = self.probe.full["rig"]["pole"]["pose"].as_table().unwrap();
        let mut pose = closed(self.table("rig.pole.pose", "FreePose", full));
        pose["description"] = self.descriptions.of("Rig", "Free").into();
        let vehicle = json!({
            "anyOf": [{ "const": "ego" }, { "type": "integer", "minimum": 0 }],
            "description": "What carries the rig: \"ego\", or the index of another vehicle from 0.",
        });
        closed(Map::from_iter([
            ("pose".into(), pose),
            ("vehicle".into(), vehicle),
        ]))
    }

    /// One alternative per kind. None asks for `kind`, because a file that is laid over another
    /// need not repeat it.
    fn sensor(&self) -> Json {
        let kinds = sensor_spec::SensorSpec::KINDS.map(|kind| {
            let full = self.probe.full["sensor"][kind].as_table().unwrap();
            let of = self.descriptions.struct_of_kind(kind);
            let mut keys = Map::new();
            for (key, default) in full.iter().filter(|(key, _)| *key != "kind" && *key != "rig") {
                keys.insert(
                    key.clone(),
                    self.value(&format!("sensor.{kind}"), &of, key, default),
                );
            }
            keys.insert(
                "kind".into(),
                json!({ "const": kind, "description": self.descriptions.of("SensorSpec", &describe::camel(kind)) }),
            );
            keys.insert(
                "rig".into(),
                json!({
                    "anyOf": [{ "type": "string" }, { "type": "array", "items": { "type": "string" }, "minItems": 1 }],
                    "default": "ego",
                    "description": self.descriptions.of("Sensor", "rigs"),
                }),
            );
            keys.insert(
                "sensor".into(),
                json!({
                    "type": "string",
                    "description": "Profile of a sensor as it is sold, such as \"ouster/os1-128\", or a file that ends in .toml; the other keys stand above it.",
                }),
            );
            let mut schema = closed(keys);
            schema["title"] = kind.into();
            schema
        });
        json!({ "anyOf": kinds })
    }

    fn batch(&self) -> Json {
        let images: Vec<&str> = schema_frames::Modality::ALL
            .iter()
            .filter(|modality| modality.is_image())
            .map(|modality| modality.name())
            .collect();
        let written = self.probe.full["batch"]["b"].as_table().unwrap();
        let keys = written.keys().map(|key| {
            let mut schema = match key.as_str() {
                "cameras" => json!({ "items": { "type": "string" } }),
                _ => json!({ "items": { "enum": images }, "default": written[key] }),
            };
            schema["type"] = "array".into();
            schema["minItems"] = 1.into();
            schema["description"] = self.descriptions.of("Batch", key).into();
            (key.clone(), schema)
        });
        closed(keys.collect())
    }

    fn topic(&self) -> Json {
        let path = "topic.\"a/b\"";
        let mut keys = Map::new();
        for key in ["readers", "buffer", "borrowed"] {
            keys.insert(key.into(), self.bare(path, "TopicLimits", key, "1"));
        }
        keys.insert(
            "gpu".into(),
            json!({ "type": "boolean", "default": false, "description": self.descriptions.of("TopicLimits", "gpu") }),
        );
        keys.insert(
            "gpu_readers".into(),
            self.bare("topic.\"a/rgb\"", "TopicLimits", "gpu_readers", "1"),
        );
        keys.insert(
            "max_bytes".into(),
            self.bare(path, "Topic", "max_bytes", "1"),
        );
        let names: Vec<&str> = schema_frames::ResultType::ALL
            .iter()
            .map(|kind| kind.name())
            .collect();
        keys.insert(
            "type".into(),
            json!({ "enum": names, "description": self.descriptions.of("Topic", "result") }),
        );
        closed(keys)
    }

    fn process(&self) -> Json {
        let mut full = self.probe.full["process"]["p"].as_table().unwrap().clone();
        let ready = full.remove("ready").expect("the probe has a sign");
        let mut keys = self.table("process.p", "Process", &full);
        keys["cmd"].as_object_mut().unwrap().remove("default");
        keys["cmd"]["minItems"] = 1.into();
        keys["env"] = json!({
            "type": "object",
            "additionalProperties": { "type": "string" },
            "description": self.descriptions.of("Process", "env"),
        });
        for key in ["cwd", "venv"] {
            let mut path = self.bare("process.p", "Process", key, "\"x\"");
            path["minLength"] = 1.into();
            keys.insert(key.into(), path);
        }
        keys.insert(
            "nice".into(),
            self.bare("process.p", "Process", "nice", "1"),
        );
        keys.insert(
            "params".into(),
            json!({ "type": "object", "description": self.descriptions.of("Process", "params") }),
        );
        let within = self.value("process.p.ready", "Ready", "within", &ready["within"]);
        let mut ready = Map::from_iter([("within".to_owned(), within)]);
        for sign in ["service", "line", "tcp"] {
            let text = self.descriptions.of("ReadyWhen", &describe::camel(sign));
            ready.insert(
                sign.into(),
                json!({ "type": "string", "description": text }),
            );
        }
        let mut ready = closed(ready);
        ready["description"] = self.descriptions.of("Process", "ready").into();
        keys.insert("ready".into(), ready);
        closed(keys)
    }
}

/// A table that has these keys and no others.
fn closed(properties: Map<String, Json>) -> Json {
    json!({ "type": "object", "properties": properties, "additionalProperties": false })
}

/// A table of tables with names.
fn named(pattern: &str, inside: Json) -> Json {
    json!({ "type": "object", "patternProperties": { pattern: inside }, "additionalProperties": false })
}

/// The same with all keys in order, whatever order the JSON library keeps.
fn sorted(value: &Json) -> Json {
    match value {
        Json::Object(map) => {
            let mut entries: Vec<_> = map.iter().collect();
            entries.sort_by_key(|(key, _)| *key);
            entries
                .into_iter()
                .map(|(key, value)| (key.clone(), sorted(value)))
                .collect::<Map<_, _>>()
                .into()
        }
        Json::Array(list) => list.iter().map(sorted).collect(),
        other => other.clone(),
    }
}

#[test]
fn the_schema_says_what_the_reader_accepts() {
    let maker = Maker {
        probe: Probe::new(),
        descriptions: Descriptions::read(),
    };
    let text = format!("{:#}\n", sorted(&maker.schema()));
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../launch.schema.json");
    if std::env::var_os("GANTRY_BLESS").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap();
    let differs = kept.lines().zip(text.lines()).find(|(a, b)| a != b);
    assert!(
        kept == text,
        "launch/launch.schema.json is not what the reader accepts (first difference: {differs:?}); look at it, then run ./gantry bless"
    );
}

#[test]
fn ranges_and_choices_are_those_of_the_sentences() {
    let probe = Probe::new();
    let leaf = |path: &str| probe.leaf(path, probe.default(path));
    assert_eq!(
        leaf("sensor.lidar.channels"),
        json!({ "type": "integer", "minimum": 1, "maximum": 256, "default": 64 })
    );
    assert_eq!(
        leaf("scenario.weather.sun_altitude_deg"),
        json!({ "type": "number", "minimum": -90, "maximum": 90, "default": 42.0 })
    );
    assert_eq!(
        leaf("sensor.camera.fov_deg"),
        json!({ "type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 180, "default": 90.0 })
    );
    assert_eq!(
        leaf("scenario.mode"),
        json!({ "enum": ["free_running", "stepped"], "default": "free_running" })
    );
    // Both of the two ranges that it can have.
    assert_eq!(
        leaf("sensor.camera.dvs.positive_threshold"),
        json!({ "type": "number", "minimum": 0.01, "maximum": 255, "default": 0.3 })
    );
    let position = leaf("sensor.imu.mount.position_m");
    assert_eq!(
        (&position["minItems"], &position["items"]["maximum"]),
        (&json!(3), &json!(100))
    );
}
