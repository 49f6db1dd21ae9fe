//! Who drives on which lane: the vehicles before and behind a place on a lane.

use crate::network::Network;

/// Deepest search along following lanes.
const MAX_LANES: usize = 12;

/// A vehicle on a lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OnLane {
    pub lane: u32,
    /// Lane s of its middle, metres.
    pub s_m: f64,
    /// Index of the mover.
    pub mover: u32,
}

/// All vehicles by lane.
#[derive(Clone, Debug, Default)]
pub(crate) struct LaneTable {
    entries: Vec<OnLane>,
}

impl LaneTable {
    pub fn new(mut entries: Vec<OnLane>) -> LaneTable {
        entries.sort_unstable_by(|a, b| {
            a.lane
                .cmp(&b.lane)
                .then(a.s_m.total_cmp(&b.s_m))
                .then(a.mover.cmp(&b.mover))
        });
        LaneTable { entries }
    }

    /// Enters one more vehicle, or a further lane of one.
    pub fn insert(&mut self, entry: OnLane) {
        let at = self
            .entries
            .partition_point(|it| (it.lane, it.s_m) < (entry.lane, entry.s_m));
        self.entries.insert(at, entry);
    }

    /// Vehicles on a lane by rising s.
    pub fn on(&self, lane: u32) -> &[OnLane] {
        let from = self.entries.partition_point(|entry| entry.lane < lane);
        let to = self.entries.partition_point(|entry| entry.lane <= lane);
        &self.entries[from..to]
    }

    /// The nearest vehicle ahead of a place, other than `me`, and how far its middle is ahead.
    pub fn ahead(
        &self,
        net: &mut Network,
        lane: u32,
        s_m: f64,
        within_m: f64,
        me: u32,
    ) -> Option<(f64, u32)> {
        self.search(net, lane, s_m, within_m, me, true)
    }

    /// The nearest vehicle behind a place, and how far its middle is behind.
    pub fn behind(
        &self,
        net: &mut Network,
        lane: u32,
        s_m: f64,
        within_m: f64,
        me: u32,
    ) -> Option<(f64, u32)> {
        self.search(net, lane, s_m, within_m, me, false)
    }

    fn search(
        &self,
        net: &mut Network,
        lane: u32,
        s_m: f64,
        within_m: f64,
        me: u32,
        forward: bool,
    ) -> Option<(f64, u32)> {
        // Lanes to search, and how far their beginning in the direction of the search is away.
        let span_m = net.way(lane).span_m;
        let mut open = vec![(lane, if forward { -s_m } else { s_m - span_m })];
        let mut best: Option<(f64, u32)> = None;
        let mut n_lanes = 0;
        while let Some((lane, start_m)) = open.pop() {
            n_lanes += 1;
            let way = net.way(lane);
            let place = |it: &OnLane| start_m + if forward { it.s_m } else { way.span_m - it.s_m };
            let found = self
                .on(lane)
                .iter()
                .filter(|it| it.mover != me)
                .map(|it| (place(it), it.mover))
                .filter(|(distance, _)| *distance >= 0.0 && *distance < within_m)
                .min_by(|a, b| a.0.total_cmp(&b.0));
            match found {
                Some(found) if best.is_none_or(|old| found.0 < old.0) => best = Some(found),
                Some(_) => {}
                None if start_m + way.span_m < within_m && n_lanes < MAX_LANES => {
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
