//! Plans of the towns around the dense centre, drawn as streets between named points.

use crate::geometry::{Bend, P2};
use crate::plan::{AVENUE, Edge, HIGHWAY, Houses, Plan, Profile, STREET};
use crate::random::Random;

/// One lane each way with a gutter: the usual street of a small town.
const LANE: Profile = Profile { n_lanes: 1, lane_m: 3.5, edge: Edge::Gutter, edge_m: 0.6, pavement_m: 3.0, speed_kmh: 40, main: false };
/// The same with priority and traffic lights.
const HIGH_STREET: Profile = Profile { pavement_m: 3.5, speed_kmh: 40, main: true, ..LANE };
/// Three lanes each way.
const BOULEVARD: Profile = Profile { n_lanes: 3, lane_m: 3.5, edge: Edge::Gutter, edge_m: 0.5, pavement_m: 4.5, speed_kmh: 60, main: true };

/// Collects nodes and streets.
struct Sketch {
    plan: Plan,
    random: Random,
}

impl Sketch {
    fn new(name: &str, seed: u64, stream: u64, lat_lon_deg: (f64, f64), houses: Houses) -> Sketch {
        let plan = Plan { name: name.to_owned(), lat_lon_deg, nodes_m: Vec::new(), streets: Vec::new(), parks_m: Vec::new(), houses };
        Sketch { plan, random: Random::new(seed, stream, 0) }
    }

    fn node(&mut self, x: f64, y: f64) -> usize {
        self.plan.nodes_m.push(P2::new(x, y));
        self.plan.nodes_m.len() - 1
    }

    /// Streets along a line of nodes.
    fn chain(&mut self, nodes: &[usize], profile: Profile) {
        for pair in nodes.windows(2) {
            self.street(pair[0], pair[1], &[], profile);
        }
    }

    /// A street through rounded corners: (x, y, radius).
    fn street(&mut self, from: usize, to: usize, corners: &[(f64, f64, f64)], profile: Profile) {
        let bends = corners.iter().map(|&(x, y, radius_m)| Bend { corner_m: P2::new(x, y), radius_m }).collect();
        self.plan.streets.push(crate::plan::Street { from, to, bends, profile });
    }

    /// The same value for each, moved by up to `by_m`.
    fn moved<const N: usize>(&mut self, values: [f64; N], by_m: f64) -> [f64; N] {
        values.map(|x| x + self.random.between(-by_m, by_m))
    }
}

/// Town01: a small town in which every junction is a T.
pub fn small_town(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(name, seed, 0x101, (49.02, 8.41), Houses::Cottages);
    let (w, h) = (195.0, 155.0);
    let below = s.moved([-112.0, 18.0, 122.0], 4.0);
    let above = s.moved([-52.0, 72.0], 4.0);
    let [high, low, upper] = s.moved([8.0, -72.0, 84.0], 4.0);
    let south = below.map(|x| s.node(x, -h));
    let north = above.map(|x| s.node(x, h));
    let west = [high, upper].map(|y| s.node(-w, y));
    let east = [low, high, upper].map(|y| s.node(w, y));
    let middle_below = below.map(|x| s.node(x, high));
    let middle_above = above.map(|x| s.node(x, high));
    let cross_low = below.map(|x| s.node(x, low));
    let cross_upper = above.map(|x| s.node(x, upper));
    let [b0, b1, b2] = middle_below;
    let [a0, a1] = middle_above;
    s.chain(&[west[0], b0, a0, b1, a1, b2, east[1]], HIGH_STREET);
    for i in 0..3 {
        s.chain(&[south[i], cross_low[i], middle_below[i]], LANE);
    }
    for i in 0..2 {
        s.chain(&[middle_above[i], cross_upper[i], north[i]], LANE);
    }
    s.chain(&[cross_low[0], cross_low[1]], STREET);
    s.chain(&[cross_low[2], east[0]], LANE);
    s.chain(&[west[1], cross_upper[0]], LANE);
    s.chain(&[cross_upper[1], east[2]], STREET);
    s.chain(&south, LANE);
    s.chain(&north, LANE);
    s.chain(&west, LANE);
    s.chain(&east, LANE);
    s.street(west[0], south[0], &[(-w, -h, 30.0)], LANE);
    s.street(south[2], east[0], &[(w, -h, 30.0)], LANE);
    s.street(east[2], north[1], &[(w, h, 30.0)], LANE);
    s.street(north[0], west[1], &[(-w, h, 30.0)], LANE);
    s.plan.parks_m = vec![P2::new(-20.0, 40.0)];
    s.plan
}

/// Town02: compact, short blocks, narrow streets, one lane each way.
pub fn compact(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(name, seed, 0x102, (47.66, 9.18), Houses::Terraces);
    let (w, h) = (135.0, 128.0);
    let xs = s.moved([-62.0, 4.0, 70.0], 3.0);
    let ys = s.moved([-62.0, 0.0, 62.0], 3.0);
    let south = xs.map(|x| s.node(x, -h));
    let north = xs.map(|x| s.node(x, h));
    let west = ys.map(|y| s.node(-w, y));
    let east = ys.map(|y| s.node(w, y));
    let inner = ys.map(|y| xs.map(|x| s.node(x, y)));
    for r in 0..3 {
        let profile = if r == 1 { HIGH_STREET } else { LANE };
        s.chain(&[west[r], inner[r][0], inner[r][1], inner[r][2], east[r]], profile);
    }
    for c in 0..3 {
        let profile = if c == 1 { HIGH_STREET } else { LANE };
        s.chain(&[south[c], inner[0][c], inner[1][c], inner[2][c], north[c]], profile);
    }
    for side in [south, north, west, east] {
        s.chain(&side, LANE);
    }
    s.street(west[0], south[0], &[(-w, -h, 24.0)], LANE);
    s.street(south[2], east[0], &[(w, -h, 24.0)], LANE);
    s.street(east[2], north[2], &[(w, h, 24.0)], LANE);
    s.street(north[0], west[2], &[(-w, h, 24.0)], LANE);
    s.plan.parks_m = vec![P2::new(36.0, 30.0)];
    s.plan
}

/// Town05: a grid of streets with several lanes, a wide ring round it.
pub fn multi_lane_grid(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(name, seed, 0x105, (33.75, -84.39), Houses::Towers { within_m: 190.0 });
    let (w, h) = (300.0, 240.0);
    let xs = s.moved([-190.0, -95.0, 5.0, 100.0, 195.0], 5.0);
    let ys = s.moved([-140.0, -45.0, 50.0, 145.0], 5.0);
    let south = xs.map(|x| s.node(x, -h));
    let north = xs.map(|x| s.node(x, h));
    let west = ys.map(|y| s.node(-w, y));
    let east = ys.map(|y| s.node(w, y));
    let inner = ys.map(|y| xs.map(|x| s.node(x, y)));
    for r in 0..4 {
        let mut row = vec![west[r]];
        row.extend(inner[r]);
        row.push(east[r]);
        s.chain(&row, if r == 2 { BOULEVARD } else { AVENUE });
    }
    for c in 0..5 {
        let mut column = vec![south[c]];
        column.extend(inner.iter().map(|row| row[c]));
        column.push(north[c]);
        s.chain(&column, [AVENUE, AVENUE, BOULEVARD, STREET, AVENUE][c]);
    }
    for side in [&south[..], &north[..], &west[..], &east[..]] {
        s.chain(side, HIGHWAY);
    }
    s.street(west[0], south[0], &[(-w, -h, 60.0)], HIGHWAY);
    s.street(south[4], east[0], &[(w, -h, 60.0)], HIGHWAY);
    s.street(east[3], north[4], &[(w, h, 60.0)], HIGHWAY);
    s.street(north[0], west[3], &[(-w, h, 60.0)], HIGHWAY);
    s.plan.parks_m = vec![P2::new(-145.0, 0.0), P2::new(50.0, -190.0)];
    s.plan
}
