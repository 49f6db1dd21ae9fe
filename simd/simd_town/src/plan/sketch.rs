//! A plan that is drawn street by street between nodes.

use super::layout::{Edge, Houses, Plan, Profile, SIGNED_FROM_M, Street};
use crate::geometry::{Bend, P2, heading, unit, wrap};
use crate::random::Random;

/// One lane each way with a gutter: the usual street of a small town.
pub const LANE: Profile = Profile {
    n_lanes: 1,
    lane_m: 3.5,
    edge: Edge::Gutter,
    edge_m: 0.6,
    pavement_m: 3.0,
    speed_kmh: 40,
    main: false,
    verge: false,
    one_way: false,
    motorway: false,
};
/// A street as `LANE` with priority and traffic lights.
pub const HIGH_STREET: Profile = Profile {
    pavement_m: 3.5,
    speed_kmh: 40,
    main: true,
    ..LANE
};
/// One lane each way between fields.
pub const COUNTRY: Profile = Profile {
    n_lanes: 1,
    lane_m: 3.5,
    edge_m: 0.7,
    pavement_m: 1.8,
    speed_kmh: 70,
    verge: true,
    ..LANE
};
/// The one-way street round a roundabout, counter-clockwise.
const CIRCLE: Profile = Profile {
    lane_m: 5.0,
    pavement_m: 2.5,
    speed_kmh: 30,
    one_way: true,
    ..LANE
};
/// Three lanes each way.
pub const BOULEVARD: Profile = Profile {
    n_lanes: 3,
    lane_m: 3.5,
    edge: Edge::Gutter,
    edge_m: 0.5,
    pavement_m: 4.5,
    speed_kmh: 60,
    main: true,
    verge: false,
    one_way: false,
    motorway: false,
};

/// An elevated road over the streets of a town.
pub const ELEVATED: Profile = Profile {
    n_lanes: 2,
    lane_m: 3.5,
    edge_m: 0.8,
    pavement_m: 1.6,
    speed_kmh: 70,
    verge: true,
    ..LANE
};

/// Collects nodes and streets of a plan.
pub struct Sketch {
    pub plan: Plan,
    pub random: Random,
}

impl Sketch {
    pub fn new(
        name: &str,
        seed: u64,
        stream: u64,
        lat_lon_deg: (f64, f64),
        houses: Houses,
    ) -> Sketch {
        let plan = Plan {
            name: name.to_owned(),
            lat_lon_deg,
            nodes_m: Vec::new(),
            heights_m: Vec::new(),
            hills_m: 0.0,
            streets: Vec::new(),
            ponds_m: Vec::new(),
            parks_m: Vec::new(),
            all_lights: false,
            houses,
            cottages_m: Vec::new(),
            green_courts: false,
            limits_from_m: SIGNED_FROM_M,
        };
        Sketch {
            plan,
            random: Random::new(seed, stream, 0),
        }
    }

    pub fn node(&mut self, x: f64, y: f64) -> usize {
        self.plan.heights_m.push(0.0);
        self.plan.nodes_m.push(P2::new(x, y));
        self.plan.nodes_m.len() - 1
    }

    /// Adds streets along a line of nodes.
    pub fn chain(&mut self, nodes: &[usize], profile: Profile) {
        for pair in nodes.windows(2) {
            self.street(pair[0], pair[1], &[], profile);
        }
    }

    /// Adds a street through rounded corners: (x, y, radius).
    pub fn street(
        &mut self,
        from: usize,
        to: usize,
        corners: &[(f64, f64, f64)],
        profile: Profile,
    ) {
        let bends = corners
            .iter()
            .map(|&(x, y, radius_m)| Bend {
                corner_m: P2::new(x, y),
                radius_m,
            })
            .collect();
        self.plan
            .streets
            .push(Street::new(from, to, bends, profile));
    }

    /// Adds a roundabout about a point with one junction per heading (counter-clockwise, radians).
    pub fn roundabout(&mut self, centre: P2, radius_m: f64, headings: &[f64]) -> Vec<usize> {
        let nodes: Vec<usize> = headings
            .iter()
            .map(|&h| centre + unit(h) * radius_m)
            .map(|p| self.node(p.x, p.y))
            .collect();
        for i in 0..nodes.len() {
            let k = (i + 1) % nodes.len();
            let turn = (headings[k] - headings[i]).rem_euclid(std::f64::consts::TAU);
            let corner = centre + unit(headings[i] + 0.5 * turn) * (radius_m / (0.5 * turn).cos());
            self.street(
                nodes[i],
                nodes[k],
                &[(corner.x, corner.y, radius_m)],
                CIRCLE,
            );
        }
        self.plan.parks_m.push(centre);
        nodes
    }

    /// Gives the street drawn last a hump (or a dip).
    pub fn crest(&mut self, crest_m: f64) {
        if let Some(street) = self.plan.streets.last_mut() {
            street.rises_m = vec![(0.5, crest_m)];
        }
    }

    /// Puts the street drawn last on a deck between two places (metres from its first node), with
    /// heights as [`Street::rises_m`].
    pub fn bridge(&mut self, bridge_m: (f64, f64), rises_m: &[(f64, f64)]) {
        if let Some(street) = self.plan.streets.last_mut() {
            street.bridge_m = Some(bridge_m);
            street.rises_m = rises_m.to_vec();
        }
    }

    /// Drops the nodes at which no street ends.
    pub fn drop_orphans(&mut self) {
        let mut used = vec![false; self.plan.nodes_m.len()];
        for street in &self.plan.streets {
            (used[street.from], used[street.to]) = (true, true);
        }
        self.keep_nodes(&used);
    }

    /// Joins the two streets at every node where only two streets of one cross-section meet, and
    /// drops the node: the street bends there.
    pub fn drop_passages(&mut self) {
        let mut ends: Vec<Vec<usize>> = vec![Vec::new(); self.plan.nodes_m.len()];
        for (i, street) in self.plan.streets.iter().enumerate() {
            ends[street.from].push(i);
            ends[street.to].push(i);
        }
        let mut gone = vec![false; self.plan.streets.len()];
        let mut dropped = vec![false; ends.len()];
        for node in 0..ends.len() {
            let [a, b] = ends[node][..] else { continue };
            let streets = &self.plan.streets;
            if a == b || streets[a].profile != streets[b].profile {
                continue;
            }
            let first = towards(&streets[a], node);
            let second = towards(&streets[b], node).reversed();
            let joined = join(&first, &second, &self.plan.nodes_m);
            // The joined street takes the place of the first, also in the list of its far end.
            for at in &mut ends[second.to] {
                if *at == b {
                    *at = a;
                }
            }
            self.plan.streets[a] = joined;
            (gone[b], dropped[node]) = (true, true);
        }
        let mut streets = gone.iter();
        self.plan
            .streets
            .retain(|_| !streets.next().unwrap_or(&false));
        let kept: Vec<bool> = dropped.iter().map(|dropped| !dropped).collect();
        self.keep_nodes(&kept);
    }

    /// Keeps these nodes only, in their order. No street may end at another.
    fn keep_nodes(&mut self, kept: &[bool]) {
        let mut number = vec![0; kept.len()];
        let mut n = 0;
        for (node, is_kept) in kept.iter().enumerate() {
            number[node] = n;
            if *is_kept {
                self.plan.nodes_m[n] = self.plan.nodes_m[node];
                self.plan.heights_m[n] = self.plan.heights_m[node];
                n += 1;
            }
        }
        self.plan.nodes_m.truncate(n);
        self.plan.heights_m.truncate(n);
        for street in &mut self.plan.streets {
            (street.from, street.to) = (number[street.from], number[street.to]);
        }
    }

    /// The values, each moved by a random distance of up to `by_m`.
    pub fn moved<const N: usize>(&mut self, values: [f64; N], by_m: f64) -> [f64; N] {
        values.map(|x| x + self.random.between(-by_m, by_m))
    }
}

/// Radius of a bend in place of a dropped node, and least turn for which there is one.
const PASSAGE_M: f64 = 45.0;
const PASSAGE_RAD: f64 = 0.03;

/// A street that ends at this node, reversed if it begins there.
fn towards(street: &Street, node: usize) -> Street {
    if street.to == node {
        street.clone()
    } else {
        street.reversed()
    }
}

/// One street out of two, of which the second begins where the first ends.
fn join(first: &Street, second: &Street, nodes_m: &[P2]) -> Street {
    let middle = nodes_m[first.to];
    let before = first
        .bends
        .last()
        .map_or(nodes_m[first.from], |bend| bend.corner_m);
    let behind = second
        .bends
        .first()
        .map_or(nodes_m[second.to], |bend| bend.corner_m);
    let turn = wrap(heading(behind - middle) - heading(middle - before));
    let passage = (turn.abs() > PASSAGE_RAD).then_some(Bend {
        corner_m: middle,
        radius_m: PASSAGE_M,
    });
    let bends = first
        .bends
        .iter()
        .copied()
        .chain(passage)
        .chain(second.bends.iter().copied());
    Street::new(first.from, second.to, bends.collect(), first.profile)
}
