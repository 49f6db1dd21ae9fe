//! Who drives on which lane: the vehicles before and behind a place on a lane.

use crate::lanes::network::{LanePlace, Network};

/// Deepest search along following lanes.
const MAX_LANES: usize = 12;

/// A vehicle on a lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OnLane {
    /// Lane and place of its middle.
    pub at: LanePlace,
    /// Index of the mover.
    pub mover: u32,
}

/// Where to look for a vehicle's neighbour.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Search {
    /// The place from which distances count.
    pub from: LanePlace,
    /// How far to look, metres.
    pub within_m: f64,
    /// Index of the mover that looks.
    pub me: u32,
}

/// A vehicle before or behind a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Neighbour {
    /// How far its middle is from the place, along the lanes, metres.
    pub distance_m: f64,
    /// Index of the mover.
    pub mover: u32,
}

#[derive(Clone, Copy, PartialEq)]
enum Direction {
    Ahead,
    Behind,
}

/// All vehicles by lane.
#[derive(Clone, Debug, Default)]
pub(crate) struct LaneTable {
    entries: Vec<OnLane>,
}

impl LaneTable {
    pub fn new(mut entries: Vec<OnLane>) -> LaneTable {
        entries.sort_unstable_by(|a, b| {
            a.at.lane
                .cmp(&b.at.lane)
                .then(a.at.s_m.total_cmp(&b.at.s_m))
                .then(a.mover.cmp(&b.mover))
        });
        LaneTable { entries }
    }

    /// Enters one more vehicle, or a further lane of one.
    pub fn insert(&mut self, entry: OnLane) {
        let at = self
            .entries
            .partition_point(|it| (it.at.lane, it.at.s_m) < (entry.at.lane, entry.at.s_m));
        self.entries.insert(at, entry);
    }

    /// Vehicles on a lane by rising s.
    pub fn on(&self, lane: u32) -> &[OnLane] {
        let from = self.entries.partition_point(|entry| entry.at.lane < lane);
        let to = self.entries.partition_point(|entry| entry.at.lane <= lane);
        &self.entries[from..to]
    }

    /// The nearest vehicle ahead of a place.
    pub fn ahead(&self, net: &mut Network, search: &Search) -> Option<Neighbour> {
        self.nearest(net, search, Direction::Ahead)
    }

    /// The nearest vehicle behind a place.
    pub fn behind(&self, net: &mut Network, search: &Search) -> Option<Neighbour> {
        self.nearest(net, search, Direction::Behind)
    }

    fn nearest(
        &self,
        net: &mut Network,
        search: &Search,
        direction: Direction,
    ) -> Option<Neighbour> {
        let LanePlace { lane, s_m } = search.from;
        let forward = direction == Direction::Ahead;
        // Lanes to search, and how far their beginning in the direction of the search is away.
        let span_m = net.way(lane).span_m;
        let mut open = vec![(lane, if forward { -s_m } else { s_m - span_m })];
        let mut best: Option<Neighbour> = None;
        let mut n_lanes = 0;
        while let Some((lane, start_m)) = open.pop() {
            n_lanes += 1;
            let way = net.way(lane);
            let place = |it: &OnLane| {
                start_m
                    + if forward {
                        it.at.s_m
                    } else {
                        way.span_m - it.at.s_m
                    }
            };
            let found = self
                .on(lane)
                .iter()
                .filter(|it| it.mover != search.me)
                .map(|it| Neighbour {
                    distance_m: place(it),
                    mover: it.mover,
                })
                .filter(|it| it.distance_m >= 0.0 && it.distance_m < search.within_m)
                .min_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
            match found {
                Some(found) if best.is_none_or(|old| found.distance_m < old.distance_m) => {
                    best = Some(found)
                }
                Some(_) => {}
                None if start_m + way.span_m < search.within_m && n_lanes < MAX_LANES => {
                    let next = if forward {
                        &way.successors
                    } else {
                        &way.predecessors
                    };
                    open.extend(next.iter().map(|lane| (*lane, start_m + way.span_m)));
                }
                None => {}
            }
        }
        best
    }
}
