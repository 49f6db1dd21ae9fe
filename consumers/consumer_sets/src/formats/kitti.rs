//! KITTI: `object/`, `tracking/`, and `depth/` and `flow/` if the recording has such images.
//!
//! The first camera is image_2, and the reference of all labels; a second one with parallel axes is
//! image_3. Velodyne axes are the lidar's own (x forward, y left, z up, as KITTI's).

mod labels;
mod text;

use std::collections::HashMap;
use std::io::Write as _;
use std::sync::Arc;

use anyhow::Context as _;
use schema_frames::{FrameHeader, Modality};
use serde_json::{Value, json};

use super::family::{Cloud, Motion, camera_pair, first_topic};
use crate::exporter::{DoneScenario, Exporter, Format, last_number, splits};
use crate::options::Options;
use crate::picture;
use crate::tree::{Job, PartFile, Tree};
use consumer_truth::scenario::{Scenario, Sensor, Topic};
use consumer_truth::ticks::{TickFrame, TickSet};
use text::Calibration;

/// Writes KITTI.
pub struct Kitti {
    options: Options,
    /// Frames of `object/` so far, over all scenarios.
    n_frames: u64,
    /// Pairs of `flow/` so far, over all scenarios.
    n_pairs: u64,
    /// Frames of the running scenario.
    n_here: u64,
    /// Numbers of tracks by actor.
    tracks: HashMap<u32, u32>,
    files: Option<Files>,
    motion: Motion,
    /// The colour frame before this one, for pairs.
    before: Option<TickFrame>,
}

/// Files that grow over a scenario.
struct Files {
    labels: PartFile,
    oxts: Option<PartFile>,
}

/// The sensors that are exported.
struct Chosen<'a> {
    cameras: Vec<&'a Sensor>,
    lidar: Option<(&'a Sensor, &'a Topic)>,
}

impl Kitti {
    /// Nothing is written yet.
    pub fn new(options: &Options) -> Kitti {
        Kitti {
            options: options.clone(),
            n_frames: 0,
            n_pairs: 0,
            n_here: 0,
            tracks: HashMap::new(),
            files: None,
            motion: Motion::default(),
            before: None,
        }
    }

    fn choose<'a>(&self, scenario: &'a Scenario) -> anyhow::Result<Chosen<'a>> {
        Ok(Chosen {
            cameras: camera_pair(Format::Kitti, scenario, &self.options)?,
            lidar: first_topic(scenario, &LIDARS),
        })
    }
}

/// Clouds that can be written, the preferred ones first.
const LIDARS: [Modality; 3] = [
    Modality::Lidar,
    Modality::SemanticLidar,
    Modality::LidarReturns,
];

/// Names of KITTI's folders for the cameras of a pair.
const IMAGES: [(&str, &str); 2] = [("image_2", "image_02"), ("image_3", "image_03")];

impl Exporter for Kitti {
    fn check(&mut self, scenario: &Scenario) -> anyhow::Result<()> {
        self.choose(scenario).map(drop)
    }

    fn wants(&self, scenario: &Scenario, topic: &Topic) -> bool {
        use Modality::{Depth, Flow, Gnss, Imu, Instance, Rgb, Semantic};
        let Ok(chosen) = self.choose(scenario) else {
            return false;
        };
        let of_camera = |at: usize| {
            chosen
                .cameras
                .get(at)
                .is_some_and(|c| c.name == *topic.sensor)
        };
        match topic.modality {
            Rgb => of_camera(0) || of_camera(1),
            Depth | Flow | Instance | Semantic => of_camera(0),
            modality if LIDARS.contains(&modality) => chosen
                .lidar
                .is_some_and(|(_, lidar)| lidar.name == topic.name),
            Imu | Gnss => true,
            _ => false,
        }
    }

    fn keys(&self, scenario: &Scenario) -> Vec<Arc<str>> {
        let Ok(chosen) = self.choose(scenario) else {
            return Vec::new();
        };
        let colour = chosen
            .cameras
            .iter()
            .filter_map(|camera| camera.topic(Modality::Rgb));
        colour
            .chain(chosen.lidar.map(|(_, topic)| topic))
            .map(|topic| topic.name.clone())
            .collect()
    }

    fn begin(
        &mut self,
        scenario: &Scenario,
        done: &[DoneScenario],
        tree: &Tree,
    ) -> anyhow::Result<()> {
        let last = |name: &str| last_number(done, name);
        (self.n_frames, self.n_pairs, self.n_here) = (last("frames"), last("pairs"), 0);
        self.tracks.clear();
        (self.motion, self.before) = (Motion::default(), None);
        let chosen = self.choose(scenario)?;
        let sequence = format!("{:04}", scenario.index);
        let calibration = Calibration::of(
            scenario,
            &chosen.cameras,
            chosen.lidar.map(|(lidar, _)| lidar),
        );
        tree.write(&format!("tracking/training/calib/{sequence}.txt"), || {
            Ok(calibration.tracking().into_bytes())
        })?;
        let has = |modality| scenario.with(modality).next().is_some();
        let grows =
            |folder: &str| tree.begin(&format!("tracking/training/{folder}/{sequence}.txt"));
        let with_oxts = has(Modality::Imu) && has(Modality::Gnss);
        self.files = Some(Files {
            labels: grows("label_02")?,
            oxts: with_oxts.then(|| grows("oxts")).transpose()?,
        });
        Ok(())
    }

    fn tick(&mut self, scenario: &Scenario, tick: &TickSet, tree: &Tree) -> anyhow::Result<()> {
        self.motion.update(tick);
        let chosen = self.choose(scenario)?;
        let first = chosen.cameras[0];
        let frame = tick.frame(&first.name, Modality::Rgb);
        let result = match (tick.key, frame, &tick.world) {
            (Some(_), Some(_), Some(_)) => self.keyframe(scenario, tick, &chosen, tree),
            _ => Ok(()),
        };
        self.before = frame.cloned().or(self.before.take());
        result
    }

    fn end(&mut self, scenario: &Scenario, tree: &Tree) -> anyhow::Result<Value> {
        let files = self.files.take().expect("a scenario has begun");
        files.labels.finish()?;
        if let Some(oxts) = files.oxts {
            oxts.finish()?;
        }
        let _ = (scenario, tree);
        Ok(json!({"frames": self.n_frames, "pairs": self.n_pairs, "here": self.n_here}))
    }

    fn finish(&mut self, done: &[DoneScenario], tree: &Tree) -> anyhow::Result<()> {
        for split in splits(done) {
            let mut frames = String::new();
            let mut sequences = String::new();
            let mut first = 0;
            for (index, scenario) in done.iter().enumerate() {
                let behind = scenario.state["frames"].as_u64().unwrap_or(first);
                if scenario.split == split {
                    frames.extend((first..behind).map(|frame| format!("{frame:06}\n")));
                    sequences += &format!("{index:04} empty 000000 {:06}\n", behind - first);
                }
                first = behind;
            }
            tree.write(&format!("object/ImageSets/{split}.txt"), || {
                Ok(frames.into_bytes())
            })?;
            let map = format!("tracking/evaluate_tracking.seqmap.{split}");
            tree.write(&map, || Ok(sequences.into_bytes()))?;
        }
        Ok(())
    }
}

impl Kitti {
    fn keyframe(
        &mut self,
        scenario: &Scenario,
        tick: &TickSet,
        chosen: &Chosen<'_>,
        tree: &Tree,
    ) -> anyhow::Result<()> {
        let first = chosen.cameras[0];
        let form = self.options.images;
        let ending = form.ending();
        let object = format!("{:06}", self.n_frames);
        let here = format!("{:04}/{:06}", scenario.index, self.n_here);
        let cloud = chosen
            .lidar
            .and_then(|(lidar, topic)| tick.frame(&lidar.name, topic.modality));
        let cloud = cloud.map(|frame| (frame.header, Cloud::of(frame)));
        let mut jobs = Vec::new();
        let mut links = Vec::new();
        for (camera, (folder, tracking)) in chosen.cameras.iter().zip(IMAGES) {
            let Some(frame) = tick.frame(&camera.name, Modality::Rgb) else {
                continue;
            };
            let path = format!("object/training/{folder}/{object}.{ending}");
            links.push((
                path.clone(),
                format!("tracking/training/{tracking}/{here}.{ending}"),
            ));
            jobs.push(Job::new(path, move || picture::colour(frame, form)));
        }
        if let Some((_, cloud)) = &cloud {
            let path = format!("object/training/velodyne/{object}.bin");
            links.push((
                path.clone(),
                format!("tracking/training/velodyne/{here}.bin"),
            ));
            jobs.push(Job::new(path, move || Ok(cloud.velodyne())));
        }
        let lidar = chosen.lidar.map(|(lidar, _)| lidar);
        let calibration = Calibration::of(scenario, &chosen.cameras, lidar);
        jobs.push(Job::new(
            format!("object/training/calib/{object}.txt"),
            move || Ok(calibration.object().into_bytes()),
        ));
        let labels = labels::labels(
            scenario,
            tick,
            first,
            cloud.as_ref(),
            self.options.min_pixels,
        );
        let lines: String = labels.iter().map(|label| label.object_line()).collect();
        jobs.push(Job::new(
            format!("object/training/label_2/{object}.txt"),
            move || Ok(lines.into_bytes()),
        ));
        let image = format!("object/training/image_2/{object}.{ending}");
        let drive = format!("depth/{}/{}", scenario.split, scenario.name);
        let number = format!("{:010}", self.n_here);
        if let Some(frame) = tick.frame(&first.name, Modality::Depth) {
            let path = format!("{drive}/proj_depth/groundtruth/image_02/{number}.png");
            jobs.push(Job::new(path, move || depth_png(frame)));
            links.push((
                image.clone(),
                format!("{drive}/image_02/data/{number}.{ending}"),
            ));
        }
        let flow = tick.frame(&first.name, Modality::Flow);
        let has_before = |header: &FrameHeader| {
            let then = header.sim_nanos.wrapping_sub(header.window_nanos);
            header.flags & FrameHeader::FIRST == 0
                && self
                    .before
                    .as_ref()
                    .is_some_and(|before| before.header.sim_nanos == then)
        };
        if let Some(flow) = flow.filter(|flow| has_before(&flow.header)) {
            let pair = format!("{:06}", self.n_pairs);
            jobs.push(Job::new(
                format!("flow/training/flow_occ/{pair}_10.png"),
                move || flow_png(flow),
            ));
            let before = self.before.as_ref().expect("it was looked for");
            let path = format!("flow/training/image_2/{pair}_11.{ending}");
            jobs.push(Job::new(path, move || picture::colour(before, form)));
            links.push((
                image.clone(),
                format!("flow/training/image_2/{pair}_10.{ending}"),
            ));
            self.n_pairs = self.n_pairs.saturating_add(1);
        }
        tree.write_all(jobs)?;
        for (of, path) in links {
            tree.link(&of, &path)?;
        }
        let files = self.files.as_mut().expect("a scenario has begun");
        let cannot = "cannot write the tracks of a scenario";
        for label in &labels {
            let n_tracks = self.tracks.len() as u32;
            let track = label
                .id
                .map(|id| *self.tracks.entry(id).or_insert(n_tracks));
            let line = label.tracking_line(self.n_here, track);
            files.labels.write_all(line.as_bytes()).context(cannot)?;
        }
        if let (Some(oxts), Some(world)) = (&mut files.oxts, &tick.world) {
            let line = text::oxts(scenario, world, &self.motion);
            oxts.write_all(line.as_bytes()).context(cannot)?;
        }
        self.n_frames = self.n_frames.saturating_add(1);
        self.n_here = self.n_here.saturating_add(1);
        Ok(())
    }
}

/// 16 bits, metres · 256; 0 for nothing, and for what is 256 m away or more.
fn depth_png(frame: &TickFrame) -> anyhow::Result<Vec<u8>> {
    let coded = |metres: f32| {
        let value = (metres * 256.0).round();
        if value < 65536.0 {
            (value as u16).max(1)
        } else {
            0
        }
    };
    let pixels: Vec<u16> = frame.elements::<f32>().into_iter().map(coded).collect();
    picture::gray16(&pixels, frame.header.width, frame.header.height)
}

/// 16 bits, pixels · 64 + 2¹⁵, and whether they are valid: where a point of this image was in the
/// image before it.
fn flow_png(frame: &TickFrame) -> anyhow::Result<Vec<u8>> {
    let coded = |[x, y]: [f32; 2]| {
        let code = |pixels: f32| (-pixels * 64.0).round() + 32768.0;
        let (x, y) = (code(x), code(y));
        let fits = |value: f32| (0.0..65536.0).contains(&value);
        if fits(x) && fits(y) {
            [x as u16, y as u16, 1]
        } else {
            [0, 0, 0]
        }
    };
    let pixels: Vec<[u16; 3]> = frame
        .elements::<[f32; 2]>()
        .into_iter()
        .map(coded)
        .collect();
    picture::rgb16(&pixels, frame.header.width, frame.header.height)
}
