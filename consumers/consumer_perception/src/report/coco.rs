//! COCO's files: the truth as an annotation file, the results of each program as `results.json`, for
//! pycocotools and everything that reads its form.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use consumer_metrics::coco_json::{CocoResult, CocoTruth};
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

/// Writes `TASK/truth.json` and `TASK/RUN/results.json` below `folder`; says which files.
///
/// # Errors
///
/// A file cannot be written.
pub fn write(files: &CocoFiles, folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let folder = folder.join(&files.task);
    std::fs::create_dir_all(&folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let truth = folder.join("truth.json");
    let whole = Truth {
        info: Info {
            description: format!("Truth of the task {}", files.task),
            version: env!("CARGO_PKG_VERSION"),
        },
        licenses: [],
        images: &files.images,
        annotations: &files.truths,
        categories: &files.categories,
    };
    save(&truth, &whole)?;
    let mut written = vec![truth];
    for results in &files.results {
        let folder = folder.join(&results.run);
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let path = folder.join("results.json");
        save(&path, &results.detections)?;
        written.push(path);
    }
    Ok(written)
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

fn save(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    let cannot = || format!("cannot write {}", path.display());
    let file = std::fs::File::create(path).with_context(cannot)?;
    let mut file = BufWriter::new(file);
    serde_json::to_writer(&mut file, value).with_context(cannot)?;
    file.write_all(b"\n").with_context(cannot)?;
    file.flush().with_context(cannot)
}
