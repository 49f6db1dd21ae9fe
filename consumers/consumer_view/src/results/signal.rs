//! Numbers, texts and bytes over time.

use std::time::{Duration, Instant};

use rerun::TextLogLevel;
use schema_frames::{Scalar, VehicleControlRecord};

use super::canvas::Canvas;
use super::state::{Flow, Results};
use crate::layout::{LOG, ViewKind};
use crate::rerun;

/// Most curves of one topic; names beyond are not shown.
const MAX_CURVES: usize = 64;
/// How often a topic of bytes gets a line.
const LINE_EVERY: Duration = Duration::from_secs(1);

impl Results {
    pub(super) fn scalars(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        for scalar in canvas.parts.records::<Scalar>() {
            self.curve(canvas, &path_part(&scalar.name()), scalar.value)?;
        }
        Ok(())
    }

    pub(super) fn controls(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        let records = canvas.parts.records::<VehicleControlRecord>();
        let several = records.len() > 1;
        for record in records {
            let values = [
                ("throttle", record.throttle_ratio),
                ("steer", record.steer_ratio),
                ("brake", record.brake_ratio),
            ];
            for (name, value) in values {
                let curve = match several {
                    true => format!("{}/{name}", record.actor_id),
                    false => name.to_owned(),
                };
                self.curve(canvas, &curve, value as f64)?;
            }
        }
        Ok(())
    }

    fn curve(&mut self, canvas: &Canvas<'_>, name: &str, value: f64) -> anyhow::Result<()> {
        let topic = canvas.parts.topic;
        if !value.is_finite() {
            self.bad.note(topic, 1, "a number is not finite");
            return Ok(());
        }
        self.need(canvas.parts, ViewKind::Series);
        let known = self.series.entry(topic.to_owned()).or_default();
        if !known.contains(name) {
            if known.len() >= MAX_CURVES {
                let why = format!("it has more than {MAX_CURVES} names of numbers");
                self.bad.note(topic, 1, &why);
                return Ok(());
            }
            known.insert(name.to_owned());
        }
        let path = format!("{}/{name}", canvas.own_path());
        canvas.log(&path, &rerun::Scalars::single(value))
    }

    pub(super) fn text(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        match std::str::from_utf8(canvas.parts.body) {
            Ok(text) => self.line(canvas, text),
            Err(_) => {
                self.bad.note(canvas.parts.topic, 1, "a text is not UTF-8");
                Ok(())
            }
        }
    }

    fn line(&mut self, canvas: &Canvas<'_>, text: &str) -> anyhow::Result<()> {
        self.need(canvas.parts, ViewKind::Lines);
        let path = format!("{LOG}/{}", canvas.parts.topic);
        let line = rerun::TextLog::new(text).with_level(TextLogLevel::INFO);
        canvas.log(&path, &line)
    }

    pub(super) fn json(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        let value: Result<serde_json::Value, _> = serde_json::from_slice(canvas.parts.body);
        let Ok(value) = value else {
            self.bad.note(canvas.parts.topic, 1, "a text is not JSON");
            return Ok(());
        };
        self.need(canvas.parts, ViewKind::Page);
        let page = rerun::TextDocument::new(format!("{value:#}"));
        self.draw(canvas, &canvas.own_path(), false, &page)
    }

    /// Bytes are not understood here: their size and rate are shown once a second.
    pub(super) fn bytes(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        let parts = canvas.parts;
        let fresh = || Flow {
            since: Instant::now(),
            n: 0,
            bytes: 0,
        };
        let Some(flow) = self.flows.get_mut(parts.topic) else {
            self.flows.insert(parts.topic.to_owned(), fresh());
            let line = format!("{}: {} bytes", schema_name(canvas), parts.body.len());
            return self.line(canvas, &line);
        };
        flow.n += 1;
        flow.bytes += parts.body.len() as u64;
        let elapsed = flow.since.elapsed();
        if elapsed < LINE_EVERY {
            return Ok(());
        }
        let rate_hz = flow.n as f64 / elapsed.as_secs_f64();
        let mean = flow.bytes as f64 / flow.n as f64;
        *flow = fresh();
        let name = schema_name(canvas);
        self.line(
            canvas,
            &format!("{name}: {rate_hz:.1} Hz, {mean:.0} bytes each"),
        )?;
        self.curve(canvas, "bytes", mean)?;
        self.curve(canvas, "rate_hz", rate_hz)
    }
}

fn schema_name(canvas: &Canvas<'_>) -> String {
    let schema = canvas.parts.about.schema.as_ref();
    schema.map_or_else(
        || "bytes".to_owned(),
        |schema| format!("{} ({})", schema.name, schema.message_encoding),
    )
}

/// A name as one part of an entity's path.
fn path_part(name: &str) -> String {
    let plain = |c: char| match c.is_ascii_alphanumeric() || "_-.".contains(c) {
        true => c,
        false => '_',
    };
    match name {
        "" => "value".to_owned(),
        name => name.chars().map(plain).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_name_is_one_part_of_a_path() {
        assert_eq!(path_part("speed_mps"), "speed_mps");
        assert_eq!(path_part("a/b c\u{e9}"), "a_b_c_");
        assert_eq!(path_part(""), "value");
    }
}
