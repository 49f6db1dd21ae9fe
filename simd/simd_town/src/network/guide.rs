//! Numbers of Town10HD's spawn points that CARLA's guides use.
//!
//! CARLA's guide to the Traffic Manager sends cars from two spawn points along lists of other spawn
//! points, which it names by number. The same numbers must make sense in our town: the points with
//! these numbers follow each other along lanes, one per road, so that a car that is led from one to
//! the next never has to turn round.

use std::collections::{BTreeMap, BTreeSet};

use schema_roads::{LaneKey, LaneKind, RoadMap};
use schema_types::Pose;

/// The guide's two routes: where cars start, then where they are led.
pub const ROUTES: [&[usize]; 2] = [
    &[32, 129, 28, 124, 33, 97, 119, 58, 154, 147],
    &[149, 21, 76, 38, 34, 90, 3],
];

/// Spawn points by the lane that they stand on, in its direction.
type OnLanes = BTreeMap<LaneKey, Vec<usize>>;

/// Renumbers spawn points so that the guide's routes lie along lanes. The first and the last point
/// stay where they are, because other guides drive from one to the other.
pub fn number(points: &mut [Pose], open_drive: &str) {
    let Ok(roads) = RoadMap::parse(open_drive) else {
        return;
    };
    let most = ROUTES
        .iter()
        .flat_map(|route| route.iter())
        .max()
        .copied()
        .unwrap_or_default();
    if points.len() <= most + 1 {
        return;
    }
    let on_lanes = on_lanes(points, &roads);
    let mut used = BTreeSet::new();
    let mut places: Vec<(usize, usize)> = Vec::new();
    for numbers in ROUTES {
        let begins = on_lanes.keys().copied().collect::<Vec<_>>();
        let found = begins.into_iter().find_map(|lane| {
            let mut lanes = vec![lane];
            (!used.contains(&lane.road)
                && extend(&roads, &on_lanes, &used, &mut lanes, numbers.len()))
            .then_some(lanes)
        });
        let Some(lanes) = found else { continue };
        used.extend(lanes.iter().map(|lane| lane.road));
        places.extend(
            numbers
                .iter()
                .zip(&lanes)
                .map(|(number, lane)| (*number, on_lanes[lane][on_lanes[lane].len() / 2])),
        );
    }
    // Current index of each original point.
    let mut now: Vec<usize> = (0..points.len()).collect();
    for (number, old) in places {
        let from = now.iter().position(|at| *at == old).unwrap_or(number);
        points.swap(number, from);
        now.swap(number, from);
    }
}

fn on_lanes(points: &[Pose], roads: &RoadMap) -> OnLanes {
    let mut found: BTreeMap<LaneKey, Vec<(f64, usize)>> = BTreeMap::new();
    for (idx, point) in points.iter().enumerate().take(points.len() - 1).skip(1) {
        let on = roads.nearest(point.translation_m, |lane| {
            lane.kind == LaneKind::Driving && lane.junction.is_none()
        });
        if let Some(at) = on {
            found.entry(at.lane).or_default().push((at.s_m, idx));
        }
    }
    found
        .into_iter()
        .map(|(lane, mut points)| {
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            (lane, points.into_iter().map(|(_, idx)| idx).collect())
        })
        .collect()
}

/// Extends the list from its last lane, through one junction at a time, to the wanted number of
/// lanes with spawn points. Uses no road twice.
fn extend(
    roads: &RoadMap,
    on_lanes: &OnLanes,
    used: &BTreeSet<u32>,
    lanes: &mut Vec<LaneKey>,
    n_wanted: usize,
) -> bool {
    if lanes.len() == n_wanted {
        return true;
    }
    let Some(last) = lanes.last().copied() else {
        return false;
    };
    for exit in exits(roads, last) {
        let is_new = !used.contains(&exit.road) && lanes.iter().all(|lane| lane.road != exit.road);
        if is_new && on_lanes.contains_key(&exit) {
            lanes.push(exit);
            if extend(roads, on_lanes, used, lanes, n_wanted) {
                return true;
            }
            lanes.pop();
        }
    }
    false
}

/// Lanes behind the next junction.
fn exits(roads: &RoadMap, lane: LaneKey) -> Vec<LaneKey> {
    const MOST_STEPS: usize = 64;
    let (mut open, mut exits) = (roads.successors(lane).to_vec(), Vec::new());
    for _ in 0..MOST_STEPS {
        let Some(next) = open.pop() else { break };
        match roads.lane(next) {
            Some(inside) if inside.junction.is_some() || next.road == lane.road => {
                open.extend(roads.successors(next))
            }
            Some(_) => exits.push(next),
            None => {}
        }
    }
    exits
}
