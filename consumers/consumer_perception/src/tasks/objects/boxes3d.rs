//! Boxes in space: nuScenes' detection metrics, in the world at the time of the query.

use std::collections::HashMap;

use consumer_metrics::detection3d::{
    Box3, ClassRule, Collector, Detection, Settings, Truth, matches,
};
use consumer_truth::Body;
use nalgebra::{Isometry3, Vector3};
use schema_frames::{Box3d, Modality, SemanticLidarPoint};

use super::detect::{DISTANCES_M, Place, records};
use crate::evidence::ignore::Shown;
use crate::evidence::moment::Moment;
use crate::picture::Picture;
use crate::suite::SuiteFault;
use crate::tasks::Unreadable;
use crate::tasks::classes::{Target, name_of, program_target, target_of, targets};
use crate::tasks::spaces::{EgoPoses, ground_distance_m, is_finite, normalised};
use crate::tasks::{Bad, Context, Drawn, Headline, Measure, Reading, Spec};

/// nuScenes' distance limit of a class, metres.
fn usual_range_m(number: u32) -> f64 {
    match number {
        12 | 18 | 19 => 40.0,
        _ => 50.0,
    }
}

/// Which bodies something of the truth sensor shows.
#[derive(Clone, Debug, Default)]
pub struct Evidence {
    /// Points of the newest exact cloud by object id; `None` if the sensor is no lidar.
    points: Option<HashMap<u32, u64>>,
}

impl Evidence {
    /// Sees a tick.
    pub fn watch(&mut self, moment: &Moment<'_>, truth: &str) {
        let Some(frame) = moment.frame(truth, Modality::SemanticLidar) else {
            return;
        };
        let mut points = HashMap::new();
        for point in frame.elements::<SemanticLidarPoint>() {
            *points.entry(point.object_id).or_insert(0) += 1;
        }
        self.points = Some(points);
    }

    /// Whether a body is ignored.
    pub fn ignores(&self, moment: &Moment<'_>, spec: &Spec, body: &Body) -> bool {
        if let Some(points) = &self.points {
            return points.get(&body.id).copied().unwrap_or(0) < spec.rules.min_points;
        }
        let Some(view) = moment.view(&spec.truth) else {
            return true;
        };
        let own = view.objects.iter().filter(|object| object.id == body.id);
        let most = own.max_by_key(|object| object.n_pixels);
        most.is_none_or(|object| {
            spec.rules.ignores(&Shown {
                pixels: object.n_pixels,
                height_px: f64::from(object.bounds[3] - object.bounds[1]),
                of_body: object
                    .of_body
                    .map(|(seen, truncation)| (seen.visible_fraction, truncation)),
                distance_m: None,
            })
        })
    }
}

/// A body's box as the metrics take it.
pub fn shape_of(world_from_box: &Isometry3<f64>, half_m: Vector3<f64>) -> Box3 {
    Box3 {
        centre_m: world_from_box.translation.vector.into(),
        size_m: (half_m * 2.0).into(),
        yaw_rad: world_from_box.rotation.euler_angles().2,
    }
}

/// A box that a program found, in the world.
#[derive(Clone, Debug)]
pub struct Found {
    /// As the metrics take it; its distance follows at each query.
    pub detection: Detection,
    /// Its pose and half its size.
    pub placed: (Isometry3<f64>, Vector3<f64>),
}

/// What a moment and a result gave.
pub struct Part {
    truths: Vec<Truth>,
    detections: Vec<Detection>,
}

/// The measure.
pub struct Boxes3d {
    spec: Spec,
    targets: Vec<Target>,
    poses: EgoPoses,
    evidence: Evidence,
}

impl Boxes3d {
    /// For a task.
    ///
    /// # Errors
    /// A sentence if a class cannot be asked for.
    pub fn new(spec: &Spec) -> Result<Boxes3d, SuiteFault> {
        Ok(Boxes3d {
            spec: spec.clone(),
            targets: targets(&spec.classes)?,
            poses: EgoPoses::default(),
            evidence: Evidence::default(),
        })
    }

    fn truths(&self, moment: &Moment<'_>, at: &Vector3<f64>) -> Vec<Truth> {
        let of_targets = moment.bodies().iter().filter_map(|body| {
            let number = target_of(&self.targets, body.class)?;
            let shape = shape_of(&body.world_from_box, body.half_m);
            let centre = body.world_from_box.translation.vector;
            Some(Truth {
                velocity_mps: Some([body.velocity_mps.x, body.velocity_mps.y]),
                distance_m: ground_distance_m(&centre, at),
                ignore: self.evidence.ignores(moment, &self.spec, body),
                ..Truth::new(number, shape)
            })
        });
        of_targets.collect()
    }
}

impl Measure for Boxes3d {
    type Estimate = Vec<Found>;
    type Part = Part;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "NDS",
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
        self.poses.watch(moment);
        self.evidence.watch(moment, &self.spec.truth);
    }

    fn empty(&self) -> Collector {
        let rule = |target: &Target| {
            let range_m = self.spec.rules.distance_or(usual_range_m(target.number));
            let rule = ClassRule {
                range_m: Some(range_m),
                ..ClassRule::default()
            };
            (target.number, rule)
        };
        Collector::new(Settings {
            classes: self.targets.iter().map(rule).collect(),
            count_absent: false,
        })
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Self::Estimate, Unreadable> {
        let world_from_space = self.poses.world_from_space(&reading.result.header)?;
        let found = records::<Box3d>(reading.body).into_iter();
        let usable = found.filter(|found| is_finite(&found.pose));
        Ok(usable
            .filter_map(|found| {
                let number = program_target(&self.targets, reading.about, found.class)?;
                let world_from_box = world_from_space * normalised(&found.pose);
                let half_m = Vector3::from(found.half_m.map(f64::from));
                let velocity = Vector3::from(found.velocity_mps.map(f64::from));
                let velocity = world_from_space.rotation * velocity;
                let is_known = velocity.x.is_finite() && velocity.y.is_finite();
                let shape = shape_of(&world_from_box, half_m);
                let detection = Detection {
                    velocity_mps: is_known.then_some([velocity.x, velocity.y]),
                    ..Detection::new(number, f64::from(found.score), shape)
                };
                Some(Found {
                    detection,
                    placed: (world_from_box, half_m),
                })
            })
            .collect())
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Self::Estimate>) -> Option<Part> {
        let ego = moment.ego().filter(|_| moment.is_query)?;
        let at = ego.world_from_ego.translation.vector;
        let placed = estimate.into_iter().flatten().map(|found| {
            let centre = Vector3::from(found.detection.shape.centre_m);
            Detection {
                distance_m: ground_distance_m(&centre, &at),
                ..found.detection.clone()
            }
        });
        Some(Part {
            truths: self.truths(moment, &at),
            detections: placed.collect(),
        })
    }

    fn add(&self, total: &mut Collector, part: &Part) {
        total.add(&part.truths, &part.detections);
    }

    fn strata(&self) -> Vec<(&'static str, &'static str)> {
        DISTANCES_M
            .map(|(_, _, part)| ("distance_m", part))
            .to_vec()
    }

    fn add_stratum(&self, total: &mut Collector, part: &Part, stratum: usize) {
        let place = |distance_m: f64| Place {
            distance_m: Some(distance_m),
            occlusion: None,
        };
        total.add_part(
            &part.truths,
            &part.detections,
            |at| !place(part.truths[at].distance_m).is_in(stratum),
            |at| !place(part.detections[at].distance_m).is_in(stratum),
        );
    }

    fn bad(&self, part: &Part) -> Option<Bad> {
        let range = |number: u32| self.spec.rules.distance_or(usual_range_m(number));
        let truths: Vec<Truth> = part
            .truths
            .iter()
            .filter(|truth| truth.distance_m < range(truth.class))
            .cloned()
            .collect();
        let near = part
            .detections
            .iter()
            .filter(|found| found.distance_m < range(found.class));
        let detections: Vec<Detection> = near.cloned().collect();
        let found = matches(&truths, &detections, 2.0);
        let sure = |at: &&usize| detections[**at].score >= 0.5;
        let n_false = found.unmatched.iter().filter(sure).count();
        let n_missed = found.missed.len();
        let nearness = |at: &usize| 10.0 / (truths[*at].distance_m + 5.0);
        let weight: f64 = found.missed.iter().map(nearness).sum();
        (n_missed + n_false > 0).then(|| Bad {
            badness: weight + 0.5 * n_false as f64,
            why: format!(
                "{n_missed} of {} missed, {n_false} false alarms",
                n_missed + found.pairs.len()
            ),
        })
    }

    fn draw(&self, picture: &mut Picture, moment: &Moment<'_>, what: Drawn<'_, Self::Estimate>) {
        match what {
            Drawn::Truth => {
                for body in moment.bodies() {
                    let Some(number) = target_of(&self.targets, body.class) else {
                        continue;
                    };
                    let counts = !self.evidence.ignores(moment, &self.spec, body);
                    let name = name_of(number);
                    let label = if counts { name.as_str() } else { "" };
                    picture.cuboid(&body.world_from_box, body.half_m, counts, label);
                }
            }
            Drawn::Result(found) => {
                for found in found {
                    let (world_from_box, half_m) = &found.placed;
                    let own = &found.detection;
                    let label = format!("{} {:.2}", name_of(own.class), own.score);
                    picture.cuboid(world_from_box, *half_m, true, &label);
                }
            }
        }
    }
}
