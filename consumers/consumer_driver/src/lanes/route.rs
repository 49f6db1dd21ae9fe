//! Ways through the network: the lanes from one place to another.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use crate::lanes::network::Network;

/// Lanes that one search visits at most.
const MAX_VISITS: usize = 20_000;
/// What a change of lanes costs, metres.
const CHANGE_M: f64 = 30.0;

/// The drivable lane nearest to a place, by index.
pub(crate) fn nearest_lane(net: &Network, place_m: [f64; 3]) -> Option<u32> {
    let at = net.map().nearest(place_m, |lane| lane.kind.is_drivable())?;
    net.lane(at.lane)
}

/// The lanes from one lane to another, both included: the shortest way, where a change of lanes
/// counts as 30 m; `None` if there is none within 20 000 lanes.
pub(crate) fn between(net: &mut Network, from: u32, to: u32) -> Option<Vec<u32>> {
    // Costs in centimetres, so that the order of equal ones does not depend on rounding.
    let mut costs: HashMap<u32, (u64, u32)> = HashMap::from([(from, (0, from))]);
    let mut open = BinaryHeap::from([(Reverse(0u64), from)]);
    for _ in 0..MAX_VISITS {
        let (Reverse(cost), lane) = open.pop()?;
        if lane == to {
            let mut lanes = vec![to];
            let mut at = to;
            while at != from {
                at = costs.get(&at)?.1;
                lanes.push(at);
            }
            lanes.reverse();
            return Some(lanes);
        }
        if costs.get(&lane).is_some_and(|(least, _)| *least < cost) {
            continue;
        }
        let way = net.way(lane);
        let ahead = way.successors.iter().map(|next| (*next, way.span_m));
        let beside = [way.left, way.right].into_iter().flatten();
        let beside = beside
            .filter(|_| way.zone.is_none())
            .map(|next| (next, CHANGE_M));
        for (next, length_m) in ahead.chain(beside) {
            let total = cost + (100.0 * length_m) as u64 + 1;
            if costs.get(&next).is_none_or(|(least, _)| total < *least) {
                costs.insert(next, (total, lane));
                open.push((Reverse(total), next));
            }
        }
    }
    None
}
