//! A surface without ridges through heights that are known at many points.
//!
//! At each place a plane is fitted to the points around it, the near ones counting most (local linear
//! regression): planes stay as they are, also at the rim, and steps become slopes. Towards the mouths
//! of a junction, where its roads meet those outside, the heights are kept.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

/// How far away points still count, metres.
const REACH_M: f64 = 6.0;
/// Side of the squares in which points of one level are put together, metres.
const CELL_M: f64 = 1.0;
/// Heights that differ more are those of two levels, metres.
pub(super) const LEVEL_M: f64 = 1.5;
/// Distance from a mouth within which heights are kept for the most part, metres.
const MOUTH_M: f64 = 4.0;

/// The middle of some points that are near each other.
#[derive(Clone, Copy, Debug)]
struct Spot {
    sum_m: Vector3<f64>,
    n_points: f64,
}

impl Spot {
    fn middle_m(&self) -> Vector3<f64> {
        self.sum_m / self.n_points
    }
}

/// The heights of one junction.
#[derive(Debug, Default)]
pub(super) struct Fairing {
    spots: BTreeMap<(i32, i32), Vec<Spot>>,
    mouths_m: BTreeMap<(i32, i32), Vec<Vector3<f64>>>,
}

/// Number of a cell; its neighbours' numbers exist wherever a file puts a lane.
fn cell(x: f64, side_m: f64) -> i32 {
    (x / side_m).floor().clamp(-1e9, 1e9) as i32
}

impl Fairing {
    /// Adds a point of the surface.
    pub fn add(&mut self, point: [f64; 3]) {
        let point = Vector3::from(point);
        let key = (cell(point.x, CELL_M), cell(point.y, CELL_M));
        let spots = self.spots.entry(key).or_default();
        let same_level = |spot: &&mut Spot| (spot.middle_m().z - point.z).abs() < LEVEL_M;
        match spots.iter_mut().find(same_level) {
            Some(spot) => {
                spot.sum_m += point;
                spot.n_points += 1.0;
            }
            None => spots.push(Spot {
                sum_m: point,
                n_points: 1.0,
            }),
        }
    }

    /// Adds a point at which the surface meets a road outside.
    pub fn add_mouth(&mut self, point: [f64; 3]) {
        let key = (cell(point[0], 2.0 * MOUTH_M), cell(point[1], 2.0 * MOUTH_M));
        self.mouths_m.entry(key).or_default().push(point.into());
    }

    /// Height of the surface without ridges at one of its points, metres.
    pub fn height(&self, point: [f64; 3]) -> f64 {
        let point = Vector3::from(point);
        let kept = (-(self.to_mouth_m(point) / MOUTH_M).powi(2)).exp();
        if kept > 0.999 {
            return point.z;
        }
        point.z + (1.0 - kept) * (self.fit(point) - point.z)
    }

    /// Distance from the nearest mouth, metres; infinite where it is too far to count.
    fn to_mouth_m(&self, point: Vector3<f64>) -> f64 {
        let at = |x: f64| cell(x, 2.0 * MOUTH_M);
        let (x, y) = (at(point.x), at(point.y));
        let near = (x - 1..=x + 1).flat_map(|x| (y - 1..=y + 1).map(move |y| (x, y)));
        near.filter_map(|key| self.mouths_m.get(&key))
            .flatten()
            .filter(|mouth| (mouth.z - point.z).abs() < LEVEL_M)
            .map(|mouth| (mouth.xy() - point.xy()).norm())
            .fold(f64::INFINITY, f64::min)
    }

    fn fit(&self, point: Vector3<f64>) -> f64 {
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        let span = |x: f64| cell(x - REACH_M, CELL_M)..=cell(x + REACH_M, CELL_M);
        for x in span(point.x) {
            let column = self
                .spots
                .range((x, *span(point.y).start())..=(x, *span(point.y).end()));
            for spot in column.flat_map(|(_, spots)| spots) {
                let from = spot.middle_m() - point;
                let share = from.xy().norm_squared() / (REACH_M * REACH_M);
                if share >= 1.0 || from.z.abs() > LEVEL_M {
                    continue;
                }
                let weight = (1.0 - share).powi(2);
                let row = Vector3::new(1.0, from.x, from.y);
                normal += weight * row * row.transpose();
                right += weight * from.z * row;
            }
        }
        // A little of a level plane, so that points in one line have an answer.
        normal[(1, 1)] += 1e-3;
        normal[(2, 2)] += 1e-3;
        let plane = normal.cholesky().map(|it| it.solve(&right));
        plane.map_or(point.z, |plane| point.z + plane[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(height: impl Fn(f64, f64) -> f64) -> (Fairing, Vec<[f64; 3]>) {
        let mut fairing = Fairing::default();
        let steps = || (0..=80).map(|i| -20.0 + 0.5 * f64::from(i));
        let points: Vec<[f64; 3]> = steps()
            .flat_map(|x| steps().map(move |y| (x, y)))
            .map(|(x, y)| [x, y, height(x, y)])
            .collect();
        points.iter().for_each(|point| fairing.add(*point));
        (fairing, points)
    }

    #[test]
    fn planes_stay_as_they_are_also_at_the_rim() {
        let (fairing, points) = field(|x, y| 3.0 + 0.08 * x - 0.05 * y);
        for point in points {
            assert!((fairing.height(point) - point[2]).abs() < 1e-3, "{point:?}");
        }
    }

    #[test]
    fn a_step_becomes_a_slope_of_the_kernels_width() {
        let (fairing, points) = field(|x, _| if x < 0.0 { 0.0 } else { 0.45 });
        let mut along: Vec<(f64, f64)> = points
            .iter()
            .filter(|point| point[1] == 0.0)
            .map(|point| (point[0], fairing.height(*point)))
            .collect();
        along.sort_by(|a, b| a.0.total_cmp(&b.0));
        let steepest = along
            .windows(2)
            .map(|pair| (pair[1].1 - pair[0].1) / (pair[1].0 - pair[0].0))
            .fold(0.0, f64::max);
        // Where a step is smoothed the slope is its height times the kernel's density there: the
        // integral of (1 - r²)² along the line through the middle over that on the disc, which is
        // (16 / 15) / (π / 3) = 1.019 for a reach of one.
        let slope = 0.45 * (16.0 / 15.0) / (std::f64::consts::PI / 3.0) / REACH_M;
        assert!(
            (steepest / slope - 1.0).abs() < 0.1,
            "{steepest}, not {slope}"
        );
    }

    #[test]
    fn mouths_and_other_levels_keep_their_heights() {
        let (mut fairing, points) = field(|x, _| if x < 0.0 { 0.0 } else { 0.45 });
        fairing.add_mouth([0.0, 0.0, 0.45]);
        assert_eq!(fairing.height([0.0, 0.0, 0.45]), 0.45);
        let far = fairing.height([0.0, 15.0, 0.45]);
        assert!((far - 0.225).abs() < 0.05, "{far}");
        for point in points {
            fairing.add([point[0], point[1], 6.0]);
        }
        assert!((fairing.height([0.0, 15.0, 6.0]) - 6.0).abs() < 1e-6);
        assert!((fairing.height([0.0, 15.0, 0.45]) - far).abs() < 1e-6);
    }
}
