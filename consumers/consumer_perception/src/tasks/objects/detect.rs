//! Objects in an image, as boxes or masks: COCO's average precision against what exact images show.

use bytemuck::AnyBitPattern;
use consumer_metrics::average_precision::{Collector, Detection, Pairs, Region, Truth};

use crate::evidence::coco_keep::Kept;
use crate::evidence::ignore::Shown;
use crate::evidence::moment::{Moment, Object, View};
use crate::picture::Picture;
use crate::suite::SuiteFault;
use crate::tasks::Unreadable;
use crate::tasks::classes::{RIDER, Target, name_of, program_target, target_of, targets};
use crate::tasks::{Bad, Context, Drawn, Headline, Measure, Reading, Spec};

/// Distances of strata, metres.
pub const DISTANCES_M: [(f64, f64, &str); 5] = [
    (0.0, 10.0, "0-10"),
    (10.0, 20.0, "10-20"),
    (20.0, 40.0, "20-40"),
    (40.0, 80.0, "40-80"),
    (80.0, f64::INFINITY, "80-"),
];

/// Occlusions of strata: KITTI's levels as `consumer_sets` divides them.
pub const OCCLUSIONS: [(f64, f64, &str); 3] = [
    (0.0, 0.1, "0-0.1"),
    (0.1, 0.5, "0.1-0.5"),
    (0.5, 1.01, "0.5-1"),
];

/// The strata of objects, distances first.
fn object_strata() -> Vec<(&'static str, &'static str)> {
    let distances = DISTANCES_M.map(|(_, _, part)| ("distance_m", part));
    let occlusions = OCCLUSIONS.map(|(_, _, part)| ("occlusion", part));
    distances.into_iter().chain(occlusions).collect()
}

/// A truth's or a detection's place among the strata; `None` where it is not known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Distance from the camera, metres.
    pub distance_m: Option<f64>,
    /// Occlusion, 0..=1.
    pub occlusion: Option<f64>,
}

impl Place {
    /// Whether it lies in a stratum of [`object_strata`]. What is not known lies in none.
    pub fn is_in(&self, stratum: usize) -> bool {
        let within = |value: Option<f64>, (low, high, _): (f64, f64, &str)| {
            value.is_some_and(|value| (low..high).contains(&value))
        };
        match stratum.checked_sub(DISTANCES_M.len()) {
            None => within(self.distance_m, DISTANCES_M[stratum]),
            Some(at) => within(self.occlusion, OCCLUSIONS[at]),
        }
    }

    /// Whether a detection without a truth is no false alarm in a stratum: its distance is known and
    /// another. Occlusions of what is not there do not exist, so there each counts, as KITTI does it.
    pub fn is_elsewhere(&self, stratum: usize) -> bool {
        stratum < DISTANCES_M.len() && self.distance_m.is_some() && !self.is_in(stratum)
    }
}

/// What a moment and a result gave, of boxes or masks.
pub struct Part<R> {
    /// Who overlaps whom.
    pub pairs: Pairs,
    /// The truths.
    pub truths: Vec<Truth<R>>,
    /// What the program found.
    pub detections: Vec<Detection<R>>,
    /// Where the truths are.
    pub of_truths: Vec<Place>,
    /// Where the detections are.
    pub of_detections: Vec<Place>,
}

/// Records behind each other in a body.
pub fn records<T: AnyBitPattern>(body: &[u8]) -> Vec<T> {
    body.chunks_exact(size_of::<T>())
        .map(bytemuck::pod_read_unaligned)
        .collect()
}

/// What a truth counts as.
pub fn fate(spec: &Spec, targets: &[Target], object: &Object) -> Option<(u32, bool)> {
    let shown = Shown {
        pixels: object.n_pixels,
        height_px: f64::from(object.bounds[3] - object.bounds[1]),
        of_body: object
            .of_body
            .map(|(seen, truncation)| (seen.visible_fraction, truncation)),
        distance_m: object.distance_m,
    };
    if object.class == RIDER {
        return Some((target_of(targets, 12)?, true));
    }
    let number = target_of(targets, object.class)?;
    Some((number, spec.rules.ignores(&shown)))
}

/// Where a truth is.
fn place_of(object: &Object) -> Place {
    Place {
        distance_m: object.distance_m,
        occlusion: object.of_body.map(|(seen, _)| seen.occlusion),
    }
}

/// What is wrong with a matching, in words: objects that were missed, and false alarms that the
/// program was sure of.
fn bad<R>(part: &Part<R>) -> Option<Bad> {
    let matches = part.pairs.matches(0.5);
    let sure = |at: &&usize| part.detections[**at].score >= 0.5;
    let n_false = matches.unmatched.iter().filter(sure).count();
    let n_missed = matches.missed.len();
    let area = |at: &usize| part.truths[*at].area_px.sqrt();
    let weight: f64 = matches.missed.iter().map(area).sum();
    let false_weight: f64 = 20.0 * n_false as f64;
    (n_missed + n_false > 0).then(|| Bad {
        badness: weight + false_weight,
        why: format!(
            "{n_missed} of {} missed, {n_false} false alarms",
            n_missed + matches.pairs.len()
        ),
    })
}

/// How an object's place in the image is said.
pub trait Shape: Send + Sync + 'static {
    /// Its place.
    type Region: Region + Clone + Send + Sync;

    /// The place of an object that the image shows; `None` if it has none.
    fn of_object(view: &View, object: &Object) -> Option<Self::Region>;

    /// The objects of a result: class, score, place.
    ///
    /// # Errors
    /// A sentence if the result is not what it must be.
    fn read(reading: &Reading<'_>) -> Result<Vec<(u32, f32, Self::Region)>, Unreadable>;

    /// Corners of the rectangle round a place, pixels.
    fn corners(region: &Self::Region) -> [[f64; 2]; 2];

    /// Keeps a frame for COCO's files.
    fn keep(kept: &mut Kept, moment: &Moment<'_>, part: &Part<Self::Region>);

    /// Draws the n-th object.
    fn draw(picture: &mut Picture, region: &Self::Region, n: usize, counts: bool, label: &str);
}

/// The measure.
pub struct Detect<S: Shape> {
    spec: Spec,
    targets: Vec<Target>,
    kept: Kept,
    shape: std::marker::PhantomData<fn() -> S>,
}

impl<S: Shape> Detect<S> {
    /// For a task.
    ///
    /// # Errors
    /// A sentence if a class cannot be asked for.
    pub fn new(spec: &Spec) -> Result<Self, SuiteFault> {
        Ok(Detect {
            spec: spec.clone(),
            targets: targets(&spec.classes)?,
            kept: Kept::default(),
            shape: std::marker::PhantomData,
        })
    }

    fn truths(&self, view: &View) -> (Vec<Truth<S::Region>>, Vec<Place>) {
        let found = view.objects.iter().filter_map(|object| {
            let (number, ignored) = fate(&self.spec, &self.targets, object)?;
            let region = S::of_object(view, object)?;
            let truth = match ignored {
                true => Truth::ignored(number, region),
                false => Truth::new(number, region),
            };
            Some((truth, place_of(object)))
        });
        found.unzip()
    }
}

impl<S: Shape> Measure for Detect<S> {
    type Estimate = Vec<Detection<S::Region>>;
    type Part = Part<S::Region>;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "AP",
            unit: "",
            higher_is_better: true,
        }
    }

    fn begin(&mut self, context: &Context<'_>) -> anyhow::Result<()> {
        let classes = self.targets.iter();
        self.kept.begin(
            context.scenario,
            [&self.spec.name, &self.spec.input, &self.spec.truth],
            classes.map(|target| (target.number, target.name)),
        );
        Ok(())
    }

    fn empty(&self) -> Collector {
        let numbers: Vec<u32> = self.targets.iter().map(|target| target.number).collect();
        Collector::for_classes(&numbers)
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Self::Estimate, Unreadable> {
        let found = S::read(reading)?.into_iter();
        Ok(found
            .filter_map(|(class, score, region)| {
                let number = program_target(&self.targets, reading.about, class)?;
                Some(Detection::new(number, f64::from(score), region))
            })
            .collect())
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Self::Estimate>) -> Option<Self::Part> {
        let view = moment.view(&self.spec.truth)?;
        let (truths, of_truths) = self.truths(view);
        let detections = estimate.cloned().unwrap_or_default();
        let of_detections = detections.iter().map(|found| {
            let [min_px, max_px] = S::corners(&found.region);
            Place {
                distance_m: view.median_depth_m(min_px, max_px),
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
        S::keep(&mut self.kept, moment, part);
    }

    fn draw(&self, picture: &mut Picture, moment: &Moment<'_>, what: Drawn<'_, Self::Estimate>) {
        match what {
            Drawn::Truth => {
                let view = moment.view(&self.spec.truth);
                let truths = view.map(|view| self.truths(view).0).unwrap_or_default();
                for (n, truth) in truths.iter().enumerate() {
                    let name = name_of(truth.class);
                    let label = if truth.ignore { "" } else { &name };
                    S::draw(picture, &truth.region, n, !truth.ignore, label);
                }
            }
            Drawn::Result(found) => {
                for (n, found) in found.iter().enumerate() {
                    let label = format!("{} {:.2}", name_of(found.class), found.score);
                    S::draw(picture, &found.region, n, true, &label);
                }
            }
        }
    }

    fn coco(&mut self) -> Option<Kept> {
        Some(std::mem::take(&mut self.kept))
    }
}
