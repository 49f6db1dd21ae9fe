//! A value of JSON as bytes. JSON's text would do, but reading a number from it may round.
//!
//! The feature `float_roundtrip` of `serde_json` rounds correctly, but a feature holds for a whole
//! build: every number that clients send in commands would be read with it, too, and some worlds
//! would differ from those of earlier versions in the last bit. `f32` fields of a specification would
//! still be read as `f64` first, because its kind is a tag beside them.

use anyhow::bail;
use serde_json::{Map, Number, Value};

use super::bytes::{Reader, Writer};

/// Lists and tables may lie in one another this deep.
const MAX_DEPTH: u32 = 64;

pub fn put(value: &Value, to: &mut Writer) {
    match value {
        Value::Null => to.put(0u8),
        Value::Bool(is_true) => {
            to.put(1u8);
            to.put(u8::from(*is_true));
        }
        Value::Number(number) => {
            if let Some(whole) = number.as_u64() {
                to.put(2u8);
                to.put(whole);
            } else if let Some(whole) = number.as_i64() {
                to.put(3u8);
                to.put(whole);
            } else {
                to.put(4u8);
                to.put(number.as_f64().unwrap_or(f64::NAN));
            }
        }
        Value::String(text) => {
            to.put(5u8);
            to.put_text(text);
        }
        Value::Array(values) => {
            to.put(6u8);
            to.put_len(values.len());
            values.iter().for_each(|value| put(value, to));
        }
        Value::Object(values) => {
            to.put(7u8);
            to.put_len(values.len());
            for (key, value) in values {
                to.put_text(key);
                put(value, to);
            }
        }
    }
}

pub fn get(from: &mut Reader<'_>) -> anyhow::Result<Value> {
    get_at(from, 0)
}

fn get_at(from: &mut Reader<'_>, depth: u32) -> anyhow::Result<Value> {
    if depth > MAX_DEPTH {
        bail!("it is too deep");
    }
    Ok(match from.get::<u8>()? {
        0 => Value::Null,
        1 => Value::Bool(from.get::<u8>()? != 0),
        2 => from.get::<u64>()?.into(),
        3 => from.get::<i64>()?.into(),
        4 => Number::from_f64(from.get()?).map_or(Value::Null, Value::Number),
        5 => Value::String(from.get_text()?),
        6 => {
            let n = from.get_len()?;
            let mut values = Vec::new();
            for _ in 0..n {
                values.push(get_at(from, depth + 1)?);
            }
            Value::Array(values)
        }
        7 => {
            let n = from.get_len()?;
            let mut values = Map::new();
            for _ in 0..n {
                let key = from.get_text()?;
                values.insert(key, get_at(from, depth + 1)?);
            }
            Value::Object(values)
        }
        other => bail!("kind {other} of a value is not known"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bit_of_a_number_arrives() {
        let number = f64::from_bits(0x3fb9_9999_9999_999b);
        let value = serde_json::json!({
            "a": [number, 0.1f32, -3, u64::MAX, true, null],
            "b": {"c": "text"},
        });
        let mut writer = Writer::default();
        put(&value, &mut writer);
        let mut reader = Reader(&writer.0);
        let read = get(&mut reader).unwrap();
        reader.end().unwrap();
        assert_eq!(read, value);
        assert_eq!(
            read["a"][0].as_f64().map(f64::to_bits),
            Some(number.to_bits())
        );
        for n_bytes in 0..writer.0.len() {
            assert!(get(&mut Reader(&writer.0[..n_bytes])).is_err());
        }
    }
}
