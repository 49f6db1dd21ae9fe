//! Plans of the towns with motorways: two carriageways, ramps, streets that cross over or under
//! them.

use std::f64::consts::PI;

use super::layout::{Edge, HIGHWAY, Houses, Plan, Profile, Street};
use super::sketch::{COUNTRY, HIGH_STREET, LANE, Sketch};
use crate::geometry::{Bend, P2, Path, Segment, unit};

/// Three lanes, one way.
const CARRIAGEWAY: Profile = Profile {
    n_lanes: 3,
    lane_m: 3.6,
    edge: Edge::Gutter,
    edge_m: 1.4,
    pavement_m: 2.2,
    speed_kmh: 90,
    main: false,
    verge: true,
    one_way: true,
    motorway: true,
};
/// Four lanes, one way.
const WIDE_CARRIAGEWAY: Profile = Profile {
    n_lanes: 4,
    ..CARRIAGEWAY
};
/// On and off the motorway.
const RAMP: Profile = Profile {
    n_lanes: 1,
    lane_m: 4.0,
    edge_m: 1.0,
    pavement_m: 1.6,
    speed_kmh: 60,
    motorway: false,
    ..CARRIAGEWAY
};
/// Across the motorway.
const LINK: Profile = Profile {
    n_lanes: 1,
    lane_m: 3.5,
    edge_m: 0.8,
    pavement_m: 1.8,
    speed_kmh: 60,
    main: true,
    verge: true,
    ..LANE
};
/// From an interchange into the country.
const LANE_OUT: Profile = Profile {
    n_lanes: 1,
    lane_m: 3.5,
    edge_m: 0.8,
    pavement_m: 1.8,
    speed_kmh: 60,
    verge: true,
    ..LANE
};
/// A highway where it passes houses: pavements, crosswalks, slower.
const BUILT_UP: Profile = Profile {
    pavement_m: 3.5,
    speed_kmh: 60,
    verge: false,
    ..HIGHWAY
};
/// Grass between the verges of both carriageways.
const MEDIAN_M: f64 = 3.0;
/// Height of a bridge over what it crosses: clear height and thickness of the deck.
const OVER_M: f64 = 7.2;

/// Lengths of the extra lanes in which traffic slows down before a ramp and gains speed behind one.
const SLOWING_M: f64 = 150.0;
const GAINING_M: f64 = 190.0;
/// Length over which such a lane begins or ends, half of it before its node.
const TAPER_M: f64 = 70.0;
/// Least distance between a taper and the next node or bridge on the carriageway.
const APART_M: f64 = 60.0;

/// What happens to a carriageway at a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum At {
    /// The carriageway ends, or crosses streets.
    End,
    /// A ramp leaves.
    Off,
    /// A ramp arrives.
    On,
    /// A lane begins on the right.
    Widens,
    /// The rightmost lane ends.
    Narrows,
}

/// One carriageway while it is being laid out.
struct Carriageway {
    /// Course in the direction of travel: a closed line, or one with two ends.
    path: Path,
    closed: bool,
    profile: Profile,
    /// Nodes on it: station, number, what happens there.
    nodes: Vec<(f64, usize, At)>,
    /// Heights: station, rise over the straight line between the nodes.
    rises: Vec<(f64, f64)>,
    /// Stations between which it stands on decks.
    bridges: Vec<(f64, f64)>,
}

impl Carriageway {
    fn new(path: Path, closed: bool, profile: Profile) -> Carriageway {
        Carriageway {
            path,
            closed,
            profile,
            nodes: Vec::new(),
            rises: Vec::new(),
            bridges: Vec::new(),
        }
    }

    fn station(&self, s_m: f64) -> f64 {
        if self.closed {
            s_m.rem_euclid(self.path.length_m())
        } else {
            s_m
        }
    }

    fn node(&mut self, sketch: &mut Sketch, s_m: f64, what: At) -> usize {
        let s = self.station(s_m);
        let p = self.path.at(s).0;
        let node = sketch.node(p.x, p.y);
        self.nodes.push((s, node, what));
        node
    }

    /// Distance from one station to another in the direction of travel.
    fn along(&self, from_m: f64, to_m: f64) -> f64 {
        if self.closed {
            (to_m - from_m).rem_euclid(self.path.length_m())
        } else {
            to_m - from_m
        }
    }

    /// Whether a taper about this station would be clear of all bridge decks.
    fn is_plain(&self, s_m: f64) -> bool {
        let reach = 0.5 * TAPER_M + 10.0;
        self.bridges.iter().all(|&(begin, end)| {
            let length = self.along(begin, end) + 2.0 * reach;
            !(0.0..length).contains(&self.along(begin - reach, s_m))
        })
    }

    /// Adds lanes for gaining speed behind ramps and for losing it before them, where there is
    /// room. Where there is no room for both, one lane leads from ramp to ramp.
    fn widen(&mut self, sketch: &mut Sketch) {
        self.nodes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let n = self.nodes.len();
        for i in 0..if self.closed { n } else { n - 1 } {
            let ((from, a, before), (to, b, behind)) = (self.nodes[i], self.nodes[(i + 1) % n]);
            let (gains, slows) = (before == At::On, behind == At::Off);
            let needs = |yes: bool, length: f64| {
                if yes {
                    1.25 * length + 0.5 * TAPER_M
                } else {
                    0.0
                }
            };
            if needs(gains, GAINING_M) + needs(slows, SLOWING_M) + APART_M > self.along(from, to) {
                continue;
            }
            let mut taper = |wanted: bool, s_m: &dyn Fn(f64) -> f64, level: usize, what: At| {
                if let Some(s) = [1.0, 1.25, 0.75]
                    .map(s_m)
                    .into_iter()
                    .find(|&s| wanted && self.is_plain(s))
                {
                    let node = self.node(sketch, s, what);
                    sketch.plan.heights_m[node] = sketch.plan.heights_m[level];
                }
            };
            taper(gains, &|share| from + share * GAINING_M, a, At::Narrows);
            taper(slows, &|share| to - share * SLOWING_M, b, At::Widens);
        }
    }

    /// Puts the carriageway on a deck from `from_m` to `to_m` that is highest in the middle.
    fn over(&mut self, from_m: f64, to_m: f64, rise_m: f64) {
        self.bridges
            .push((self.station(from_m), self.station(to_m)));
        self.rises
            .push((self.station(0.5 * (from_m + to_m)), rise_m));
    }

    /// Adds the streets between neighbouring nodes to the sketch.
    fn lay(mut self, sketch: &mut Sketch) {
        self.widen(sketch);
        self.nodes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let n = self.nodes.len();
        for i in 0..if self.closed { n } else { n - 1 } {
            let ((from, a, before), (to, b, behind)) = (self.nodes[i], self.nodes[(i + 1) % n]);
            let length = if i + 1 < n {
                to - from
            } else {
                to + self.path.length_m() - from
            };
            let middle = self.path.around(from, length);
            let is_wide = before == At::Widens
                || behind == At::Narrows
                || (before, behind) == (At::On, At::Off);
            let (profile, course) = if is_wide {
                let profile = Profile {
                    n_lanes: self.profile.n_lanes + 1,
                    ..self.profile
                };
                (
                    profile,
                    middle.offset(self.profile.driving_m() - profile.driving_m()),
                )
            } else {
                (self.profile, middle)
            };
            let mut street = Street::new(a, b, Vec::new(), profile);
            let within = |s: f64| (0.0..length).contains(&self.along(from, s));
            let along = |s: f64| course.nearest(self.path.at(s).0).0;
            let whole = course.length_m();
            street.rises_m = self
                .rises
                .iter()
                .filter(|rise| within(rise.0))
                .map(|rise| (along(rise.0) / whole, rise.1))
                .collect();
            street.bridge_m = self
                .bridges
                .iter()
                .find(|bridge| within(bridge.0))
                .map(|bridge| (along(bridge.0), along(bridge.1)));
            street.course = Some(course);
            sketch.plan.streets.push(street);
        }
    }
}

/// Where a street crosses a motorway.
struct Crossing {
    /// Stations of the crossing on both carriageways.
    at_m: [f64; 2],
    /// Distance of the ramps' ends on the motorway from the crossing, along the first and the
    /// second carriageway.
    reach_m: [f64; 2],
    /// Distance of the ramps' ends on the street from the carriageways.
    away_m: f64,
    /// Whether the street runs over the motorway; otherwise it runs under it.
    over: bool,
    /// Height of the motorway and of the street's ends.
    heights_m: (f64, f64),
}

/// Draws ramps on the right of both carriageways and the street that joins them. Returns the nodes
/// at which the ramps meet the street.
fn interchange(
    sketch: &mut Sketch,
    ways: &mut [Carriageway; 2],
    crossing: &Crossing,
) -> [usize; 2] {
    let mut meetings = [0; 2];
    for (k, way) in ways.iter_mut().enumerate() {
        let (at, reach) = (crossing.at_m[k], crossing.reach_m[k]);
        let middle = way.path.beside(way.station(at), -crossing.away_m);
        let meeting = sketch.node(middle.x, middle.y);
        sketch.plan.heights_m[meeting] = crossing.heights_m.1;
        let (off, on) = (
            way.node(sketch, at - reach, At::Off),
            way.node(sketch, at + reach, At::On),
        );
        sketch.plan.heights_m[off] = crossing.heights_m.0;
        sketch.plan.heights_m[on] = crossing.heights_m.0;
        // A ramp leaves at a small angle, which is larger where the motorway bends towards the
        // ramp; then it follows the motorway to the street.
        let bends = |sign: f64| {
            let (p, heading) = way.path.at(way.station(at + sign * reach));
            let ahead = way.path.at(way.station(at + sign * (reach - 10.0))).1;
            let towards_ramp = (sign * crate::geometry::wrap(ahead - heading) / 10.0).max(0.0);
            let angle = 0.24 + 50.0 * towards_ramp;
            let (away, forward) = if sign < 0.0 {
                (heading - angle, 1.0)
            } else {
                (heading + angle, -1.0)
            };
            let leave_m = 88.0 - 5400.0 * towards_ramp;
            let along = way
                .path
                .beside(way.station(at + sign * 40.0), 6.0 - crossing.away_m);
            [
                Bend {
                    corner_m: p + unit(away) * (forward * leave_m),
                    radius_m: 70.0,
                },
                Bend {
                    corner_m: along,
                    radius_m: 30.0,
                },
            ]
        };
        sketch
            .plan
            .streets
            .push(Street::new(off, meeting, bends(-1.0).to_vec(), RAMP));
        sketch.plan.streets.push(Street::new(
            meeting,
            on,
            bends(1.0).into_iter().rev().collect(),
            RAMP,
        ));
        if !crossing.over {
            way.over(at - 24.0, at + 24.0, OVER_M - 0.6);
        }
        meetings[k] = meeting;
    }
    let mut street = Street::new(meetings[0], meetings[1], Vec::new(), LINK);
    if crossing.over {
        let length = (sketch.plan.nodes_m[meetings[0]] - sketch.plan.nodes_m[meetings[1]]).norm();
        let half = half_gap_m(&ways[0].profile) + ways[0].profile.back_m() + 9.0;
        street.bridge_m = Some((0.5 * length - half, 0.5 * length + half));
        street.rises_m = vec![(0.5, crossing.heights_m.0 + OVER_M - crossing.heights_m.1)];
    }
    sketch.plan.streets.push(street);
    meetings
}

/// Middle line of a figure of eight about the origin, counter-clockwise round the right loop, and
/// the stations of its crossing.
fn eight(loops_m: f64, radius_m: f64) -> (Path, [f64; 2]) {
    let angle = (radius_m / loops_m).asin();
    let reach = (loops_m * loops_m - radius_m * radius_m).sqrt();
    let turn = PI + 2.0 * angle;
    let line = |start_m: P2, heading_rad: f64| Segment {
        start_m,
        heading_rad,
        length_m: 2.0 * reach,
        curvature_per_m: 0.0,
    };
    let arc = |start_m: P2, heading_rad: f64, k: f64| Segment {
        start_m,
        heading_rad,
        length_m: turn * radius_m,
        curvature_per_m: k,
    };
    // Down to the right, round the right loop, down to the left, round the left loop.
    let down = line(-unit(-angle) * reach, -angle);
    let right = arc(unit(-angle) * reach, -angle, 1.0 / radius_m);
    let back = line(unit(angle) * reach, angle + PI);
    let left = arc(-unit(angle) * reach, angle + PI, -1.0 / radius_m);
    (
        Path {
            segments: vec![down, right, back, left],
        },
        [reach, 3.0 * reach + turn * radius_m],
    )
}

/// From a carriageway's middle to that of the whole motorway.
fn half_gap_m(profile: &Profile) -> f64 {
    profile.back_m() + 0.5 * MEDIAN_M
}

/// Both carriageways of a motorway with this middle line.
fn carriageways(middle: &Path, closed: bool, profile: Profile) -> [Carriageway; 2] {
    let forward = middle.offset(-half_gap_m(&profile));
    let backward = middle.offset(half_gap_m(&profile)).reversed();
    [
        Carriageway::new(forward, closed, profile),
        Carriageway::new(backward, closed, profile),
    ]
}

/// Town04: a motorway in a figure of eight that crosses itself on a bridge; a small town inside the
/// right loop, a village in the left one.
pub fn figure_of_eight(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(name, seed, 0x104, (46.95, 7.45), Houses::Cottages);
    const LOOPS_M: f64 = 330.0;
    const RADIUS_M: f64 = 200.0;
    let (middle, crossings) = eight(LOOPS_M, RADIUS_M);
    let mut ways = carriageways(&middle, true, CARRIAGEWAY);
    // The second line passes over the first.
    for way in &mut ways {
        let at = way.path.nearest(middle.at(crossings[1]).0).0;
        // Both lines pass near the origin; this is the one that leads to the left.
        let heading = middle.at(crossings[1]).1;
        let candidates = [at, at + 0.5 * way.path.length_m()];
        let is_along = |s: f64| {
            unit(way.path.at(way.station(s)).1)
                .dot(&unit(heading))
                .abs()
                > 0.98
        };
        let at = candidates.into_iter().find(|&s| is_along(s)).unwrap_or(at);
        way.over(at - 46.0, at + 46.0, OVER_M);
    }
    // The town's street passes under the motorway in the east, the village's over it in the west.
    let at = |ways: &[Carriageway; 2], p: P2| [0, 1].map(|k: usize| ways[k].path.nearest(p).0);
    let east = at(&ways, P2::new(LOOPS_M + RADIUS_M, 0.0));
    let arc = |k: f64| 0.92 * (RADIUS_M + k * half_gap_m(&CARRIAGEWAY));
    let [east_out, east_in] = interchange(
        &mut s,
        &mut ways,
        &Crossing {
            at_m: east,
            reach_m: [arc(1.0), arc(-1.0)],
            away_m: 66.0,
            over: false,
            heights_m: (0.0, 0.0),
        },
    );
    let west = at(&ways, P2::new(-LOOPS_M - RADIUS_M, 0.0));
    let [west_in, west_out] = interchange(
        &mut s,
        &mut ways,
        &Crossing {
            at_m: west,
            reach_m: [arc(-1.0), arc(1.0)],
            away_m: 84.0,
            over: true,
            heights_m: (-2.6, 1.6),
        },
    );
    ways.into_iter().for_each(|way| way.lay(&mut s));
    // The small town.
    let xs = s
        .moved([-104.0, -40.0, 24.0, 82.0], 3.0)
        .map(|x| x + LOOPS_M);
    let ys = s.moved([-74.0, 0.0, 74.0], 3.0);
    let middle = xs.map(|x| s.node(x, ys[1]));
    let [low, high] = [ys[0], ys[2]].map(|y| [xs[1], xs[2]].map(|x| s.node(x, y)));
    s.chain(
        &[middle[0], middle[1], middle[2], middle[3], east_in],
        HIGH_STREET,
    );
    for row in [low, high] {
        s.chain(&row, LANE);
    }
    for c in 0..2 {
        s.chain(&[low[c], middle[c + 1], high[c]], LANE);
    }
    for (side, y, row) in [
        (0, ys[0], low),
        (0, ys[2], high),
        (3, ys[0], low),
        (3, ys[2], high),
    ] {
        s.street(middle[side], row[side / 3], &[(xs[side], y, 16.0)], LANE);
    }
    s.plan.parks_m = vec![P2::new(0.5 * (xs[1] + xs[2]), 0.5 * (ys[1] + ys[2]))];
    // The village.
    let x = -LOOPS_M;
    let village = [(x - 40.0, 0.0), (x + 30.0, -48.0), (x + 28.0, 52.0)].map(|(x, y)| s.node(x, y));
    s.chain(
        &[west_in, village[0], village[1], village[2], village[0]],
        LANE,
    );
    s.street(
        village[1],
        village[2],
        &[(x + 88.0, -40.0, 30.0), (x + 84.0, 50.0, 30.0)],
        LANE,
    );
    s.plan.ponds_m = vec![
        (P2::new(LOOPS_M - 20.0, 132.0), 17.0),
        (P2::new(-70.0, 190.0), 32.0),
    ];
    // Country roads round the whole town start from a junction beyond either interchange.
    let far = LOOPS_M + RADIUS_M + 150.0;
    let beyond = [far, -far].map(|x| s.node(x, 0.0));
    s.chain(&[east_out, beyond[0]], LANE_OUT);
    s.chain(&[west_out, beyond[1]], LANE_OUT);
    for sign in [1.0, -1.0] {
        let y = sign * (RADIUS_M + 105.0);
        let corners = [
            (far, y, 85.0),
            (110.0, sign * (RADIUS_M + 34.0), 140.0),
            (-120.0, y + sign * 26.0, 150.0),
            (-far, y, 95.0),
        ];
        s.street(beyond[0], beyond[1], &corners, COUNTRY);
        s.plan.streets.last_mut().expect("drawn").rises_m =
            vec![(0.3, 4.0), (0.52, -1.0), (0.75, 5.0)];
    }
    s.plan.hills_m = 40.0;
    s.plan
}

/// The southern highway, which passes through a village in its middle: pavements along it, and two
/// streets behind it.
fn built_up_stretch(s: &mut Sketch, south: &[usize]) {
    let middle = s.plan.nodes_m[south[1]];
    let [far_west, west, east, far_east] = s
        .moved([-215.0, -106.0, 108.0, 212.0], 5.0)
        .map(|x| x + middle.x);
    let [first, second] = s.moved([-84.0, -158.0], 3.0).map(|y| y + middle.y);
    let [from, to] = [far_west, far_east].map(|x| s.node(x, middle.y));
    s.chain(&[south[0], from], HIGHWAY);
    s.chain(&[from, south[1], to], BUILT_UP);
    s.chain(&[to, south[2]], HIGHWAY);
    let row = [far_west, west, middle.x, east, far_east].map(|x| s.node(x, first));
    let back = [west, middle.x, east].map(|x| s.node(x, second));
    s.chain(&row, HIGH_STREET);
    s.chain(&back, LANE);
    for (ahead, behind) in [(from, row[0]), (south[1], row[2]), (to, row[4])] {
        s.chain(&[ahead, behind], LANE);
    }
    for k in 0..3 {
        s.chain(&[row[k + 1], back[k]], LANE);
    }
    s.street(row[0], back[0], &[(far_west, second, 22.0)], LANE);
    s.street(row[4], back[2], &[(far_east, second, 22.0)], LANE);
    let (before, between) = (0.5 * (middle.y + first), 0.5 * (first + second));
    s.plan.cottages_m = vec![
        P2::new(0.5 * (far_west + middle.x), before),
        P2::new(0.5 * (middle.x + far_east), before),
        P2::new(0.5 * (far_west + west), between),
        P2::new(0.5 * (west + middle.x), between),
        P2::new(0.5 * (middle.x + east), between),
    ];
    s.plan
        .parks_m
        .push(P2::new(0.5 * (east + far_east), between));
}

/// Town06: a long motorway of eight lanes between two highways, three interchanges; the southern
/// highway passes through a village.
pub fn long_highways(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(name, seed, 0x106, (42.33, -83.05), Houses::Farms);
    let xs = s.moved([-430.0, 0.0, 430.0], 10.0);
    let (w, h) = (760.0, 215.0);
    let line = Path::rounded(P2::new(-w, 0.0), &[], P2::new(w, 0.0));
    let mut ways = carriageways(&line, false, WIDE_CARRIAGEWAY);
    // Both carriageways meet at either end.
    let ends = [-w, w].map(|x| s.node(x, 0.0));
    for (k, way) in ways.iter_mut().enumerate() {
        let (from, to) = if k == 0 { (-w, w) } else { (w, -w) };
        let y = half_gap_m(&WIDE_CARRIAGEWAY) * if k == 0 { -1.0 } else { 1.0 };
        let inward = (to - from).signum();
        let bend = |x: f64, wide: f64| Bend {
            corner_m: P2::new(x, wide * y),
            radius_m: 60.0,
        };
        let near = [(56.0, 2.6), (150.0, 1.0)];
        let mut bends: Vec<Bend> = near
            .iter()
            .map(|&(x, wide)| bend(from + inward * x, wide))
            .collect();
        bends.extend(
            near.iter()
                .rev()
                .map(|&(x, wide)| bend(to - inward * x, wide)),
        );
        let course = Path::rounded(P2::new(from, 0.0), &bends, P2::new(to, 0.0));
        way.path = course;
        let length = way.path.length_m();
        way.nodes = if k == 0 {
            vec![(0.0, ends[0], At::End), (length, ends[1], At::End)]
        } else {
            vec![(0.0, ends[1], At::End), (length, ends[0], At::End)]
        };
    }
    let (mut south, mut north) = (Vec::new(), Vec::new());
    for x in xs {
        let at_m = [0, 1].map(|k: usize| ways[k].path.nearest(P2::new(x, 0.0)).0);
        let crossing = Crossing {
            at_m,
            reach_m: [165.0; 2],
            away_m: 84.0,
            over: true,
            heights_m: (0.0, 2.4),
        };
        let [below, above] = interchange(&mut s, &mut ways, &crossing);
        let (low, high) = (s.node(x, -h), s.node(x, h));
        s.plan
            .streets
            .push(Street::new(below, low, Vec::new(), LINK));
        s.plan
            .streets
            .push(Street::new(above, high, Vec::new(), LINK));
        south.push(low);
        north.push(high);
    }
    ways.into_iter().for_each(|way| way.lay(&mut s));
    built_up_stretch(&mut s, &south);
    s.chain(&north, HIGHWAY);
    for (end, side, low, high) in [
        (ends[0], -1.0, south[0], north[0]),
        (ends[1], 1.0, south[2], north[2]),
    ] {
        s.street(low, end, &[(side * (w + 6.0), -h, 90.0)], HIGHWAY);
        s.street(end, high, &[(side * (w + 6.0), h, 90.0)], HIGHWAY);
    }
    s.plan.ponds_m = vec![
        (P2::new(215.0, -150.0), 26.0),
        (P2::new(-200.0, 150.0), 34.0),
    ];
    s.plan.hills_m = 18.0;
    s.plan
}
