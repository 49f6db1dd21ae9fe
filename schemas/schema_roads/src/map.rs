//! The map: what it holds and how it is put together.

use std::collections::HashMap;

use crate::graph;
use crate::index::{Chord, Grid};
use crate::lane::{Lane, LaneKey};
use crate::objects::{self, RoadObject};
use crate::query::CHORD_SLACK_M;
use crate::raw::RawMap;
use crate::signals::{self, Controller, Crosswalk, Signal, SignalStop};
use crate::{MapError, Warning, parse};

/// Latitude and longitude of the origin of a map that states none, degrees (as CARLA).
pub const DEFAULT_GEO_REFERENCE: (f64, f64) = (42.0, 2.0);
/// Most lanes.
const MAX_LANES: usize = 2_000_000;
/// Most chords the search index aims at.
const MAX_CHORDS: f64 = 2.0e6;
/// Length of a chord where the map is not gigantic, metres.
const CHORD_M: f64 = 2.0;

/// Most chords that are cut in two for a tight bend; a map that has more such bends is no road
/// network.
const MAX_HALVINGS: u32 = 100_000;

/// A road network.
#[derive(Clone, Debug)]
pub struct RoadMap {
    pub(crate) raw: RawMap,
    pub(crate) lanes: Vec<Lane>,
    pub(crate) grid: Grid,
    pub(crate) chord_reach_m: f64,
    signals: Vec<Signal>,
    controllers: Vec<Controller>,
    crosswalks: Vec<Crosswalk>,
    objects: Vec<RoadObject>,
    signal_stops: HashMap<LaneKey, Vec<(u32, SignalStop)>>,
}

impl RoadMap {
    /// Reads an OpenDRIVE text. What cannot be used is left out and named in [`RoadMap::warnings`].
    pub fn parse(xodr_text: &str) -> Result<RoadMap, MapError> {
        let raw = parse::parse(xodr_text)?;
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
            .map(|walk| signals::crosswalk(&raw, walk))
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
        let grid = Grid::new(Vec::new());
        let mut map = RoadMap {
            raw,
            lanes,
            grid,
            chord_reach_m: 0.0,
            signals,
            controllers,
            crosswalks,
            objects,
            signal_stops,
        };
        map.build_index();
        Ok(map)
    }

    fn build_index(&mut self) {
        let total_m: f64 = self.lanes.iter().map(|lane| lane.length_m).sum();
        let step_m = CHORD_M.max(total_m / MAX_CHORDS);
        let mut chords: Vec<Chord> = Vec::new();
        let mut halvings = MAX_HALVINGS;
        for (idx, lane) in self.lanes.iter().enumerate() {
            let pieces = (lane.length_m / step_m).ceil().max(1.0) as usize;
            let at = |i: usize| lane.length_m * i as f64 / pieces as f64;
            let mut from_m = self.middle_point(lane, 0.0);
            for i in 0..pieces {
                let to_m = self.middle_point(lane, at(i + 1));
                self.add_chords(
                    &mut chords,
                    Chord {
                        from_m,
                        to_m,
                        lane: idx as u32,
                        s_m: [at(i), at(i + 1)],
                    },
                    &mut halvings,
                );
                from_m = to_m;
            }
        }
        let reach = |c: &Chord| (c.to_m[0] - c.from_m[0]).hypot(c.to_m[1] - c.from_m[1]);
        self.chord_reach_m = chords.iter().map(reach).fold(0.0, f64::max);
        self.grid = Grid::new(chords);
    }

    /// The chord, or two for its halves where the lane's middle leaves it by half of what the
    /// search allows for: a bend may be tighter than a
    /// chord is long.
    fn add_chords(&self, chords: &mut Vec<Chord>, chord: Chord, halvings: &mut u32) {
        const SHORTEST_M: f64 = 0.05;
        let half_s_m = 0.5 * (chord.s_m[0] + chord.s_m[1]);
        if *halvings > 0 && chord.s_m[1] - chord.s_m[0] > SHORTEST_M {
            let half_m = self.middle_point(&self.lanes[chord.lane as usize], half_s_m);
            if chord.foot(half_m).0.sqrt() > 0.5 * CHORD_SLACK_M {
                *halvings -= 1;
                self.add_chords(
                    chords,
                    Chord {
                        to_m: half_m,
                        s_m: [chord.s_m[0], half_s_m],
                        ..chord
                    },
                    halvings,
                );
                self.add_chords(
                    chords,
                    Chord {
                        from_m: half_m,
                        s_m: [half_s_m, chord.s_m[1]],
                        ..chord
                    },
                    halvings,
                );
                return;
            }
        }
        if chord
            .from_m
            .iter()
            .chain(&chord.to_m)
            .all(|x| x.is_finite() && x.abs() < 1e9)
        {
            chords.push(chord);
        }
    }

    /// What was left out or odd.
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

    /// A lane.
    pub fn lane(&self, key: LaneKey) -> Option<&Lane> {
        graph::find(&self.lanes, key).map(|idx| &self.lanes[idx])
    }

    /// Lanes traffic may go on to at the end of this one, by rising key; empty for an unknown lane.
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

    /// Signals that must be obeyed by who takes this lane, and where to stop for each.
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

    /// Objects other than crosswalks; a repeated one once per repetition.
    pub fn objects(&self) -> &[RoadObject] {
        &self.objects
    }

    /// Latitude and longitude of the world's origin, degrees; 42° and 2° if the file states none.
    pub fn geo_reference(&self) -> (f64, f64) {
        self.raw.geo_reference.unwrap_or(DEFAULT_GEO_REFERENCE)
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
