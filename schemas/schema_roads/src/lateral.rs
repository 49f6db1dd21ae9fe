//! The road's shape across its reference plane: `<shape>`, `<crossfall>`, and the height of single
//! lanes.

use crate::profile::Profile;

/// One `<shape>`: a cubic of the distance across, which applies from `t_m` on to the left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ShapeRecord {
    pub s_m: f64,
    pub t_m: f64,
    pub coefficients: [f64; 4],
}

/// Height of one lane over the road from a station on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LaneHeight {
    pub s_offset_m: f64,
    pub inner_m: f64,
    pub outer_m: f64,
}

/// Heights across a road, measured from its superelevated plane.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lateral {
    /// Records by rising s, then t.
    shapes: Vec<ShapeRecord>,
    /// Index in `shapes` of the first record of each station.
    starts: Vec<usize>,
    /// Angle at which the road falls away from the reference line, radians: right, left.
    crossfall: [Profile; 2],
}

impl Lateral {
    /// Shapes in any order; crossfall of the right and of the left side.
    pub fn new(mut shapes: Vec<ShapeRecord>, crossfall: [Profile; 2]) -> Lateral {
        shapes.sort_by(|a, b| a.s_m.total_cmp(&b.s_m).then(a.t_m.total_cmp(&b.t_m)));
        let starts = (0..shapes.len())
            .filter(|i| *i == 0 || shapes[*i].s_m > shapes[*i - 1].s_m)
            .collect();
        Lateral {
            shapes,
            starts,
            crossfall,
        }
    }

    /// Whether every road's cross-section is a plane.
    pub fn is_plane(&self) -> bool {
        self.shapes.is_empty() && self.crossfall.iter().all(Profile::is_empty)
    }

    /// Height at (s, t) and its slope towards the left.
    pub fn at(&self, s_m: f64, t_m: f64) -> (f64, f64) {
        if self.is_plane() {
            return (0.0, 0.0);
        }
        let (mut height, mut slope) = self.shape(s_m, t_m);
        let side = &self.crossfall[usize::from(t_m >= 0.0)];
        if !side.is_empty() {
            let fall = side.at(s_m).0.clamp(-1.2, 1.2).tan();
            height -= t_m.abs() * fall;
            slope -= fall * if t_m >= 0.0 { 1.0 } else { -1.0 };
        }
        (height, slope)
    }

    /// Between two stations with shapes the height changes linearly.
    fn shape(&self, s_m: f64, t_m: f64) -> (f64, f64) {
        if self.starts.is_empty() {
            return (0.0, 0.0);
        }
        let after = self.starts.partition_point(|i| self.shapes[*i].s_m <= s_m);
        let before = after.saturating_sub(1);
        let (h0, d0) = self.across(before, t_m);
        if after == 0 || after == self.starts.len() {
            return (h0, d0);
        }
        let (h1, d1) = self.across(after, t_m);
        let (s0, s1) = (
            self.shapes[self.starts[before]].s_m,
            self.shapes[self.starts[after]].s_m,
        );
        let share = (s_m - s0) / (s1 - s0);
        (h0 + share * (h1 - h0), d0 + share * (d1 - d0))
    }

    fn across(&self, group: usize, t_m: f64) -> (f64, f64) {
        let end = self
            .starts
            .get(group + 1)
            .copied()
            .unwrap_or(self.shapes.len());
        let records = &self.shapes[self.starts[group]..end];
        let record = records[records.partition_point(|r| r.t_m <= t_m).saturating_sub(1)];
        let x = t_m - record.t_m;
        let [a, b, c, d] = record.coefficients;
        (
            a + x * (b + x * (c + x * d)),
            b + x * (2.0 * c + x * 3.0 * d),
        )
    }

    /// Stations at which something begins.
    pub fn stations(&self) -> impl Iterator<Item = f64> + '_ {
        self.starts
            .iter()
            .map(|i| self.shapes[*i].s_m)
            .chain(self.crossfall.iter().flat_map(Profile::starts))
    }
}

/// Inner and outer height of a lane `ds_m` after its section's start: those of the last record that
/// has begun.
pub(crate) fn lane_height(records: &[LaneHeight], ds_m: f64) -> (f64, f64) {
    let after = records.partition_point(|r| r.s_offset_m <= ds_m + 1e-9);
    let record = records.get(after.saturating_sub(1)).filter(|_| after > 0);
    record.map_or((0.0, 0.0), |r| (r.inner_m, r.outer_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::Cubic;

    #[test]
    fn shapes_join_evenly_between_their_stations() {
        let shape = |s_m, t_m, a, b| ShapeRecord {
            s_m,
            t_m,
            coefficients: [a, b, 0.0, 0.0],
        };
        let lateral = Lateral::new(
            vec![
                shape(0.0, -5.0, 0.0, 0.0),
                shape(10.0, -5.0, 0.0, 0.02),
                shape(10.0, 0.0, 0.1, -0.04),
            ],
            Default::default(),
        );
        assert_eq!(lateral.at(0.0, 3.0), (0.0, 0.0));
        let (h, d) = lateral.at(10.0, 2.0);
        assert!((h - 0.02).abs() < 1e-12 && (d + 0.04).abs() < 1e-12);
        let (h, d) = lateral.at(5.0, 2.0);
        assert!((h - 0.01).abs() < 1e-12 && (d + 0.02).abs() < 1e-12);
    }

    #[test]
    fn crossfall_falls_to_both_sides() {
        let fall = Profile::new(vec![Cubic {
            s_m: 0.0,
            coefficients: [0.02, 0.0, 0.0, 0.0],
        }]);
        let lateral = Lateral::new(Vec::new(), [fall.clone(), fall]);
        let tan = 0.02f64.tan();
        assert_eq!(lateral.at(3.0, 4.0), (-4.0 * tan, -tan));
        assert_eq!(lateral.at(3.0, -4.0), (-4.0 * tan, tan));
    }
}
