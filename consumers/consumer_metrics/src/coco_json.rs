//! Truths and results in the JSON of COCO's tools: `annotations` of a ground-truth file, and
//! `results.json`, which is a list of results.

use serde::Serialize;

use crate::average_precision::{BoxPx, Detection, RunMask, Truth};

/// One element of `results.json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CocoResult {
    /// Number of the image.
    pub image_id: u64,
    /// Its class.
    pub category_id: u32,
    /// Left, top, width and height, pixels. Only of boxes: COCO's tools take results for boxes as
    /// soon as they have this key.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bbox: Option<[f64; 4]>,
    /// Confidence.
    pub score: f64,
    /// Its mask.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub segmentation: Option<CocoRuns>,
}

/// Area of truths that do not count and are no crowd. COCO's own tools do not read `ignore`, but leave
/// out what has an area beyond all of their ranges, so that they give the figures of
/// [`crate::average_precision`].
pub const IGNORED_AREA_PX: f64 = 2e10;

/// One element of `annotations` in a ground-truth file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CocoTruth {
    /// Number of the annotation, from 1: COCO's tools take 0 for "not found".
    pub id: u64,
    /// Number of the image.
    pub image_id: u64,
    /// Its class.
    pub category_id: u32,
    /// Left, top, width and height, pixels.
    pub bbox: [f64; 4],
    /// Area, square pixels; [`IGNORED_AREA_PX`] of what does not count.
    pub area: f64,
    /// 1 for a region with many objects that are not told apart.
    pub iscrowd: u8,
    /// 1 for what does not count.
    pub ignore: u8,
    /// Its mask.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub segmentation: Option<CocoRuns>,
}

/// A mask.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct CocoRuns {
    /// Height and width of the image, pixels.
    pub size: [u32; 2],
    /// Its runs in COCO's text form.
    pub counts: String,
}

impl CocoRuns {
    /// A mask, with the function that writes runs as text.
    pub fn new(mask: &RunMask, runs_text: impl Fn(&[u32]) -> String) -> CocoRuns {
        let [width, height] = mask.size();
        CocoRuns {
            size: [height, width],
            counts: runs_text(&mask.runs()),
        }
    }
}

impl CocoResult {
    /// A detected box.
    pub fn of_box(image_id: u64, detection: &Detection<BoxPx>) -> CocoResult {
        CocoResult {
            image_id,
            category_id: detection.class,
            bbox: Some(detection.region.xywh()),
            score: detection.score,
            segmentation: None,
        }
    }

    /// A detected mask, with the function that writes runs as text.
    pub fn of_mask(
        image_id: u64,
        detection: &Detection<RunMask>,
        runs_text: impl Fn(&[u32]) -> String,
    ) -> CocoResult {
        CocoResult {
            image_id,
            category_id: detection.class,
            bbox: None,
            score: detection.score,
            segmentation: Some(CocoRuns::new(&detection.region, runs_text)),
        }
    }
}

impl CocoTruth {
    /// A true box.
    pub fn of_box(id: u64, image_id: u64, truth: &Truth<BoxPx>) -> CocoTruth {
        let bbox = truth.region.xywh();
        CocoTruth::new(id, image_id, truth, bbox, None)
    }

    /// A true mask, with the function that writes runs as text.
    pub fn of_mask(
        id: u64,
        image_id: u64,
        truth: &Truth<RunMask>,
        runs_text: impl Fn(&[u32]) -> String,
    ) -> CocoTruth {
        let [x0, y0, x1, y1] = truth.region.bounds().unwrap_or_default().map(f64::from);
        let runs = CocoRuns::new(&truth.region, runs_text);
        CocoTruth::new(id, image_id, truth, [x0, y0, x1 - x0, y1 - y0], Some(runs))
    }

    fn new<R>(
        id: u64,
        image_id: u64,
        truth: &Truth<R>,
        bbox: [f64; 4],
        segmentation: Option<CocoRuns>,
    ) -> CocoTruth {
        CocoTruth {
            id,
            image_id,
            category_id: truth.class,
            bbox,
            area: if truth.ignore && !truth.crowd {
                IGNORED_AREA_PX
            } else {
                truth.area_px
            },
            iscrowd: u8::from(truth.crowd),
            ignore: u8::from(truth.ignore),
            segmentation,
        }
    }
}
