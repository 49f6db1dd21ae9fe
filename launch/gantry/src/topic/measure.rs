//! `gantry topic hz` and `delay`: rate, jitter, losses and age of a topic over a window.

use std::time::Instant;

use anyhow::Context as _;
use hdrhistogram::Histogram;
use launch_cli::{Exit, Shutdown};
use schema_bus::{Bus, mono_now};

use super::source::{Source, Stamp};
use crate::cli::{Form, WindowArgs};

/// Which figures to print.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// Intervals between the writer's stamps.
    Rate,
    /// Time from the writer's stamp until this program had the sample.
    Age,
}

/// The figures of one measurement.
struct Window {
    samples: u64,
    lost: u64,
    bytes: u64,
    /// Intervals or ages, nanoseconds.
    nanos: Histogram<u64>,
    secs: f64,
}

/// Sequence number and time of the previous sample.
#[derive(Default)]
struct Previous {
    seq: Option<u64>,
    at_nanos: Option<u64>,
}

pub fn run(bus: &Bus, topic: &str, args: &WindowArgs, what: What) -> anyhow::Result<Exit> {
    let shutdown = Shutdown::install()?;
    let mut source = Source::open(bus, topic)?;
    let mut previous = Previous::default();
    let mut windows = 0;
    while args.count.is_none_or(|count| windows < count) {
        let window = measure(&mut source, &mut previous, args, what, &shutdown)?;
        // A window that Ctrl-C cut short says nothing about the rate.
        if shutdown.requested() {
            break;
        }
        windows += 1;
        print(topic, &window, what, Form::of(args.json));
    }
    Ok(Exit::Done)
}

fn measure(
    source: &mut Source,
    previous: &mut Previous,
    args: &WindowArgs,
    what: What,
    shutdown: &Shutdown,
) -> anyhow::Result<Window> {
    let start = Instant::now();
    let mut window = Window::new()?;
    while start.elapsed() < args.window.duration() && !shutdown.requested() {
        match source.next()? {
            Some(sample) => window.count(&sample.stamp(), previous, what)?,
            None => source.nap()?,
        }
    }
    window.secs = start.elapsed().as_secs_f64();
    Ok(window)
}

impl Window {
    fn new() -> anyhow::Result<Self> {
        let nanos = Histogram::new(3).context("cannot make a histogram")?;
        Ok(Window {
            samples: 0,
            lost: 0,
            bytes: 0,
            nanos,
            secs: 0.0,
        })
    }

    fn count(&mut self, stamp: &Stamp, previous: &mut Previous, what: What) -> anyhow::Result<()> {
        let now = mono_now().0;
        let at = stamp.published_mono_nanos.unwrap_or(now);
        self.samples += 1;
        self.bytes += stamp.bytes;
        if let (Some(before), Some(seq)) = (previous.seq, stamp.seq) {
            // A sequence number that falls back comes from a new writer.
            self.lost += seq.saturating_sub(before.saturating_add(1));
        }
        let value = match what {
            What::Rate => previous.at_nanos.map(|before| at.saturating_sub(before)),
            What::Age => {
                let published = stamp
                    .published_mono_nanos
                    .context("this topic has no publishing time in its header, so it has no age")?;
                Some(now.saturating_sub(published))
            }
        };
        if let Some(value) = value {
            self.nanos
                .record(value)
                .context("an interval is too long to count")?;
        }
        *previous = Previous {
            seq: stamp.seq,
            at_nanos: Some(at),
        };
        Ok(())
    }

    fn rate_hz(&self) -> f64 {
        let mean = self.nanos.mean();
        if self.nanos.is_empty() || mean <= 0.0 {
            self.samples as f64 / self.secs
        } else {
            1e9 / mean
        }
    }

    fn as_json(&self, topic: &str, what: What) -> serde_json::Value {
        let nanos = &self.nanos;
        let at = |quantile: f64| nanos.value_at_quantile(quantile);
        let name = if what == What::Rate {
            "interval"
        } else {
            "delay"
        };
        let mut line = serde_json::json!({"topic": topic, "samples": self.samples, "lost": self.lost, "window_secs": self.secs});
        let figures = [
            ("min", nanos.min()),
            ("p50", at(0.5)),
            ("p90", at(0.9)),
            ("p99", at(0.99)),
            ("p999", at(0.999)),
            ("max", nanos.max()),
        ];
        for (figure, value) in figures {
            line[format!("{name}_nanos_{figure}")] = (!nanos.is_empty()).then_some(value).into();
        }
        if what == What::Rate {
            line["rate_hz"] = self.rate_hz().into();
            line["bytes_per_sec"] = (self.bytes as f64 / self.secs).into();
            line["jitter_nanos"] = nanos.stdev().into();
        }
        line
    }

    fn as_text(&self, topic: &str, what: What) -> String {
        if self.samples == 0 {
            return format!("{topic}: nothing in {:.1} s", self.secs);
        }
        let nanos = &self.nanos;
        let spread = |nanos_each: f64| {
            let [min, p50, p99, max] = [
                nanos.min(),
                nanos.value_at_quantile(0.5),
                nanos.value_at_quantile(0.99),
                nanos.max(),
            ];
            let [min, p50, p99, max] = [min, p50, p99, max].map(|value| value as f64 / nanos_each);
            format!("min {min:.3}  p50 {p50:.3}  p99 {p99:.3}  max {max:.3}")
        };
        let n = format!("{} samples, {} lost", self.samples, self.lost);
        match what {
            What::Rate => {
                let mbytes = self.bytes as f64 / self.secs / 1e6;
                let jitter = nanos.stdev() / 1e6;
                format!(
                    "{:.2} Hz  {mbytes:.1} MB/s  interval ms: {}  jitter {jitter:.3}  ({n})",
                    self.rate_hz(),
                    spread(1e6)
                )
            }
            What::Age => format!("delay µs: {}  ({n})", spread(1e3)),
        }
    }
}

fn print(topic: &str, window: &Window, what: What, form: Form) {
    if form == Form::Json {
        println!("{}", window.as_json(topic, what));
    } else {
        println!("{}", window.as_text(topic, what));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp(seq: u64, published: u64) -> Stamp {
        Stamp {
            seq: Some(seq),
            published_mono_nanos: Some(published),
            bytes: 10,
        }
    }

    #[test]
    fn rate_comes_from_the_writers_clock_and_gaps_are_losses() {
        let mut window = Window {
            secs: 1.0,
            ..Window::new().unwrap()
        };
        let mut previous = Previous::default();
        for seq in [1, 2, 3, 6, 7] {
            window
                .count(&stamp(seq, seq * 50_000_000), &mut previous, What::Rate)
                .unwrap();
        }
        assert_eq!((window.samples, window.lost, window.bytes), (5, 2, 50));
        // Four intervals of 50, 50, 150 and 50 ms.
        assert!(
            (window.rate_hz() - 1e9 / 75e6).abs() < 0.05,
            "{}",
            window.rate_hz()
        );
        assert_eq!(window.as_json("a", What::Rate)["lost"], 2);
        window
            .count(&stamp(1, 1_000_000_000), &mut previous, What::Rate)
            .unwrap();
        assert_eq!(window.lost, 2, "a new writer begins to count anew");
    }

    #[test]
    fn an_empty_window_says_so() {
        let window = Window {
            secs: 3.0,
            ..Window::new().unwrap()
        };
        assert_eq!(
            window.as_text("ego/front/rgb", What::Age),
            "ego/front/rgb: nothing in 3.0 s"
        );
        assert!(window.as_json("a", What::Age)["delay_nanos_p50"].is_null());
    }
}
