//! Plan-view geometry of a reference line in f64: line, arc, clothoid, cubic and parametric cubic.
//!
//! Every curve is evaluated from its definition. Clothoids are integrated with Gauss–Legendre
//! quadrature; cubics are inverted from arc length with a table and Newton steps.

/// Point, heading and curvature on a plan-view curve.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PlanPoint {
    pub x_m: f64,
    pub y_m: f64,
    pub heading_rad: f64,
    pub curvature_per_m: f64,
}

/// Nodes and weights of the five-point Gauss–Legendre rule on [−1, 1].
const GAUSS: [(f64, f64); 5] = [
    (0.0, 0.568_888_888_888_888_9),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];

/// Most intervals of an arc-length table.
const MAX_INTERVALS: usize = 4096;
/// Greatest turn for which one application of the rule is exact to rounding, radians.
const TURN_PER_PIECE_RAD: f64 = 0.5;

/// Shape of a geometry record.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    Arc { curvature_per_m: f64 },
    Spiral(Spiral),
    Param(ParamCurve),
}

/// One `<geometry>`: a curve from its own start.
#[derive(Clone, Debug)]
pub(crate) struct Geometry {
    pub s_m: f64,
    pub x_m: f64,
    pub y_m: f64,
    pub heading_rad: f64,
    pub length_m: f64,
    pub shape: Shape,
}

impl Geometry {
    /// The curve's point `ds_m` after its start. Beyond its ends the curve continues by its own
    /// definition.
    pub fn at(&self, ds_m: f64) -> PlanPoint {
        let (u, v, turn, curvature_per_m) = match &self.shape {
            Shape::Arc { curvature_per_m } => arc(*curvature_per_m, ds_m),
            Shape::Spiral(spiral) => spiral.at(ds_m),
            Shape::Param(curve) => curve.at(ds_m),
        };
        let (sin, cos) = self.heading_rad.sin_cos();
        PlanPoint {
            x_m: self.x_m + cos * u - sin * v,
            y_m: self.y_m + sin * u + cos * v,
            heading_rad: self.heading_rad + turn,
            curvature_per_m,
        }
    }
}

/// Displacement (u, v), turn and curvature of an arc; a straight line is curvature 0.
fn arc(k: f64, s: f64) -> (f64, f64, f64, f64) {
    let turn = k * s;
    // sin(x)/x and (1 − cos x)/x without cancellation near zero.
    let half = 0.5 * turn;
    let sinc_half = if half.abs() < 1e-6 {
        1.0 - half * half / 6.0
    } else {
        half.sin() / half
    };
    (
        s * sinc_half * half.cos(),
        s * sinc_half * half.sin(),
        turn,
        k,
    )
}

/// A clothoid, with the points at the ends of equal pieces integrated in advance.
#[derive(Clone, Debug)]
pub(crate) struct Spiral {
    start_per_m: f64,
    rate_per_m2: f64,
    piece_m: f64,
    knots: Vec<[f64; 2]>,
}

impl Spiral {
    /// A clothoid whose curvature changes linearly from start to end. Curves tighter than the
    /// number of pieces allows are approximated coarsely.
    pub fn new(start_per_m: f64, end_per_m: f64, length_m: f64) -> Spiral {
        let most = (4.0 * length_m).clamp(8.0, MAX_INTERVALS as f64);
        let pieces = (length_m * start_per_m.abs().max(end_per_m.abs()) / TURN_PER_PIECE_RAD)
            .ceil()
            .clamp(1.0, most);
        let mut spiral = Spiral {
            start_per_m,
            rate_per_m2: (end_per_m - start_per_m) / length_m,
            piece_m: length_m / pieces,
            knots: vec![[0.0; 2]],
        };
        for piece in 1..=pieces as usize {
            spiral
                .knots
                .push(spiral.beyond_knot(piece - 1, piece as f64 * spiral.piece_m));
        }
        spiral
    }

    fn turn(&self, s: f64) -> f64 {
        s * (self.start_per_m + 0.5 * self.rate_per_m2 * s)
    }

    /// The point at `s`, integrated from a knot.
    fn beyond_knot(&self, knot: usize, s: f64) -> [f64; 2] {
        let from = knot as f64 * self.piece_m;
        let (middle, half) = (0.5 * (from + s), 0.5 * (s - from));
        let [mut u, mut v] = self.knots[knot];
        for (node, weight) in GAUSS {
            let (sin, cos) = self.turn(middle + half * node).sin_cos();
            u += half * weight * cos;
            v += half * weight * sin;
        }
        [u, v]
    }

    fn at(&self, s: f64) -> (f64, f64, f64, f64) {
        let knot = ((s / self.piece_m).max(0.0) as usize).min(self.knots.len() - 1);
        let [u, v] = self.beyond_knot(knot, s);
        (u, v, self.turn(s), self.start_per_m + self.rate_per_m2 * s)
    }
}

/// A parametric cubic with its arc length tabulated over equal steps of the parameter.
#[derive(Clone, Debug)]
pub(crate) struct ParamCurve {
    u: [f64; 4],
    v: [f64; 4],
    parameter_end: f64,
    arc_m: Vec<f64>,
    /// Arc length of the curve divided by the length that the file states.
    arc_per_length: f64,
}

fn poly(c: &[f64; 4], p: f64) -> (f64, f64, f64) {
    let value = c[0] + p * (c[1] + p * (c[2] + p * c[3]));
    let first = c[1] + p * (2.0 * c[2] + p * 3.0 * c[3]);
    (value, first, 2.0 * c[2] + 6.0 * c[3] * p)
}

impl ParamCurve {
    /// The curve over the parameters 0..`parameter_end`, whose ends are the ends of the record;
    /// `None` if it is degenerate.
    pub fn new(u: [f64; 4], v: [f64; 4], parameter_end: f64, length_m: f64) -> Option<Self> {
        let arc_m = arc_table(&u, &v, parameter_end, length_m)?;
        let arc_per_length = arc_m.last()? / length_m;
        (arc_per_length.is_finite() && arc_per_length > 1e-6).then_some(ParamCurve {
            u,
            v,
            parameter_end,
            arc_m,
            arc_per_length,
        })
    }

    /// `v = a + b·u + c·u² + d·u³` as far as `length_m` along the curve.
    pub fn cubic(v: [f64; 4], length_m: f64) -> Option<Self> {
        let u = [0.0, 1.0, 0.0, 0.0];
        // |dr/du| ≥ 1, so u never exceeds the arc length.
        let whole = ParamCurve::new(u, v, length_m, length_m)?;
        let parameter_end = whole.parameter(length_m.min(*whole.arc_m.last()?));
        ParamCurve::new(u, v, parameter_end, length_m)
    }

    /// Metres by which the curve is longer than its record states.
    pub fn excess_m(&self, stated_m: f64) -> f64 {
        self.arc_m.last().copied().unwrap_or(0.0) - stated_m
    }

    fn speed(&self, p: f64) -> f64 {
        poly(&self.u, p).1.hypot(poly(&self.v, p).1)
    }

    /// Parameter at which the curve is `arc` metres long.
    fn parameter(&self, arc: f64) -> f64 {
        let intervals = self.arc_m.len() - 1;
        let idx = self
            .arc_m
            .partition_point(|a| *a <= arc)
            .clamp(1, intervals)
            - 1;
        let step = self.parameter_end / intervals as f64;
        let span = (self.arc_m[idx + 1] - self.arc_m[idx]).max(1e-12);
        let start = idx as f64 * step;
        let mut p = start + step * (arc - self.arc_m[idx]) / span;
        for _ in 0..3 {
            let error = self.arc_m[idx] + arc_length(&self.u, &self.v, start, p) - arc;
            p -= error / self.speed(p).max(1e-9);
        }
        p
    }

    fn at(&self, ds_m: f64) -> (f64, f64, f64, f64) {
        let p = self.parameter(ds_m * self.arc_per_length);
        let ((u, du, ddu), (v, dv, ddv)) = (poly(&self.u, p), poly(&self.v, p));
        let speed = du.hypot(dv).max(1e-9);
        (
            u,
            v,
            dv.atan2(du),
            (du * ddv - dv * ddu) / (speed * speed * speed),
        )
    }
}

/// Length of the curve between two parameters.
fn arc_length(u: &[f64; 4], v: &[f64; 4], from: f64, to: f64) -> f64 {
    let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
    GAUSS
        .iter()
        .map(|(node, weight)| {
            weight
                * poly(u, middle + half * node)
                    .1
                    .hypot(poly(v, middle + half * node).1)
        })
        .sum::<f64>()
        * half
}

fn arc_table(u: &[f64; 4], v: &[f64; 4], parameter_end: f64, length_m: f64) -> Option<Vec<f64>> {
    let intervals = (length_m.ceil() as usize).clamp(8, MAX_INTERVALS);
    let step = parameter_end / intervals as f64;
    let mut table = Vec::with_capacity(intervals + 1);
    let mut sum = 0.0;
    table.push(sum);
    for i in 0..intervals {
        sum += arc_length(u, v, i as f64 * step, (i + 1) as f64 * step);
        table.push(sum);
    }
    sum.is_finite().then_some(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn geometry(shape: Shape, length_m: f64) -> Geometry {
        Geometry {
            s_m: 0.0,
            x_m: 1.0,
            y_m: 2.0,
            heading_rad: 0.3,
            length_m,
            shape,
        }
    }

    #[test]
    fn arc_lies_on_its_circle() {
        let g = geometry(
            Shape::Arc {
                curvature_per_m: 0.05,
            },
            40.0,
        );
        let (cx, cy) = (1.0 - 20.0 * 0.3f64.sin(), 2.0 + 20.0 * 0.3f64.cos());
        for i in 0..=40 {
            let p = g.at(i as f64);
            assert!(((p.x_m - cx).hypot(p.y_m - cy) - 20.0).abs() < 1e-12);
            assert!((p.heading_rad - 0.3 - i as f64 * 0.05).abs() < 1e-12);
        }
    }

    #[test]
    fn spiral_agrees_with_fine_integration() {
        let g = geometry(Shape::Spiral(Spiral::new(-0.02, 0.16, 60.0)), 60.0);
        let (mut x, mut y) = (1.0, 2.0);
        let n = 600_000;
        for i in 0..n {
            let s = (i as f64 + 0.5) * 60.0 / n as f64;
            let heading = 0.3 - 0.02 * s + 0.0015 * s * s;
            x += heading.cos() * 60.0 / n as f64;
            y += heading.sin() * 60.0 / n as f64;
        }
        let p = g.at(60.0);
        assert!((p.x_m - x).hypot(p.y_m - y) < 1e-8, "{p:?} {x} {y}");
    }

    #[test]
    fn parametric_quarter_of_a_parabola_is_walked_at_unit_speed() {
        let (u, v) = ([0.0, 10.0, 5.0, 0.0], [0.0, 0.0, 12.0, -3.0]);
        let length = (0..1000)
            .map(|i| arc_length(&u, &v, i as f64 / 1000.0, (i + 1) as f64 / 1000.0))
            .sum::<f64>();
        let g = geometry(
            Shape::Param(ParamCurve::new(u, v, 1.0, length).unwrap()),
            length,
        );
        let mut walked = 0.0;
        let n = 20_000;
        for i in 0..n {
            let (a, b) = (
                g.at(length * i as f64 / n as f64),
                g.at(length * (i + 1) as f64 / n as f64),
            );
            walked += (a.x_m - b.x_m).hypot(a.y_m - b.y_m);
            assert!(((a.x_m - b.x_m).hypot(a.y_m - b.y_m) - length / n as f64).abs() < 1e-7);
        }
        assert!((walked - length).abs() < 1e-6);
    }

    #[test]
    fn cubic_ends_where_its_arc_length_says() {
        let curve = ParamCurve::cubic([0.0, 0.0, 0.02, -0.0003], 30.0).unwrap();
        assert!((arc_length(&curve.u, &curve.v, 0.0, curve.parameter_end) - 30.0).abs() < 1e-3);
    }
}
