//! Lots of houses along the streets of a block.

use crate::geometry::{P2, contains, cross, left};
use crate::ground::Ring;
use crate::plan::Houses;
use crate::random::Random;

/// A house before it is built.
#[derive(Clone, Debug)]
pub struct Lot {
    /// Footprint, counter-clockwise; the first edge faces the street.
    pub footprint_m: [P2; 4],
}

/// How houses stand along a street.
#[derive(Clone, Copy, Debug)]
struct Manner {
    width_m: (f64, f64),
    depth_m: (f64, f64),
    /// Distance from the back of the pavement.
    setback_m: f64,
    /// Share of houses with a wide gap behind them.
    gaps: f64,
    gap_m: (f64, f64),
    close_m: f64,
}

impl Manner {
    fn of(houses: Houses) -> Manner {
        let row = Manner {
            width_m: (13.0, 27.0),
            depth_m: (11.0, 16.0),
            setback_m: 0.05,
            gaps: 0.12,
            gap_m: (3.5, 3.5),
            close_m: 0.04,
        };
        match houses {
            Houses::Towers { .. } => row,
            Houses::Terraces => Manner {
                width_m: (8.0, 15.0),
                depth_m: (8.0, 11.5),
                gaps: 0.08,
                ..row
            },
            Houses::Cottages => Manner {
                width_m: (9.0, 15.0),
                depth_m: (8.0, 10.5),
                setback_m: 3.2,
                gaps: 0.35,
                gap_m: (7.0, 16.0),
                close_m: 3.0,
            },
            Houses::Farms => Manner {
                width_m: (10.0, 19.0),
                depth_m: (8.0, 11.0),
                setback_m: 5.5,
                gaps: 0.8,
                gap_m: (25.0, 110.0),
                close_m: 5.0,
            },
        }
    }
}

/// Lots along the inside of a ring: as many as fit without overlapping.
pub fn lots(ring: &Ring, houses: Houses, random: &mut Random) -> Vec<Lot> {
    let manner = Manner::of(houses);
    let border: Vec<P2> = ring.back_m.clone();
    let n = border.len();
    let mut lengths = vec![0.0];
    for i in 0..n {
        lengths.push(lengths[i] + (border[(i + 1) % n] - border[i]).norm());
    }
    let total = lengths[n];
    let at = |l: f64| {
        let l = l.rem_euclid(total);
        let i = lengths.partition_point(|&x| x <= l).clamp(1, n) - 1;
        border[i]
            + (border[(i + 1) % n] - border[i])
                * ((l - lengths[i]) / (lengths[i + 1] - lengths[i]).max(1e-9))
    };
    let place = |l: f64| {
        lengths
            .partition_point(|&x| x <= l.rem_euclid(total))
            .clamp(1, n)
            - 1
    };
    let faces_a_street = |from: f64, to: f64| {
        [from, 0.5 * (from + to), to]
            .into_iter()
            .all(|l| ring.fronted[place(l)])
    };
    let mut lots: Vec<Lot> = Vec::new();
    let mut l = 0.0;
    while l < total - 6.0 {
        let wanted = random.between(manner.width_m.0, manner.width_m.1);
        let depth = random.between(manner.depth_m.0, manner.depth_m.1);
        let fitting = [1.0, 0.75, 0.55, 0.45]
            .iter()
            .map(|share| wanted * share)
            .find_map(|width| {
                if !faces_a_street(l, l + width) {
                    return None;
                }
                let lot = lot_at(&at, (l, l + width), depth, manner.setback_m)?;
                (fits(&lot, ring) && !lots.iter().any(|other| overlap(&lot, other)))
                    .then_some((lot, width))
            });
        match fitting {
            Some((lot, width)) => {
                lots.push(lot);
                let gap = if random.chance(manner.gaps) {
                    manner.gap_m.0 + (manner.gap_m.1 - manner.gap_m.0) * width / wanted * 0.5
                } else {
                    manner.close_m
                };
                l += width + gap;
            }
            None => l += 1.0,
        }
    }
    lots
}

fn lot_at(at: &impl Fn(f64) -> P2, (from, to): (f64, f64), depth: f64, back_m: f64) -> Option<Lot> {
    let (a, b) = (at(from), at(to));
    let chord = b - a;
    let inward = left(chord.normalize());
    // The house stands behind the pavement's back everywhere, but not far behind it.
    let mut setback = 0.05f64;
    for k in 1..6 {
        let away = (at(from + (to - from) * k as f64 / 6.0) - a).dot(&inward);
        if away < -0.8 {
            return None;
        }
        setback = setback.max(away + 0.05);
    }
    if setback > 0.8 || chord.norm() < 0.93 * (to - from) {
        return None;
    }
    let setback = setback + back_m - 0.05;
    let (a, b) = (a + inward * setback, b + inward * setback);
    Some(Lot {
        footprint_m: [a, b, b + inward * depth, a + inward * depth],
    })
}

/// Whether a lot lies within its block.
pub fn fits(lot: &Lot, ring: &Ring) -> bool {
    let inside = |p: P2| contains(&ring.back_m, p) != ring.outside;
    let corners = &lot.footprint_m;
    let middle = corners.iter().sum::<P2>() / 4.0;
    (0..4).all(|i| {
        (0..4).all(|k| {
            let p = corners[i] + (corners[(i + 1) % 4] - corners[i]) * (k as f64 / 4.0);
            inside(p + (middle - p) * 0.002)
        })
    }) && !ring
        .back_m
        .iter()
        .any(|&p| contains(corners, p + (p - middle).normalize() * 0.05))
}

/// Whether two lots have ground in common.
pub fn overlap(a: &Lot, b: &Lot) -> bool {
    let separated = |p: &[P2; 4], q: &[P2; 4]| {
        (0..4).any(|i| {
            let edge = p[(i + 1) % 4] - p[i];
            q.iter().all(|&corner| cross(edge, corner - p[i]) < 0.01)
        })
    };
    !separated(&a.footprint_m, &b.footprint_m) && !separated(&b.footprint_m, &a.footprint_m)
}
