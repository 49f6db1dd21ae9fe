//! Each town is what its name promises, as read back from its own OpenDRIVE text and its solid
//! geometry.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};
use schema_roads::{LaneKey, LanePosition, RoadMap, SignalKind};
use simd_town::{LampGroup, Town};

fn town(name: &str) -> (Town, RoadMap) {
    let town = Town::generate(name, 1).expect("a name of the list");
    let map = RoadMap::parse(&town.open_drive).expect("our own text");
    (town, map)
}

fn drivable(map: &RoadMap) -> impl Iterator<Item = LaneKey> + '_ {
    map.lanes()
        .iter()
        .filter(|lane| lane.kind.is_drivable())
        .map(|lane| lane.key)
}

/// Points on the middle of every drivable lane, at most `step_m` apart.
fn points(map: &RoadMap, step_m: f64) -> Vec<(LaneKey, Vector3<f64>)> {
    drivable(map)
        .flat_map(|key| {
            map.centreline(key, step_m)
                .into_iter()
                .map(move |p| (key, Vector3::from(p)))
        })
        .collect()
}

fn cell(p: &Vector3<f64>, side_m: f64) -> (i64, i64) {
    ((p.x / side_m).floor() as i64, (p.y / side_m).floor() as i64)
}

/// Differences in height of lanes that pass over each other: one per pair of roads.
fn overpasses(map: &RoadMap) -> BTreeMap<(u32, u32), f64> {
    let points = points(map, 2.0);
    let mut cells: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
    for (i, (_, p)) in points.iter().enumerate() {
        cells.entry(cell(p, 3.0)).or_default().push(i);
    }
    let mut found = BTreeMap::new();
    for members in cells.values() {
        for &i in members {
            for &k in members {
                let ((a, p), (b, q)) = (points[i], points[k]);
                if a.road < b.road && (p.z - q.z).abs() > 2.0 {
                    let least = found.entry((a.road, b.road)).or_insert(f64::INFINITY);
                    *least = f64::min(*least, (p.z - q.z).abs());
                }
            }
        }
    }
    found
}

fn heading(map: &RoadMap, key: LaneKey, s_m: f64) -> f64 {
    let forward = map
        .pose(LanePosition::new(key, s_m))
        .expect("a place on a lane")
        .rotation
        * Vector3::x();
    forward.y.atan2(forward.x)
}

fn turn(from: f64, to: f64) -> f64 {
    (to - from + PI).rem_euclid(TAU) - PI
}

/// Sum of the changes of direction along a lane, and the sharpest bend.
fn bend(map: &RoadMap, key: LaneKey) -> (f64, f64) {
    let length = map.lane(key).expect("a lane of the map").length_m;
    let n = (length / 2.0).ceil().max(1.0) as usize;
    let headings: Vec<f64> = (0..=n)
        .map(|k| heading(map, key, length * k as f64 / n as f64))
        .collect();
    let turns = headings.windows(2).map(|pair| turn(pair[0], pair[1]));
    let sharpest = turns.clone().map(f64::abs).fold(0.0, f64::max) * n as f64 / length;
    (turns.sum(), sharpest)
}

/// Follows the lanes from `start`, choosing among successors by `choose`, until `start` comes
/// again: length, sum of turns, sharpest bend.
fn lap(map: &RoadMap, start: LaneKey, choose: impl Fn(f64) -> f64) -> Option<(f64, f64, f64)> {
    let (mut key, mut length, mut turned, mut sharpest) = (start, 0.0, 0.0, 0.0f64);
    for _ in 0..200 {
        let (bent, sharp) = bend(map, key);
        (length, turned, sharpest) = (
            length + map.lane(key)?.length_m,
            turned + bent,
            sharpest.max(sharp),
        );
        let next = map
            .successors(key)
            .iter()
            .copied()
            .min_by(|&a, &b| choose(bend(map, a).0).total_cmp(&choose(bend(map, b).0)))?;
        if next == start {
            return Some((length, turned, sharpest));
        }
        key = next;
    }
    None
}

/// Number of roads that meet at each junction.
fn arms(map: &RoadMap) -> Vec<usize> {
    let mut roads: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
    for lane in map.lanes() {
        let Some(junction) = lane.junction else {
            continue;
        };
        let ends = map
            .successors(lane.key)
            .iter()
            .chain(map.predecessors(lane.key));
        roads
            .entry(junction)
            .or_default()
            .extend(ends.map(|key| key.road));
    }
    roads.values().map(BTreeSet::len).collect()
}

/// Lanes of one direction on the widest road.
fn widest(map: &RoadMap) -> usize {
    let mut sides: BTreeMap<(u32, u16, bool), usize> = BTreeMap::new();
    for key in
        drivable(map).filter(|&key| map.lane(key).is_some_and(|lane| lane.junction.is_none()))
    {
        *sides
            .entry((key.road, key.section, key.lane > 0))
            .or_default() += 1;
    }
    sides.into_values().max().unwrap_or(0)
}

#[test]
fn motorways_and_viaducts_pass_over_other_roads_and_nothing_else_does() {
    for (name, least) in [
        ("Town04", 6),
        ("Town05", 5),
        ("Town06", 6),
        ("Town01", 0),
        ("Town02", 0),
        ("Town10HD", 0),
    ] {
        let (_, map) = town(name);
        let over = overpasses(&map);
        assert!(
            if least == 0 {
                over.is_empty()
            } else {
                over.len() >= least
            },
            "{name}: {over:?}"
        );
        // A lorry of 4.5 m fits under a deck of 1.1 m.
        assert!(
            over.values().all(|&height| height > 5.6),
            "{name}: {over:?}"
        );
    }
}

#[test]
fn town04_is_a_figure_of_eight_that_leads_back_to_itself() {
    let (_, map) = town("Town04");
    let motorway = drivable(&map)
        .filter(|&key| key.lane == -1 && map.lane(key).is_some_and(|lane| lane.junction.is_none()));
    let three_lanes = motorway.filter(|&key| {
        map.lane(LaneKey { lane: -3, ..key })
            .is_some_and(|lane| lane.kind.is_drivable())
    });
    let laps: Vec<_> = three_lanes
        .filter_map(|key| lap(&map, key, f64::abs))
        .collect();
    assert!(laps.len() >= 4);
    for (length, turned, sharpest) in laps {
        // Once round to the left and once to the right: together nothing, where a plain loop would
        // turn by a full circle.
        assert!(turned.abs() < 0.05, "{turned}");
        assert!((2000.0..3500.0).contains(&length), "{length}");
        assert!(sharpest < 1.0 / 150.0, "{sharpest}");
    }
}

#[test]
fn town03_has_roundabouts_hills_and_a_tunnel() {
    let (town, map) = town("Town03");
    let rounds = drivable(&map)
        .filter_map(|key| lap(&map, key, |turned| -turned))
        .filter(|(length, turned, sharpest)| {
            // Counter-clockwise, small, and nowhere as sharp as a turn at a crossing.
            (turned - TAU).abs() < 0.01 && (60.0..260.0).contains(length) && *sharpest < 1.0 / 12.0
        });
    let lengths: BTreeSet<u64> = rounds.map(|(length, ..)| length.round() as u64).collect();
    assert!(lengths.len() >= 2, "{lengths:?}");
    assert!(steepest(&map) > 0.045, "{}", steepest(&map));
    let covered = Solid::of(&town).covered_m(&map, 4.6, 7.5);
    assert!(covered > 60.0, "{covered}");
}

/// Greatest slope along any lane.
fn steepest(map: &RoadMap) -> f64 {
    let slope = |pair: &[[f64; 3]]| {
        (pair[1][2] - pair[0][2]).abs()
            / (pair[1][0] - pair[0][0])
                .hypot(pair[1][1] - pair[0][1])
                .max(0.5)
    };
    drivable(map)
        .flat_map(|key| {
            map.centreline(key, 2.0)
                .windows(2)
                .map(slope)
                .collect::<Vec<_>>()
        })
        .fold(0.0, f64::max)
}

#[test]
fn slopes_are_drivable_everywhere() {
    for name in Town::NAMES {
        let (_, map) = town(name);
        assert!(steepest(&map) < 0.12, "{name}: {}", steepest(&map));
    }
}

#[test]
fn junctions_and_lanes_are_as_the_names_say() {
    let of = |name| arms(&town(name).1);
    assert!(of("Town01").iter().all(|&n| n == 3), "{:?}", of("Town01"));
    assert!(of("Town02").iter().filter(|&&n| n == 4).count() >= 3);
    assert!(of("Town05").iter().filter(|&&n| n == 4).count() >= 12);
    assert!(of("Town10HD").contains(&3) && of("Town10HD").contains(&4));
    for (name, lanes) in [
        ("Town01", 1),
        ("Town02", 1),
        ("Town04", 4),
        ("Town05", 3),
        ("Town06", 5),
        ("Town07", 1),
        ("Town10HD", 2),
    ] {
        assert_eq!(widest(&town(name).1), lanes, "{name}");
    }
    // Country: most of the way is narrow and fast.
    let (_, map) = town("Town07");
    let (mut fast, mut all) = (0.0, 0.0);
    for key in drivable(&map) {
        let (length, limit) = (
            map.lane(key).expect("a lane").length_m,
            map.speed_limit_mps(LanePosition::new(key, 1.0))
                .unwrap_or(0.0),
        );
        all += length;
        fast += if limit > 16.0 { length } else { 0.0 };
    }
    assert!(fast > 0.6 * all, "{fast} of {all}");
}

/// Lanes beside the others in which one gets slower before a ramp, or faster behind one: at how
/// many ramps, and the shortest of them.
#[test]
fn ramps_of_motorways_have_lanes_of_their_own() {
    for (name, least) in [("Town04", 8), ("Town06", 8)] {
        let (_, map) = town(name);
        let width = |key: LaneKey| map.width_m(LanePosition::new(key, 1.0));
        // Ramps are the one-way roads with one lane, 4 m wide.
        let is_ramp = |key: LaneKey| {
            (width(key) - 4.0).abs() < 1e-6
                && map.lane(key).is_some_and(|lane| lane.junction.is_none())
        };
        let (mut n_off, mut n_on, mut shortest_m) = (0, 0, f64::INFINITY);
        for key in drivable(&map).filter(|&key| {
            map.lane(key).is_some_and(|lane| lane.junction.is_none()) && !is_ramp(key)
        }) {
            let length_m = map.lane(key).expect("a lane of the map").length_m;
            let through =
                |keys: &[LaneKey], onward: fn(&RoadMap, LaneKey) -> Vec<LaneKey>| -> Vec<LaneKey> {
                    keys.iter().flat_map(|&key| onward(&map, key)).collect()
                };
            let after = through(map.successors(key), |map, key| map.successors(key).to_vec());
            let before = through(map.predecessors(key), |map, key| {
                map.predecessors(key).to_vec()
            });
            let is_wide = (width(key) - 3.6).abs() < 1e-6;
            if is_wide && !after.is_empty() && after.iter().all(|&key| is_ramp(key)) {
                n_off += 1;
                shortest_m = length_m.min(shortest_m);
            }
            if is_wide && !before.is_empty() && before.iter().all(|&key| is_ramp(key)) {
                n_on += 1;
                shortest_m = length_m.min(shortest_m);
            }
        }
        println!("{name}: {n_off} lanes before ramps, {n_on} behind, at least {shortest_m:.0} m");
        assert!(
            n_off + n_on >= least && shortest_m > 60.0,
            "{name}: {n_off} before, {n_on} behind, {shortest_m} m"
        );
    }
}

#[test]
fn lights_belong_to_one_controller_each_and_every_town_has_its_signs() {
    for name in Town::NAMES {
        let (_, map) = town(name);
        let of = |kind: SignalKind| {
            map.signals()
                .iter()
                .filter(|signal| signal.kind == kind)
                .collect::<Vec<_>>()
        };
        for light in of(SignalKind::TrafficLight) {
            let owners = map
                .controllers()
                .iter()
                .filter(|controller| controller.signals.contains(&light.id));
            let junctions: Vec<_> = owners.map(|controller| controller.junction).collect();
            assert_eq!(junctions, [light.junction], "{name} light {}", light.id);
            assert!(!light.stops.is_empty(), "{name} light {}", light.id);
        }
        assert!(!of(SignalKind::TrafficLight).is_empty(), "{name}");
        let limits: BTreeSet<i64> = of(SignalKind::SpeedLimit)
            .iter()
            .filter_map(|s| s.value)
            .map(|v| v as i64)
            .collect();
        assert!(
            !limits.is_empty() && limits.iter().all(|limit| (30..=90).contains(limit)),
            "{name}: {limits:?}"
        );
    }
    for (name, kind) in [
        ("Town01", SignalKind::Yield),
        ("Town01", SignalKind::Stop),
        ("Town04", SignalKind::Yield),
        ("Town07", SignalKind::Yield),
    ] {
        assert!(
            town(name)
                .1
                .signals()
                .iter()
                .any(|signal| signal.kind == kind),
            "{name} has no {kind:?}"
        );
    }
}

#[test]
fn spawn_points_lie_on_driving_lanes_and_look_along_them() {
    for name in Town::NAMES {
        let (town, map) = town(name);
        assert!(
            town.spawn_points.len() >= 155,
            "{name} has {}",
            town.spawn_points.len()
        );
        for point in &town.spawn_points {
            let at = map
                .nearest(point.translation_m, |lane| lane.kind.is_drivable())
                .expect("a lane is near");
            let pose = map.pose(at).expect("a place on a lane");
            let along =
                (pose.rotation * Vector3::x()).dot(&(point.isometry().rotation * Vector3::x()));
            let [x, y, z] = point.translation_m;
            let off = (Point3::new(x, y, z - 0.3) - Point3::from(pose.translation.vector)).norm();
            assert!(
                off < 0.05 && along > 0.995,
                "{name}: {point:?} is {off} m off, {along} along"
            );
        }
    }
}

/// Solid triangles by cells of 8 m.
struct Solid(BTreeMap<(i64, i64), Vec<[Vector3<f64>; 3]>>);

impl Solid {
    fn of(town: &Town) -> Solid {
        let mut cells: BTreeMap<(i64, i64), Vec<[Vector3<f64>; 3]>> = BTreeMap::new();
        for mesh in &town.collision {
            for t in &mesh.triangles {
                let p = t.map(|i| Vector3::from(mesh.vertices_m[i as usize]).cast::<f64>());
                let (low, high) = (p[0].inf(&p[1]).inf(&p[2]), p[0].sup(&p[1]).sup(&p[2]));
                let (low, high) = (cell(&low, 8.0), cell(&high, 8.0));
                if (high.0 - low.0) * (high.1 - low.1) < 400 {
                    (low.0..=high.0).for_each(|x| {
                        (low.1..=high.1).for_each(|y| cells.entry((x, y)).or_default().push(p))
                    });
                }
            }
        }
        Solid(cells)
    }

    /// Height of the lowest solid surface more than 0.3 m over a point.
    fn ceiling_m(&self, p: &Vector3<f64>) -> Option<f64> {
        let over = self.0.get(&cell(p, 8.0))?.iter().filter_map(|t| {
            let weight = |a: Vector3<f64>, b: Vector3<f64>| {
                (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x)
            };
            let w = [weight(t[1], t[2]), weight(t[2], t[0]), weight(t[0], t[1])];
            let area: f64 = w.iter().sum();
            let inside = area.abs() > 1e-6 && w.iter().all(|w| w * area >= 0.0);
            inside.then(|| (0..3).map(|i| w[i] / area * t[i].z).sum::<f64>() - p.z)
        });
        over.filter(|&height| height > 0.3).reduce(f64::min)
    }

    /// Metres of lanes with something overhead at a height in this range.
    fn covered_m(&self, map: &RoadMap, low_m: f64, high_m: f64) -> f64 {
        points(map, 4.0)
            .iter()
            .filter(|(_, p)| {
                self.ceiling_m(p)
                    .is_some_and(|height| (low_m..high_m).contains(&height))
            })
            .count() as f64
            * 4.0
    }
}

#[test]
fn a_lorry_passes_under_everything() {
    for name in Town::NAMES {
        let (town, map) = town(name);
        let solid = Solid::of(&town);
        for (key, p) in points(&map, 4.0) {
            if let Some(height) = solid.ceiling_m(&p) {
                assert!(height > 4.5, "{name}: {height} m over {key} at {p}");
            }
        }
    }
}

#[test]
fn objects_have_boxes_about_their_triangles_and_layers_by_kind() {
    use simd_town::MapLayer;
    for name in ["Town01", "Town04", "Town10HD"] {
        let (town, _) = town(name);
        let mut layers: BTreeMap<MapLayer, usize> = BTreeMap::new();
        let by_id: BTreeMap<u32, &simd_town::SceneryObject> = town
            .objects
            .iter()
            .map(|object| (object.id.0, object))
            .collect();
        let names: BTreeSet<&str> = town
            .objects
            .iter()
            .map(|object| object.name.as_str())
            .collect();
        assert_eq!(
            (by_id.len(), names.len()),
            (town.objects.len(), town.objects.len())
        );
        for object in &town.objects {
            assert!(
                object
                    .box_half_m
                    .iter()
                    .all(|&half| (0.0..2000.0).contains(&half)),
                "{object:?}"
            );
            object
                .layer
                .inspect(|&layer| *layers.entry(layer).or_default() += 1);
        }
        for layer in [
            MapLayer::Buildings,
            MapLayer::Foliage,
            MapLayer::Props,
            MapLayer::StreetLights,
            MapLayer::Decals,
        ] {
            assert!(
                layers.get(&layer).is_some_and(|&n| n > 5),
                "{name} {layer:?}: {layers:?}"
            );
        }
        // Every triangle lies in its object's box.
        for each in town.assets.statics.iter().step_by(7) {
            for vertex in &town.assets.mesh(each.mesh).vertices {
                let object = if each.object.0 != 0 {
                    each.object.0
                } else {
                    vertex.object_id
                };
                let object = by_id[&object];
                let p = each.world_from_mesh
                    * Point3::from(Vector3::from(vertex.position_m).cast::<f64>());
                let local = object.box_pose.isometry().inverse_transform_point(&p);
                let inside = (0..3).all(|i| local[i].abs() <= object.box_half_m[i] + 1e-3);
                assert!(
                    inside,
                    "{name} {}: {local} {:?}",
                    object.name, object.box_half_m
                );
            }
        }
        assert!(
            town.lamps
                .iter()
                .all(|lamp| by_id.contains_key(&lamp.object.0))
        );
        let lamps = |group: LampGroup| town.lamps.iter().filter(|lamp| lamp.group == group).count();
        assert_eq!(lamps(LampGroup::Street), layers[&MapLayer::StreetLights]);
        assert_eq!(lamps(LampGroup::Building), layers[&MapLayer::Buildings]);
        assert_eq!(
            lamps(LampGroup::Other) > 5,
            name == "Town03",
            "lamps of its tunnel"
        );
    }
}
