//! Boxes in an image, against visible boxes.

use consumer_metrics::average_precision::BoxPx;
use schema_frames::Box2d;

use super::detect::{Detect, Part, Shape, records};
use crate::evidence::coco_keep::Kept;
use crate::evidence::moment::{Moment, Object, View};
use crate::picture::Picture;
use crate::tasks::Reading;
use crate::tasks::Unreadable;

/// Places are boxes.
pub struct Boxes;

/// The measure.
pub type Boxes2d = Detect<Boxes>;

impl Shape for Boxes {
    type Region = BoxPx;

    fn of_object(_: &View, object: &Object) -> Option<BoxPx> {
        let [x0, y0, x1, y1] = object.bounds.map(f64::from);
        Some(BoxPx::new([x0, y0], [x1, y1]))
    }

    fn read(reading: &Reading<'_>) -> Result<Vec<(u32, f32, BoxPx)>, Unreadable> {
        let found = records::<Box2d>(reading.body).into_iter();
        let boxed = found.map(|found| {
            let region = BoxPx::new(found.min_px.map(f64::from), found.max_px.map(f64::from));
            (found.class, found.score, region)
        });
        Ok(boxed.collect())
    }

    fn corners(region: &BoxPx) -> [[f64; 2]; 2] {
        [region.min_px, region.max_px]
    }

    fn keep(kept: &mut Kept, moment: &Moment<'_>, part: &Part<BoxPx>) {
        kept.add_boxes(moment, &part.truths, &part.detections);
    }

    fn draw(picture: &mut Picture, region: &BoxPx, _: usize, counts: bool, label: &str) {
        picture.rectangle(region.min_px, region.max_px, counts, label);
    }
}
