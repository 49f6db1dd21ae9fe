//! What the viewer remembers of results, and how they are put into its recording.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Instant;

use consumer_forms::palette;
use consumer_kit::items::{BadItems, Chains, ResultParts};
use rerun::{AsComponents, Rgba32};

use super::canvas::Canvas;
use crate::layout::{ResultView, ViewKind};
use crate::rerun;

/// What the recording holds of results.
#[derive(Default)]
pub(crate) struct Results {
    pub(super) chains: Chains,
    pub(super) bad: BadItems,
    pub(super) views: BTreeSet<ResultView>,
    pub(super) cameras: VecDeque<(u64, [u64; 11], String)>,
    pub(super) trails: BTreeMap<String, Trail>,
    pub(super) flows: BTreeMap<String, Flow>,
    pub(super) series: BTreeMap<String, BTreeSet<String>>,
    /// Images on which boxes or tracks say what is what, so that masks need not say it again.
    pub(super) labelled: BTreeSet<String>,
    /// Names of the classes that are logged at a path.
    pub(super) classes: BTreeMap<String, Vec<String>>,
    /// By topic: entities that hold what its newest result says.
    pub(super) drawn: BTreeMap<String, BTreeSet<String>>,
}

/// Where a pose was.
#[derive(Default)]
pub(super) struct Trail {
    pub(super) writer_epoch: u64,
    pub(super) points: Vec<[f64; 3]>,
}

/// What came on a topic of bytes since its last line.
pub(super) struct Flow {
    pub(super) since: Instant,
    pub(super) n: u64,
    pub(super) bytes: u64,
}

impl Results {
    pub(super) fn need(&mut self, parts: &ResultParts<'_>, kind: ViewKind) {
        let topic = parts.topic.to_owned();
        self.views.insert(ResultView { topic, kind });
    }

    /// Where image coordinates are drawn: on the camera's image, or in a view of the topic's own.
    pub(super) fn on_image(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<String> {
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
    pub(super) fn name_classes(&mut self, canvas: &Canvas<'_>, path: &str) -> anyhow::Result<()> {
        let names = &canvas.parts.about.classes;
        if names.is_empty() || self.classes.get(path) == Some(names) {
            return Ok(());
        }
        let described = names.iter().take(u16::MAX as usize).enumerate();
        let classes = described.map(|(number, name)| {
            let [r, g, b] = palette::class_of(canvas.parts.about, number as u32);
            let colour = Rgba32::from_rgb(r, g, b);
            rerun::ClassDescription::from((number as u16, name.as_str(), colour))
        });
        canvas
            .rec
            .log_static(path, &rerun::AnnotationContext::new(classes))?;
        self.classes.insert(path.to_owned(), names.clone());
        Ok(())
    }

    /// Remembers that an entity holds what the newest result of the topic says.
    pub(super) fn note_drawn(&mut self, canvas: &Canvas<'_>, path: &str) {
        let drawn = self.drawn.entry(canvas.parts.topic.to_owned()).or_default();
        drawn.insert(path.to_owned());
    }

    /// Logs a list. An empty one is logged only where there was something before.
    pub(super) fn draw(
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
