//! Heights along a road.

/// A piece of the height profile: a cubic of the distance from its start, level at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Station where it begins.
    pub s_m: f64,
    /// Height there.
    pub a_m: f64,
    /// Factor of the square, 1/m.
    pub c: f64,
    /// Factor of the cube, 1/m².
    pub d: f64,
}

/// Height of a road's reference line over its length; level at both ends, so that junctions can be
/// level.
#[derive(Clone, Debug, PartialEq)]
pub struct Elevation {
    /// In order; the first begins at 0.
    pub pieces: Vec<Piece>,
}

impl Elevation {
    /// A profile from one height to another over `length_m`. `rises_m` gives heights over the
    /// straight line between both, at shares of the length.
    pub fn between(length_m: f64, from_m: f64, to_m: f64, rises_m: &[(f64, f64)]) -> Elevation {
        let mut knots = vec![(0.0, from_m)];
        knots.extend(
            rises_m.iter().map(|&(share, rise_m)| {
                (share * length_m, from_m + (to_m - from_m) * share + rise_m)
            }),
        );
        knots.push((length_m, to_m));
        let piece = |pair: &[(f64, f64)]| {
            let ((s_m, a_m), (end_m, b_m)) = (pair[0], pair[1]);
            let (length, rise) = (end_m - s_m, b_m - a_m);
            Piece {
                s_m,
                a_m,
                c: 3.0 * rise / length.powi(2),
                d: -2.0 * rise / length.powi(3),
            }
        };
        Elevation {
            pieces: knots.windows(2).map(piece).collect(),
        }
    }

    /// Height at a station.
    pub fn at(&self, s_m: f64) -> f64 {
        let piece = self
            .pieces
            .iter()
            .rev()
            .find(|piece| piece.s_m <= s_m)
            .unwrap_or(&self.pieces[0]);
        let u = s_m - piece.s_m;
        piece.a_m + u * u * (piece.c + u * piece.d)
    }

    /// Stations whose chords deviate by at most 3 mm in height, each with the distance to its
    /// neighbours; both ends included.
    pub fn steps(&self, length_m: f64) -> Vec<(f64, f64)> {
        let mut steps = vec![(0.0, 0.0)];
        for (i, piece) in self.pieces.iter().enumerate() {
            let end = self.pieces.get(i + 1).map_or(length_m, |next| next.s_m);
            let length = end - piece.s_m;
            // A cubic that is level at both ends has its greatest curvature at its ends.
            let wanted = (8.0 * 0.003 / (2.0 * piece.c.abs()).max(1e-9))
                .sqrt()
                .clamp(2.5, 16.0);
            let n = (length / wanted).ceil().max(1.0);
            steps.extend((1..=n as usize).map(|k| (piece.s_m + length * k as f64 / n, length / n)));
        }
        steps
    }

    /// Whether the whole road has one height.
    pub fn is_level(&self) -> bool {
        self.pieces
            .iter()
            .all(|piece| piece.c == 0.0 && piece.d == 0.0)
    }
}
