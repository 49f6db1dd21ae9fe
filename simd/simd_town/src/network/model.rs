//! Roads, junctions, lanes through them, lights and signs: all that OpenDRIVE says of a town,
//! before it is text.

use std::f64::consts::PI;

use super::elevation::Elevation;
use crate::geometry::{P2, Path, cross, left, unit};
use crate::plan::Profile;

/// Radius of kerbs at corners.
pub const CORNER_RADIUS_M: f64 = 6.5;
/// Where a crosswalk begins and ends, from the junction's edge outwards.
pub const CROSSWALK_M: (f64, f64) = (0.8, 4.0);
/// Middle of the stop line from the junction's edge where there is a crosswalk.
pub const STOP_M: f64 = 5.2;
/// Height of the pavement over the road.
pub const KERB_HEIGHT_M: f64 = 0.15;
/// Height and width of a parapet.
pub const PARAPET_M: (f64, f64) = (0.95, 0.3);
/// Least distance of a kerb from the lanes that lead through its junction.
pub const CLEAR_M: f64 = 0.3;
/// Distance between the points of a kerb at which its clearance is measured.
const PROBE_M: f64 = 0.5;

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

impl Road {
    /// The stations between two stations, both included.
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

    /// Stretches that lie on the ground: the whole road, or what lies before and behind its bridge.
    pub fn on_ground(&self) -> Vec<(f64, f64)> {
        let length = self.path.length_m();
        self.bridge.map_or(vec![(0.0, length)], |(from, to)| {
            vec![(0.0, from), (to, length)]
        })
    }

    /// A point of the road's surface, `up_m` over it.
    pub fn point(&self, s_m: f64, t_m: f64, up_m: f64) -> [f64; 3] {
        let p = self.path.beside(s_m, t_m);
        [p.x, p.y, self.elevation.at(s_m) + up_m]
    }

    /// Width of the footway (or verge) on a deck.
    pub fn deck_edge_m(&self) -> f64 {
        self.profile.pavement_m.min(2.0)
    }

    /// Half the width of a deck.
    pub fn deck_half_width_m(&self) -> f64 {
        self.profile.kerb_m() + self.deck_edge_m() + PARAPET_M.1
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

/// Right of way at a junction.
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
    /// Which arms give way.
    pub control: Control,
}

/// A connecting lane: one way from one lane through a junction to another.
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
    /// Whether everything has the height 0.
    pub fn is_level(&self) -> bool {
        self.junctions
            .iter()
            .all(|junction| junction.height_m == 0.0)
            && self.roads.iter().all(|road| road.elevation.is_level())
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

    /// Whether a point lies under or beside a bridge's deck.
    pub fn is_near_bridge(&self, p: P2, margin_m: f64) -> bool {
        self.roads
            .iter()
            .filter(|road| road.bridge.is_some())
            .any(|road| {
                let (from, to) = road.bridge.unwrap_or_default();
                let (s, away) = road.path.nearest(p);
                s > from - 4.0 && s < to + 4.0 && away < road.deck_half_width_m() + margin_m
            })
    }
}

impl Link {
    /// Progress from the start's width to the end's at a station, 0 to 1, with slope 0 at both
    /// ends, as OpenDRIVE's cubic has it.
    pub fn share_at(&self, s_m: f64) -> f64 {
        let u = (s_m / self.path.length_m()).clamp(0.0, 1.0);
        u * u * (3.0 - 2.0 * u)
    }

    /// Width of the lane at a station.
    pub fn width_at(&self, s_m: f64) -> f64 {
        self.width_m.0 + (self.width_m.1 - self.width_m.0) * self.share_at(s_m)
    }

    /// Least distance of a line from the lane; negative where the line enters it.
    pub fn clearance_m(&self, line_m: &[P2]) -> f64 {
        let probes = line_m.windows(2).flat_map(|pair| {
            let n = ((pair[1] - pair[0]).norm() / PROBE_M).ceil().max(1.0) as usize;
            (0..=n).map(move |k| pair[0] + (pair[1] - pair[0]) * (k as f64 / n as f64))
        });
        probes.map(|p| self.away_m(p)).fold(f64::INFINITY, f64::min)
    }

    /// The nearest place that is clear of the lane.
    pub fn moved_off(&self, p: P2) -> P2 {
        if self.away_m(p) >= CLEAR_M {
            return p;
        }
        let (s, _) = self.path.nearest(p);
        let (q, heading) = self.path.at(s);
        let (rightward, width) = (cross(p - q, unit(heading)), self.width_at(s));
        let wanted = if rightward < 0.5 * width {
            -CLEAR_M
        } else {
            width + CLEAR_M
        };
        p - left(unit(heading)) * (wanted - rightward)
    }

    /// Distance of a point from the lane, negative inside it.
    fn away_m(&self, p: P2) -> f64 {
        let (s, _) = self.path.nearest(p);
        let (q, heading) = self.path.at(s);
        let (forward, rightward) = (
            (p - q).dot(&unit(heading)).abs(),
            cross(p - q, unit(heading)),
        );
        let aside = (rightward - self.width_at(s)).max(-rightward);
        // The point lies before the lane's start or behind its end.
        if forward > 1e-3 {
            aside.max(0.0).hypot(forward)
        } else {
            aside
        }
    }
}

/// Heading of a signal's face: against the traffic that must obey.
pub fn facing(road_heading_rad: f64, against: bool) -> f64 {
    if against {
        road_heading_rad
    } else {
        road_heading_rad + PI
    }
}
