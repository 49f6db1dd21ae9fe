//! Which places are covered by lanes, and how high the lanes are there.

use std::collections::HashMap;

use schema_roads::{LaneKind, SectionSurface};

use crate::geometry::{P2, cross, flat, unit};

/// Side of the cells in which pieces of lanes are looked up.
const CELL_M: f64 = 6.0;
/// Greatest number of cells in which one piece is listed.
const MAX_CELLS: i64 = 4096;

/// A piece of a lane between two rows.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// Right, right, left, left: counter-clockwise from above.
    corners_m: [[f64; 3]; 4],
    road: u32,
    for_vehicles: bool,
}

/// Pieces of all lanes by place.
pub(super) struct Cover {
    pieces: Vec<Piece>,
    cells: HashMap<(i32, i32), Vec<u32>>,
}

/// Whether vehicles drive on lanes of this kind.
pub(super) fn is_for_vehicles(kind: LaneKind) -> bool {
    use LaneKind as K;
    !matches!(
        kind,
        K::Sidewalk | K::Kerb | K::Median | K::Border | K::Other | K::Shoulder
    )
}

impl Cover {
    /// Every lane of these sections.
    pub fn new(sections: &[SectionSurface]) -> Cover {
        let mut cover = Cover {
            pieces: Vec::new(),
            cells: HashMap::new(),
        };
        for section in sections {
            for lane in &section.lanes {
                for row in 1..section.stations_m.len() {
                    let (a, b) = (lane.row(row - 1), lane.row(row));
                    let corners_m = [a[0], b[0], b[lane.columns - 1], a[lane.columns - 1]];
                    cover.add(Piece {
                        corners_m,
                        road: section.road,
                        for_vehicles: is_for_vehicles(lane.kind),
                    });
                }
            }
        }
        cover
    }

    fn add(&mut self, piece: Piece) {
        let span = |axis: usize| {
            let (low, high) = piece
                .corners_m
                .iter()
                .fold((f64::MAX, f64::MIN), |(l, h), p| {
                    (l.min(p[axis]), h.max(p[axis]))
                });
            (
                (low / CELL_M).floor() as i32,
                (high / CELL_M).floor() as i32,
            )
        };
        let ((x0, x1), (y0, y1)) = (span(0), span(1));
        if (i64::from(x1) - i64::from(x0) + 1).saturating_mul(i64::from(y1) - i64::from(y0) + 1)
            > MAX_CELLS
        {
            return;
        }
        let idx = self.pieces.len() as u32;
        self.pieces.push(piece);
        for x in x0..=x1 {
            (y0..=y1).for_each(|y| self.cells.entry((x, y)).or_default().push(idx));
        }
    }

    fn at(&self, p: P2) -> impl Iterator<Item = (&Piece, f64)> {
        let cell = ((p.x / CELL_M).floor() as i32, (p.y / CELL_M).floor() as i32);
        let near = self.cells.get(&cell).map_or(&[][..], Vec::as_slice);
        near.iter()
            .map(|idx| &self.pieces[*idx as usize])
            .filter_map(move |piece| Some((piece, piece.height_at(p)?)))
    }

    /// Whether any lane lies here.
    pub fn is_covered(&self, p: P2) -> bool {
        self.at(p).next().is_some()
    }

    /// Height of the highest lane here.
    pub fn height_at(&self, p: P2) -> Option<f64> {
        self.at(p).map(|(_, z)| z).max_by(f64::total_cmp)
    }

    /// Whether any lane lies within about `margin_m`.
    pub fn is_near(&self, p: P2, margin_m: f64) -> bool {
        let ring = (0..8).map(|k| p + unit(f64::from(k) * std::f64::consts::FRAC_PI_4) * margin_m);
        std::iter::once(p).chain(ring).any(|q| self.is_covered(q))
    }

    /// Height of the highest lane for vehicles here.
    pub fn vehicles_at(&self, p: P2) -> Option<f64> {
        self.at(p)
            .filter(|(piece, _)| piece.for_vehicles)
            .map(|(_, z)| z)
            .max_by(f64::total_cmp)
    }

    /// Whether a lane for vehicles lies within about `margin_m`.
    pub fn vehicles_near(&self, p: P2, margin_m: f64) -> bool {
        let ring = (0..8).map(|k| p + unit(f64::from(k) * std::f64::consts::FRAC_PI_4) * margin_m);
        std::iter::once(p)
            .chain(ring)
            .any(|q| self.vehicles_at(q).is_some())
    }

    /// Whether vehicles of another road pass here at about this height.
    pub fn crossed_by_others(&self, p: P2, z_m: f64, road: u32) -> bool {
        self.at(p)
            .any(|(piece, z)| piece.for_vehicles && piece.road != road && (z - z_m).abs() < 1.5)
    }

    /// Whether a road other than `road` lies here within 4 m of the height `z_m`.
    pub fn others_near(&self, p: P2, z_m: f64, road: u32) -> bool {
        self.at(p)
            .any(|(piece, z)| piece.road != road && (z - z_m).abs() < 4.0)
    }
}

impl Piece {
    /// Height of the piece at a point on it.
    fn height_at(&self, p: P2) -> Option<f64> {
        let [a, b, c, d] = self.corners_m;
        height_in([a, b, c], p).or_else(|| height_in([a, c, d], p))
    }
}

/// Height of a triangle at a point inside it, whichever way it turns.
pub(super) fn height_in(corners: [[f64; 3]; 3], p: P2) -> Option<f64> {
    let [a, b, c] = corners.map(flat);
    let area = cross(b - a, c - a);
    if area.abs() < 1e-9 {
        return None;
    }
    let w = [
        cross(c - b, p - b) / area,
        cross(a - c, p - c) / area,
        cross(b - a, p - a) / area,
    ];
    (w.iter().all(|w| *w >= -1e-9)).then(|| (0..3).map(|i| w[i] * corners[i][2]).sum())
}
