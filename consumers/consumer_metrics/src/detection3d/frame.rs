//! Boxes of one frame: truths, detections, which of them count, and who takes whom.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use crate::average_precision::Matches;

/// Detections of a frame that count, best scores first.
pub const MAX_DETECTIONS: usize = 500;

/// A box that stands upright.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box3 {
    /// Its centre, metres.
    pub centre_m: [f64; 3],
    /// Its length, width and height, metres.
    pub size_m: [f64; 3],
    /// Direction of its front on the ground, radians from the x axis towards the y axis.
    pub yaw_rad: f64,
}

impl Box3 {
    fn is_valid(&self) -> bool {
        let sizes = self.size_m.iter();
        self.centre_m.iter().all(|value| value.is_finite())
            && sizes.copied().all(|value| value.is_finite() && value > 0.0)
            && self.yaw_rad.is_finite()
    }

    /// Distance of the centres on the ground, metres.
    pub fn distance_m(&self, other: &Box3) -> f64 {
        distance(
            [self.centre_m[0], self.centre_m[1]],
            [other.centre_m[0], other.centre_m[1]],
        )
    }

    /// Intersection over union if both boxes had the same centre and heading.
    pub(super) fn size_overlap(&self, other: &Box3) -> f64 {
        let volume = |size: [f64; 3]| size.iter().product::<f64>();
        let both: [f64; 3] = std::array::from_fn(|axis| self.size_m[axis].min(other.size_m[axis]));
        volume(both) / (volume(self.size_m) + volume(other.size_m) - volume(both))
    }

    /// Difference of the headings, 0..=π, of boxes that look alike after turning by `period`.
    pub(super) fn turn_rad(&self, other: &Box3, period: f64) -> f64 {
        let half = period / 2.0;
        let turn = (self.yaw_rad - other.yaw_rad + half).rem_euclid(period) - half;
        (if turn > PI { turn - TAU } else { turn }).abs()
    }
}

pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    let [x, y] = [a[0] - b[0], a[1] - b[1]];
    (x * x + y * y).sqrt()
}

/// An object.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Its class.
    pub class: u32,
    /// Where it is and how large.
    pub shape: Box3,
    /// Its velocity on the ground `[x, y]`, m/s; `None` if that is not known.
    pub velocity_mps: Option<[f64; 2]>,
    /// Number of its attribute; `None` if it has none.
    pub attribute: Option<u32>,
    /// Its distance from the vehicle on the ground, metres; matters only to classes with a range.
    pub distance_m: f64,
    /// Does not count.
    pub ignore: bool,
}

impl Truth {
    /// An object of which no more is known, at distance 0.
    pub fn new(class: u32, shape: Box3) -> Truth {
        Truth {
            class,
            shape,
            velocity_mps: None,
            attribute: None,
            distance_m: 0.0,
            ignore: false,
        }
    }
}

/// Something that was detected.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection {
    /// Its class.
    pub class: u32,
    /// Where it is and how large.
    pub shape: Box3,
    /// Confidence; only its order matters, but 0 means that nothing was found.
    pub score: f64,
    /// Its velocity on the ground `[x, y]`, m/s; `None` if it was not estimated.
    pub velocity_mps: Option<[f64; 2]>,
    /// Number of its attribute; `None` if it was not estimated.
    pub attribute: Option<u32>,
    /// Its distance from the vehicle on the ground, metres; matters only to classes with a range.
    pub distance_m: f64,
    /// Does not count as false if it finds no truth.
    pub ignore_unmatched: bool,
}

impl Detection {
    /// A detection that says no more, at distance 0.
    pub fn new(class: u32, score: f64, shape: Box3) -> Detection {
        Detection {
            class,
            shape,
            score,
            velocity_mps: None,
            attribute: None,
            distance_m: 0.0,
            ignore_unmatched: false,
        }
    }
}

/// Indices of truths and detections that are in the lists and in range, by class.
pub(super) struct Frame {
    pub(super) classes: BTreeMap<u32, (Vec<usize>, Vec<usize>)>,
    pub(super) n_invalid: u64,
    pub(super) n_too_many: u64,
}

impl Frame {
    pub(super) fn new(
        truths: &[Truth],
        detections: &[Detection],
        in_range: impl Fn(u32, f64) -> bool,
    ) -> Frame {
        let mut frame = Frame {
            classes: BTreeMap::new(),
            n_invalid: 0,
            n_too_many: 0,
        };
        for (index, truth) in truths.iter().enumerate() {
            if !truth.shape.is_valid() {
                frame.n_invalid += 1;
            } else if in_range(truth.class, truth.distance_m) {
                let class = frame.classes.entry(truth.class).or_default();
                class.0.push(index);
            }
        }
        let mut kept = Vec::with_capacity(detections.len());
        for (index, detection) in detections.iter().enumerate() {
            if !detection.shape.is_valid() || !detection.score.is_finite() {
                frame.n_invalid += 1;
            } else if in_range(detection.class, detection.distance_m) {
                kept.push(index);
            }
        }
        if kept.len() > MAX_DETECTIONS {
            frame.n_too_many = (kept.len() - MAX_DETECTIONS) as u64;
            kept.sort_by(|a, b| best_first(detections, *a, *b));
            kept.truncate(MAX_DETECTIONS);
            kept.sort();
        }
        for index in kept {
            let class = frame.classes.entry(detections[index].class).or_default();
            class.1.push(index);
        }
        frame
    }
}

/// Order by score; of equals the later one comes first.
pub(super) fn best_first(detections: &[Detection], a: usize, b: usize) -> std::cmp::Ordering {
    let (score_a, score_b) = (detections[a].score, detections[b].score);
    let order = score_b.partial_cmp(&score_a);
    order.unwrap_or(std::cmp::Ordering::Equal).then(b.cmp(&a))
}

/// Position in `indices` of the truth nearest to a detection among those that `free` leaves, if it is
/// nearer than `limit_m`.
pub(super) fn nearest(
    distances_m: &[f64],
    limit_m: f64,
    free: impl Fn(usize) -> bool,
) -> Option<usize> {
    let mut best = (limit_m, None);
    for (at, distance_m) in distances_m.iter().enumerate() {
        if *distance_m < best.0 && free(at) {
            best = (*distance_m, Some(at));
        }
    }
    best.1
}

/// Who finds whom in a frame if centres must be nearer than `distance_m` metres, without regard to
/// ranges.
pub fn matches(truths: &[Truth], detections: &[Detection], distance_m: f64) -> Matches {
    let mut matches = Matches::default();
    let frame = Frame::new(truths, detections, |_, _| true);
    for (of_class, mut found) in frame.classes.into_values() {
        found.sort_by(|a, b| best_first(detections, *a, *b));
        let mut taken = vec![false; of_class.len()];
        for index in found {
            let detection = &detections[index];
            let distances: Vec<f64> = of_class
                .iter()
                .map(|truth| truths[*truth].shape.distance_m(&detection.shape))
                .collect();
            let ignored = |at: usize| truths[of_class[at]].ignore;
            let counted = nearest(&distances, distance_m, |at| !taken[at] && !ignored(at));
            let left_out = nearest(&distances, distance_m, |at| !taken[at] && ignored(at));
            match counted.or(left_out) {
                Some(at) => {
                    taken[at] = true;
                    if !ignored(at) {
                        matches.pairs.push((of_class[at], index));
                    }
                }
                None if detection.ignore_unmatched => {}
                None => matches.unmatched.push(index),
            }
        }
        let missed = of_class.iter().zip(&taken);
        let missed = missed.filter(|(truth, taken)| !**taken && !truths[**truth].ignore);
        matches.missed.extend(missed.map(|(truth, _)| *truth));
    }
    matches
}
