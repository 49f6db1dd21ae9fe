//! A moving ball against one triangle.
//!
//! Moving a ball against a triangle is the same as moving a point against the triangle thickened by
//! the radius: two planes, three cylinders and three balls.
//! Source: Ericson, *Real-Time Collision Detection* (2005), sections 5.5.6 and 5.3.7.

use nalgebra::{Isometry3, Point3, Vector3};

/// A moving ball, in the space of the triangles it meets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ball {
    pub centre: Point3<f64>,
    /// Unit vector.
    pub direction: Vector3<f64>,
    pub radius_m: f64,
}

/// Where a ball first touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Touch {
    /// How far the centre has moved.
    pub way_m: f64,
    pub contact: Point3<f64>,
}

impl Ball {
    /// The same ball in another space.
    pub fn seen_from(&self, to_space: &Isometry3<f64>) -> Ball {
        Ball {
            centre: to_space * self.centre,
            direction: to_space.rotation * self.direction,
            radius_m: self.radius_m,
        }
    }

    /// First touch of a triangle on a way of at most `max_m`.
    pub fn touch(&self, corners: &[Point3<f64>; 3], max_m: f64) -> Option<Touch> {
        let nearest = nearest_point(&self.centre, corners);
        if (nearest - self.centre).norm_squared() <= self.radius_m * self.radius_m {
            return Some(Touch {
                way_m: 0.0,
                contact: nearest,
            });
        }
        let touch = match self.touch_face(corners) {
            // If the ball touches the inside of the triangle at all, it touches that first.
            Some(touch) => Some(touch),
            None => (0..3)
                .filter_map(|i| self.touch_edge(&corners[i], &corners[(i + 1) % 3]))
                .min_by(|a, b| a.way_m.total_cmp(&b.way_m)),
        };
        touch.filter(|touch| touch.way_m <= max_m)
    }

    fn at(&self, way_m: f64) -> Point3<f64> {
        self.centre + self.direction * way_m
    }

    fn touch_face(&self, corners: &[Point3<f64>; 3]) -> Option<Touch> {
        let normal = (corners[1] - corners[0])
            .cross(&(corners[2] - corners[0]))
            .try_normalize(0.0)?;
        let height = normal.dot(&(self.centre - corners[0]));
        let normal = if height < 0.0 { -normal } else { normal };
        let closing = -normal.dot(&self.direction);
        let gap = height.abs() - self.radius_m;
        if closing <= 0.0 || gap < 0.0 {
            return None;
        }
        let way_m = gap / closing;
        let contact = self.at(way_m) - normal * self.radius_m;
        let inside = |a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>| {
            let across = (b - a).cross(&normal);
            across.dot(&(contact - a)) * across.dot(&(c - a)) >= 0.0
        };
        let [a, b, c] = corners;
        (inside(a, b, c) && inside(b, c, a) && inside(c, a, b)).then_some(Touch { way_m, contact })
    }

    fn touch_edge(&self, a: &Point3<f64>, b: &Point3<f64>) -> Option<Touch> {
        let edge = b - a;
        let length2 = edge.norm_squared();
        let side = if length2 > 0.0 {
            // Without the components along the edge this is a ray against a circle.
            let across = |v: Vector3<f64>| v - edge * (v.dot(&edge) / length2);
            first_root(
                &across(self.centre - a),
                &across(self.direction),
                self.radius_m,
            )
            .and_then(|way_m| {
                let along = (self.at(way_m) - a).dot(&edge) / length2;
                (0.0..=1.0).contains(&along).then(|| Touch {
                    way_m,
                    contact: a + edge * along,
                })
            })
        } else {
            None
        };
        let end = |corner: &Point3<f64>| {
            first_root(&(self.centre - corner), &self.direction, self.radius_m).map(|way_m| Touch {
                way_m,
                contact: *corner,
            })
        };
        [side, end(a), end(b)]
            .into_iter()
            .flatten()
            .min_by(|a, b| a.way_m.total_cmp(&b.way_m))
    }
}

/// Smallest t ≥ 0 at which |from + t·direction| falls to the radius.
fn first_root(from: &Vector3<f64>, direction: &Vector3<f64>, radius_m: f64) -> Option<f64> {
    let (a, b, c) = (
        direction.norm_squared(),
        from.dot(direction),
        from.norm_squared() - radius_m * radius_m,
    );
    let discriminant = b * b - a * c;
    if a <= 1e-18 || b >= 0.0 || discriminant < 0.0 {
        return None;
    }
    let t = (-b - discriminant.sqrt()) / a;
    (t >= 0.0).then_some(t)
}

/// The point of a triangle nearest to `p`.
fn nearest_point(p: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> Point3<f64> {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * if d1 > d3 { d1 / (d1 - d3) } else { 0.0 };
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * if d2 > d6 { d2 / (d2 - d6) } else { 0.0 };
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let sum = (d4 - d3) + (d5 - d6);
        return b + (c - b) * if sum > 0.0 { (d4 - d3) / sum } else { 0.0 };
    }
    let sum = va + vb + vc;
    if sum == 0.0 {
        *a
    } else {
        a + ab * (vb / sum) + ac * (vc / sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(rng: &mut fastrand::Rng, scale: f64) -> Point3<f64> {
        Point3::new(rng.f64() - 0.5, rng.f64() - 0.5, rng.f64() - 0.5) * scale
    }

    /// Distance of a point to a triangle by a fine grid over it: independent of the formulas above.
    fn gridded_distance(p: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3], n: usize) -> f64 {
        let mut best = f64::INFINITY;
        for i in 0..=n {
            for j in 0..=n - i {
                let (u, v) = (i as f64 / n as f64, j as f64 / n as f64);
                best = best.min((a + (b - a) * u + (c - a) * v - p).norm());
            }
        }
        best
    }

    #[test]
    fn a_ball_touches_where_its_distance_to_the_triangle_falls_to_the_radius() {
        let mut rng = fastrand::Rng::with_seed(3);
        let (mut n_touched, mut n_missed) = (0, 0);
        for _ in 0..300 {
            let corners = [
                random(&mut rng, 4.0),
                random(&mut rng, 4.0),
                random(&mut rng, 4.0),
            ];
            let centre = random(&mut rng, 16.0);
            let direction = (random(&mut rng, 5.0) - centre).normalize();
            let ball = Ball {
                centre,
                direction,
                radius_m: 0.2 + rng.f64(),
            };
            // A grid of 80 by 80 on edges of up to 6 m is off by 5 cm at most, and only too far.
            let gap = |t: f64| gridded_distance(&ball.at(t), &corners, 80) - ball.radius_m;
            match ball.touch(&corners, 30.0) {
                Some(touch) => {
                    n_touched += 1;
                    assert!(
                        touch.way_m == 0.0 || gap(touch.way_m).abs() < 0.06,
                        "{touch:?} {}",
                        gap(touch.way_m)
                    );
                    assert!(
                        (0..20).all(|i| gap(touch.way_m * i as f64 / 20.0) > -1e-9),
                        "touched before"
                    );
                    assert!(
                        touch.way_m == 0.0
                            || ((touch.contact - ball.at(touch.way_m)).norm() - ball.radius_m)
                                .abs()
                                < 1e-9
                    );
                }
                None => {
                    n_missed += 1;
                    assert!((0..600).all(|i| gap(i as f64 * 0.05) > -1e-9), "missed");
                }
            }
        }
        assert!(n_touched > 50 && n_missed > 50, "{n_touched} {n_missed}");
    }
}
