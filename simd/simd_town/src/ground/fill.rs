//! The ground inside a block, or round the town: triangles between its border and points in
//! between, with heights.
//!
//! The border's edges are kept as they are, so that pavements meet the ground without a gap.
//! Heights inside follow the nearest part of the border; outside the town hills rise with distance,
//! and ponds lie in hollows.

use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation as _};

use crate::geometry::{P2, contains};

/// Half the side of the square that is the world, metres.
pub const FAR_M: f64 = 1500.0;
/// Depth of a pond's bed under its water.
const POND_DEPTH_M: f64 = 1.4;
/// Width of a pond's bank.
const BANK_M: f64 = 14.0;

/// Triangulated ground.
#[derive(Clone, Debug, Default)]
pub struct Fill {
    /// Corners: those of the border first.
    pub points_m: Vec<P2>,
    /// Height of each.
    pub heights_m: Vec<f64>,
    /// Corners of triangles, counter-clockwise.
    pub triangles: Vec<[usize; 3]>,
}

/// A pond in the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pond {
    /// Middle.
    pub middle_m: P2,
    /// Radius of the water.
    pub radius_m: f64,
    /// Height of the water.
    pub level_m: f64,
}

/// The closed line that is to be filled.
#[derive(Clone, Copy, Debug)]
pub struct Border<'a> {
    /// Closed line with the block on its left.
    pub points_m: &'a [P2],
    /// Height at each point.
    pub heights_m: &'a [f64],
    /// The block is everything outside.
    pub outside: bool,
}

impl Fill {
    /// Fills a border. `rough` ground gets points between the border's; level ground needs none.
    pub fn of(border: &Border<'_>, rough: bool, hills_m: f64, ponds: &[Pond]) -> Fill {
        let (points_m, heights_m, outside) = (border.points_m, border.heights_m, border.outside);
        let mut corners: Vec<(P2, f64)> = points_m
            .iter()
            .copied()
            .zip(heights_m.iter().copied())
            .collect();
        let n = corners.len();
        if outside {
            corners.extend(world_corners().into_iter().map(|p| (p, 0.0)));
        }
        let nearness = Nearness::new(points_m, heights_m);
        if rough || outside {
            let inner = grid(border, rough, &nearness);
            corners.extend(inner.into_iter().map(|p| (p, 0.0)));
        }
        for (p, height) in &mut corners[n..] {
            let (near_m, border_height_m) = nearness.at(*p);
            *height = border_height_m;
            if outside {
                *height += hill(*p, near_m, border_height_m, hills_m);
            }
            for pond in ponds {
                let over = (*p - pond.middle_m).norm() - pond.radius_m;
                if over < BANK_M {
                    let k = ((over + 0.35 * pond.radius_m) / (BANK_M + 0.35 * pond.radius_m))
                        .clamp(0.0, 1.0);
                    let bed = pond.level_m - POND_DEPTH_M;
                    *height =
                        bed + (height.max(pond.level_m + 0.3) - bed) * k * k * (3.0 - 2.0 * k);
                }
            }
        }
        let triangles = triangulate(&corners, n, border);
        Fill {
            points_m: corners.iter().map(|c| c.0).collect(),
            heights_m: corners.iter().map(|c| c.1).collect(),
            triangles,
        }
    }
}

/// Corners of the world's edge.
fn world_corners() -> Vec<P2> {
    (0..24)
        .map(|k| crate::geometry::unit(std::f64::consts::TAU * f64::from(k) / 24.0) * FAR_M)
        .collect()
}

/// Points in between: dense near the border, wide apart far away.
fn grid(border: &Border<'_>, rough: bool, nearness: &Nearness) -> Vec<P2> {
    let (mut low, mut high) = (P2::repeat(f64::MAX), P2::repeat(f64::MIN));
    for p in border.points_m {
        (low, high) = (low.inf(p), high.sup(p));
    }
    let mut points = Vec::new();
    let steps: &[(f64, f64, f64)] = match (border.outside, rough) {
        (false, _) => &[(14.0, 0.0, f64::INFINITY)],
        // Each row: distance between points, and the range of distances from the border in which it
        // applies.
        (true, true) => &[
            (18.0, 0.0, 90.0),
            (50.0, 90.0, 320.0),
            (170.0, 320.0, f64::INFINITY),
        ],
        (true, false) => &[(110.0, 40.0, 400.0), (260.0, 400.0, f64::INFINITY)],
    };
    for &(step, from, to) in steps {
        let reach = if border.outside {
            (to + 10.0).min(FAR_M)
        } else {
            0.0
        };
        let first = |axis: usize| ((low[axis] - reach).max(-FAR_M) / step).floor() as i64;
        let last = |axis: usize| ((high[axis] + reach).min(FAR_M) / step).ceil() as i64;
        for j in first(1)..=last(1) {
            for i in first(0)..=last(0) {
                // Every other row is shifted by half a step, which gives triangles of equal sides.
                let p = P2::new(
                    (i as f64 + if j % 2 == 0 { 0.0 } else { 0.5 }) * step,
                    j as f64 * step,
                );
                let near_m = nearness.distance(p);
                let fits = near_m > (0.45 * step).max(from)
                    && near_m <= to
                    && p.norm() < FAR_M - 0.4 * step;
                if fits && contains(border.points_m, p) != border.outside {
                    points.push(p);
                }
            }
        }
    }
    points
}

fn triangulate(corners: &[(P2, f64)], n_border: usize, border: &Border<'_>) -> Vec<[usize; 3]> {
    let mut mesh = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
    let mut numbers = Vec::with_capacity(corners.len());
    let handles: Vec<_> = (corners.iter().enumerate())
        .filter_map(|(i, (p, _))| {
            let handle = mesh.insert(Point2::new(p.x, p.y)).ok()?;
            // Two points at the same place become one corner.
            if handle.index() == numbers.len() {
                numbers.push(i);
            }
            Some(handle)
        })
        .collect();
    for i in 0..n_border {
        let (a, b) = (handles[i], handles[(i + 1) % n_border]);
        if a != b && mesh.can_add_constraint(a, b) {
            mesh.add_constraint(a, b);
        }
    }
    let triangles = mesh
        .inner_faces()
        .map(|face| face.vertices().map(|v| numbers[v.fix().index()]));
    let belongs = |t: &[usize; 3]| {
        // A triangle with an inner point lies inside, because no triangle crosses the border.
        if t.iter().any(|&i| i >= n_border) {
            return true;
        }
        let middle = (corners[t[0]].0 + corners[t[1]].0 + corners[t[2]].0) / 3.0;
        contains(border.points_m, middle) != border.outside
    };
    triangles.filter(belongs).collect()
}

/// The border sorted into square cells, to find its nearest points quickly.
struct Nearness<'a> {
    points_m: &'a [P2],
    heights_m: &'a [f64],
}

impl Nearness<'_> {
    fn new<'a>(points_m: &'a [P2], heights_m: &'a [f64]) -> Nearness<'a> {
        Nearness {
            points_m,
            heights_m,
        }
    }

    fn distance(&self, p: P2) -> f64 {
        let n = self.points_m.len();
        let to_edge = |i: usize| {
            let (a, b) = (self.points_m[i], self.points_m[(i + 1) % n]);
            let along = ((p - a).dot(&(b - a)) / (b - a).norm_squared().max(1e-12)).clamp(0.0, 1.0);
            (a + (b - a) * along - p).norm_squared()
        };
        (0..n).map(to_edge).fold(f64::INFINITY, f64::min).sqrt()
    }

    /// Distance to the border, and the border's height as a mean weighted by nearness.
    fn at(&self, p: P2) -> (f64, f64) {
        let (mut sum, mut weights, mut nearest) = (0.0, 0.0, f64::INFINITY);
        for (q, height) in self.points_m.iter().zip(self.heights_m) {
            let d2 = (q - p).norm_squared() + 1.0;
            let weight = 1.0 / (d2 * d2);
            sum += weight * height;
            weights += weight;
            nearest = nearest.min(d2);
        }
        (nearest.sqrt(), sum / weights)
    }
}

/// How much the ground rises outside, at this distance from the border.
fn hill(p: P2, near_m: f64, border_m: f64, hills_m: f64) -> f64 {
    let wave = 0.5
        + 0.3 * (p.x * 0.0061 + 1.0).sin() * (p.y * 0.0047).cos()
        + 0.2 * (p.x * 0.011 - p.y * 0.013).sin();
    let far = ((near_m - 25.0) / 380.0).clamp(0.0, 1.0);
    let far = far * far * (3.0 - 2.0 * far);
    hills_m * wave * far - border_m * far
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::area;

    #[test]
    fn triangles_cover_a_border_exactly_and_follow_its_height() {
        let corners = [
            (0.0, 0.0),
            (40.0, 0.0),
            (80.0, 0.0),
            (80.0, 60.0),
            (50.0, 60.0),
            (50.0, 20.0),
            (20.0, 20.0),
            (20.0, 60.0),
            (0.0, 60.0),
        ]
        .map(|(x, y)| P2::new(x, y));
        let heights = corners.map(|p| 5.0 + 0.1 * p.x);
        let border = Border {
            points_m: &corners,
            heights_m: &heights,
            outside: false,
        };
        for rough in [false, true] {
            let fill = Fill::of(&border, rough, 0.0, &[]);
            let areas: Vec<f64> = fill
                .triangles
                .iter()
                .map(|t| area(&t.map(|i| fill.points_m[i])))
                .collect();
            assert!(areas.iter().all(|&a| a > 0.0), "{areas:?}");
            assert!((areas.iter().sum::<f64>() - area(&corners)).abs() < 1e-9);
            assert_eq!(fill.points_m.len() > corners.len(), rough);
            assert!(fill.heights_m.iter().all(|h| (5.0..=13.0).contains(h)));
        }
    }

    #[test]
    fn the_world_outside_reaches_to_its_edge_without_the_town() {
        // Clockwise: the town lies on the right.
        let corners = [
            (-100.0, -80.0),
            (-100.0, 80.0),
            (0.0, 20.0),
            (100.0, 80.0),
            (100.0, -80.0),
        ]
        .map(|(x, y)| P2::new(x, y));
        let border = Border {
            points_m: &corners,
            heights_m: &[2.0; 5],
            outside: true,
        };
        let fill = Fill::of(&border, true, 30.0, &[]);
        let sum: f64 = fill
            .triangles
            .iter()
            .map(|t| area(&t.map(|i| fill.points_m[i])))
            .sum();
        let world = 12.0 * (std::f64::consts::TAU / 24.0).sin() * FAR_M * FAR_M;
        assert!(
            (sum - (world + area(&corners))).abs() < 1e-6 * world,
            "{sum} {world}"
        );
        assert!(fill.heights_m.iter().any(|&h| h > 12.0));
    }

    #[test]
    fn a_pond_lies_in_a_hollow() {
        let corners = [(-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0)]
            .map(|(x, y)| P2::new(x, y));
        let border = Border {
            points_m: &corners,
            heights_m: &[3.0; 4],
            outside: false,
        };
        let pond = Pond {
            middle_m: P2::zeros(),
            radius_m: 20.0,
            level_m: 2.0,
        };
        let fill = Fill::of(&border, true, 0.0, &[pond]);
        for (p, height) in fill.points_m.iter().zip(&fill.heights_m) {
            let over = p.norm() - pond.radius_m;
            assert!(over > -6.0 || *height < pond.level_m, "{p} {height}");
            assert!(
                over < BANK_M || (*height - 3.0).abs() < 1e-6,
                "{p} {height}"
            );
        }
    }
}
