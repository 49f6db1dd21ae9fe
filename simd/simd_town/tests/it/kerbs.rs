//! Kerbs and pavements stay out of the lanes, those of junctions too: the map's lanes against the
//! solid geometry.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use schema_roads::RoadMap;
use simd_town::Town;

/// Side of the cells in which triangles are looked up.
const CELL_M: f64 = 8.0;
/// Room between a junction's lanes and its kerbs, as in `network/kerb.rs`.
const CLEAR_M: f64 = 0.3;

/// Upward triangles of pavements, verges and yards by place.
struct Raised(BTreeMap<(i64, i64), Vec<[Vector3<f64>; 3]>>);

fn cell(x: f64, y: f64) -> (i64, i64) {
    ((x / CELL_M).floor() as i64, (y / CELL_M).floor() as i64)
}

impl Raised {
    fn of(town: &Town) -> Raised {
        let mesh = town
            .collision
            .iter()
            .find(|mesh| mesh.name == "pavement")
            .expect("a town has kerbs");
        let mut cells: BTreeMap<(i64, i64), Vec<[Vector3<f64>; 3]>> = BTreeMap::new();
        for corners in &mesh.triangles {
            let t = corners.map(|i| Vector3::from(mesh.vertices_m[i as usize]).cast::<f64>());
            let (low, high) = (t[0].inf(&t[1]).inf(&t[2]), t[0].sup(&t[1]).sup(&t[2]));
            let (low, high) = (cell(low.x, low.y), cell(high.x, high.y));
            for x in low.0..=high.0 {
                (low.1..=high.1).for_each(|y| cells.entry((x, y)).or_default().push(t));
            }
        }
        Raised(cells)
    }

    /// Height over `p` of the triangle there, if it is near `p`'s height; ground far below a bridge
    /// is not.
    fn over(&self, p: Vector3<f64>) -> Option<f64> {
        let heights = self.0.get(&cell(p.x, p.y))?.iter().filter_map(|t| {
            let weight = |a: Vector3<f64>, b: Vector3<f64>| {
                (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x)
            };
            let w = [weight(t[1], t[2]), weight(t[2], t[0]), weight(t[0], t[1])];
            let area: f64 = w.iter().sum();
            (area > 1e-6 && w.iter().all(|w| *w >= 0.0))
                .then(|| (0..3).map(|i| w[i] / area * t[i].z).sum::<f64>() - p.z)
        });
        heights
            .filter(|height| height.abs() < 1.0)
            .max_by(f64::total_cmp)
    }
}

#[test]
fn no_kerb_lies_in_a_lane() {
    let (mut n_probes, mut bad) = (0, Vec::new());
    for seed in 1..=4 {
        for name in Town::NAMES {
            let town = Town::generate(name, seed).expect("a name of the list");
            let roads = RoadMap::parse(&town.open_drive).expect("our own text");
            let raised = Raised::of(&town);
            let mut deepest: BTreeMap<(Option<u32>, u32), (f64, [f64; 3])> = BTreeMap::new();
            for lane in roads.lanes().iter().filter(|lane| lane.kind.is_drivable()) {
                let clear_m = if lane.junction.is_some() {
                    CLEAR_M
                } else {
                    0.0
                };
                let (left, right) = roads.boundaries(lane.key, 1.0);
                for (l, r) in left.into_iter().zip(right) {
                    let (l, r) = (Vector3::from(l), Vector3::from(r));
                    let width = (l - r).norm();
                    // From edge to edge and as much farther as must be clear, a centimetre less for
                    // rounding.
                    for k in 0..=10 {
                        let aside =
                            -clear_m + 0.01 + (width + 2.0 * clear_m - 0.02) * f64::from(k) / 10.0;
                        let p = r + (l - r) * (aside / width.max(1e-9));
                        n_probes += 1;
                        if let Some(height) = raised.over(p) {
                            let depth = aside.min(width - aside);
                            let worst = deepest
                                .entry((lane.junction, lane.key.road))
                                .or_insert((f64::NEG_INFINITY, p.into()));
                            if depth > worst.0 {
                                *worst = (depth, [p.x, p.y, height]);
                            }
                        }
                    }
                }
            }
            bad.extend(deepest.into_iter().map(|(road, (depth, place))| {
                format!("{name} seed {seed} {road:?}: {depth:.2} m deep at {place:.2?}")
            }));
        }
    }
    assert!(
        bad.is_empty(),
        "kerbs in lanes, by junction and road, with place and height: {bad:#?}"
    );
    assert!(n_probes > 1_000_000, "{n_probes}");
}
