//! Results of users' programs in the recording: over the image that they answer, in the world, or
//! in views of their own.
//!
//! `state` is what the viewer remembers of results, `canvas` what one of them is drawn with. The
//! other files by what they draw: `overlay` (boxes, tracks, masks and key points on images), `space`
//! (boxes, points, poses and paths in the world), `picture` (images and tensors), `signal`
//! (numbers, texts and bytes over time).

mod canvas;
mod overlay;
mod picture;
mod signal;
mod space;
mod state;

use std::collections::{BTreeMap, BTreeSet};

use consumer_kit::items::ResultParts;
use rerun::RecordingStream;
use schema_frames::{FrameHeader, Modality, ResultType, SensorKind};

use crate::layout::{Place, ResultView};
use crate::pictures::Pictures;
use crate::rerun;
use canvas::Canvas;
pub(crate) use state::Results;

/// Frames of cameras that are remembered, so that a result finds the one that it answers.
const KEPT_CAMERAS: usize = 256;

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
        pictures: &mut Pictures,
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
            ResultType::Masks => self.masks(&canvas, pictures)?,
            ResultType::Keypoints => self.keypoints(&canvas)?,
            ResultType::Boxes3d => self.boxes3d(&canvas)?,
            ResultType::Points => self.points(&canvas)?,
            ResultType::Pose | ResultType::Odometry => self.poses(&canvas)?,
            ResultType::Path => self.path(&canvas)?,
            ResultType::Image
            | ResultType::Flow
            | ResultType::Depth
            | ResultType::Semantic
            | ResultType::Instance => self.picture(&canvas, pictures)?,
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
}

/// Pose and lens of a camera, bit by bit.
fn eye(pose: &schema_types::Pose, intrinsics_px: &[f64; 4]) -> [u64; 11] {
    let numbers = pose.translation_m.iter().chain(&pose.rotation_xyzw);
    let mut bits = numbers.chain(intrinsics_px).map(|x| x.to_bits());
    std::array::from_fn(|_| bits.next().unwrap_or(0))
}
