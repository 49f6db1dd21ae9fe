//! `gantry topic hz`, `bw` and `delay`: rate, size, losses, age and latency of a topic over a
//! window.

use std::time::Instant;

use launch_cli::{Exit, Shutdown, wrong_usage};
use schema_bus::{Bus, mono_now};
use serde_json::{Value, json};

use crate::cli::{Form, WindowArgs};
use crate::look::reading::meter::{Meter, Previous, quantiles_into, spread};
use crate::look::reading::source::Source;

/// Which figures to print.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// Intervals between the writer's stamps.
    Rate,
    /// Bytes per second and per sample.
    Bandwidth,
    /// Time from the writer's stamp until this program had the sample, and of results the time
    /// from their inputs.
    Age,
}

/// One measurement.
struct Window {
    meter: Meter,
    secs: f64,
}

pub fn run(bus: &Bus, topic: &str, args: &WindowArgs, what: What) -> anyhow::Result<Exit> {
    let shutdown = Shutdown::install()?;
    let mut source = Source::open(bus, topic)?;
    let mut previous = Previous::default();
    let count = if args.once { Some(1) } else { args.count };
    let mut windows = 0;
    while count.is_none_or(|count| windows < count) {
        let window = measure(&mut source, &mut previous, args, &shutdown)?;
        // A window that Ctrl-C cut short says nothing about the rate.
        if shutdown.requested() {
            break;
        }
        if what == What::Age && window.meter.samples > 0 && window.meter.ages.is_empty() {
            return Err(wrong_usage(format!(
                "samples of {topic:?} have no time of publishing, so they have no age; `gantry topic hz {topic}` counts them"
            )));
        }
        windows += 1;
        match Form::of(args.json) {
            Form::Json => println!("{}", window.as_json(topic, what, source.n_refused())),
            Form::Text => println!("{}", window.as_text(topic, what)),
        }
    }
    Ok(Exit::Done)
}

fn measure(
    source: &mut Source,
    previous: &mut Previous,
    args: &WindowArgs,
    shutdown: &Shutdown,
) -> anyhow::Result<Window> {
    let start = Instant::now();
    let mut meter = Meter::new()?;
    while start.elapsed() < args.window.duration() && !shutdown.requested() {
        match source.next()? {
            Some(sample) => {
                let now = mono_now().0;
                meter.count(&sample.stamp(), previous, now)?;
            }
            None => source.nap()?,
        }
    }
    let secs = start.elapsed().as_secs_f64();
    Ok(Window { meter, secs })
}

impl Window {
    fn as_json(&self, topic: &str, what: What, n_refused: u64) -> Value {
        let meter = &self.meter;
        let mut line = json!({"topic": topic, "samples": meter.samples, "lost": meter.lost, "refused": n_refused, "window_secs": self.secs});
        let bytes_per_sec = meter.bytes as f64 / self.secs;
        match what {
            What::Rate => {
                quantiles_into(&mut line, "interval", &meter.intervals);
                line["rate_hz"] = meter.rate_hz(self.secs).into();
                line["bytes_per_sec"] = bytes_per_sec.into();
                line["jitter_nanos"] = meter.intervals.stdev().into();
            }
            What::Bandwidth => {
                line["bytes_per_sec"] = bytes_per_sec.into();
                line["bytes"] = meter.bytes.into();
                line["sample_bytes_min"] = meter.sizes.map(|(least, _)| least).into();
                line["sample_bytes_mean"] = (meter.samples > 0)
                    .then(|| meter.bytes as f64 / meter.samples as f64)
                    .into();
                line["sample_bytes_max"] = meter.sizes.map(|(_, most)| most).into();
            }
            What::Age => {
                quantiles_into(&mut line, "delay", &meter.ages);
                if !meter.since_sensor.is_empty() {
                    quantiles_into(&mut line, "since_sensor", &meter.since_sensor);
                }
                let of_input = |(input, times)| {
                    let mut object = json!({"input": input});
                    quantiles_into(&mut object, "latency", times);
                    object
                };
                let inputs: Vec<Value> = meter.latencies.iter().map(of_input).collect();
                if !inputs.is_empty() {
                    line["inputs"] = inputs.into();
                }
            }
        }
        line
    }

    fn as_text(&self, topic: &str, what: What) -> String {
        let meter = &self.meter;
        if meter.samples == 0 {
            return format!("{topic}: nothing in {:.1} s", self.secs);
        }
        let n = format!("{} samples, {} lost", meter.samples, meter.lost);
        let mbytes = meter.bytes as f64 / self.secs / 1e6;
        match what {
            What::Rate => {
                let jitter = meter.intervals.stdev() / 1e6;
                format!(
                    "{:.2} Hz  {mbytes:.1} MB/s  interval ms: {}  jitter {jitter:.3}  ({n})",
                    meter.rate_hz(self.secs),
                    spread(&meter.intervals, 1e6)
                )
            }
            What::Bandwidth => {
                let (least, most) = meter.sizes.unwrap_or_default();
                let mean = meter.bytes / meter.samples;
                format!(
                    "{mbytes:.3} MB/s  bytes a sample: min {least}  mean {mean}  max {most}  ({n})"
                )
            }
            What::Age => {
                let mut text = format!("delay µs: {}  ({n})", spread(&meter.ages, 1e3));
                for (input, times) in &meter.latencies {
                    text += &format!("\n  after {input} ms: {}", spread(times, 1e6));
                }
                if !meter.since_sensor.is_empty() {
                    let times = spread(&meter.since_sensor, 1e6);
                    text += &format!("\n  after the oldest sensor frame ms: {times}");
                }
                text
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::reading::source::Stamp;

    #[test]
    fn an_empty_window_says_so() {
        let window = Window {
            meter: Meter::new().unwrap(),
            secs: 3.0,
        };
        assert_eq!(
            window.as_text("ego/front/rgb", What::Age),
            "ego/front/rgb: nothing in 3.0 s"
        );
        assert!(window.as_json("a", What::Age, 0)["delay_nanos_p50"].is_null());
        assert!(window.as_json("a", What::Bandwidth, 0)["sample_bytes_mean"].is_null());
    }

    #[test]
    fn a_result_tells_its_latency_by_input() {
        let (mut meter, mut previous) = (Meter::new().unwrap(), Previous::default());
        let stamp = Stamp {
            published_mono_nanos: Some(7_000_000),
            answers: vec![("ego/front/rgb".into(), 5_000_000)],
            bytes: 64,
            ..Stamp::default()
        };
        meter.count(&stamp, &mut previous, 7_000_500).unwrap();
        let window = Window { meter, secs: 1.0 };
        let json = window.as_json("a", What::Age, 0);
        assert_eq!(json["inputs"][0]["input"], "ego/front/rgb");
        let p50 = json["inputs"][0]["latency_nanos_p50"].as_u64().unwrap();
        assert!(p50.abs_diff(5_000_000) < 10_000, "{p50}");
        assert!(
            window
                .as_text("a", What::Age)
                .contains("after ego/front/rgb ms: min ")
        );
        assert_eq!(
            window.as_json("a", What::Bandwidth, 0)["sample_bytes_max"],
            64
        );
    }
}
