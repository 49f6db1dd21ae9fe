//! Prophesee RAW files with EVT 3.0 events: one per event camera, `<part>/<scenario>/<camera>.raw`,
//! with its calibration and poses beside it.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

pub mod words;

use std::collections::BTreeMap;
use std::io::Write as _;
use std::sync::Arc;

use anyhow::Context as _;
use schema_frames::{DvsEvent, FrameHeader, Modality};
use serde_json::json;

use self::words::{Encoder, Event, MAX_SIDE_PX};
use crate::exporter::{DoneScenario, Exporter, Format, missing};
use crate::formats::trajectory;
use crate::options::Options;
use crate::tree::{PartFile, Tree};
use consumer_truth::scenario::{Scenario, Topic};
use consumer_truth::ticks::{TickFrame, TickSet};

/// Writes EVT 3.0.
#[derive(Debug)]
pub struct Evt3 {
    cameras: Vec<String>,
    open: BTreeMap<String, Stream>,
}

/// The growing files of one camera.
#[derive(Debug)]
struct Stream {
    raw: PartFile,
    poses: PartFile,
    encoder: Encoder,
    n_events: u64,
}

impl Evt3 {
    /// An exporter of the cameras that the options name, or of all.
    pub fn new(options: &Options) -> Evt3 {
        Evt3 {
            cameras: options.cameras.clone(),
            open: BTreeMap::new(),
        }
    }

    fn topics<'a>(&self, scenario: &'a Scenario) -> anyhow::Result<Vec<&'a Topic>> {
        let cameras = scenario.cameras(&self.cameras)?;
        Ok(cameras
            .into_iter()
            .filter_map(|camera| camera.topic(Modality::Dvs))
            .collect())
    }
}

/// Microseconds at which an event happened, since the simulator started.
pub fn micros(header: &FrameHeader, event: &DvsEvent) -> u64 {
    let window_start = header.sim_nanos.saturating_sub(header.window_nanos);
    window_start.saturating_add(u64::from(event.nanos_in_window)) / 1000
}

/// The events of a frame in EVT 3.0's terms.
pub fn events(frame: &TickFrame) -> Vec<Event> {
    frame
        .elements::<DvsEvent>()
        .iter()
        .map(|event| Event {
            micros: micros(&frame.header, event),
            x_px: event.x_px,
            y_px: event.y_px,
            brighter: event.polarity != 0,
        })
        .collect()
}

/// Pixels of an event camera, from the principal point of its pinhole: frames of events are lists
/// and have no width of their own.
pub fn size_px(header: &FrameHeader) -> (u32, u32) {
    let [_, _, cx, cy] = header.intrinsics_px;
    ((2.0 * cx).round() as u32, (2.0 * cy).round() as u32)
}

impl Exporter for Evt3 {
    fn check(&mut self, scenario: &Scenario) -> anyhow::Result<()> {
        let topics = self.topics(scenario)?;
        if topics.is_empty() {
            return Err(missing(
                Format::Evt3,
                scenario,
                "an event camera",
                &[Modality::Dvs],
            ));
        }
        for topic in topics {
            let (width, height) = size_px(&topic.first);
            if width.max(height) > MAX_SIDE_PX || width.min(height) == 0 {
                return Err(launch_cli::wrong_usage(format!(
                    "evt3 holds images of 1 to {MAX_SIDE_PX} pixels a side, and {} has {width}×{height}; leave it out with --cameras",
                    topic.name
                )));
            }
        }
        Ok(())
    }

    fn wants(&self, scenario: &Scenario, topic: &Topic) -> bool {
        self.topics(scenario)
            .is_ok_and(|wanted| wanted.iter().any(|it| it.name == topic.name))
    }

    fn keys(&self, _: &Scenario) -> Vec<Arc<str>> {
        Vec::new()
    }

    fn begin(
        &mut self,
        scenario: &Scenario,
        _: &[DoneScenario],
        tree: &Tree,
    ) -> anyhow::Result<()> {
        self.open.clear();
        let folder = format!("{}/{}", scenario.split, scenario.name);
        let mut calibrations = serde_json::Map::new();
        for topic in self.topics(scenario)? {
            let name = topic.sensor.to_string();
            let (width, height) = size_px(&topic.first);
            let mut raw = tree.begin(&format!("{folder}/{name}.raw"))?;
            write!(
                raw,
                "% evt 3.0\n% format EVT3;height={height};width={width}\n% geometry {width}x{height}\n\
                 % integrator_name Gantry\n% camera_integration_name Gantry\n% end\n"
            )?;
            let [fx, fy, cx, cy] = topic.first.intrinsics_px;
            let sensor = scenario.sensor(&name).context("the sensor of its topic")?;
            calibrations.insert(
                name.clone(),
                json!({
                    "width": width, "height": height,
                    "camera_matrix": [[fx, 0.0, cx - 0.5], [0.0, fy, cy - 0.5], [0.0, 0.0, 1.0]],
                    "T_carrier_camera": trajectory::matrix(&sensor.carrier_from_camera()),
                }),
            );
            let mut poses = tree.begin(&format!("{folder}/{name}_poses.txt"))?;
            writeln!(poses, "{}", trajectory::HEAD)?;
            self.open.insert(
                name,
                Stream {
                    raw,
                    poses,
                    encoder: Encoder::new(),
                    n_events: 0,
                },
            );
        }
        tree.write(&format!("{folder}/calibration.json"), || {
            Ok(serde_json::to_vec_pretty(&calibrations)?)
        })
    }

    fn tick(&mut self, _: &Scenario, tick: &TickSet, _: &Tree) -> anyhow::Result<()> {
        for frame in &tick.frames {
            let Some(stream) = self.open.get_mut(frame.sensor()) else {
                continue;
            };
            let events = events(frame);
            let mut words = Vec::with_capacity(events.len().saturating_mul(4));
            stream
                .encoder
                .encode(&events, &mut words)
                .with_context(|| format!("{} at tick {}", frame.topic, tick.tick))?;
            stream
                .encoder
                .pass_time(frame.header.sim_nanos / 1000, &mut words)?;
            stream.raw.write_all(&words)?;
            stream.n_events = stream.n_events.saturating_add(events.len() as u64);
            writeln!(stream.poses, "{}", trajectory::line(&frame.header))?;
        }
        Ok(())
    }

    fn end(&mut self, _: &Scenario, _: &Tree) -> anyhow::Result<serde_json::Value> {
        let mut counts = serde_json::Map::new();
        for (name, stream) in std::mem::take(&mut self.open) {
            stream.raw.finish()?;
            stream.poses.finish()?;
            counts.insert(name, stream.n_events.into());
        }
        Ok(json!({ "events": counts }))
    }

    fn finish(&mut self, _: &[DoneScenario], _: &Tree) -> anyhow::Result<()> {
        Ok(())
    }
}
