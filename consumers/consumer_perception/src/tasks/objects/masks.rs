//! Masks of objects, against the pixels that show them.

use consumer_metrics::average_precision::RunMask;
use schema_frames::MaskRecord;

use super::detect::{Detect, Part, Shape, records};
use crate::evidence::coco_keep::Kept;
use crate::evidence::moment::{Moment, Object, View};
use crate::picture::Picture;
use crate::tasks::Reading;
use crate::tasks::Unreadable;

/// Places are masks.
pub struct OfPixels;

/// The measure.
pub type Masks = Detect<OfPixels>;

impl Shape for OfPixels {
    type Region = RunMask;

    fn of_object(view: &View, object: &Object) -> Option<RunMask> {
        let (width, height) = (view.camera.width, view.camera.height);
        let shows = |column: u32, row: u32| {
            let at = row as usize * width as usize + column as usize;
            let class = view.semantic.get(at);
            view.instance[at] == object.id && class.is_none_or(|class| *class == object.class)
        };
        RunMask::from_part(width, height, object.bounds, shows).ok()
    }

    /// Masks of images of another size overlap nothing, so they are false alarms.
    fn read(reading: &Reading<'_>) -> Result<Vec<(u32, f32, RunMask)>, Unreadable> {
        let header = &reading.result.header;
        let split = header.n_items as usize * size_of::<MaskRecord>();
        let (list, tail) = reading.body.split_at(split.min(reading.body.len()));
        let runs: Vec<u32> = records(tail);
        let mask = |record: MaskRecord| {
            let first = record.first_run as usize;
            let of = first.checked_add(record.n_runs as usize);
            let own = of.and_then(|behind| runs.get(first..behind));
            let own = own.ok_or_else(|| {
                format!(
                    "has a mask with runs {first} to {}, but only {} runs",
                    first as u64 + u64::from(record.n_runs),
                    runs.len()
                )
            })?;
            let mask = RunMask::from_runs(header.width, header.height, own)
                .map_err(|error| format!("has a mask that cannot be read: {error}"))?;
            Ok((record.class, record.score, mask))
        };
        records::<MaskRecord>(list).into_iter().map(mask).collect()
    }

    fn corners(region: &RunMask) -> [[f64; 2]; 2] {
        let [x0, y0, x1, y1] = region.bounds().unwrap_or_default().map(f64::from);
        [[x0, y0], [x1, y1]]
    }

    fn keep(kept: &mut Kept, moment: &Moment<'_>, part: &Part<RunMask>) {
        kept.add_masks(moment, &part.truths, &part.detections);
    }

    fn draw(picture: &mut Picture, region: &RunMask, n: usize, counts: bool, _: &str) {
        picture.mask(region, n, counts);
    }
}
