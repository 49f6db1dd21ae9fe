//! The junctions on a path.

use schema_roads::SignalKind;

use crate::lanes::path::{Foot, Path};
use crate::traffic::Mover;

/// A stop line farther from the junction is not where turns are waited for, metres.
pub(super) const LINE_BEFORE_M: f64 = 12.0;
/// Most junctions that are looked at ahead.
const MAX_ENTRIES: usize = 3;

/// A junction on the path that the vehicle is in or comes to.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The junction, or several that are crossed as one.
    pub zone: u32,
    /// Path length at which it begins and at which it is left, metres.
    pub arc_m: [f64; 2],
    /// Path length of the line at which to wait for one's turn, metres.
    pub line_m: f64,
    /// Change of direction within, radians, positive to the left.
    pub turn_rad: f64,
    /// Whether a traffic light guards this way.
    pub has_light: bool,
    /// Whether a stop or yield sign guards this way, and which.
    pub sign: Option<SignalKind>,
    /// Its legs.
    pub(crate) legs: [usize; 2],
}

/// Fills `entries` with the junctions that a vehicle on its path is in or comes to.
pub(super) fn find_entries(path: &Path, foot: Foot, me: &Mover, entries: &mut Vec<Entry>) {
    entries.clear();
    let legs = path.legs();
    let rear = foot.arc_m - me.rear_m();
    let until = foot.arc_m + me.front_m() + 25.0f64.max(7.0 * me.speed_mps);
    let mut idx = legs.partition_point(|leg| leg.arc_m[1] <= rear);
    // A zone in which we are may have begun with an earlier leg.
    while idx > 0
        && idx < legs.len()
        && legs[idx].zone().is_some()
        && legs[idx - 1].zone() == legs[idx].zone()
    {
        idx -= 1;
    }
    while idx < legs.len() && entries.len() < MAX_ENTRIES {
        let Some(zone) = legs[idx].zone() else {
            idx += 1;
            continue;
        };
        if legs[idx].arc_m[0] > until {
            break;
        }
        let n = legs[idx..]
            .iter()
            .take_while(|leg| leg.zone() == Some(zone))
            .count();
        let before = idx.checked_sub(1).map(|at| &legs[at].way);
        let first = &legs[idx].way;
        let guards = || {
            let of_before = before.iter().flat_map(|way| &way.guards);
            first.guards.iter().chain(of_before)
        };
        let has = |kind: SignalKind| guards().any(|guard| guard.kind == kind);
        let sign = [SignalKind::Stop, SignalKind::Yield]
            .into_iter()
            .find(|kind| has(*kind));
        let entry_m = legs[idx].arc_m[0];
        let lines = guards().filter_map(|guard| {
            let on = [Some(&legs[idx]), idx.checked_sub(1).map(|at| &legs[at])];
            let leg = on
                .into_iter()
                .flatten()
                .find(|leg| leg.lane == guard.lane)?;
            Some(leg.arc_at_m(guard.s_m)).filter(|arc| *arc > entry_m - LINE_BEFORE_M)
        });
        let line_m = lines.fold(entry_m, f64::min);
        entries.push(Entry {
            zone,
            line_m,
            arc_m: [legs[idx].arc_m[0], legs[idx + n - 1].arc_m[1]],
            turn_rad: legs[idx..idx + n].iter().map(|leg| leg.way.turn_rad).sum(),
            has_light: has(SignalKind::TrafficLight),
            sign,
            legs: [idx, idx + n],
        });
        idx += n;
    }
}
