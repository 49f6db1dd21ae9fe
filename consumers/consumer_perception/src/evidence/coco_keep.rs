//! What COCO's files need of the frames that were scored.

use std::collections::HashSet;
use std::sync::Arc;

use consumer_metrics::average_precision::{BoxPx, Detection, RunMask, Truth};
use consumer_metrics::coco_json::{CocoResult, CocoTruth};
use consumer_truth::masks::runs_text;
use consumer_truth::scenario::Scenario;

use crate::evidence::moment::Moment;
use crate::report::coco::{Category, CocoFiles, Image, ProgramResults};

/// Most images of one task and run; later ones are left out of COCO's files.
pub const MAX_IMAGES: usize = 20_000;

/// Room for the ticks of one scenario in the numbers of images.
const IDS_PER_SCENARIO: u64 = 100_000_000;

/// Frames of one task and run.
#[derive(Clone, Debug, Default)]
pub struct Kept {
    task: String,
    truth: String,
    input: Arc<str>,
    scenario: String,
    scenario_index: u64,
    begin_nanos: u64,
    categories: Vec<Category>,
    images: Vec<Image>,
    truths: Vec<CocoTruth>,
    results: Vec<CocoResult>,
}

impl Kept {
    /// A scenario begins, of a task with these input, truth camera and classes.
    pub fn begin<'a>(
        &mut self,
        scenario: &Scenario,
        [task, input, truth]: [&str; 3],
        classes: impl Iterator<Item = (u32, &'a str)>,
    ) {
        (self.task, self.truth) = (task.into(), truth.into());
        self.input = input.into();
        self.scenario.clone_from(&scenario.name);
        self.scenario_index = u64::from(scenario.index);
        self.begin_nanos = scenario.start_nanos;
        let category = |(id, name): (u32, &str)| Category {
            id,
            name: name.into(),
        };
        self.categories = classes.map(category).collect();
    }

    fn image(&mut self, moment: &Moment<'_>) -> Option<u64> {
        let view = moment.view(&self.truth)?;
        if self.images.len() >= MAX_IMAGES {
            return None;
        }
        let tick = moment.set.tick;
        let id = self.scenario_index * IDS_PER_SCENARIO + tick;
        self.images.push(Image {
            id,
            file_name: format!("{}/{}/{tick}", self.scenario, self.input),
            width: view.camera.width,
            height: view.camera.height,
            scenario: self.scenario.clone(),
            secs: moment.sim_nanos().saturating_sub(self.begin_nanos) as f64 / 1e9,
        });
        Some(id)
    }

    /// Keeps a frame with boxes.
    pub fn add_boxes(
        &mut self,
        moment: &Moment<'_>,
        truths: &[Truth<BoxPx>],
        found: &[Detection<BoxPx>],
    ) {
        let Some(image) = self.image(moment) else {
            return;
        };
        for truth in truths {
            // Numbers follow when runs are joined.
            self.truths.push(CocoTruth::of_box(0, image, truth));
        }
        self.results
            .extend(found.iter().map(|found| CocoResult::of_box(image, found)));
    }

    /// Keeps a frame with masks.
    pub fn add_masks(
        &mut self,
        moment: &Moment<'_>,
        truths: &[Truth<RunMask>],
        found: &[Detection<RunMask>],
    ) {
        let Some(image) = self.image(moment) else {
            return;
        };
        for truth in truths {
            self.truths
                .push(CocoTruth::of_mask(0, image, truth, runs_text));
        }
        self.results.extend(
            found
                .iter()
                .map(|found| CocoResult::of_mask(image, found, runs_text)),
        );
    }

    /// Puts what a run kept beside that of others of the same task.
    pub fn join(self, run: String, files: &mut Vec<CocoFiles>) {
        if self.images.is_empty() {
            return;
        }
        let at = files.iter().position(|files| files.task == self.task);
        let at = at.unwrap_or_else(|| {
            files.push(CocoFiles {
                task: self.task.clone(),
                categories: self.categories.clone(),
                ..CocoFiles::default()
            });
            files.len() - 1
        });
        let files = &mut files[at];
        let there: HashSet<u64> = files.images.iter().map(|image| image.id).collect();
        let is_new = |image: &u64| !there.contains(image);
        for mut truth in self.truths {
            if is_new(&truth.image_id) {
                truth.id = files.truths.len() as u64 + 1;
                files.truths.push(truth);
            }
        }
        let images = self.images.into_iter();
        files
            .images
            .extend(images.filter(|image| is_new(&image.id)));
        files.results.push(ProgramResults {
            run,
            detections: self.results,
        });
    }
}
