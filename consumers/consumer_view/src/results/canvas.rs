//! What one result is drawn with: the recording, the camera behind it, its colours.

use consumer_forms::palette;
use consumer_kit::items::ResultParts;
use rerun::{AsComponents, RecordingStream, Rgba32};

use crate::layout::{self, Place};
use crate::rerun;

/// What one result is drawn with.
pub(super) struct Canvas<'a> {
    pub(super) rec: &'a RecordingStream,
    pub(super) parts: &'a ResultParts<'a>,
    /// The camera that it answers.
    pub(super) camera: Option<Place>,
    /// The rig of the sensor that it answers.
    pub(super) rig: Option<String>,
}

impl Canvas<'_> {
    /// Entity of a topic with a view of its own.
    pub(super) fn own_path(&self) -> String {
        format!("{}/{}", layout::RESULTS, self.parts.topic)
    }

    /// Entity of the image that it answers.
    pub(super) fn image(&self) -> Option<String> {
        self.camera.as_ref().map(Place::frame_path)
    }

    pub(super) fn log(&self, path: &str, what: &impl AsComponents) -> anyhow::Result<()> {
        Ok(self.rec.log(path, what)?)
    }

    /// Colour of an object: of its number if it has one and `by_id`, else of its class.
    pub(super) fn colour(&self, class: u32, id: u32, by_id: bool) -> Rgba32 {
        let [r, g, b] = match by_id && id != 0 {
            true => palette::object(id),
            false => palette::class_of(self.parts.about, class),
        };
        Rgba32::from_rgb(r, g, b)
    }
}

/// Class as rerun numbers it; a number that does not fit has no name either.
pub(super) fn class_id(class: u32) -> u16 {
    u16::try_from(class).unwrap_or(u16::MAX)
}
