//! Plane curves of lines and arcs, parametrised by arc length: what every OpenDRIVE reader
//! evaluates exactly alike.

use nalgebra::Vector2;

/// A point or vector in the ground plane, metres.
pub type P2 = Vector2<f64>;

/// Unit vector of a heading, radians counter-clockwise from x.
pub fn unit(heading_rad: f64) -> P2 {
    P2::new(heading_rad.cos(), heading_rad.sin())
}

/// The vector turned left by a quarter.
pub fn left(v: P2) -> P2 {
    P2::new(-v.y, v.x)
}

/// z of the cross product.
pub fn cross(a: P2, b: P2) -> f64 {
    a.x * b.y - a.y * b.x
}

/// The same angle in (−π, π].
pub fn wrap(angle_rad: f64) -> f64 {
    let turns = (angle_rad / std::f64::consts::TAU).round();
    let wrapped = angle_rad - turns * std::f64::consts::TAU;
    if wrapped <= -std::f64::consts::PI {
        wrapped + std::f64::consts::TAU
    } else {
        wrapped
    }
}

/// Heading of a vector.
pub fn heading(v: P2) -> f64 {
    v.y.atan2(v.x)
}

/// A line (curvature 0) or an arc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Start.
    pub start_m: P2,
    /// Heading at the start.
    pub heading_rad: f64,
    /// Length.
    pub length_m: f64,
    /// 1/radius, positive to the left.
    pub curvature_per_m: f64,
}

impl Segment {
    fn line(from: P2, to: P2) -> Segment {
        let v = to - from;
        Segment {
            start_m: from,
            heading_rad: heading(v),
            length_m: v.norm(),
            curvature_per_m: 0.0,
        }
    }

    /// Arc length of the nearest point.
    fn nearest(&self, p: P2) -> f64 {
        let k = self.curvature_per_m;
        if k.abs() < 1e-12 {
            return (p - self.start_m)
                .dot(&unit(self.heading_rad))
                .clamp(0.0, self.length_m);
        }
        let centre = self.start_m + left(unit(self.heading_rad)) / k;
        let turned = wrap(heading(p - centre) - heading(self.start_m - centre));
        let (along, turn) = (
            if k > 0.0 { turned } else { -turned },
            self.length_m * k.abs(),
        );
        // Behind the end or before the start, whichever is nearer.
        let along = if along < 0.0 && along + std::f64::consts::TAU <= turn {
            along + std::f64::consts::TAU
        } else {
            along
        };
        if (0.0..=turn).contains(&along) {
            return along / k.abs();
        }
        let ends = [0.0, self.length_m].map(|s| (self.at(s).0 - p).norm());
        if ends[0] <= ends[1] {
            0.0
        } else {
            self.length_m
        }
    }

    /// Point and heading at arc length `s`.
    pub fn at(&self, s_m: f64) -> (P2, f64) {
        let (h, k) = (self.heading_rad, self.curvature_per_m);
        if k.abs() < 1e-12 {
            return (self.start_m + unit(h) * s_m, h);
        }
        let e = h + k * s_m;
        (
            self.start_m + P2::new(e.sin() - h.sin(), h.cos() - e.cos()) / k,
            e,
        )
    }
}

/// A chain of segments that meet with equal headings.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Path {
    /// In order.
    pub segments: Vec<Segment>,
}

/// A corner of a polyline that is to be rounded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bend {
    /// Corner of the polyline.
    pub corner_m: P2,
    /// Radius of the arc that replaces it.
    pub radius_m: f64,
}

impl Path {
    /// Length.
    pub fn length_m(&self) -> f64 {
        self.segments.iter().map(|segment| segment.length_m).sum()
    }

    /// Point and heading at arc length `s` (clamped to the ends).
    pub fn at(&self, s_m: f64) -> (P2, f64) {
        let mut rest = s_m.max(0.0);
        let last = self.segments.len() - 1;
        for (i, segment) in self.segments.iter().enumerate() {
            if rest <= segment.length_m || i == last {
                return segment.at(rest.min(segment.length_m));
            }
            rest -= segment.length_m;
        }
        unreachable!("the last segment returns")
    }

    /// Point `t` metres left of the curve at `s`.
    pub fn beside(&self, s_m: f64, t_m: f64) -> P2 {
        let (p, h) = self.at(s_m);
        p + left(unit(h)) * t_m
    }

    /// Station of the nearest point of the curve, and how far away it is.
    pub fn nearest(&self, p: P2) -> (f64, f64) {
        let (mut best, mut s) = ((0.0, f64::INFINITY), 0.0);
        for segment in &self.segments {
            let along = segment.nearest(p);
            let away = (segment.at(along).0 - p).norm();
            if away < best.1 {
                best = (s + along, away);
            }
            s += segment.length_m;
        }
        best
    }

    /// The curve in the other direction.
    pub fn reversed(&self) -> Path {
        let turned = |segment: &Segment| {
            let (start_m, heading) = segment.at(segment.length_m);
            Segment {
                start_m,
                heading_rad: wrap(heading + std::f64::consts::PI),
                curvature_per_m: -segment.curvature_per_m,
                length_m: segment.length_m,
            }
        };
        Path {
            segments: self.segments.iter().rev().map(turned).collect(),
        }
    }

    /// The curve `aside_m` to the left.
    pub fn offset(&self, aside_m: f64) -> Path {
        let moved = |segment: &Segment| {
            let k = segment.curvature_per_m;
            Segment {
                start_m: segment.start_m + left(unit(segment.heading_rad)) * aside_m,
                length_m: segment.length_m * (1.0 - k * aside_m),
                curvature_per_m: k / (1.0 - k * aside_m),
                ..*segment
            }
        };
        Path {
            segments: self.segments.iter().map(moved).collect(),
        }
    }

    /// The part of a closed curve that begins at `from_m` and is `length_m` long; it may pass the
    /// curve's start.
    pub fn around(&self, from_m: f64, length_m: f64) -> Path {
        let total = self.length_m();
        let from = from_m.rem_euclid(total);
        let to = from + length_m;
        let mut segments = self.cut(from, to.min(total)).segments;
        if to > total {
            segments.extend(self.cut(0.0, to - total).segments);
        }
        Path { segments }
    }

    /// From `a` to `b` through rounded corners.
    pub fn rounded(a: P2, bends: &[Bend], b: P2) -> Path {
        let mut segments = Vec::new();
        let mut from = a;
        for (i, bend) in bends.iter().enumerate() {
            let next = bends.get(i + 1).map_or(b, |n| n.corner_m);
            let (u, v) = (
                (bend.corner_m - from).normalize(),
                (next - bend.corner_m).normalize(),
            );
            // A single corner between legs of equal length may use both legs completely.
            let whole = bends.len() == 1
                && ((bend.corner_m - from).norm() - (next - bend.corner_m).norm()).abs() < 1e-6;
            let turn = cross(u, v).atan2(u.dot(&v));
            let ahead = if whole { 1.0 } else { 0.49 } * (next - bend.corner_m).norm();
            let tangent = (bend.radius_m * (0.5 * turn.abs()).tan())
                .min(ahead)
                .min((bend.corner_m - from).norm());
            let radius = tangent / (0.5 * turn.abs()).tan();
            let arc_start = bend.corner_m - u * tangent;
            segments.push(Segment::line(from, arc_start));
            let arc = Segment {
                start_m: arc_start,
                heading_rad: heading(u),
                length_m: radius * turn.abs(),
                curvature_per_m: turn.signum() / radius,
            };
            segments.push(arc);
            from = bend.corner_m + v * tangent;
        }
        if (b - from).norm() > 1e-6 {
            segments.push(Segment::line(from, b));
        }
        segments.retain(|segment| segment.length_m > 1e-6);
        Path { segments }
    }

    /// The part from `from` to `to` metres.
    pub fn cut(&self, from_m: f64, to_m: f64) -> Path {
        let mut segments = Vec::new();
        let mut s = 0.0;
        for segment in &self.segments {
            let (a, b) = ((from_m - s).max(0.0), (to_m - s).min(segment.length_m));
            if b - a > 1e-6 {
                let (start_m, heading_rad) = segment.at(a);
                segments.push(Segment {
                    start_m,
                    heading_rad,
                    length_m: b - a,
                    ..*segment
                });
            }
            s += segment.length_m;
        }
        Path { segments }
    }

    /// A smooth curve from pose to pose: a line, line–arc–line, or two arcs. Arcs of a single turn
    /// are at most `max_radius_m` wide.
    pub fn connect(from: (P2, f64), to: (P2, f64), max_radius_m: f64) -> Path {
        let (u, v, d) = (unit(from.1), unit(to.1), to.0 - from.0);
        let turn = wrap(to.1 - from.1);
        if turn.abs() < 1e-9 && cross(u, d).abs() < 1e-7 && u.dot(&d) > 0.0 {
            return Path {
                segments: vec![Segment::line(from.0, to.0)],
            };
        }
        let sine = cross(u, v);
        if sine.abs() > 1e-6 {
            let (a, b) = (cross(d, v) / sine, cross(u, d) / sine);
            let half_tan = (0.5 * turn.abs()).tan();
            let tangent = a.min(b).min(max_radius_m * half_tan);
            if tangent > 0.0 && tangent / half_tan > 3.0 && tangent > 0.2 * a.max(b).min(12.0) {
                return line_arc_line(from, to, turn, (a, b), tangent);
            }
        }
        two_arcs(from, to)
    }

    /// A single rounded corner of this radius where the directions meet; two arcs where they do
    /// not.
    pub fn corner(from: (P2, f64), to: (P2, f64), radius_m: f64) -> Path {
        let (u, v, d) = (unit(from.1), unit(to.1), to.0 - from.0);
        let (turn, sine) = (wrap(to.1 - from.1), cross(u, v));
        if sine.abs() > 1e-6 {
            let reach = (cross(d, v) / sine, cross(u, d) / sine);
            let tangent = reach
                .0
                .min(reach.1)
                .min(radius_m * (0.5 * turn.abs()).tan());
            if tangent > 0.05 {
                return line_arc_line(from, to, turn, reach, tangent);
            }
        }
        Path::connect(from, to, f64::INFINITY)
    }

    /// Stations such that chords deviate little from the curve and no step exceeds `max_step_m`;
    /// both ends included.
    pub fn stations(&self, max_step_m: f64) -> Vec<f64> {
        let mut stations = vec![0.0];
        let mut s = 0.0;
        for segment in &self.segments {
            let by_angle = segment.length_m * segment.curvature_per_m.abs() / 0.12;
            let n = (segment.length_m / max_step_m)
                .ceil()
                .max(by_angle.ceil())
                .max(1.0) as usize;
            stations.extend((1..=n).map(|i| s + segment.length_m * i as f64 / n as f64));
            s += segment.length_m;
        }
        stations
    }
}

fn line_arc_line(
    from: (P2, f64),
    to: (P2, f64),
    turn: f64,
    reach: (f64, f64),
    tangent: f64,
) -> Path {
    let radius = tangent / (0.5 * turn.abs()).tan();
    let mut segments = Vec::new();
    let first = reach.0 - tangent;
    if first > 1e-6 {
        segments.push(Segment {
            start_m: from.0,
            heading_rad: from.1,
            length_m: first,
            curvature_per_m: 0.0,
        });
    }
    let arc_start = from.0 + unit(from.1) * first;
    segments.push(Segment {
        start_m: arc_start,
        heading_rad: from.1,
        length_m: radius * turn.abs(),
        curvature_per_m: turn.signum() / radius,
    });
    let last = reach.1 - tangent;
    if last > 1e-6 {
        segments.push(Segment {
            start_m: to.0 - unit(to.1) * last,
            heading_rad: to.1,
            length_m: last,
            curvature_per_m: 0.0,
        });
    }
    Path { segments }
}

/// Two arcs with equal tangent lengths.
fn two_arcs(from: (P2, f64), to: (P2, f64)) -> Path {
    let (u, v, d) = (unit(from.1), unit(to.1), to.0 - from.0);
    let (sum, bend) = (u + v, 2.0 * (1.0 - u.dot(&v)));
    let along = d.dot(&sum);
    let reach = if bend < 1e-9 {
        d.norm_squared() / (4.0 * d.dot(&v))
    } else {
        ((along * along + bend * d.norm_squared()).sqrt() - along) / bend
    };
    let middle = 0.5 * ((from.0 + u * reach) + (to.0 - v * reach));
    let arc = |start_m: P2, heading_rad: f64, end: P2| {
        let chord = end - start_m;
        let w = unit(heading_rad);
        let turn = 2.0 * cross(w, chord).atan2(w.dot(&chord));
        let curvature_per_m = 2.0 * cross(w, chord) / chord.norm_squared();
        let length_m = if turn.abs() < 1e-9 {
            chord.norm()
        } else {
            turn / curvature_per_m
        };
        Segment {
            start_m,
            heading_rad,
            length_m,
            curvature_per_m: if turn.abs() < 1e-9 {
                0.0
            } else {
                curvature_per_m
            },
        }
    };
    let first = arc(from.0, from.1, middle);
    let second = arc(middle, first.at(first.length_m).1, to.0);
    Path {
        segments: vec![first, second],
    }
}

/// Signed area, counter-clockwise positive.
pub fn area(polygon: &[P2]) -> f64 {
    (0..polygon.len())
        .map(|i| 0.5 * cross(polygon[i], polygon[(i + 1) % polygon.len()]))
        .sum()
}

/// Whether a point lies inside.
pub fn contains(polygon: &[P2], p: P2) -> bool {
    let mut inside = false;
    for i in 0..polygon.len() {
        let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x) {
            inside = !inside;
        }
    }
    inside
}

/// The point without its height.
pub fn flat(p: [f64; 3]) -> P2 {
    P2::new(p[0], p[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connections_end_where_they_should() {
        for (x, y, turn) in [
            (20.0, 0.0, 0.0),
            (20.0, 1.5, 0.0),
            (12.0, 12.0, 1.57),
            (12.0, -12.0, -1.4),
            (25.0, 2.0, 0.2),
            (20.0, -8.0, 0.3),
        ] {
            let from = (P2::new(3.0, 4.0), 0.4);
            let rotate = |p: P2| unit(0.4) * p.x + left(unit(0.4)) * p.y;
            let to = (from.0 + rotate(P2::new(x, y)), 0.4 + turn);
            let path = Path::connect(from, to, f64::INFINITY);
            let (p, h) = path.at(path.length_m());
            assert!(
                (p - to.0).norm() < 1e-9 && wrap(h - to.1).abs() < 1e-9,
                "{x} {y} {turn}: {p} {h}"
            );
            for pair in path.segments.windows(2) {
                let (p, h) = pair[0].at(pair[0].length_m);
                assert!(
                    (p - pair[1].start_m).norm() < 1e-9
                        && wrap(h - pair[1].heading_rad).abs() < 1e-9
                );
            }
        }
    }

    #[test]
    fn a_cut_path_keeps_its_points() {
        let path = Path::rounded(
            P2::zeros(),
            &[Bend {
                corner_m: P2::new(50.0, 0.0),
                radius_m: 20.0,
            }],
            P2::new(50.0, 60.0),
        );
        let cut = path.cut(10.0, 70.0);
        assert!((cut.length_m() - 60.0).abs() < 1e-9);
        for s in [0.0, 13.0, 31.0, 60.0] {
            assert!((cut.at(s).0 - path.at(s + 10.0).0).norm() < 1e-9);
        }
    }
}
