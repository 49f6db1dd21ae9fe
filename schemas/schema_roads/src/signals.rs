//! Signals and controllers in the world.

use std::collections::HashMap;

use nalgebra::{Isometry3, Vector3};

use crate::graph;
use crate::lane::{Lane, LaneKey, LanePosition};
use crate::raw::{End, Placement, RawMap, RawSignal};

/// What a signal shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SignalKind {
    /// A traffic light for vehicles.
    TrafficLight,
    /// Stop sign.
    Stop,
    /// Give way.
    Yield,
    /// Speed limit.
    SpeedLimit,
    /// Anything else.
    Other,
}

/// Where vehicles on one lane stop for a signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SignalStop {
    /// Lane that is controlled: vehicles that drive onto it must obey.
    pub lane: LaneKey,
    /// Where to stop. On the controlled lane itself, or at the end of the lane before it if that
    /// one crosses a junction.
    pub stop: LanePosition,
}

/// A signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// OpenDRIVE id.
    pub id: String,
    /// Its name.
    pub name: String,
    /// What it shows.
    pub kind: SignalKind,
    /// OpenDRIVE's type, e.g. `1000001`.
    pub type_code: String,
    /// OpenDRIVE's subtype.
    pub subtype: String,
    /// Country code.
    pub country: String,
    /// Value, e.g. of a speed limit.
    pub value: Option<f64>,
    /// Unit of the value.
    pub unit: String,
    /// Text on it.
    pub text: String,
    /// Whether it changes.
    pub dynamic: bool,
    /// Pose in the world: x points out of its face, against the traffic that it is for.
    pub pose: Isometry3<f64>,
    /// Width, metres; 0 if not stated.
    pub width_m: f64,
    /// Height, metres; 0 if not stated.
    pub height_m: f64,
    /// Lanes that it is valid for, and where to stop on each.
    pub stops: Vec<SignalStop>,
    /// Junction that it belongs to: that of its road, or else the one that its traffic drives
    /// towards.
    pub junction: Option<u32>,
}

impl Signal {
    /// Lanes it is valid for.
    pub fn lanes(&self) -> impl Iterator<Item = LaneKey> + '_ {
        self.stops.iter().map(|stop| stop.lane)
    }
}

/// Signals that switch together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Controller {
    /// OpenDRIVE id.
    pub id: String,
    /// Its name.
    pub name: String,
    /// Ids of its signals.
    pub signals: Vec<String>,
    /// Junction it belongs to.
    pub junction: Option<u32>,
    /// Place in the junction's sequence of controllers.
    pub sequence: u32,
}

/// Kind by type code: CARLA's and Germany's numbers.
fn kind(signal: &RawSignal) -> SignalKind {
    match signal.kind.as_str() {
        "1000001" | "1000009" | "1000010" | "1000011" | "1000012" => SignalKind::TrafficLight,
        "206" => SignalKind::Stop,
        "205" => SignalKind::Yield,
        "274" => SignalKind::SpeedLimit,
        _ => SignalKind::Other,
    }
}

pub(crate) fn signals(map: &RawMap, lanes: &[Lane]) -> Vec<Signal> {
    let mut references: HashMap<&str, Vec<&Placement>> = HashMap::new();
    for (id, placement) in &map.references {
        references.entry(id).or_default().push(placement);
    }
    map.signals
        .iter()
        .map(|raw| {
            let further = references
                .get(raw.id.as_str())
                .into_iter()
                .flatten()
                .copied();
            let mut stops = Vec::new();
            for placement in std::iter::once(&raw.placement).chain(further) {
                placed_stops(map, lanes, placement, &mut stops);
            }
            let junction = junction(map, &raw.placement).or_else(|| {
                stops
                    .iter()
                    .find_map(|stop| lanes[graph::find(lanes, stop.lane)?].junction)
            });
            signal(map, raw, stops, junction)
        })
        .collect()
}

fn signal(map: &RawMap, raw: &RawSignal, stops: Vec<SignalStop>, junction: Option<u32>) -> Signal {
    Signal {
        id: raw.id.clone(),
        name: raw.name.clone(),
        kind: kind(raw),
        type_code: raw.kind.clone(),
        subtype: raw.subtype.clone(),
        country: raw.country.clone(),
        value: raw.value,
        unit: raw.unit.clone(),
        text: raw.text.clone(),
        dynamic: raw.dynamic,
        pose: pose(map, raw),
        width_m: raw.width_m,
        height_m: raw.height_m,
        stops,
        junction,
    }
}

fn pose(map: &RawMap, raw: &RawSignal) -> Isometry3<f64> {
    let Placement {
        road,
        s_m,
        t_m,
        along,
        ..
    } = raw.placement;
    let station = map.roads[road].station(s_m);
    let [x, y, z] = station.point(t_m, 0.0);
    let against = if along == Some(false) {
        0.0
    } else {
        std::f64::consts::PI
    };
    let yaw = station.plan.heading_rad + against + raw.heading_offset_rad;
    Isometry3::new(Vector3::new(x, y, z + raw.z_offset_m), Vector3::z() * yaw)
}

/// The stops of one placement: on the lanes that it names and whose traffic its orientation is for;
/// where these are none, the named lanes decide alone, as for CARLA.
fn placed_stops(map: &RawMap, lanes: &[Lane], placement: &Placement, stops: &mut Vec<SignalStop>) {
    let before = stops.len();
    stops_of(map, lanes, placement, placement.along, stops);
    if stops.len() == before && !placement.validity.is_empty() {
        stops_of(map, lanes, placement, None, stops);
    }
}

fn stops_of(
    map: &RawMap,
    lanes: &[Lane],
    placement: &Placement,
    along: Option<bool>,
    stops: &mut Vec<SignalStop>,
) {
    let road = &map.roads[placement.road];
    let section = road.section_at(placement.s_m);
    for raw in road.sections[section]
        .left
        .iter()
        .chain(&road.sections[section].right)
    {
        let key = LaneKey {
            road: road.number,
            section: section as u16,
            lane: raw.id,
        };
        let Some(lane) = graph::find(lanes, key).map(|idx| &lanes[idx]) else {
            continue;
        };
        let right_way = along.is_none_or(|along| along == lane.forward);
        if !right_way || !lane.kind.is_drivable() || !placement.is_valid_for(raw.id) {
            continue;
        }
        if lane.junction.is_some() && !lane.predecessors.is_empty() {
            for before in &lane.predecessors {
                let Some(idx) = graph::find(lanes, *before) else {
                    continue;
                };
                stops.push(SignalStop {
                    lane: key,
                    stop: LanePosition::new(*before, lanes[idx].length_m),
                });
            }
        } else {
            let s_m = lane.s_at_station_m(placement.s_m).clamp(0.0, lane.length_m);
            stops.push(SignalStop {
                lane: key,
                stop: LanePosition::new(key, s_m),
            });
        }
    }
}

fn junction(map: &RawMap, placement: &Placement) -> Option<u32> {
    let road = &map.roads[placement.road];
    if let Some(id) = &road.junction {
        return map.junctions.iter().find(|j| j.id == *id).map(|j| j.number);
    }
    let ends = match placement.along {
        Some(true) => [End::Finish, End::Finish],
        Some(false) => [End::Start, End::Start],
        None if placement.s_m < 0.5 * road.length_m => [End::Start, End::Finish],
        None => [End::Finish, End::Start],
    };
    ends.into_iter()
        .find_map(|end| graph::junction_at(map, road, end))
}

pub(crate) fn controllers(map: &RawMap, signals: &[Signal]) -> Vec<Controller> {
    let mut homes: HashMap<&str, (u32, u32)> = HashMap::new();
    for junction in &map.junctions {
        for (id, sequence) in &junction.controllers {
            homes.insert(id, (junction.number, *sequence));
        }
    }
    let junction_of: HashMap<&str, u32> = signals
        .iter()
        .filter_map(|s| Some((s.id.as_str(), s.junction?)))
        .collect();
    map.controllers
        .iter()
        .enumerate()
        .map(|(idx, raw)| {
            let home = homes.get(raw.id.as_str());
            Controller {
                id: raw.id.clone(),
                name: raw.name.clone(),
                signals: raw.signals.clone(),
                junction: home.map(|h| h.0).or_else(|| {
                    raw.signals
                        .iter()
                        .find_map(|id| junction_of.get(id.as_str()).copied())
                }),
                sequence: home
                    .map(|h| h.1)
                    .filter(|s| *s != u32::MAX)
                    .unwrap_or(idx as u32),
            }
        })
        .collect()
}
