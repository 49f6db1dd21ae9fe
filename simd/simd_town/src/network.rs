//! Roads cut at junctions, lanes joined by connecting roads, traffic lights and signs.

use std::f64::consts::PI;

use crate::elevation::Elevation;
use crate::geometry::{P2, Path, left, unit, wrap};
use crate::kerb::corner;
use crate::plan::{Plan, Profile, Street};

/// Radius of kerbs at corners.
pub const CORNER_RADIUS_M: f64 = 6.5;
/// Where a crosswalk begins and ends, from the junction's edge outwards.
pub const CROSSWALK_M: (f64, f64) = (0.8, 4.0);
/// Middle of the stop line from the junction's edge where there is a crosswalk.
pub const STOP_M: f64 = 5.2;

/// A street between two junctions, without the junctions' areas.
#[derive(Clone, Debug)]
pub struct Road {
    /// OpenDRIVE id.
    pub id: u32,
    /// Reference line: the middle of the street.
    pub path: Path,
    /// Height over its length.
    pub elevation: Elevation,
    /// Cross-section.
    pub profile: Profile,
    /// Runs through a tunnel.
    pub tunnel: bool,
    /// Stations between which it stands on a deck.
    pub bridge: Option<(f64, f64)>,
    /// Junction indices at start and end.
    pub ends: [usize; 2],
    /// Stations of the surface's corners: chords deviate little from the road, sideways and in height.
    pub stations: Vec<f64>,
}

/// Stations for a road with this path, elevation and bridge.
fn stations(path: &Path, elevation: &Elevation, bridge: Option<(f64, f64)>) -> Vec<f64> {
    let mut stations = path.stations(16.0);
    for (s, step) in elevation.steps(path.length_m()) {
        stations.retain(|other| (other - s).abs() > 0.35 * step || *other == 0.0);
        stations.push(s);
    }
    stations.sort_by(f64::total_cmp);
    stations.dedup_by(|a, b| (*a - *b).abs() < 0.05);
    if let Some((from, to)) = bridge {
        stations.retain(|s| (s - from).abs() > 0.5 && (s - to).abs() > 0.5);
        stations.extend([from, to]);
        stations.sort_by(f64::total_cmp);
    }
    stations
}

impl Road {
    /// The same between two stations, both included.
    pub fn stations_between(&self, from_m: f64, to_m: f64) -> Vec<f64> {
        let mut stations = vec![from_m];
        let first = self.stations.partition_point(|&s| s <= from_m + 0.05);
        stations.extend(self.stations[first..].iter().take_while(|&&s| s < to_m - 0.05));
        stations.push(to_m);
        stations
    }

    /// Whether the road stands on a deck here.
    pub fn is_on_bridge(&self, s_m: f64) -> bool {
        self.bridge.is_some_and(|(from, to)| s_m > from && s_m < to)
    }

    /// Parts that lie on the ground: the whole road, or what is before and behind a bridge.
    pub fn on_ground(&self) -> Vec<(f64, f64)> {
        let length = self.path.length_m();
        self.bridge.map_or(vec![(0.0, length)], |(from, to)| vec![(0.0, from), (to, length)])
    }
}

/// One end of a road at a junction.
#[derive(Clone, Copy, Debug)]
pub struct Arm {
    /// Index of the road.
    pub road: usize,
    /// The road begins here (its reference line leads out of the junction).
    pub at_start: bool,
    /// Heading away from the junction.
    pub heading_rad: f64,
    /// Vehicles on this arm wait at a line: lights, stop or yield sign.
    pub waits: bool,
    /// A zebra crosses this arm.
    pub crosswalk: bool,
}

/// Who goes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// Traffic lights.
    Lights,
    /// One arm gives way at a yield sign.
    Yield,
    /// One arm stops at a stop sign.
    Stop,
}

/// A junction.
#[derive(Clone, Debug)]
pub struct Junction {
    /// OpenDRIVE id.
    pub id: u32,
    /// Height of the whole junction.
    pub height_m: f64,
    /// Counter-clockwise.
    pub arms: Vec<Arm>,
    /// Who goes first.
    pub control: Control,
}

/// One way of one lane through a junction.
#[derive(Clone, Debug)]
pub struct Link {
    /// OpenDRIVE road id.
    pub id: u32,
    /// Index of the junction.
    pub junction: usize,
    /// Arm (index in the junction) and OpenDRIVE lane where it comes from.
    pub from: (usize, i32),
    /// Arm and lane where it goes.
    pub to: (usize, i32),
    /// Left edge of the lane, in driving direction.
    pub path: Path,
    /// Lane widths at start and end.
    pub width_m: (f64, f64),
}

/// What a signal says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignalKind {
    /// Three lamps.
    Light,
    /// Stop.
    Stop,
    /// Give way.
    Yield,
    /// Speed limit, km/h.
    Limit(u32),
}

/// A light or sign beside a road.
#[derive(Clone, Copy, Debug)]
pub struct Signal {
    /// OpenDRIVE id.
    pub id: u32,
    /// What it says.
    pub kind: SignalKind,
    /// Index of the road.
    pub road: usize,
    /// It concerns traffic towards the start of the road (lanes with positive ids).
    pub against: bool,
    /// Station of the stop line, or of the sign.
    pub s_m: f64,
    /// Lateral place of the pole, left positive.
    pub t_m: f64,
    /// Station of the pole.
    pub pole_s_m: f64,
    /// Index of the junction it guards.
    pub junction: Option<usize>,
}

/// Lights that switch together.
#[derive(Clone, Debug)]
pub struct Stage {
    /// OpenDRIVE controller id.
    pub id: u32,
    /// Index of the junction.
    pub junction: usize,
    /// Indices of the signals.
    pub signals: Vec<usize>,
}

/// Everything that OpenDRIVE says, before it is text.
#[derive(Clone, Debug)]
pub struct Network {
    /// Streets.
    pub roads: Vec<Road>,
    /// Junctions, by plan node.
    pub junctions: Vec<Junction>,
    /// Connecting roads.
    pub links: Vec<Link>,
    /// Lights and signs.
    pub signals: Vec<Signal>,
    /// Stages of traffic lights.
    pub stages: Vec<Stage>,
}

impl Network {
    /// Lays out a plan.
    pub fn build(plan: &Plan) -> Network {
        let course = |s: &Street| s.course.clone().unwrap_or_else(|| Path::rounded(plan.nodes_m[s.from], &s.bends, plan.nodes_m[s.to]));
        let whole: Vec<Path> = plan.streets.iter().map(course).collect();
        let mut trims = vec![[0.0; 2]; plan.streets.len()];
        let mut junctions = Vec::new();
        for node in 0..plan.nodes_m.len() {
            let arms = arms_of(plan, &whole, node);
            for (i, arm) in arms.iter().enumerate() {
                let next = arms[(i + 1) % arms.len()];
                let (a, b) = if arms.len() == 2 {
                    (TAPER_M, TAPER_M)
                } else {
                    corner_needs(
                        plan.streets[arm.road].profile,
                        plan.streets[next.road].profile,
                        wrap_turn(next.heading_rad - arm.heading_rad),
                    )
                };
                for (arm, need) in [(arm, a), (&next, b)] {
                    let trim = &mut trims[arm.road][usize::from(!arm.at_start)];
                    *trim = need.max(*trim);
                }
            }
            junctions
                .push(control(Junction { id: 2001 + node as u32, height_m: plan.heights_m[node], arms, control: Control::Lights }, plan));
        }
        let roads: Vec<Road> = plan
            .streets
            .iter()
            .zip(&whole)
            .zip(&trims)
            .enumerate()
            .map(|(i, ((street, path), trim))| {
                let (whole_m, path) = (path.length_m(), path.cut(trim[0], path.length_m() - trim[1]));
                let (from_m, to_m) = (plan.heights_m[street.from], plan.heights_m[street.to]);
                // Shares of the whole street are shares of what the junctions left of it.
                let share = |share: f64| (share * whole_m - trim[0]) / path.length_m();
                let rises: Vec<(f64, f64)> = street.rises_m.iter().map(|&(at, rise_m)| (share(at), rise_m)).collect();
                let elevation = Elevation::between(path.length_m(), from_m, to_m, &rises);
                let bridge = street.bridge_m.map(|(from, to)| (from - trim[0], to - trim[0]));
                let ends = [street.from, street.to];
                let stations = stations(&path, &elevation, bridge);
                Road { id: 1 + i as u32, path, elevation, profile: street.profile, tunnel: street.tunnel, bridge, ends, stations }
            })
            .collect();
        let mut network = Network { roads, junctions, links: Vec::new(), signals: Vec::new(), stages: Vec::new() };
        for junction in 0..network.junctions.len() {
            let links = links_of(&network, junction);
            network.links.extend(links);
            place_signals(&mut network, junction);
        }
        place_limits(&mut network);
        network
    }

    /// Whether everything has the height 0.
    pub fn is_level(&self) -> bool {
        self.junctions.iter().all(|junction| junction.height_m == 0.0) && self.roads.iter().all(|road| road.elevation.is_level())
    }

    /// The edge of a junction's surface, counter-clockwise.
    pub fn border(&self, junction: usize) -> Vec<P2> {
        let arms = 0..self.junctions[junction].arms.len();
        let mut border: Vec<P2> = arms.flat_map(|i| corner(self, junction, i).kerb_m).collect();
        border.dedup_by(|a, b| (*a - *b).norm() < 1e-6);
        border
    }

    /// Pose of the middle of the street at an arm's end, heading away from the junction.
    pub fn arm_end(&self, arm: &Arm) -> (P2, f64) {
        let path = &self.roads[arm.road].path;
        if arm.at_start {
            path.at(0.0)
        } else {
            let (p, h) = path.at(path.length_m());
            (p, h + PI)
        }
    }

    /// Station of the road that lies `away_m` metres from the junction along the arm.
    pub fn arm_station(&self, arm: &Arm, away_m: f64) -> f64 {
        if arm.at_start { away_m } else { self.roads[arm.road].path.length_m() - away_m }
    }
}

fn wrap_turn(angle_rad: f64) -> f64 {
    angle_rad.rem_euclid(2.0 * PI)
}

fn arms_of(plan: &Plan, whole: &[Path], node: usize) -> Vec<Arm> {
    let mut arms = Vec::new();
    for (road, street) in plan.streets.iter().enumerate() {
        for (at_start, end) in [(true, street.from), (false, street.to)] {
            if end == node {
                let s = if at_start { 0.0 } else { whole[road].length_m() };
                let heading_rad = wrap(whole[road].at(s).1 + if at_start { 0.0 } else { PI });
                arms.push(Arm { road, at_start, heading_rad, waits: true, crosswalk: !street.profile.verge });
            }
        }
    }
    arms.sort_by(|a, b| a.heading_rad.total_cmp(&b.heading_rad));
    arms
}

/// How far from the node each of two neighbouring arms must end, the second `angle` to the left of the first.
fn corner_needs(a: Profile, b: Profile, angle: f64) -> (f64, f64) {
    if !(SHARPEST_RAD..2.9).contains(&angle) {
        return (6.0, 6.0);
    }
    if angle < 0.6 {
        // Where a ramp leaves: up to where the verges of both part.
        let along = |own: f64, other: f64| (other + own * angle.cos()) / angle.sin() + 8.0;
        return (along(a.back_m(), b.back_m()), along(b.back_m(), a.back_m()));
    }
    let tangent = CORNER_RADIUS_M / (0.5 * angle).tan();
    let along = |own: f64, other: f64| (other + own * angle.cos()) / angle.sin() + tangent;
    (along(a.kerb_m(), b.kerb_m()), along(b.kerb_m(), a.kerb_m()))
}

/// Least angle between two arms.
const SHARPEST_RAD: f64 = 0.12;

/// Who waits, and at what. Nobody waits where nobody arrives.
fn control(junction: Junction, plan: &Plan) -> Junction {
    let mut junction = rules(junction, plan);
    for arm in &mut junction.arms {
        arm.waits &= !(plan.streets[arm.road].profile.one_way && arm.at_start);
    }
    junction
}

/// Half the length of a junction in which a motorway only gains or loses a lane.
const TAPER_M: f64 = 35.0;

/// Ramps give way to the motorway unless they get a lane of their own; lights where four arms or an avenue meet, and at every junction of a dense
/// centre; elsewhere the stem of the T waits.
fn rules(mut junction: Junction, plan: &Plan) -> Junction {
    let arms = &mut junction.arms;
    let motorway = |arm: &&Arm| plan.streets[arm.road].profile.motorway;
    if arms.iter().filter(motorway).count() == 2 && arms.len() <= 3 {
        let lanes = |leaving: bool| {
            arms.iter().filter(motorway).find(|arm| arm.at_start == leaving).map(|arm| plan.streets[arm.road].profile.n_lanes)
        };
        let merges = lanes(true) <= lanes(false);
        arms.iter_mut().for_each(|arm| arm.waits = merges && !plan.streets[arm.road].profile.motorway);
        junction.control = Control::Yield;
        return junction;
    }
    if arms.len() > 3 || plan.all_lights || arms.iter().any(|arm| plan.streets[arm.road].profile.main) {
        return junction;
    }
    let straightness = |i: usize| {
        let (a, b) = (arms[(i + 1) % 3].heading_rad, arms[(i + 2) % 3].heading_rad);
        PI - wrap(a - b).abs()
    };
    let stem = (0..3).min_by(|&a, &b| straightness(a).total_cmp(&straightness(b))).expect("a junction has three arms");
    for (i, arm) in arms.iter_mut().enumerate() {
        arm.waits = i == stem;
        arm.crosswalk &= i == stem;
    }
    let circle = junction.arms.iter().any(|arm| plan.streets[arm.road].profile.one_way);
    junction.control = if !circle && junction.id.is_multiple_of(3) { Control::Stop } else { Control::Yield };
    junction
}

#[derive(Clone, Copy, PartialEq)]
enum Turn {
    Left,
    Straight,
    Right,
}

/// Lane index (0 beside the middle) to OpenDRIVE id of the lane that enters or leaves a junction on this arm.
fn lane_id(arm: &Arm, lane: usize, entering: bool) -> i32 {
    let id = lane as i32 + 1;
    if arm.at_start == entering { id } else { -id }
}

/// Number of lanes that enter (or leave) a junction on an arm.
fn n_lanes(network: &Network, arm: &Arm, entering: bool) -> usize {
    let profile = &network.roads[arm.road].profile;
    if profile.one_way && arm.at_start == entering { 0 } else { profile.n_lanes }
}

fn links_of(network: &Network, junction_idx: usize) -> Vec<Link> {
    let junction = &network.junctions[junction_idx];
    // Lanes that enter the junction on an arm, and lanes that leave it there.
    let lanes = |arm: usize, entering: bool| n_lanes(network, &junction.arms[arm], entering);
    let motorway = |arm: usize| network.roads[junction.arms[arm].road].profile.motorway;
    let turn = |from: usize, to: usize| {
        let angle = wrap(junction.arms[to].heading_rad - junction.arms[from].heading_rad - PI);
        if angle.abs() < 0.6 {
            Turn::Straight
        } else if angle > 0.0 {
            Turn::Left
        } else {
            Turn::Right
        }
    };
    let mut ways: Vec<(usize, usize, usize, usize)> = Vec::new();
    let n = junction.arms.len();
    let pairs: Vec<(usize, usize)> =
        (0..n).flat_map(|a| (0..n).map(move |b| (a, b))).filter(|&(a, b)| a != b && lanes(a, true) > 0 && lanes(b, false) > 0).collect();
    for &(a, b) in &pairs {
        let (n_in, n_out) = (lanes(a, true), lanes(b, false));
        match turn(a, b) {
            Turn::Right => ways.push((a, n_in - 1, b, n_out - 1)),
            Turn::Left => ways.push((a, 0, b, 0)),
            // Lanes of a motorway begin and end on the right.
            Turn::Straight if motorway(a) && motorway(b) => ways.extend((0..n_in.min(n_out)).map(|k| (a, k, b, k))),
            Turn::Straight => ways.extend((0..n_in.min(n_out)).map(|k| (a, n_in - 1 - k, b, n_out - 1 - k))),
        }
    }
    // Lanes that nothing reaches, or that lead nowhere, get a way of the straightest kind there is.
    let rank = |a: usize, b: usize| match turn(a, b) {
        Turn::Straight => 0,
        Turn::Left => 1,
        Turn::Right => 2,
    };
    for arm in 0..n {
        for lane in 0..lanes(arm, true) {
            if !ways.iter().any(|w| w.0 == arm && w.1 == lane) {
                let to = (0..n).filter(|&b| b != arm && lanes(b, false) > 0).min_by_key(|&b| rank(arm, b)).expect("two arms");
                ways.push((arm, lane, to, lane.min(lanes(to, false) - 1)));
            }
        }
        for lane in 0..lanes(arm, false) {
            if !ways.iter().any(|w| w.2 == arm && w.3 == lane) {
                let from = (0..n).filter(|&a| a != arm && lanes(a, true) > 0).min_by_key(|&a| rank(a, arm)).expect("two arms");
                ways.push((from, lane.min(lanes(from, true) - 1), arm, lane));
            }
        }
    }
    ways.sort();
    ways.dedup();
    let first_id = 1001 + network.links.len() as u32;
    ways.iter().enumerate().map(|(i, &way)| link(network, junction_idx, first_id + i as u32, way)).collect()
}

fn link(network: &Network, junction: usize, id: u32, (a, lane_in, b, lane_out): (usize, usize, usize, usize)) -> Link {
    let arms = &network.junctions[junction].arms;
    let profile = |arm: usize| network.roads[arms[arm].road].profile;
    // In driving direction the traffic keeps right of the reference line, so lane k's left edge is k lanes to the right.
    let (p_in, out_heading) = network.arm_end(&arms[a]);
    let heading_in = wrap(out_heading + PI);
    let from = (p_in - left(unit(heading_in)) * profile(a).lane_left_m(lane_in), heading_in);
    let (p_out, heading_out) = network.arm_end(&arms[b]);
    let to = (p_out - left(unit(heading_out)) * profile(b).lane_left_m(lane_out), heading_out);
    Link {
        id,
        junction,
        from: (a, lane_id(&arms[a], lane_in, true)),
        to: (b, lane_id(&arms[b], lane_out, false)),
        path: Path::connect(from, to, f64::INFINITY),
        width_m: (profile(a).lane_m, profile(b).lane_m),
    }
}

fn place_signals(network: &mut Network, junction_idx: usize) {
    let junction = network.junctions[junction_idx].clone();
    let first = network.signals.len();
    for arm in junction.arms.iter().filter(|arm| arm.waits) {
        let side = network.roads[arm.road].profile.kerb_m() + 0.6;
        network.signals.push(Signal {
            id: 1 + network.signals.len() as u32,
            kind: match junction.control {
                Control::Lights => SignalKind::Light,
                Control::Yield => SignalKind::Yield,
                Control::Stop => SignalKind::Stop,
            },
            road: arm.road,
            against: arm.at_start,
            s_m: network.arm_station(arm, STOP_M),
            t_m: if arm.at_start { side } else { -side },
            pole_s_m: network.arm_station(arm, 4.6),
            junction: Some(junction_idx),
        });
    }
    if junction.control != Control::Lights {
        return;
    }
    // Opposite arms are green together where four narrow ones meet. On several lanes who turns left would meet two lanes of oncoming traffic, and
    // cars that wait for each other's gaps in the middle of a junction lock it; of a T, half of an arm's traffic turns left.
    let waiting: Vec<usize> = (0..junction.arms.len()).filter(|&i| junction.arms[i].waits).collect();
    let mut done = vec![false; waiting.len()];
    for i in 0..waiting.len() {
        if done[i] {
            continue;
        }
        let arm = |k: usize| &junction.arms[waiting[k]];
        let is_narrow = |k: usize| network.roads[arm(k).road].profile.n_lanes == 1;
        let opposite = (i + 1..waiting.len()).find(|&k| {
            !done[k] && waiting.len() > 3 && is_narrow(i) && is_narrow(k) && wrap(arm(k).heading_rad - arm(i).heading_rad).abs() > 2.4
        });
        let members: Vec<usize> = std::iter::once(i).chain(opposite).collect();
        members.iter().for_each(|&k| done[k] = true);
        let id = 1 + network.stages.len() as u32;
        network.stages.push(Stage { id, junction: junction_idx, signals: members.into_iter().map(|k| first + k).collect() });
    }
}

fn place_limits(network: &mut Network) {
    for road in 0..network.roads.len() {
        let (length, profile) = (network.roads[road].path.length_m(), network.roads[road].profile);
        for against in [false, true].into_iter().filter(|&against| !(against && profile.one_way)) {
            let side = profile.kerb_m() + 0.6;
            if length < 30.0 {
                continue;
            }
            let s_m = if against { length - 14.0 } else { 14.0 };
            network.signals.push(Signal {
                id: 1 + network.signals.len() as u32,
                kind: SignalKind::Limit(profile.speed_kmh),
                road,
                against,
                s_m,
                t_m: if against { side } else { -side },
                pole_s_m: s_m,
                junction: None,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::town::plans;

    #[test]
    fn connecting_roads_meet_their_lanes() {
        for plan in (0..20).flat_map(plans) {
            let network = Network::build(&plan);
            for link in &network.links {
                let arms = &network.junctions[link.junction].arms;
                for (at, (arm, lane), entering) in [(0.0, link.from, true), (link.path.length_m(), link.to, false)] {
                    let arm = &arms[arm];
                    let road = &network.roads[arm.road];
                    let s = if arm.at_start { 0.0 } else { road.path.length_m() };
                    let inner = road.profile.lane_left_m(lane.unsigned_abs() as usize - 1) * f64::from(lane.signum());
                    let edge = road.path.beside(s, inner);
                    let heading = road.path.at(s).1 + if lane > 0 { PI } else { 0.0 };
                    let (p, h) = link.path.at(at);
                    assert!((p - edge).norm() < 1e-3, "{} road {} entering {entering}", plan.name, link.id);
                    assert!(wrap(h - heading).abs() < 1e-3, "{} road {} entering {entering}", plan.name, link.id);
                }
                let motorway = arms.iter().any(|arm| network.roads[arm.road].profile.motorway);
                let longest_m = if motorway { 140.0 } else { 60.0 };
                assert!(link.path.length_m() < longest_m, "{} road {} is {} m", plan.name, link.id, link.path.length_m());
                for segment in &link.path.segments {
                    assert!(segment.curvature_per_m.abs() < 1.0 / 4.5, "{} road {} bends too much", plan.name, link.id);
                }
            }
        }
    }

    #[test]
    fn every_lane_end_continues() {
        for plan in plans(1) {
            let network = Network::build(&plan);
            for (j, junction) in network.junctions.iter().enumerate() {
                for (a, arm) in junction.arms.iter().enumerate() {
                    for lane in 0..network.roads[arm.road].profile.n_lanes {
                        let exists = |entering: bool| n_lanes(&network, arm, entering) > 0;
                        let ways = |entering: bool| {
                            let id = lane_id(arm, lane, entering);
                            network
                                .links
                                .iter()
                                .filter(|l| l.junction == j && if entering { l.from == (a, id) } else { l.to == (a, id) })
                                .count()
                        };
                        assert!(
                            [true, false].into_iter().all(|entering| ways(entering) > 0 || !exists(entering)),
                            "junction {} arm {a} lane {lane}",
                            junction.id
                        );
                    }
                }
            }
        }
    }
}
