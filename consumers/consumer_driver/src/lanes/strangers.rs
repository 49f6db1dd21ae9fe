//! Vehicles that this process does not drive: the lanes they are on, followed from tick to tick.

use std::collections::BTreeMap;

use schema_roads::LaneKey;

use crate::lanes::network::{LanePlace, Network};
use crate::plane::{distance, wrap};
use crate::traffic::{Mover, STANDING_MPS, Traffic};

/// Farthest from the middle of its lane before a vehicle's lane is searched anew, metres.
const OFF_LANE_M: f64 = 1.6;
/// A vehicle that stands nearer to a junction than this may be waiting there, metres.
const QUEUE_M: f64 = 40.0;
/// A vehicle that has stood for so long with nothing to wait for is parked, seconds.
const PARKED_SECS: f64 = 2.0;

#[derive(Clone, Copy, Debug)]
struct Place {
    at: LanePlace,
    /// Nearest point of the lane.
    point: usize,
    to_junction_m: f64,
    /// Since when it stands, seconds; `None` while it moves.
    standing_since_secs: Option<f64>,
    /// Where the lane was searched in vain.
    lost_at_m: Option<[f64; 2]>,
}

/// The places of all strangers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Strangers {
    places: BTreeMap<u32, Place>,
}

impl Strangers {
    /// The lane a vehicle is on and the place there, for this tick.
    pub fn place(&mut self, net: &mut Network, mover: &Mover, now_secs: f64) -> Option<LanePlace> {
        let known = self.places.get(&mover.id).copied();
        let followed = known
            .filter(|place| place.lost_at_m.is_none())
            .and_then(|place| follow(net, place, mover));
        let place = match (followed, known) {
            (Some(place), _) => place,
            (None, Some(place))
                if place
                    .lost_at_m
                    .is_some_and(|at| distance(at, mover.origin()) < 1.0) =>
            {
                return None;
            }
            _ => match locate(net, mover) {
                Some(at) => found(net, at),
                None => Place {
                    at: LanePlace { lane: 0, s_m: 0.0 },
                    point: 0,
                    to_junction_m: f64::INFINITY,
                    standing_since_secs: None,
                    lost_at_m: Some(mover.origin()),
                },
            },
        };
        let since = known.and_then(|place| place.standing_since_secs);
        let place = Place {
            standing_since_secs: (mover.speed_mps.abs() < STANDING_MPS)
                .then_some(since.unwrap_or(now_secs)),
            ..place
        };
        self.places.insert(mover.id, place);
        place.lost_at_m.is_none().then_some(place.at)
    }

    /// The lane a vehicle was last found on, and the place there.
    pub fn at(&self, id: u32) -> Option<LanePlace> {
        let place = self.places.get(&id)?;
        place.lost_at_m.is_none().then_some(place.at)
    }

    /// Whether it is near a junction, where standing has a reason.
    pub fn is_before_junction(&self, id: u32) -> bool {
        self.places
            .get(&id)
            .is_some_and(|place| place.to_junction_m < QUEUE_M)
    }

    /// Whether it stands, and has for a while, where there is nothing to wait for.
    pub fn is_parked(&self, id: u32, now_secs: f64) -> bool {
        self.places.get(&id).is_some_and(|place| {
            let stands = place.standing_since_secs;
            stands.is_some_and(|since| now_secs > since + PARKED_SECS)
                && place.to_junction_m >= QUEUE_M
        })
    }

    /// Forgets vehicles that are gone or driven here.
    pub fn forget_absent(&mut self, traffic: &Traffic, is_driven: impl Fn(u32) -> bool) {
        self.places
            .retain(|id, _| traffic.mover(*id).is_some() && !is_driven(*id));
    }
}

fn found(net: &mut Network, at: LanePlace) -> Place {
    let way = net.way(at.lane);
    let arc_m = way.arc_at(at.s_m);
    let leads_in = way.zone.is_none()
        && way
            .successors
            .iter()
            .any(|next| net.way(*next).zone.is_some());
    Place {
        at,
        point: way
            .points
            .partition_point(|p| p.arc_m < arc_m)
            .min(way.points.len() - 1),
        to_junction_m: if way.zone.is_some() {
            0.0
        } else if leads_in {
            way.length_m() - arc_m
        } else {
            f64::INFINITY
        },
        standing_since_secs: None,
        lost_at_m: None,
    }
}

/// The place on the same lane or on one that follows.
fn follow(net: &mut Network, place: Place, mover: &Mover) -> Option<Place> {
    let lane = place.at.lane;
    let way = net.way(lane);
    let at = mover.origin();
    let away = |idx: usize| distance(way.points[idx].position_m, at);
    let mut idx = place.point.min(way.points.len() - 1);
    while idx + 1 < way.points.len() && away(idx + 1) < away(idx) {
        idx += 1;
    }
    while idx > 0 && away(idx - 1) < away(idx) {
        idx -= 1;
    }
    let point = &way.points[idx];
    let (sin, cos) = point.heading_rad.sin_cos();
    let [dx, dy] = [at[0] - point.position_m[0], at[1] - point.position_m[1]];
    let (along, aside) = (dx * cos + dy * sin, dy * cos - dx * sin);
    let fits = aside.abs() < OFF_LANE_M
        && wrap(point.heading_rad - mover.yaw_rad).abs() < 0.8
        && (point.position_m[0] - at[0]).abs() < 30.0;
    let is_on = along.abs() < 1.2 && fits;
    if !is_on {
        return None;
    }
    // Past the end, or at a place where several lanes begin: search anew.
    let is_end = idx + 1 == way.points.len() && along > 0.0;
    if is_end || way.zone.is_some() && idx < 6 {
        return None;
    }
    let s_m = way.s_at(point.arc_m + along).clamp(0.0, way.span_m);
    Some(found(net, LanePlace { lane, s_m }))
}

/// The lane a vehicle drives on, by index, and the place there: the nearest one that runs its way.
pub(crate) fn locate(net: &Network, me: &Mover) -> Option<LanePlace> {
    let map = net.map();
    let mut wrong: Vec<LaneKey> = Vec::new();
    let mut fallback = None;
    for _ in 0..8 {
        let at = map.nearest(me.position_m, |lane| {
            lane.kind.is_drivable() && !wrong.contains(&lane.key)
        })?;
        let heading = map.pose(at)?.rotation.euler_angles().2;
        let place = Some(LanePlace {
            lane: net.lane(at.lane)?,
            s_m: at.s_m,
        });
        if wrap(heading - me.yaw_rad).abs() < 0.8 {
            return place;
        }
        fallback = fallback.or(place);
        wrong.push(at.lane);
    }
    fallback
}
