//! Piecewise cubics along a road: elevation, superelevation, lane offset, lane width.

/// `a + b·x + c·x² + d·x³` from `s_m` on, with x measured from there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cubic {
    pub s_m: f64,
    pub coefficients: [f64; 4],
}

/// Cubics by rising start.
#[derive(Clone, Debug, Default)]
pub(crate) struct Profile(Vec<Cubic>);

impl Profile {
    /// Sorts the cubics by start; of two with the same start the later one counts.
    pub fn new(mut cubics: Vec<Cubic>) -> Self {
        cubics.sort_by(|a, b| a.s_m.total_cmp(&b.s_m));
        Profile(cubics)
    }

    /// Whether it is 0 everywhere.
    pub fn is_zero(&self) -> bool {
        self.0.iter().all(|c| c.coefficients == [0.0; 4])
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Stations at which a record begins.
    pub fn starts(&self) -> impl Iterator<Item = f64> + '_ {
        self.0.iter().map(|c| c.s_m)
    }

    /// Value and slope at `s_m`. Before the first start the first cubic continues backwards;
    /// without cubics both are 0.
    pub fn at(&self, s_m: f64) -> (f64, f64) {
        let after = self.0.partition_point(|c| c.s_m <= s_m + 1e-9);
        let Some(cubic) = self.0.get(after.saturating_sub(1)) else {
            return (0.0, 0.0);
        };
        let x = s_m - cubic.s_m;
        let [a, b, c, d] = cubic.coefficients;
        (
            a + x * (b + x * (c + x * d)),
            b + x * (2.0 * c + x * 3.0 * d),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_record_in_force_is_the_last_one_begun() {
        let cubic = |s_m, coefficients| Cubic { s_m, coefficients };
        let p = Profile::new(vec![
            cubic(10.0, [5.0, 0.0, 1.0, 0.0]),
            cubic(0.0, [1.0, 2.0, 0.0, 0.0]),
        ]);
        assert_eq!(p.at(4.0), (9.0, 2.0));
        assert_eq!(p.at(12.0), (9.0, 4.0));
        assert_eq!(Profile::default().at(3.0), (0.0, 0.0));
    }
}
