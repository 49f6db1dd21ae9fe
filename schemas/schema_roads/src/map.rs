//! The map: how it is put together, and what it holds.

use std::collections::HashMap;

use crate::chords::LaneChords;
use crate::curve::{Geometry, Shape};
use crate::error::{MapError, Warning};
use crate::graph;
use crate::lane::{Lane, LaneKey};
use crate::objects::{self, Crosswalk, RoadObject};
use crate::parse::parse;
use crate::raw::{JunctionKind, RawMap};
use crate::signals::{self, Controller, Signal, SignalStop};

/// Latitude and longitude of the origin of a map that states none, degrees; CARLA's values.
pub const DEFAULT_GEO_REFERENCE: (f64, f64) = (42.0, 2.0);
/// Most lanes.
const MAX_LANES: usize = 2_000_000;
/// Facts about a road.
#[derive(Clone, Debug, PartialEq)]
pub struct RoadInfo<'m> {
    /// Its number in [`LaneKey`].
    pub number: u32,
    /// OpenDRIVE's id.
    pub id: &'m str,
    /// Length of the reference line, metres.
    pub length_m: f64,
    /// Junction it belongs to.
    pub junction: Option<u32>,
}

/// Facts about a junction.
#[derive(Clone, Debug, PartialEq)]
pub struct JunctionInfo<'m> {
    /// Its number in [`Lane::junction`].
    pub number: u32,
    /// OpenDRIVE's id.
    pub id: &'m str,
    /// How its roads meet.
    pub kind: JunctionKind,
    /// Number of its connections.
    pub n_connections: usize,
}

/// A road network.
#[derive(Clone, Debug)]
pub struct RoadMap {
    pub(crate) raw: RawMap,
    pub(crate) lanes: Vec<Lane>,
    pub(crate) chords: LaneChords,
    signals: Vec<Signal>,
    controllers: Vec<Controller>,
    crosswalks: Vec<Crosswalk>,
    objects: Vec<RoadObject>,
    signal_stops: HashMap<LaneKey, Vec<(u32, SignalStop)>>,
}

impl RoadMap {
    /// Reads an OpenDRIVE text. What cannot be used is left out and named in [`RoadMap::warnings`].
    pub fn parse(xodr_text: &str) -> Result<RoadMap, MapError> {
        let raw = parse(xodr_text)?;
        let mut lanes = graph::lanes(&raw);
        if lanes.len() > MAX_LANES {
            return Err(MapError::TooLarge(format!(
                "it has {} lanes; at most {MAX_LANES} are read",
                lanes.len()
            )));
        }
        graph::link(&raw, &mut lanes);
        let signals = signals::signals(&raw, &lanes);
        let controllers = signals::controllers(&raw, &signals);
        let crosswalks = raw
            .crosswalks
            .iter()
            .map(|walk| objects::crosswalk(&raw, walk))
            .collect();
        let objects = raw
            .objects
            .iter()
            .map(|object| objects::object(&raw, object))
            .collect();
        let mut signal_stops: HashMap<LaneKey, Vec<(u32, SignalStop)>> = HashMap::new();
        for (idx, signal) in signals.iter().enumerate() {
            for stop in &signal.stops {
                signal_stops
                    .entry(stop.lane)
                    .or_default()
                    .push((idx as u32, *stop));
            }
        }
        Ok(RoadMap {
            chords: LaneChords::new(&raw, &lanes),
            raw,
            lanes,
            signals,
            controllers,
            crosswalks,
            objects,
            signal_stops,
        })
    }

    /// What was left out, or needed an interpretation.
    pub fn warnings(&self) -> &[Warning] {
        &self.raw.warnings
    }

    /// Name in the file's header.
    pub fn name(&self) -> &str {
        &self.raw.name
    }

    /// All lanes by rising key.
    pub fn lanes(&self) -> &[Lane] {
        &self.lanes
    }

    /// The lane of this name.
    pub fn lane(&self, key: LaneKey) -> Option<&Lane> {
        graph::find(&self.lanes, key).map(|idx| &self.lanes[idx])
    }

    /// Lanes that traffic may continue on at the end of this one, by rising key; empty for an
    /// unknown lane.
    pub fn successors(&self, key: LaneKey) -> &[LaneKey] {
        self.lane(key).map_or(&[], |lane| &lane.successors)
    }

    /// Lanes traffic may come from, by rising key; empty for an unknown lane.
    pub fn predecessors(&self, key: LaneKey) -> &[LaneKey] {
        self.lane(key).map_or(&[], |lane| &lane.predecessors)
    }

    /// All signals in the file's order.
    pub fn signals(&self) -> &[Signal] {
        &self.signals
    }

    /// Signals that vehicles on this lane must obey, and where to stop for each.
    pub fn signal_stops(&self, lane: LaneKey) -> impl Iterator<Item = (&Signal, SignalStop)> {
        let list = self.signal_stops.get(&lane).map_or(&[][..], Vec::as_slice);
        list.iter()
            .map(|(idx, stop)| (&self.signals[*idx as usize], *stop))
    }

    /// Groups of signals that switch together.
    pub fn controllers(&self) -> &[Controller] {
        &self.controllers
    }

    /// Crosswalks.
    pub fn crosswalks(&self) -> &[Crosswalk] {
        &self.crosswalks
    }

    /// Objects other than crosswalks; a repeated object is listed once per repetition.
    pub fn objects(&self) -> &[RoadObject] {
        &self.objects
    }

    /// Latitude and longitude of the world's origin, degrees; 42° and 2° if the file states none.
    pub fn geo_reference(&self) -> (f64, f64) {
        self.raw.geo_reference.unwrap_or(DEFAULT_GEO_REFERENCE)
    }

    /// Revision that the file states, e.g. (1, 6).
    pub fn revision(&self) -> Option<(u32, u32)> {
        self.raw.revision
    }

    /// Whether the file says where on Earth it lies.
    pub fn has_geo_reference(&self) -> bool {
        self.raw.geo_reference.is_some()
    }

    /// Greatest difference between the length of a polynomial curve and the length that the file
    /// states for it, metres. Here a curve's ends are those of its record; a program that follows
    /// the curve by its own length ends that far from them.
    pub fn length_mismatch_m(&self) -> f64 {
        let curves = self.raw.roads.iter().flat_map(|road| &road.plan);
        let excess = |geometry: &Geometry| match &geometry.shape {
            Shape::Param(curve) => curve.excess_m(geometry.length_m).abs(),
            _ => 0.0,
        };
        curves.map(excess).fold(0.0, f64::max)
    }

    /// All junctions in the file's order.
    pub fn junctions(&self) -> impl Iterator<Item = JunctionInfo<'_>> {
        self.raw.junctions.iter().map(|junction| JunctionInfo {
            number: junction.number,
            id: &junction.id,
            kind: junction.kind,
            n_connections: junction.connections.len(),
        })
    }

    /// All roads in the file's order.
    pub fn roads(&self) -> impl Iterator<Item = RoadInfo<'_>> {
        let numbers = self.raw.junction_numbers();
        self.raw.roads.iter().map(move |road| RoadInfo {
            number: road.number,
            id: &road.id,
            length_m: road.length_m,
            junction: road.junction_number(&numbers),
        })
    }

    /// OpenDRIVE's id of a road by its number.
    pub fn road_id(&self, road: u32) -> Option<&str> {
        self.raw
            .roads
            .iter()
            .find(|r| r.number == road)
            .map(|r| r.id.as_str())
    }

    /// OpenDRIVE's id of a junction by its number.
    pub fn junction_id(&self, junction: u32) -> Option<&str> {
        self.raw
            .junctions
            .iter()
            .find(|j| j.number == junction)
            .map(|j| j.id.as_str())
    }
}
