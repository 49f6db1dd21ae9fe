//! Town10HD's numbers of spawn points: the routes of CARLA's guide to the Traffic Manager lie along
//! lanes.

use schema_roads::{LaneKind, LanePosition, RoadMap};
use simd_town::Town;
use simd_town::guide::{self, ROUTES};

/// Places 2 m apart on every way on from here, as far as the lane's own points say.
fn ahead(roads: &RoadMap, from: LanePosition, metres: f64) -> Vec<LanePosition> {
    let (mut found, mut open) = (Vec::new(), vec![(from, 0.0)]);
    while let Some((at, way_m)) = open.pop() {
        found.push(at);
        if way_m < metres {
            open.extend(
                roads
                    .advance(at, 2.0)
                    .into_iter()
                    .map(|next| (next, way_m + 2.0)),
            );
        }
    }
    found
}

#[test]
fn each_point_of_a_route_lies_ahead_of_the_one_before() {
    for seed in 1..=8 {
        let town = Town::generate("Town10HD", seed).unwrap();
        let roads = RoadMap::parse(&town.open_drive).unwrap();
        let place = |number: usize| town.spawn_points[number].translation_m;
        for pair in ROUTES.iter().flat_map(|route| route.windows(2)) {
            let start = roads
                .nearest(place(pair[0]), |lane| {
                    lane.kind == LaneKind::Driving && lane.junction.is_none()
                })
                .unwrap();
            let [x, y, _] = place(pair[1]);
            let nearest_m = ahead(&roads, start, 400.0)
                .into_iter()
                .filter_map(|at| roads.pose(at))
                .map(|pose| (pose.translation.x - x).hypot(pose.translation.y - y))
                .fold(f64::INFINITY, f64::min);
            assert!(
                nearest_m < 1.5,
                "seed {seed}: {} to {}: {nearest_m} m off every way",
                pair[0],
                pair[1]
            );
        }
    }
}

#[test]
fn numbering_moves_points_and_makes_none() {
    let town = Town::generate("Town10HD", 7).unwrap();
    let sorted = |points: &[schema_types::Pose]| {
        let mut bits: Vec<[u64; 3]> = points
            .iter()
            .map(|point| point.translation_m.map(f64::to_bits))
            .collect();
        bits.sort_unstable();
        bits
    };
    let mut points = town.spawn_points.clone();
    let last = points.len() - 1;
    points[1..last].reverse();
    guide::number(&mut points, &town.open_drive);
    assert_eq!(sorted(&points), sorted(&town.spawn_points));
    assert!(
        [0, last]
            .iter()
            .all(|&end| points[end].translation_m == town.spawn_points[end].translation_m),
        "the ends stay"
    );
}
