//! What a recording shows: objects by class, distance and occlusion, and a small picture.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::Arc;

use anyhow::Context as _;
use base64::Engine as _;
use consumer_truth::recording::{TickReader, scenario};
use consumer_truth::scenario::Scenario;
use consumer_truth::ticks::{TickFrame, TickSet};
use consumer_truth::{Body, Camera, Images, bodies, box_truths};
use image::{Rgb, RgbImage, imageops};
use schema_frames::{LidarPoint, LidarReturn, Modality, SemanticLidarPoint};
use schema_recording::read::RecordingFile;
use schema_types::Class;
use schema_types::class::CLASSES;
use serde::{Deserialize, Serialize};

/// Width of a bin of distance, metres; the last bin holds everything beyond.
pub const DISTANCE_BIN_M: f64 = 10.0;
/// Bins of distance.
pub const N_DISTANCES: usize = 11;
/// Bins of occlusion, each a tenth.
pub const N_OCCLUSIONS: usize = 10;
/// Width of the small pictures, pixels.
const PICTURE_WIDTH: u32 = 320;
/// Half the side of a lidar's picture, metres.
const LIDAR_REACH_M: f32 = 50.0;

/// What a recording shows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Ticks.
    pub n_ticks: u64,
    /// Simulated time, seconds.
    pub sim_secs: f64,
    /// Frames by topic.
    pub frames: BTreeMap<String, u64>,
    /// Events of event cameras.
    pub n_events: u64,
    /// Points of lidars.
    pub n_points: u64,
    /// Objects by the name of their class.
    pub classes: BTreeMap<String, ClassCounts>,
    /// A small JPEG in base64; empty if nothing can be shown.
    #[serde(default)]
    pub picture: String,
}

/// Objects of a class. An object counts once for every image that shows it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ClassCounts {
    /// Different objects.
    pub objects: u64,
    /// Objects in images.
    pub seen: u64,
    /// Objects within an image of which nothing can be seen.
    pub hidden: u64,
    /// Of those seen: by distance, [`DISTANCE_BIN_M`] each.
    pub by_distance: [u64; N_DISTANCES],
    /// Of those seen: by the share that something else covers; empty without instance images.
    pub by_occlusion: [u64; N_OCCLUSIONS],
}

impl Statistics {
    /// Adds those of another recording; pictures and frames stay with their recordings.
    pub fn add(&mut self, other: &Statistics) {
        self.n_ticks += other.n_ticks;
        self.sim_secs += other.sim_secs;
        self.n_events += other.n_events;
        self.n_points += other.n_points;
        for (topic, n) in &other.frames {
            *self.frames.entry(topic.clone()).or_default() += n;
        }
        for (class, counts) in &other.classes {
            let own = self.classes.entry(class.clone()).or_default();
            own.objects += counts.objects;
            own.seen += counts.seen;
            own.hidden += counts.hidden;
            let add = |own: &mut [u64], other: &[u64]| {
                own.iter_mut().zip(other).for_each(|(a, b)| *a += b);
            };
            add(&mut own.by_distance, &counts.by_distance);
            add(&mut own.by_occlusion, &counts.by_occlusion);
        }
    }

    /// Objects in images.
    pub fn seen(&self) -> u64 {
        self.classes.values().map(|counts| counts.seen).sum()
    }
}

/// Reads a recording and counts; it has the ticks `ticks`, and perhaps the snapshot of the one before
/// them, which a recorder gets when it begins. `stop` is asked once a tick.
///
/// # Errors
/// If the recording cannot be read or is damaged, or on a request to stop.
pub fn count(
    path: &std::path::Path,
    name: &str,
    ticks: std::ops::RangeInclusive<u64>,
    stop: &dyn Fn() -> bool,
) -> anyhow::Result<Statistics> {
    let file = RecordingFile::open(path)?;
    let scenario = scenario(&file, name, 0, "all", rig_of(&file))?;
    let topics = scenario.sensors.iter().flat_map(|sensor| &sensor.topics);
    let wanted: HashSet<Arc<str>> = topics.map(|topic| topic.name.clone()).collect();
    let mut reader = TickReader::new(&file, (0, u64::MAX), &wanted)?;
    let mut counter = Counter::default();
    let n_ticks = (ticks.end() + 1).saturating_sub(*ticks.start());
    while let Some(tick) = reader.next_tick()? {
        if stop() {
            return Err(launch_run::RunError::Stopped.into());
        }
        if ticks.contains(&tick.tick) {
            counter.tick(&scenario, &tick, n_ticks / 2)?;
        }
    }
    let (n_lost, sentences) = reader.losses();
    anyhow::ensure!(
        n_lost == 0,
        "{} is damaged: {}",
        path.display(),
        sentences.join("; ")
    );
    anyhow::ensure!(
        counter.found.n_ticks == n_ticks,
        "{} holds {} ticks, not {n_ticks}",
        path.display(),
        counter.found.n_ticks
    );
    counter.found.sim_secs = n_ticks as f64 * scenario.info.period_nanos as f64 * 1e-9;
    counter.finish()
}

/// The rig to count on: `ego`, or the first one.
fn rig_of(file: &RecordingFile) -> Option<&str> {
    let rigs: BTreeSet<&str> = file
        .topics()
        .iter()
        .filter(|topic| topic.kind == schema_recording::read::TopicKind::Frame)
        .filter_map(|topic| topic.name.split('/').next())
        .collect();
    rigs.get("ego").or(rigs.first()).copied()
}

#[derive(Default)]
struct Counter {
    found: Statistics,
    objects: BTreeMap<String, BTreeSet<u32>>,
    picture: Option<TickFrame>,
}

impl Counter {
    fn tick(&mut self, scenario: &Scenario, tick: &TickSet, middle: u64) -> anyhow::Result<()> {
        for frame in &tick.frames {
            let n_frames = self.found.frames.entry(frame.topic.to_string());
            *n_frames.or_default() += 1;
            match frame.modality {
                Modality::Dvs => self.found.n_events += u64::from(frame.header.width),
                Modality::Lidar | Modality::SemanticLidar | Modality::LidarReturns => {
                    self.found.n_points += u64::from(frame.header.width);
                }
                _ => {}
            }
        }
        if self.found.n_ticks <= middle || self.picture.is_none() {
            self.keep_picture(tick);
        }
        self.found.n_ticks += 1;
        let Some(world) = &tick.world else {
            return Ok(());
        };
        let bodies = bodies(world, scenario.carrier_id);
        for sensor in &scenario.sensors {
            let image = [Modality::Instance, Modality::Rgb, Modality::Depth]
                .into_iter()
                .chain([Modality::Semantic])
                .find_map(|modality| tick.frame(&sensor.name, modality));
            if let Some(image) = image {
                self.camera(&bodies, image, tick);
            }
        }
        Ok(())
    }

    /// Counts what one camera sees.
    fn camera(&mut self, bodies: &[Body], image: &TickFrame, tick: &TickSet) {
        let sensor = image.sensor();
        let camera = Camera::of(&image.header);
        let instance = tick.frame(sensor, Modality::Instance);
        let instance = instance.map(|frame| frame.elements::<u32>());
        let depth = tick.frame(sensor, Modality::Depth);
        let depth = depth.map(|frame| frame.elements::<f32>());
        let images = Images {
            instance: instance.as_deref(),
            depth: depth.as_deref(),
        };
        let at_m = camera.world_from_camera.translation.vector;
        for truth in box_truths(&camera, bodies, images) {
            let body = &bodies[truth.body];
            let class = Class(body.class).info().map_or("Unlabeled", |it| it.name);
            let counts = self.found.classes.entry(class.into()).or_default();
            if truth.seen.is_some_and(|seen| seen.pixels == 0) {
                counts.hidden += 1;
                continue;
            }
            counts.seen += 1;
            let distance_m = (body.world_from_box.translation.vector - at_m).norm();
            let bin = (distance_m / DISTANCE_BIN_M) as usize;
            counts.by_distance[bin.min(N_DISTANCES - 1)] += 1;
            if let Some(seen) = truth.seen {
                let bin = (seen.occlusion * N_OCCLUSIONS as f64) as usize;
                counts.by_occlusion[bin.min(N_OCCLUSIONS - 1)] += 1;
            }
            self.objects
                .entry(class.into())
                .or_default()
                .insert(body.id);
        }
    }

    /// Keeps the frame of this tick that shows most to people.
    fn keep_picture(&mut self, tick: &TickSet) {
        let rank = |frame: &TickFrame| match frame.modality {
            Modality::Rgb => 3,
            Modality::Semantic => 2,
            Modality::Lidar | Modality::SemanticLidar | Modality::LidarReturns => 1,
            _ => 0,
        };
        let own = self.picture.as_ref().map_or(1, rank);
        // The first of the best: frames are ordered by topic.
        let best = tick
            .frames
            .iter()
            .filter(|frame| rank(frame) >= own)
            .reduce(|best, next| if rank(next) > rank(best) { next } else { best });
        if let Some(best) = best {
            self.picture = Some(best.clone());
        }
    }

    fn finish(mut self) -> anyhow::Result<Statistics> {
        for (class, objects) in &self.objects {
            if let Some(counts) = self.found.classes.get_mut(class) {
                counts.objects = objects.len() as u64;
            }
        }
        if let Some(frame) = &self.picture {
            self.found.picture = picture(frame)?;
        }
        Ok(self.found)
    }
}

/// A frame as a small JPEG in base64.
fn picture(frame: &TickFrame) -> anyhow::Result<String> {
    let (width, height) = (frame.header.width, frame.header.height);
    let whole = match frame.modality {
        Modality::Rgb => RgbImage::from_raw(width, height, consumer_sets::picture::rgb_of(frame))
            .context("the image has its size")?,
        Modality::Semantic => {
            let classes = frame.elements::<u8>();
            let colour = |class: &u8| CLASSES.get(*class as usize).map_or([0; 3], |it| it.rgb);
            let pixels = classes.iter().flat_map(colour).collect();
            RgbImage::from_raw(width, height, pixels).context("the image has its size")?
        }
        Modality::Lidar => from_above(
            frame
                .elements::<LidarPoint>()
                .iter()
                .map(|point| point.hit_in_sensor_m),
        ),
        Modality::LidarReturns => from_above(
            frame
                .elements::<LidarReturn>()
                .iter()
                .map(|point| point.hit_in_sensor_m),
        ),
        _ => from_above(
            frame
                .elements::<SemanticLidarPoint>()
                .iter()
                .map(|point| point.hit_in_sensor_m),
        ),
    };
    let small = if whole.width() > PICTURE_WIDTH {
        let height = (whole.height() * PICTURE_WIDTH / whole.width()).max(1);
        imageops::thumbnail(&whole, PICTURE_WIDTH, height)
    } else {
        whole
    };
    let mut jpeg = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 80).encode_image(&small)?;
    Ok(base64::engine::general_purpose::STANDARD.encode(jpeg))
}

/// Points seen from above, forward is up; higher points are lighter.
fn from_above(points_m: impl Iterator<Item = [f32; 3]>) -> RgbImage {
    let (width, height) = (PICTURE_WIDTH, PICTURE_WIDTH * 3 / 4);
    let mut image = RgbImage::from_pixel(width, height, Rgb([16, 18, 24]));
    let scale = height as f32 / (2.0 * LIDAR_REACH_M);
    for [x_m, y_m, z_m] in points_m {
        let column = width as f32 / 2.0 - y_m * scale;
        let row = height as f32 / 2.0 - x_m * scale;
        if (0.0..width as f32).contains(&column) && (0.0..height as f32).contains(&row) {
            let light = (120.0 + z_m * 40.0).clamp(60.0, 255.0) as u8;
            image.put_pixel(column as u32, row as u32, Rgb([light / 2, light, light]));
        }
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_add_bins_and_keep_classes_apart() {
        let mut a = Statistics {
            n_ticks: 3,
            ..Statistics::default()
        };
        let mut b = a.clone();
        let mut counts = ClassCounts {
            seen: 2,
            ..ClassCounts::default()
        };
        counts.by_distance[1] = 2;
        b.classes.insert("Car".into(), counts);
        a.add(&b);
        a.add(&b);
        assert_eq!((a.n_ticks, a.seen()), (9, 4));
        assert_eq!(a.classes["Car"].by_distance[1], 4);
    }

    #[test]
    fn a_cloud_from_above_has_what_is_ahead_on_top() {
        let image = from_above([[40.0, 0.0, 1.0], [0.0, 200.0, 0.0]].into_iter());
        let is_lit = |row: u32| (0..image.width()).any(|x| image.get_pixel(x, row).0[1] > 100);
        assert!((0..image.height() / 2).any(is_lit));
        assert!(!(image.height() / 2..image.height()).any(is_lit));
    }
}
