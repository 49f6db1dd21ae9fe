//! Roads cut at junctions, lanes joined by connecting roads, traffic lights and signs.

use std::f64::consts::PI;

use crate::elevation::Elevation;
use crate::geometry::{P2, Path, wrap};
use crate::kerb::corner;
use crate::plan::{Plan, Profile, Street};

mod connect;
mod right_of_way;

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
    /// Stations of the surface's corners: chords deviate little from the road, sideways and in
    /// height.
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
        stations.extend(
            self.stations[first..]
                .iter()
                .take_while(|&&s| s < to_m - 0.05),
        );
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
        self.bridge.map_or(vec![(0.0, length)], |(from, to)| {
            vec![(0.0, from), (to, length)]
        })
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
        let course = |s: &Street| {
            s.course.clone().unwrap_or_else(|| {
                Path::rounded(plan.nodes_m[s.from], &s.bends, plan.nodes_m[s.to])
            })
        };
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
            junctions.push(right_of_way::control(
                Junction {
                    id: 2001 + node as u32,
                    height_m: plan.heights_m[node],
                    arms,
                    control: Control::Lights,
                },
                plan,
            ));
        }
        let roads: Vec<Road> = plan
            .streets
            .iter()
            .zip(&whole)
            .zip(&trims)
            .enumerate()
            .map(|(i, ((street, path), trim))| {
                let (whole_m, path) = (
                    path.length_m(),
                    path.cut(trim[0], path.length_m() - trim[1]),
                );
                let (from_m, to_m) = (plan.heights_m[street.from], plan.heights_m[street.to]);
                // Shares of the whole street are shares of what the junctions left of it.
                let share = |share: f64| (share * whole_m - trim[0]) / path.length_m();
                let rises: Vec<(f64, f64)> = street
                    .rises_m
                    .iter()
                    .map(|&(at, rise_m)| (share(at), rise_m))
                    .collect();
                let elevation = Elevation::between(path.length_m(), from_m, to_m, &rises);
                let bridge = street
                    .bridge_m
                    .map(|(from, to)| (from - trim[0], to - trim[0]));
                let ends = [street.from, street.to];
                let stations = stations(&path, &elevation, bridge);
                Road {
                    id: 1 + i as u32,
                    path,
                    elevation,
                    profile: street.profile,
                    tunnel: street.tunnel,
                    bridge,
                    ends,
                    stations,
                }
            })
            .collect();
        let mut network = Network {
            roads,
            junctions,
            links: Vec::new(),
            signals: Vec::new(),
            stages: Vec::new(),
        };
        for junction in 0..network.junctions.len() {
            let links = connect::links_of(&network, junction);
            network.links.extend(links);
            right_of_way::place_signals(&mut network, junction);
        }
        right_of_way::place_limits(&mut network);
        network
    }

    /// Whether everything has the height 0.
    pub fn is_level(&self) -> bool {
        self.junctions
            .iter()
            .all(|junction| junction.height_m == 0.0)
            && self.roads.iter().all(|road| road.elevation.is_level())
    }

    /// The edge of a junction's surface, counter-clockwise.
    pub fn border(&self, junction: usize) -> Vec<P2> {
        let arms = 0..self.junctions[junction].arms.len();
        let mut border: Vec<P2> = arms
            .flat_map(|i| corner(self, junction, i).kerb_m)
            .collect();
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
        if arm.at_start {
            away_m
        } else {
            self.roads[arm.road].path.length_m() - away_m
        }
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
                let s = if at_start {
                    0.0
                } else {
                    whole[road].length_m()
                };
                let heading_rad = wrap(whole[road].at(s).1 + if at_start { 0.0 } else { PI });
                arms.push(Arm {
                    road,
                    at_start,
                    heading_rad,
                    waits: true,
                    crosswalk: !street.profile.verge,
                });
            }
        }
    }
    arms.sort_by(|a, b| a.heading_rad.total_cmp(&b.heading_rad));
    arms
}

/// How far from the node each of two neighbouring arms must end, the second `angle` to the left of
/// the first.
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

/// Half the length of a junction in which a motorway only gains or loses a lane.
const TAPER_M: f64 = 35.0;
