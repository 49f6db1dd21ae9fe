//! `gantry-record cat`: a recording's messages as text, one a line.

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;
use std::rc::Rc;

use mcap::records::{MessageHeader, Record};
use schema_recording::messages::PROTOBUF;
use serde_json::{Value as Json, json};

use crate::edit::Cut;
use crate::proto::Types;
use crate::pull::Pull;

/// What a channel is called, and how its messages are read.
struct Known {
    topic: String,
    schema: String,
    encoding: String,
    types: Option<Rc<Types>>,
}

/// Writes the messages of a selection: as JSON, or a line with time, topic, type and size each.
/// Stops quietly when nobody reads any more.
///
/// # Errors
/// If the file is damaged or not finished.
pub fn cat(input: &Path, cut: &Cut, as_json: bool, out: &mut dyn Write) -> anyhow::Result<()> {
    let mut pull = Pull::open(input)?;
    let mut schemas: HashMap<u16, (String, Option<Rc<Types>>)> = HashMap::new();
    let mut channels: HashMap<u16, Known> = HashMap::new();
    while let Some(record) = pull.next()? {
        match record {
            Record::Schema { header, data } => {
                let types = (header.encoding == PROTOBUF).then(|| Rc::new(Types::read(&data)));
                schemas.insert(header.id, (header.name, types));
            }
            Record::Channel(channel) if cut.select.takes_channel(&channel.topic) => {
                let (schema, types) = schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let known = Known {
                    topic: channel.topic,
                    schema,
                    encoding: channel.message_encoding,
                    types,
                };
                channels.insert(channel.id, known);
            }
            Record::Message { header, data } => {
                let Some(known) = channels.get(&header.channel_id) else {
                    continue;
                };
                if header.log_time < cut.from_nanos || header.log_time >= cut.to_nanos {
                    continue;
                }
                let written = if as_json {
                    writeln!(out, "{}", line(known, &header, &data))
                } else {
                    writeln!(
                        out,
                        "{:.6} {} {} seq {} {} bytes",
                        header.log_time as f64 * 1e-9,
                        known.topic,
                        known.schema,
                        header.sequence,
                        data.len()
                    )
                };
                match written {
                    Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => return Ok(()),
                    other => other?,
                }
            }
            _ => {}
        }
    }
    Ok(())
}

fn line(known: &Known, header: &MessageHeader, data: &[u8]) -> Json {
    let message = match &known.types {
        Some(types) => types.json(&known.schema, data),
        None if known.encoding == "json" => {
            serde_json::from_slice(data).unwrap_or_else(|error| json!({"error": error.to_string()}))
        }
        None => json!({ "bytes": data.len() }),
    };
    json!({
        "topic": known.topic,
        "schema": known.schema,
        "log_time": header.log_time,
        "publish_time": header.publish_time,
        "sequence": header.sequence,
        "message": message,
    })
}
