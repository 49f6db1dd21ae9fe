//! Objects that keep their numbers: HOTA, CLEAR MOT and identity metrics, with boxes in the image
//! compared by overlap, and boxes in space by the distance of their centres (similarity 0.5 at 2 m).

use consumer_metrics::tracking::{Collector, Frame, Settings, centre_similarity, iou_similarity};
use nalgebra::{Isometry3, Vector3};
use schema_frames::Track;

use super::boxes3d::Evidence;
use super::detect::{fate, records};
use crate::evidence::moment::Moment;
use crate::picture::Picture;
use crate::suite::SuiteFault;
use crate::tasks::Unreadable;
use crate::tasks::classes::{Target, name_of, program_target, target_of, targets};
use crate::tasks::spaces::{EgoPoses, ground_distance_m, is_finite, normalised};
use crate::tasks::{Bad, Context, Drawn, Headline, Measure, Reading, Spec};

/// Distance of two centres at which they have nothing in common, metres: half of it is nuScenes'
/// limit of 2 m.
pub const ZERO_AT_M: f64 = 4.0;

/// Farthest distance of tracks in space that counts, metres.
const FAR_M: f64 = 50.0;

/// A track that a program has.
#[derive(Clone, Debug)]
pub struct Found {
    id: u64,
    class: u32,
    score: f64,
    /// Left, top, right, bottom, pixels.
    in_image: Option<[f64; 4]>,
    /// Pose and half the size, in the world.
    in_space: Option<(Isometry3<f64>, Vector3<f64>)>,
}

/// Something that has an id and a place.
#[derive(Clone, Debug, Default)]
struct Side {
    ids: Vec<u64>,
    classes: Vec<u32>,
    ignored: Vec<bool>,
    rectangles: Vec<[f64; 4]>,
    centres: Vec<[f64; 3]>,
}

/// What a moment and a result gave.
pub struct Part {
    truths: Vec<u64>,
    ignored: Vec<bool>,
    results: Vec<u64>,
    similarity: Vec<f64>,
}

/// The measure.
pub struct Tracking {
    spec: Spec,
    targets: Vec<Target>,
    poses: EgoPoses,
    evidence: Evidence,
}

impl Tracking {
    /// For a task.
    ///
    /// # Errors
    /// A sentence if a class cannot be asked for.
    pub fn new(spec: &Spec) -> Result<Tracking, SuiteFault> {
        Ok(Tracking {
            spec: spec.clone(),
            targets: targets(&spec.classes)?,
            poses: EgoPoses::default(),
            evidence: Evidence::default(),
        })
    }

    /// Truths of a moment; `None` if it has none.
    fn truths(&self, moment: &Moment<'_>) -> Option<Side> {
        let mut side = Side::default();
        if !self.spec.options.in_space {
            let view = moment.view(&self.spec.truth)?;
            for object in &view.objects {
                let Some((number, ignored)) = fate(&self.spec, &self.targets, object) else {
                    continue;
                };
                // A two-wheeler and its rider have one id; the class tells them apart.
                let id = u64::from(object.id) << 8 | u64::from(object.class);
                side.ids.push(id);
                side.classes.push(number);
                side.ignored.push(ignored);
                side.rectangles.push(object.bounds.map(f64::from));
            }
            return Some(side);
        }
        let ego = moment.ego().filter(|_| moment.is_query)?;
        let here = ego.world_from_ego.translation.vector;
        let far = self.spec.rules.distance_or(FAR_M);
        for body in moment.bodies() {
            let Some(number) = target_of(&self.targets, body.class) else {
                continue;
            };
            let centre = body.world_from_box.translation.vector;
            let distance = ground_distance_m(&centre, &here);
            let hidden = self.evidence.ignores(moment, &self.spec, body);
            // A little beyond the limit truths take tracks away that stand on its edge.
            if distance > far + ZERO_AT_M {
                continue;
            }
            side.ids.push(u64::from(body.id));
            side.classes.push(number);
            side.ignored.push(hidden || distance > far);
            side.centres.push(centre.into());
        }
        Some(side)
    }

    fn results(&self, moment: &Moment<'_>, found: &[Found]) -> Side {
        let mut side = Side::default();
        let here = moment
            .ego()
            .map(|ego| ego.world_from_ego.translation.vector);
        let far = self.spec.rules.distance_or(FAR_M);
        for found in found {
            match (self.spec.options.in_space, found.in_image, &found.in_space) {
                (false, Some(rectangle), _) => side.rectangles.push(rectangle),
                (true, _, Some((pose, _))) => {
                    let centre = pose.translation.vector;
                    let is_near = here.is_none_or(|here| ground_distance_m(&centre, &here) <= far);
                    if !is_near {
                        continue;
                    }
                    side.centres.push(centre.into());
                }
                _ => continue,
            }
            side.ids.push(found.id);
            side.classes.push(found.class);
        }
        side
    }
}

impl Measure for Tracking {
    type Estimate = Vec<Found>;
    type Part = Part;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "HOTA",
            unit: "",
            higher_is_better: true,
        }
    }

    fn begin(&mut self, context: &Context<'_>) -> anyhow::Result<()> {
        self.poses.begin(context);
        self.evidence = Evidence::default();
        Ok(())
    }

    fn watch(&mut self, moment: &Moment<'_>) {
        if self.spec.options.in_space {
            self.poses.watch(moment);
            self.evidence.watch(moment, &self.spec.truth);
        }
    }

    fn empty(&self) -> Collector {
        Collector::new(Settings::default())
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Vec<Found>, Unreadable> {
        let world_from_space = match self.spec.options.in_space {
            true => self.poses.world_from_space(&reading.result.header)?,
            false => Isometry3::identity(),
        };
        let own = records::<Track>(reading.body).into_iter();
        // Tentative ones are no claims yet, and ended ones no more.
        let alive = own.filter(|track| matches!(track.state, 1 | 2));
        let found = alive.filter_map(|track| {
            let class = program_target(&self.targets, reading.about, track.class)?;
            let [x0, y0] = track.min_px.map(f64::from);
            let [x1, y1] = track.max_px.map(f64::from);
            let rectangle = [x0, y0, x1, y1];
            let in_image = track.flags & Track::IN_IMAGE != 0;
            let in_space = track.flags & Track::IN_SPACE != 0 && is_finite(&track.pose);
            let half_m = Vector3::from(track.half_m.map(f64::from));
            Some(Found {
                id: u64::from(track.id),
                class,
                score: f64::from(track.score),
                in_image: (in_image && rectangle.iter().all(|part| part.is_finite()))
                    .then_some(rectangle),
                in_space: in_space.then(|| (world_from_space * normalised(&track.pose), half_m)),
            })
        });
        Ok(found.collect())
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Vec<Found>>) -> Option<Part> {
        let truths = self.truths(moment)?;
        let results = estimate.map_or_else(Side::default, |found| self.results(moment, found));
        let mut similarity = match self.spec.options.in_space {
            false => iou_similarity(&truths.rectangles, &results.rectangles),
            true => centre_similarity(&truths.centres, &results.centres, ZERO_AT_M),
        };
        // What has another class is another thing.
        for (row, of_truth) in truths.classes.iter().enumerate() {
            for (column, of_result) in results.classes.iter().enumerate() {
                if of_truth != of_result {
                    similarity[row * results.ids.len() + column] = 0.0;
                }
            }
        }
        Some(Part {
            truths: truths.ids,
            ignored: truths.ignored,
            results: results.ids,
            similarity,
        })
    }

    fn add(&self, total: &mut Collector, part: &Part) {
        let frame = Frame {
            truths: &part.truths,
            ignored: &part.ignored,
            results: &part.results,
            similarity: &part.similarity,
        };
        let added = total.add(frame);
        debug_assert!(added.is_ok(), "the lists belong together");
    }

    fn bad(&self, part: &Part) -> Option<Bad> {
        let n = part.results.len();
        let best = |row: usize| {
            let of = &part.similarity[row * n..(row + 1) * n];
            of.iter().copied().fold(0.0, f64::max)
        };
        let counted = (0..part.truths.len()).filter(|row| !part.ignored[*row]);
        let n_lost = counted.clone().filter(|row| best(*row) < 0.5).count();
        (n_lost > 0).then(|| Bad {
            badness: n_lost as f64,
            why: format!("{n_lost} of {} without a track", counted.count()),
        })
    }

    fn draw(&self, picture: &mut Picture, moment: &Moment<'_>, what: Drawn<'_, Vec<Found>>) {
        match what {
            Drawn::Truth => {
                let Some(side) = self.truths(moment) else {
                    return;
                };
                for (at, [x0, y0, x1, y1]) in side.rectangles.iter().enumerate() {
                    let label = format!("{} {}", name_of(side.classes[at]), side.ids[at] >> 8);
                    let counts = !side.ignored[at];
                    let label = if counts { label.as_str() } else { "" };
                    picture.rectangle([*x0, *y0], [*x1, *y1], counts, label);
                }
                if self.spec.options.in_space {
                    for body in moment.bodies() {
                        let Some(number) = target_of(&self.targets, body.class) else {
                            continue;
                        };
                        let counts = !self.evidence.ignores(moment, &self.spec, body);
                        let label = format!("{} {}", name_of(number), body.id);
                        picture.cuboid(&body.world_from_box, body.half_m, counts, &label);
                    }
                }
            }
            Drawn::Result(found) => {
                for found in found {
                    let label = format!("{} {} {:.2}", name_of(found.class), found.id, found.score);
                    if let Some([x0, y0, x1, y1]) = found.in_image {
                        picture.rectangle([x0, y0], [x1, y1], true, &label);
                    }
                    if let Some((pose, half_m)) = &found.in_space {
                        picture.cuboid(pose, *half_m, true, &label);
                    }
                }
            }
        }
    }
}
