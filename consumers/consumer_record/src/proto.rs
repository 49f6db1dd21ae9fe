//! Protocol buffers as JSON, by the schema that stands in a recording. Any bytes are safe: a library
//! for this exists, but panics on damaged schemas.

use std::collections::HashMap;

use schema_recording::wire::{Value, fields};
use serde_json::{Map, Value as Json, json};

/// Deepest nesting of messages that is followed.
const MAX_DEPTH: usize = 32;
/// Longest list that is written out.
const MAX_ITEMS: usize = 64;

/// The message types of a `google.protobuf.FileDescriptorSet`, by full name.
#[derive(Clone, Debug, Default)]
pub(crate) struct Types(HashMap<String, HashMap<u32, Field>>);

/// A field, with its numbers from `descriptor.proto`.
#[derive(Clone, Debug)]
struct Field {
    name: String,
    is_list: bool,
    kind: u64,
    /// Of messages.
    type_name: String,
}

const LABEL_REPEATED: u64 = 3;

impl Types {
    /// Reads a schema.
    pub(crate) fn read(set: &[u8]) -> Types {
        let mut types = Types::default();
        for file in parts(set, 1) {
            let package = text(file, 2);
            for message in parts(file, 4) {
                types.add(&package, message, 0);
            }
        }
        types
    }

    fn add(&mut self, scope: &str, message: &[u8], depth: usize) {
        if depth > MAX_DEPTH {
            return;
        }
        let name = match scope {
            "" => text(message, 1),
            scope => format!("{scope}.{}", text(message, 1)),
        };
        for nested in parts(message, 3) {
            self.add(&name, nested, depth.saturating_add(1));
        }
        let of = parts(message, 2).map(|field| {
            let found = Field {
                name: text(field, 1),
                is_list: number(field, 4) == LABEL_REPEATED,
                kind: number(field, 5),
                type_name: text(field, 6).trim_start_matches('.').to_string(),
            };
            (number(field, 3) as u32, found)
        });
        let of = of.collect();
        self.0.insert(name, of);
    }

    /// A message of type `name`: every field that is set; of bytes their number, of long lists the
    /// length.
    pub(crate) fn json(&self, name: &str, message: &[u8]) -> Json {
        self.message(name, message, 0)
    }

    fn message(&self, name: &str, message: &[u8], depth: usize) -> Json {
        let Some(of) = self.0.get(name).filter(|_| depth <= MAX_DEPTH) else {
            return json!({ "bytes": message.len() });
        };
        let mut out = Map::new();
        let mut lists: HashMap<u32, (Vec<Json>, usize)> = HashMap::new();
        for (number, value) in fields(message) {
            let Some(field) = of.get(&number) else {
                continue;
            };
            if !field.is_list {
                out.insert(field.name.clone(), self.value(field, value, depth));
                continue;
            }
            let (items, n) = lists.entry(number).or_default();
            for value in unpacked(field.kind, value) {
                *n = n.saturating_add(1);
                if *n <= MAX_ITEMS {
                    items.push(self.value(field, value, depth));
                }
            }
        }
        for (number, (items, n)) in lists {
            let value = match n {
                0..=MAX_ITEMS => Json::Array(items),
                n => json!({ "items": n }),
            };
            out.insert(of[&number].name.clone(), value);
        }
        Json::Object(out)
    }

    fn value(&self, field: &Field, value: Value<'_>, depth: usize) -> Json {
        let zigzag = |n: u64| (n >> 1) as i64 ^ ((n & 1) as i64).wrapping_neg();
        match (field.kind, value) {
            (1, Value::Fixed64(bits)) => float(f64::from_bits(bits)),
            (2, Value::Fixed32(bits)) => match f32::from_bits(bits) {
                value if value.is_finite() => json!(value),
                value => float(value as f64),
            },
            (3 | 5 | 14, Value::Varint(n)) => json!(n as i64),
            (8, Value::Varint(n)) => json!(n != 0),
            (17 | 18, Value::Varint(n)) => json!(zigzag(n)),
            (16, Value::Fixed64(n)) => json!(n as i64),
            (15, Value::Fixed32(n)) => json!(n as i32),
            (_, Value::Varint(n) | Value::Fixed64(n)) => json!(n),
            (_, Value::Fixed32(n)) => json!(n),
            (9, Value::Bytes(bytes)) => json!(String::from_utf8_lossy(bytes)),
            (11, Value::Bytes(bytes)) => {
                self.message(&field.type_name, bytes, depth.saturating_add(1))
            }
            (_, Value::Bytes(bytes)) => json!({ "bytes": bytes.len() }),
        }
    }
}

/// JSON has no infinities.
fn float(value: f64) -> Json {
    match value.is_finite() {
        true => json!(value),
        false => json!(value.to_string()),
    }
}

/// The numbers of a list, which may stand one after another in one field.
fn unpacked(kind: u64, value: Value<'_>) -> Vec<Value<'_>> {
    let Value::Bytes(bytes) = value else {
        return vec![value];
    };
    match kind {
        9 | 11 | 12 => vec![value],
        1 | 6 | 16 => bytes
            .chunks_exact(8)
            .filter_map(|it| Some(Value::Fixed64(u64::from_le_bytes(it.try_into().ok()?))))
            .collect(),
        2 | 7 | 15 => bytes
            .chunks_exact(4)
            .filter_map(|it| Some(Value::Fixed32(u32::from_le_bytes(it.try_into().ok()?))))
            .collect(),
        _ => varints(bytes),
    }
}

fn varints(bytes: &[u8]) -> Vec<Value<'_>> {
    let mut out = Vec::new();
    let (mut value, mut shift) = (0u64, 0u32);
    for byte in bytes {
        if shift < 64 {
            value |= ((byte & 0x7f) as u64) << shift;
        }
        // A number of hundreds of megabytes, none of whose bytes is the last, ends nothing.
        shift = shift.saturating_add(7);
        if byte & 0x80 == 0 {
            out.push(Value::Varint(value));
            (value, shift) = (0, 0);
        }
    }
    out
}

fn parts(message: &[u8], wanted: u32) -> impl Iterator<Item = &[u8]> {
    fields(message).filter_map(move |(number, value)| match value {
        Value::Bytes(bytes) if number == wanted => Some(bytes),
        _ => None,
    })
}

fn text(message: &[u8], wanted: u32) -> String {
    parts(message, wanted)
        .next()
        .map_or_else(String::new, |it| String::from_utf8_lossy(it).into_owned())
}

fn number(message: &[u8], wanted: u32) -> u64 {
    let found = fields(message).find_map(|(number, value)| match value {
        Value::Varint(value) if number == wanted => Some(value),
        _ => None,
    });
    found.unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxglove::messages as fox;
    use schema_recording::messages::{Content, encoded};

    #[test]
    fn a_nested_message_is_told_whole() {
        let types = Types::read(&Content::CameraCalibration.schema().data);
        let message = fox::CameraCalibration {
            timestamp: Some(fox::Timestamp::new(3, 500)),
            frame_id: "front".into(),
            width: 800,
            k: vec![1.5, f64::INFINITY, -2.0],
            ..Default::default()
        };
        let told = types.json("foxglove.CameraCalibration", &encoded(&message, Vec::new()));
        let expected = json!({
            "timestamp": {"seconds": 3, "nanos": 500},
            "frame_id": "front",
            "width": 800,
            "K": [1.5, "inf", -2.0],
        });
        assert_eq!(told, expected);
    }

    #[test]
    fn random_schemas_and_messages_never_panic() {
        let schema = Content::SceneUpdate.schema().data;
        let mut rng = fastrand::Rng::with_seed(4);
        for _ in 0..300 {
            let mut broken = schema.clone();
            for _ in 0..8 {
                let at = rng.usize(..broken.len());
                broken[at] = rng.u8(..);
            }
            let types = Types::read(&broken);
            let bytes: Vec<u8> = (0..200).map(|_| rng.u8(..)).collect();
            for name in types.0.keys() {
                types.json(name, &bytes);
            }
        }
    }
}
