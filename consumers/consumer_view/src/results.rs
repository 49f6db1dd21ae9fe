//! Results of users' programs in the recording: over the image that they answer, in the world, or
//! in views of their own.
//!
//! Files by what they draw: `overlay` (boxes, tracks, masks and key points on images), `space`
//! (boxes, points, poses and paths in the world), `picture` (images and tensors), `signal`
//! (numbers, texts and bytes over time).

mod overlay;
mod picture;
mod signal;
mod space;

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use consumer_kit::items::{BadItems, Chains, ResultParts, legible};
use rerun::{AsComponents, RecordingStream, Rgba32};
use schema_frames::{FrameHeader, Modality, ResultType, SensorKind};
use schema_types::class::CLASSES;

use crate::images;
use crate::layout::{self, Place, ResultView, ViewKind};

/// Frames of cameras that are remembered, so that a result finds the one that it answers.
const KEPT_CAMERAS: usize = 256;

/// What the recording holds of results.
#[derive(Default)]
pub(crate) struct Results {
    chains: Chains,
    bad: BadItems,
    views: BTreeSet<ResultView>,
    cameras: VecDeque<(u64, [u64; 11], String)>,
    trails: BTreeMap<String, space::Trail>,
    flows: BTreeMap<String, signal::Flow>,
    series: BTreeMap<String, BTreeSet<String>>,
    /// Images on which boxes or tracks say what is what, so that masks need not say it again.
    labelled: BTreeSet<String>,
    /// Names of the classes that are logged at a path.
    classes: BTreeMap<String, Vec<String>>,
    /// By topic: entities that hold what its newest result says.
    drawn: BTreeMap<String, BTreeSet<String>>,
}

impl Results {
    /// Keeps where a camera stood, for results that do not name what they answer.
    pub(crate) fn see(&mut self, place: &Place, header: &FrameHeader) {
        if place.modality.sensor_kind() != SensorKind::Camera || header.intrinsics_px[0] == 0.0 {
            return;
        }
        let key = eye(&header.world_from_sensor, &header.intrinsics_px);
        let topic = place.topic();
        // The colour image of a camera goes before its others.
        let seen = (header.tick, key, topic);
        match place.modality {
            Modality::Rgb => self.cameras.push_front(seen),
            _ => self.cameras.push_back(seen),
        }
        while self.cameras.len() > KEPT_CAMERAS {
            let oldest = (0..self.cameras.len()).min_by_key(|idx| self.cameras[*idx].0);
            self.cameras.remove(oldest.unwrap_or(0));
        }
    }

    /// Views that results need beside those of the sensors.
    pub(crate) fn views(&self) -> &BTreeSet<ResultView> {
        &self.views
    }

    /// Items that could not be drawn, by topic.
    pub(crate) fn bad_items(&self) -> &BTreeMap<String, u64> {
        self.bad.by_topic()
    }

    /// Draws one result at the recording's time. `rigs` are the rigs whose vehicles are known.
    /// Returns whether the window needs another view.
    pub(crate) fn show(
        &mut self,
        rec: &RecordingStream,
        rigs: &BTreeMap<u32, String>,
        parts: &ResultParts<'_>,
    ) -> anyhow::Result<bool> {
        let frame = self.frame_behind(parts).and_then(|it| Place::new(&it));
        let n_views = self.views.len();
        let canvas = Canvas {
            rec,
            parts,
            camera: frame
                .as_ref()
                .filter(|place| place.modality.sensor_kind() == SensorKind::Camera)
                .cloned(),
            rig: frame
                .map(|place| place.rig)
                .filter(|rig| rigs.values().any(|known| known == rig)),
        };
        match parts.kind {
            ResultType::Boxes2d => self.boxes2d(&canvas)?,
            ResultType::Tracks => self.tracks(&canvas)?,
            ResultType::Masks => self.masks(&canvas)?,
            ResultType::Keypoints => self.keypoints(&canvas)?,
            ResultType::Boxes3d => self.boxes3d(&canvas)?,
            ResultType::Points => self.points(&canvas)?,
            ResultType::Pose | ResultType::Odometry => self.poses(&canvas)?,
            ResultType::Path => self.path(&canvas)?,
            ResultType::Image
            | ResultType::Flow
            | ResultType::Depth
            | ResultType::Semantic
            | ResultType::Instance => self.picture(&canvas)?,
            ResultType::Tensor => self.tensor(&canvas)?,
            ResultType::Control => self.controls(&canvas)?,
            ResultType::Scalars => self.scalars(&canvas)?,
            ResultType::Text => self.text(&canvas)?,
            ResultType::Json => self.json(&canvas)?,
            ResultType::Bytes => self.bytes(&canvas)?,
        }
        Ok(self.views.len() != n_views)
    }

    /// Removes what the newest result of a topic drew, because its writer has ended.
    pub(crate) fn clear(&mut self, rec: &RecordingStream, topic: &str) -> anyhow::Result<()> {
        for path in self.drawn.remove(topic).unwrap_or_default() {
            rec.log(path, &rerun::Clear::flat())?;
        }
        Ok(())
    }

    /// Forgets the views of topics that are no longer shown. Returns whether there were any.
    pub(crate) fn keep(&mut self, is_visible: impl Fn(&str) -> bool) -> bool {
        let n_views = self.views.len();
        self.views.retain(|view| is_visible(&view.topic));
        self.views.len() != n_views
    }

    /// Topic of the frame that a result answers: by its inputs, else by the pose and the lens of
    /// the camera that it carries.
    fn frame_behind(&mut self, parts: &ResultParts<'_>) -> Option<String> {
        if let Some(topic) = self.chains.frame_behind(parts) {
            return Some(topic.to_owned());
        }
        let header = parts.header;
        let key = eye(&header.world_from_space, &header.intrinsics_px);
        let same = |(tick, seen, _): &&(u64, [u64; 11], String)| {
            *tick == header.tick && *seen == key && header.intrinsics_px[0] > 0.0
        };
        let (_, _, topic) = self.cameras.iter().find(same)?;
        self.chains.remember(parts.topic, topic);
        Some(topic.clone())
    }

    fn need(&mut self, parts: &ResultParts<'_>, kind: ViewKind) {
        let topic = parts.topic.to_owned();
        self.views.insert(ResultView { topic, kind });
    }

    /// Where image coordinates are drawn: on the camera's image, or in a view of the topic's own.
    fn on_image(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<String> {
        let path = match &canvas.camera {
            Some(camera) => format!("{}/{}", camera.frame_path(), canvas.parts.topic),
            None => {
                self.need(canvas.parts, ViewKind::Picture);
                canvas.own_path()
            }
        };
        self.name_classes(canvas, &path)?;
        Ok(path)
    }

    /// Logs the names of a topic's own classes at the entity that uses them.
    fn name_classes(&mut self, canvas: &Canvas<'_>, path: &str) -> anyhow::Result<()> {
        let names = &canvas.parts.about.classes;
        if names.is_empty() || self.classes.get(path) == Some(names) {
            return Ok(());
        }
        let described = names.iter().take(u16::MAX as usize).enumerate();
        let classes = described.map(|(number, name)| {
            let [r, g, b] = images::id_colour(number as u32 + 1);
            let colour = Rgba32::from_rgb(r, g, b);
            rerun::ClassDescription::from((number as u16, name.as_str(), colour))
        });
        canvas
            .rec
            .log_static(path, &rerun::AnnotationContext::new(classes))?;
        self.classes.insert(path.to_owned(), names.clone());
        Ok(())
    }

    /// Logs a list. An empty one is logged only where there was something before.
    fn draw(
        &mut self,
        canvas: &Canvas<'_>,
        path: &str,
        is_empty: bool,
        list: &impl AsComponents,
    ) -> anyhow::Result<()> {
        let drawn = self.drawn.entry(canvas.parts.topic.to_owned()).or_default();
        if is_empty && !drawn.contains(path) {
            return Ok(());
        }
        drawn.insert(path.to_owned());
        Ok(canvas.rec.log(path, list)?)
    }
}

/// What one result is drawn with.
struct Canvas<'a> {
    rec: &'a RecordingStream,
    parts: &'a ResultParts<'a>,
    /// The camera that it answers.
    camera: Option<Place>,
    /// The rig of the sensor that it answers.
    rig: Option<String>,
}

impl Canvas<'_> {
    /// Entity of a topic with a view of its own.
    fn own_path(&self) -> String {
        format!("{}/{}", layout::RESULTS, self.parts.topic)
    }

    /// Entity of the image that it answers.
    fn image(&self) -> Option<String> {
        self.camera.as_ref().map(Place::frame_path)
    }

    fn log(&self, path: &str, what: &impl AsComponents) -> anyhow::Result<()> {
        Ok(self.rec.log(path, what)?)
    }

    /// Colour of an object: of its number if it has one and `by_id`, else of its class.
    fn colour(&self, class: u32, id: u32, by_id: bool) -> Rgba32 {
        let [r, g, b] = legible(if by_id && id != 0 {
            images::id_colour(id)
        } else if !self.parts.about.classes.is_empty() {
            images::id_colour(class.saturating_add(1))
        } else {
            CLASSES
                .get(class as usize)
                .map_or_else(|| images::id_colour(class), |info| info.rgb)
        });
        Rgba32::from_rgb(r, g, b)
    }
}

/// Class as rerun numbers it; a number that does not fit has no name either.
fn class_id(class: u32) -> u16 {
    u16::try_from(class).unwrap_or(u16::MAX)
}

/// Pose and lens of a camera, bit by bit.
fn eye(pose: &schema_types::Pose, intrinsics_px: &[f64; 4]) -> [u64; 11] {
    let numbers = pose.translation_m.iter().chain(&pose.rotation_xyzw);
    let mut bits = numbers.chain(intrinsics_px).map(|x| x.to_bits());
    std::array::from_fn(|_| bits.next().unwrap_or(0))
}
