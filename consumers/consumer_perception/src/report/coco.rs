//! COCO's files: the truth as an annotation file, the results of each program as `results.json`, for
//! pycocotools and everything that reads its form.

use consumer_metrics::coco_json::{CocoResult, CocoTruth};
use consumer_report::{Folder, FolderError};
use serde::Serialize;

/// The files of one task over all scenarios.
#[derive(Clone, Debug, Default)]
pub struct CocoFiles {
    /// The task: names the folder.
    pub task: String,
    /// Classes.
    pub categories: Vec<Category>,
    /// Images with truth, also those without an object.
    pub images: Vec<Image>,
    /// The truth; what the task's rules leave out is `iscrowd` or `ignore`.
    pub truths: Vec<CocoTruth>,
    /// Results by run.
    pub results: Vec<ProgramResults>,
}

/// A class.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Category {
    /// Its number, from 1.
    pub id: u32,
    /// Its name.
    pub name: String,
}

/// An image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Image {
    /// Its number, unique over all scenarios.
    pub id: u64,
    /// What it would be called: `SCENARIO/TOPIC/SEQ`; the images themselves stay in the recording.
    pub file_name: String,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Its scenario.
    pub scenario: String,
    /// Simulated time since the scenario began, seconds.
    pub secs: f64,
}

/// What one run detected, in its results' own times: each result under the image that it answers.
#[derive(Clone, Debug, Default)]
pub struct ProgramResults {
    /// [`super::Run::file_stem`].
    pub run: String,
    /// Detections.
    pub detections: Vec<CocoResult>,
}

/// Writes `coco/TASK/truth.json` and `coco/TASK/RUN/results.json`.
///
/// # Errors
///
/// A file cannot be written.
pub fn write(files: &CocoFiles, folder: &mut Folder) -> Result<(), FolderError> {
    let task = &files.task;
    let whole = Truth {
        info: Info {
            description: format!("Truth of the task {task}"),
            version: env!("CARGO_PKG_VERSION"),
        },
        licenses: [],
        images: &files.images,
        annotations: &files.truths,
        categories: &files.categories,
    };
    folder.json_line(&format!("coco/{task}/truth.json"), &whole)?;
    for results in &files.results {
        let name = format!("coco/{task}/{}/results.json", results.run);
        folder.json_line(&name, &results.detections)?;
    }
    Ok(())
}

#[derive(Serialize)]
struct Truth<'a> {
    info: Info,
    licenses: [(); 0],
    images: &'a [Image],
    annotations: &'a [CocoTruth],
    categories: &'a [Category],
}

#[derive(Serialize)]
struct Info {
    description: String,
    version: &'static str,
}
