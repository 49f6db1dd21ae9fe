//! Records as JSON objects, from their `Debug` form.

use serde_json::Value;

/// The first `n` elements of a list; an empty list if there is none.
pub fn first<T>(list: Option<&[T]>, n: usize, show: impl Fn(&T) -> Value) -> Value {
    list.unwrap_or_default().iter().take(n).map(show).collect()
}

/// A number as short as its 32 bits allow; text for what JSON has no number for.
pub fn number(value: f32) -> Value {
    let text = value.to_string();
    serde_json::from_str(&text).unwrap_or_else(|_| Value::from(text))
}

/// Most bytes that are shown of what is not known.
const SHOWN_BYTES: usize = 32;

/// The first bytes in hexadecimal, in groups of four; `…` stands for the rest.
pub fn hex(bytes: &[u8]) -> String {
    let shown = &bytes[..bytes.len().min(SHOWN_BYTES)];
    let group = |bytes: &[u8]| bytes.iter().map(|b| format!("{b:02x}")).collect::<String>();
    let text = shown.chunks(4).map(group).collect::<Vec<_>>().join(" ");
    match bytes.len() > shown.len() {
        true => format!("{text} …"),
        false => text,
    }
}

/// A record's fields by name, from its `Debug` form `Name { a: 1, b: [2.0, inf] }`: numbers and
/// lists of numbers only.
pub fn debug_fields(record: &impl std::fmt::Debug) -> Value {
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

#[cfg(test)]
mod tests {
    use super::*;
    use schema_frames::{DvsEvent, LidarPoint};
    use serde_json::json;

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
    fn numbers_of_32_bits_stay_short() {
        assert_eq!(number(0.9).to_string(), "0.9");
        assert_eq!(number(f32::NAN), json!("NaN"));
        assert_eq!(number(-3.0), json!(-3));
    }

    #[test]
    fn bytes_are_shown_in_groups_and_cut() {
        assert_eq!(hex(&[1, 2, 3, 255, 16]), "010203ff 10");
        assert!(hex(&[0; 33]).ends_with("00000000 …"));
        assert_eq!(hex(&[]), "");
    }
}
