//! Masks of objects: COCO's average precision against the pixels that show them.

use std::collections::BTreeMap;

use consumer_metrics::average_precision::{Collector, Detection, Pairs, RunMask, Truth};
use schema_frames::MaskRecord;

use super::boxes2d::{Part, Place, bad, fate, object_strata, place_of};
use super::classes::{Target, name_of, program_target, targets};
use super::{Bad, Context, Drawn, Headline, Measure, Reading, Spec};
use crate::coco_keep::Kept;
use crate::moment::{Moment, View};
use crate::picture::Picture;

/// The measure.
pub struct Masks {
    spec: Spec,
    targets: Vec<Target>,
    kept: Kept,
}

impl Masks {
    /// For a task.
    ///
    /// # Errors
    /// A sentence if a class cannot be asked for.
    pub fn new(spec: &Spec) -> Result<Masks, String> {
        Ok(Masks {
            spec: spec.clone(),
            targets: targets(&spec.classes)?,
            kept: Kept::default(),
        })
    }

    fn truths(&self, view: &View) -> (Vec<Truth<RunMask>>, Vec<Place>) {
        let (width, height) = (view.camera.width, view.camera.height);
        let found = view.objects.iter().filter_map(|object| {
            let (number, ignored) = fate(&self.spec, &self.targets, object)?;
            let [x0, y0, x1, y1] = object.bounds;
            let shows = |column: u32, row: u32| {
                let at = row as usize * width as usize + column as usize;
                (x0..x1).contains(&column)
                    && (y0..y1).contains(&row)
                    && view.instance[at] == object.id
                    && view
                        .semantic
                        .get(at)
                        .is_none_or(|class| *class == object.class)
            };
            let region = RunMask::from_pixels(width, height, shows).ok()?;
            let truth = match ignored {
                true => Truth::ignored(number, region),
                false => Truth::new(number, region),
            };
            Some((truth, place_of(object)))
        });
        found.unzip()
    }
}

/// Masks of a result, each with its record.
///
/// # Errors
/// A sentence if a mask's runs lie outside of the body, or do not fill the image.
pub fn masks(reading: &Reading<'_>) -> Result<Vec<(MaskRecord, RunMask)>, String> {
    let header = &reading.result.header;
    let split = header.n_items as usize * size_of::<MaskRecord>();
    let (list, tail) = reading.body.split_at(split.min(reading.body.len()));
    let runs: Vec<u32> = super::boxes2d::records(tail);
    let records: Vec<MaskRecord> = super::boxes2d::records(list);
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
        Ok((record, mask))
    };
    records.into_iter().map(mask).collect()
}

impl Measure for Masks {
    type Estimate = Vec<Detection<RunMask>>;
    type Part = Part<RunMask>;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "AP",
            unit: "",
            higher_is_better: true,
        }
    }

    fn begin(&mut self, context: &Context<'_>) -> anyhow::Result<()> {
        self.kept.begin(context, &self.spec, &self.targets);
        Ok(())
    }

    fn empty(&self) -> Collector {
        let numbers: Vec<u32> = self.targets.iter().map(|target| target.number).collect();
        Collector::for_classes(&numbers)
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Self::Estimate, String> {
        let found = masks(reading)?.into_iter();
        Ok(found
            .filter_map(|(record, mask)| {
                let number = program_target(&self.targets, reading.about, record.class)?;
                Some(Detection::new(number, f64::from(record.score), mask))
            })
            .collect())
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Self::Estimate>) -> Option<Self::Part> {
        let view = moment.view(&self.spec.truth)?;
        let (truths, of_truths) = self.truths(view);
        let size = [view.camera.width, view.camera.height];
        // Masks of images of another size overlap nothing; as such they are false alarms.
        let detections: Vec<Detection<RunMask>> = estimate.map_or_else(Vec::new, |found| {
            let fits = |found: &&Detection<RunMask>| found.region.size() == size;
            found.iter().filter(fits).cloned().collect()
        });
        let of_detections = detections.iter().map(|found| {
            let [x0, y0, x1, y1] = found.region.bounds().unwrap_or_default().map(f64::from);
            Place {
                distance_m: view.median_depth_m([x0, y0], [x1, y1]),
                occlusion: None,
            }
        });
        Some(Part {
            pairs: Pairs::new(&truths, &detections),
            of_detections: of_detections.collect(),
            truths,
            detections,
            of_truths,
        })
    }

    fn add(&self, total: &mut Collector, part: &Self::Part) {
        total.add_pairs(&part.pairs);
    }

    fn merge(&self, total: &mut Collector, other: &Collector) {
        total.merge(other);
    }

    fn named(&self, total: &Collector) -> BTreeMap<String, f64> {
        let scores = total.scores();
        let mut named = scores.named();
        named.extend(scores.named_classes(name_of));
        named
    }

    fn counts(&self, total: &Collector) -> (u64, u64) {
        let scores = total.scores();
        let of = scores.classes.values();
        of.fold((0, 0), |(n, ignored), class| {
            (n + class.n_truths, ignored + class.n_ignored)
        })
    }

    fn strata(&self) -> Vec<(&'static str, &'static str)> {
        object_strata()
    }

    fn add_stratum(&self, total: &mut Collector, part: &Self::Part, stratum: usize) {
        total.add_part(
            &part.pairs,
            |at| !part.of_truths[at].is_in(stratum),
            |at| part.of_detections[at].is_elsewhere(stratum),
        );
    }

    fn bad(&self, part: &Self::Part) -> Option<Bad> {
        bad(part)
    }

    fn keep(&mut self, moment: &Moment<'_>, part: &Self::Part) {
        self.kept.add_masks(moment, part);
    }

    fn draw(&self, picture: &mut Picture, moment: &Moment<'_>, what: Drawn<'_, Self::Estimate>) {
        match what {
            Drawn::Truth => {
                let view = moment.view(&self.spec.truth);
                let truths = view.map(|view| self.truths(view).0).unwrap_or_default();
                for (at, truth) in truths.iter().enumerate() {
                    picture.mask(&truth.region, at, !truth.ignore);
                }
            }
            Drawn::Result(found) => {
                for (at, found) in found.iter().enumerate() {
                    picture.mask(&found.region, at, true);
                }
            }
        }
    }

    fn coco(&mut self) -> Option<Kept> {
        Some(std::mem::take(&mut self.kept))
    }
}
