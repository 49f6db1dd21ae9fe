//! DSEC: events, images, flow, disparity and semantic labels of one event camera or a stereo pair, in
//! `<part>/<scenario>/`.

mod calibration;
mod classes;
mod events;
mod flow;
mod hdf5;

use std::io::Write as _;
use std::sync::Arc;

use anyhow::Context as _;
use nalgebra::Isometry3;
use schema_frames::{FrameHeader, Modality};
use serde_json::json;

use self::calibration::Pinhole;
use self::events::EventFile;
use self::flow::Flow;
use super::evt3::size_px;
use crate::exporter::{DoneScenario, Exporter, Format, missing};
use crate::formats::trajectory;
use crate::options::{ImageForm, Options};
use crate::picture;
use crate::tree::{PartFile, Tree};
use consumer_truth::scenario::{Scenario, Sensor, Topic};
use consumer_truth::ticks::{TickFrame, TickSet};

/// Names of the sides in paths.
const SIDES: [&str; 2] = ["left", "right"];
/// Steps of a pixel in images of disparity.
const STEPS_PER_PX: f64 = 256.0;
/// How exactly two cameras must be level, beside one another and alike: metres, radians, pixels.
const PAIR_TOLERANCE: f64 = 1e-3;

/// Writes DSEC's folders.
#[derive(Debug)]
pub struct Dsec {
    cameras: Vec<String>,
    open: Option<Open>,
}

/// A scenario under construction.
#[derive(Debug)]
struct Open {
    folder: String,
    /// Names of the left and, of a pair, the right camera.
    sides: Vec<String>,
    /// Distance of the pair, metres.
    baseline_m: Option<f64>,
    events: Vec<EventFile>,
    poses: PartFile,
    images: Counter,
    /// By side.
    exposures: Vec<Counter>,
    disparities: Counter,
    semantics: Counter,
    forward: Counter,
    backward: Counter,
}

/// Numbered files, and the text file with their times.
#[derive(Debug)]
struct Counter {
    times: Option<PartFile>,
    path: String,
    head: &'static str,
    n: u64,
}

impl Counter {
    fn new(folder: &str, path: &str, head: &'static str) -> Counter {
        Counter {
            times: None,
            path: format!("{folder}/{path}"),
            head,
            n: 0,
        }
    }

    /// Notes the time of the next file, and returns its number.
    fn next(&mut self, tree: &Tree, time: &str) -> anyhow::Result<u64> {
        if self.times.is_none() {
            let mut part = tree.begin(&self.path)?;
            part.write_all(self.head.as_bytes())?;
            self.times = Some(part);
        }
        let times = self.times.as_mut().context("it was just begun")?;
        writeln!(times, "{time}")?;
        self.n = self.n.saturating_add(1);
        Ok(self.n.saturating_sub(1))
    }

    fn finish(self) -> anyhow::Result<u64> {
        self.times.map_or(Ok(()), PartFile::finish)?;
        Ok(self.n)
    }
}

/// The left event camera and, if there is one beside it, the right.
struct Pair<'a> {
    left: &'a Sensor,
    right: Option<(&'a Sensor, f64)>,
}

impl Dsec {
    /// An exporter of the one or two event cameras that the options name, or of the only ones.
    pub fn new(options: &Options) -> anyhow::Result<Dsec> {
        if options.images != ImageForm::Png {
            return Err(launch_cli::wrong_usage(
                "dsec has PNG images only; leave the image form away".to_owned(),
            ));
        }
        Ok(Dsec {
            cameras: options.cameras.clone(),
            open: None,
        })
    }

    fn pair<'a>(&self, scenario: &'a Scenario) -> anyhow::Result<Pair<'a>> {
        let cameras = scenario.cameras(&self.cameras)?;
        let found: Vec<&Sensor> = cameras
            .into_iter()
            .filter(|camera| camera.has(Modality::Dvs))
            .collect();
        match found[..] {
            [] => Err(missing(
                Format::Dsec,
                scenario,
                "an event camera",
                &[Modality::Dvs],
            )),
            [left] => Ok(Pair { left, right: None }),
            [a, b] => [(a, b), (b, a)]
                .into_iter()
                .find_map(|(left, right)| Some((left, right, baseline_m(left, right)?)))
                .map(|(left, right, baseline_m)| Pair {
                    left,
                    right: Some((right, baseline_m)),
                })
                .ok_or_else(|| {
                    launch_cli::wrong_usage(format!(
                        "dsec takes two event cameras only as a stereo pair, and {:?} and {:?} of {} are not level, parallel, beside one another and alike; choose one with --cameras",
                        a.name, b.name, scenario.name
                    ))
                }),
            _ => Err(launch_cli::wrong_usage(format!(
                "dsec has one or two event cameras, and {} has {}; choose with --cameras: {}",
                scenario.name,
                found.len(),
                found.iter().map(|it| it.name.as_str()).collect::<Vec<_>>().join(", ")
            ))),
        }
    }

    fn wanted(side: usize, modality: Modality) -> bool {
        match modality {
            Modality::Dvs | Modality::Rgb => true,
            Modality::Depth | Modality::Semantic | Modality::Flow => side == 0,
            _ => false,
        }
    }
}

/// How far `right` is to the right of `left`, metres, if they are a stereo pair.
fn baseline_m(left: &Sensor, right: &Sensor) -> Option<f64> {
    let first = |sensor: &Sensor| sensor.topic(Modality::Dvs).map(|topic| topic.first);
    let (a, b) = (first(left)?, first(right)?);
    let pairs = a.intrinsics_px.iter().zip(b.intrinsics_px);
    let alike = pairs
        .into_iter()
        .all(|(a, b)| (a - b).abs() < PAIR_TOLERANCE);
    let left_from_right: Isometry3<f64> =
        left.carrier_from_camera().inverse() * right.carrier_from_camera();
    let at = left_from_right.translation.vector;
    let beside = at.y.abs().max(at.z.abs()) < PAIR_TOLERANCE && at.x > PAIR_TOLERANCE;
    let parallel = left_from_right.rotation.angle() < PAIR_TOLERANCE;
    (alike && beside && parallel).then_some(at.x)
}

/// A frame's time as DSEC's clock has it.
fn micros(header: &FrameHeader) -> u64 {
    header.sim_nanos / 1000
}

impl Open {
    fn frame(&mut self, side: usize, tick: &TickSet, tree: &Tree) -> anyhow::Result<()> {
        let name = self.sides[side].clone();
        if let Some(frame) = tick.frame(&name, Modality::Dvs) {
            self.events[side].append(frame)?;
            if side == 0 {
                writeln!(self.poses, "{}", trajectory::line(&frame.header))?;
            }
        }
        if side == 1 {
            return Ok(());
        }
        if let Some(frame) = tick.frame(&name, Modality::Semantic) {
            self.semantic(frame, tree)?;
        }
        let depth = tick.frame(&name, Modality::Depth);
        if let Some(frame) = tick.frame(&name, Modality::Flow) {
            self.flow(frame, depth, tree)?;
        }
        match (depth, self.baseline_m) {
            (Some(depth), Some(baseline_m)) => self.disparity(depth, baseline_m, tree),
            _ => Ok(()),
        }
    }

    /// The images of a tick; of a pair only ticks that have both.
    fn images(&mut self, tick: &TickSet, tree: &Tree) -> anyhow::Result<()> {
        let frames: Vec<&TickFrame> = self
            .sides
            .iter()
            .filter_map(|name| tick.frame(name, Modality::Rgb))
            .collect();
        if frames.is_empty() || frames.len() < self.sides.len() {
            return Ok(());
        }
        let time = micros(&frames[0].header);
        let n = self.images.next(tree, &time.to_string())?;
        for ((side, frame), exposures) in SIDES.iter().zip(frames).zip(&mut self.exposures) {
            // An image shows one moment.
            let time = micros(&frame.header);
            exposures.next(tree, &format!("{time}, {time}"))?;
            let path = format!("{}/images/{side}/rectified/{n:06}.png", self.folder);
            tree.write(&path, || picture::colour(frame, ImageForm::Png))?;
        }
        Ok(())
    }

    fn semantic(&mut self, frame: &TickFrame, tree: &Tree) -> anyhow::Result<()> {
        let (width, height) = (frame.header.width, frame.header.height);
        let n = self
            .semantics
            .next(tree, &micros(&frame.header).to_string())?;
        for (name, of) in [
            ("11classes", classes::of_11 as fn(u8) -> u8),
            ("19classes", classes::of_19),
        ] {
            let path = format!("{}/semantic/{name}/{n:06}.png", self.folder);
            tree.write(&path, || {
                let pixels: Vec<u8> = frame.elements::<u8>().into_iter().map(of).collect();
                picture::gray8(&pixels, width, height)
            })?;
        }
        Ok(())
    }

    fn flow(
        &mut self,
        frame: &TickFrame,
        depth: Option<&TickFrame>,
        tree: &Tree,
    ) -> anyhow::Result<()> {
        let header = &frame.header;
        let (now, window) = (micros(header), header.window_nanos / 1000);
        if window == 0 || header.flags & FrameHeader::FIRST != 0 {
            return Ok(());
        }
        let then = now.saturating_sub(window);
        let (width, height) = (header.width, header.height);
        let backward = Flow::backward(frame);
        let n = self.backward.next(tree, &format!("{now}, {then}"))?;
        tree.write(&format!("{}/flow/backward/{n:06}.png", self.folder), || {
            picture::rgb16(&backward.rgb16(), width, height)
        })?;
        let n = self.forward.next(tree, &format!("{then}, {now}"))?;
        tree.write(&format!("{}/flow/forward/{n:06}.png", self.folder), || {
            let depth_m = depth.map(|depth| depth.elements::<f32>());
            let forward = backward.forward(depth_m.as_deref());
            picture::rgb16(&forward.rgb16(), width, height)
        })
    }

    fn disparity(&mut self, depth: &TickFrame, baseline_m: f64, tree: &Tree) -> anyhow::Result<()> {
        let header = &depth.header;
        let n = self.disparities.next(tree, &micros(header).to_string())?;
        let scale = header.intrinsics_px[0] * baseline_m * STEPS_PER_PX;
        let event = format!("{}/disparity/event/{n:06}.png", self.folder);
        tree.write(&event, || {
            // 0 is unknown: nothing was hit, or the point is too near for 16 bits.
            let steps = |depth_m: f32| match (scale / f64::from(depth_m)).round() {
                steps if steps <= f64::from(u16::MAX) => steps as u16,
                _ => 0,
            };
            let pixels: Vec<u16> = depth.elements::<f32>().into_iter().map(steps).collect();
            picture::gray16(&pixels, header.width, header.height)
        })?;
        // Events and images come from the same pixels.
        tree.link(
            &event,
            &format!("{}/disparity/image/{n:06}.png", self.folder),
        )
    }
}

impl Exporter for Dsec {
    fn check(&mut self, scenario: &Scenario) -> anyhow::Result<()> {
        self.pair(scenario).map(drop)
    }

    fn wants(&self, scenario: &Scenario, topic: &Topic) -> bool {
        self.pair(scenario).is_ok_and(|pair| {
            let right = pair.right.map(|(right, _)| right.name.as_str());
            [Some(pair.left.name.as_str()), right]
                .iter()
                .position(|name| *name == Some(&*topic.sensor))
                .is_some_and(|side| Self::wanted(side, topic.modality))
        })
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
        let pair = self.pair(scenario)?;
        let folder = format!("{}/{}", scenario.split, scenario.name);
        let left = pair.left.topic(Modality::Dvs).context("it was checked")?;
        let size_px = size_px(&left.first);
        let window_start = left.first.sim_nanos.saturating_sub(left.first.window_nanos);
        let sides: Vec<&Sensor> = [Some(pair.left), pair.right.map(|it| it.0)]
            .into_iter()
            .flatten()
            .collect();
        let mut events = Vec::new();
        for side in &SIDES[..sides.len()] {
            let base = format!("{folder}/events/{side}");
            events.push(EventFile::begin(
                tree.begin(&format!("{base}/events.h5"))?,
                window_start / 1000,
            )?);
            events::write_rectify_map(tree.begin(&format!("{base}/rectify_map.h5"))?, size_px)?;
        }
        let baseline_m = pair.right.map(|it| it.1);
        tree.write(&format!("{folder}/calibration/cam_to_cam.yaml"), || {
            let camera = Pinhole::new(&left.first, size_px);
            Ok(calibration::yaml(camera, baseline_m).into_bytes())
        })?;
        let mut poses = tree.begin(&format!("{folder}/poses.txt"))?;
        writeln!(poses, "{}", trajectory::HEAD)?;
        let counter = |path: &str| Counter::new(&folder, path, "");
        let flows =
            |path: &str| Counter::new(&folder, path, "# from_timestamp_us, to_timestamp_us\n");
        let exposures = SIDES[..sides.len()].iter().map(|side| {
            let path = format!("images/{side}/exposure_timestamps.txt");
            Counter::new(
                &folder,
                &path,
                "# exposure_start_timestamp_us, exposure_end_timestamp_us\n",
            )
        });
        self.open = Some(Open {
            sides: sides.iter().map(|sensor| sensor.name.clone()).collect(),
            baseline_m,
            events,
            poses,
            images: counter("images/timestamps.txt"),
            exposures: exposures.collect(),
            disparities: counter("disparity/timestamps.txt"),
            semantics: counter("semantic/timestamps.txt"),
            forward: flows("flow/forward_timestamps.txt"),
            backward: flows("flow/backward_timestamps.txt"),
            folder,
        });
        Ok(())
    }

    fn tick(&mut self, _: &Scenario, tick: &TickSet, tree: &Tree) -> anyhow::Result<()> {
        let open = self.open.as_mut().context("a tick before its scenario")?;
        for side in 0..open.sides.len() {
            open.frame(side, tick, tree)
                .with_context(|| format!("camera {:?} at tick {}", open.sides[side], tick.tick))?;
        }
        open.images(tick, tree)
    }

    fn end(&mut self, _: &Scenario, _: &Tree) -> anyhow::Result<serde_json::Value> {
        let open = self.open.take().context("an end before its scenario")?;
        let n_events: u64 = open.events.iter().map(EventFile::n_events).sum();
        for file in open.events {
            file.finish()?;
        }
        open.poses.finish()?;
        for exposures in open.exposures {
            exposures.finish()?;
        }
        Ok(json!({
            "events": n_events,
            "images": open.images.finish()?,
            "disparities": open.disparities.finish()?,
            "semantics": open.semantics.finish()?,
            "flows": open.forward.finish()?,
            "backward_flows": open.backward.finish()?,
        }))
    }

    fn finish(&mut self, _: &[DoneScenario], _: &Tree) -> anyhow::Result<()> {
        Ok(())
    }
}
