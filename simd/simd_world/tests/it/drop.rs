//! The lane graph, rays and standing vehicles agree about a lane's surface, at 1000 random places
//! of each map.

use std::collections::{BTreeMap, HashMap};

use nalgebra::{Isometry3, Vector3};
use schema_frames::VehicleControl;
use schema_roads::{Lane, LanePosition, RoadMap};
use schema_types::Pose;
use simd_town::Town;
use simd_town::imported::{ImportOptions, import};
use simd_world::{MapData, World, WorldOptions};

const N_PLACES: usize = 1000;
/// Largest allowed distance between the hit surface and the lane graph's, metres.
const SURFACE_M: f64 = 0.02;
const CELL_M: f64 = 6.0;

/// Roads 1 to 4 in one file: a hill with superelevation that turns over, a spiral with lane offset
/// and a widening lane, a cambered road (shape), and an old one with crossfall and a lane of its
/// own height. Far from zero, where `f32` alone would see steps of half a metre.
fn hard_roads() -> String {
    let lane = |id: i8, kind: &str, width: &str, rest: &str| {
        format!(
            r#"<lane id="{id}" type="{kind}" level="false"><link/><width sOffset="0" {width}/>{rest}<roadMark sOffset="0" type="solid" color="white" width="0.15"/></lane>"#
        )
    };
    let both = |width: &str, rest: &str| {
        let (left, right) = (
            lane(1, "driving", width, rest),
            lane(-1, "driving", width, rest),
        );
        let walk = lane(-2, "sidewalk", r#"a="2" b="0" c="0" d="0""#, "");
        format!(
            r#"<laneSection s="0"><left>{left}</left><center><lane id="0" type="none" level="false"><roadMark sOffset="0" type="broken" color="yellow" width="0.15"/></lane></center><right>{right}{walk}</right></laneSection>"#
        )
    };
    let road = |id: u32, length: f64, plan: &str, profiles: &str, lanes: &str| {
        format!(
            r#"<road id="{id}" length="{length}" junction="-1"><link/><planView>{plan}</planView>{profiles}<lanes>{lanes}</lanes></road>"#
        )
    };
    let (x, y) = (690_000.0, 5_330_000.0);
    let even = both(r#"a="3.5" b="0" c="0" d="0""#, "");
    let hill = road(
        1,
        400.0,
        &format!(
            r#"<geometry s="0" x="{x}" y="{y}" hdg="0.3" length="400"><arc curvature="0.006"/></geometry>"#
        ),
        r#"<elevationProfile><elevation s="0" a="520" b="0.06" c="0.0004" d="-0.0000012"/></elevationProfile>
           <lateralProfile><superelevation s="0" a="-0.08" b="0" c="0.000003" d="0"/><superelevation s="200" a="0.04" b="0.0012" c="-0.000006" d="0"/></lateralProfile>"#,
        &even,
    );
    let spiral = road(
        2,
        150.0,
        &format!(
            r#"<geometry s="0" x="{}" y="{y}" hdg="1.2" length="150"><spiral curvStart="-0.02" curvEnd="0.03"/></geometry>"#,
            x + 600.0
        ),
        r#"<elevationProfile><elevation s="0" a="510" b="-0.05" c="0.0003" d="0"/></elevationProfile>"#,
        &format!(
            r#"<laneOffset s="0" a="0" b="0" c="0.0006" d="-0.0000027"/>{}"#,
            both(r#"a="3" b="0.01" c="0" d="0""#, "")
        ),
    );
    let camber = road(
        3,
        200.0,
        &format!(
            r#"<geometry s="0" x="{}" y="{}" hdg="-0.4" length="200"><line/></geometry>"#,
            x,
            y - 400.0
        ),
        r#"<elevationProfile><elevation s="0" a="505" b="0.03" c="0" d="0"/></elevationProfile>
           <lateralProfile><shape s="0" t="-7" a="0" b="0" c="0" d="0"/><shape s="120" t="-7" a="-0.1" b="0.04" c="-0.0029" d="0"/></lateralProfile>"#,
        &even,
    );
    let old = road(
        4,
        160.0,
        &format!(
            r#"<geometry s="0" x="{}" y="{}" hdg="2.4" length="160"><poly3 a="0" b="0" c="0.002" d="-0.000006"/></geometry>"#,
            x + 300.0,
            y - 500.0
        ),
        r#"<elevationProfile><elevation s="0" a="500" b="0" c="0.0005" d="0"/></elevationProfile>
           <lateralProfile><crossfall side="both" s="0" a="0.025" b="0" c="0" d="0"/></lateralProfile>"#,
        &both(
            r#"a="3.5" b="0" c="0" d="0""#,
            r#"<height sOffset="0" inner="0.05" outer="0.05"/>"#,
        ),
    );
    format!(
        r#"<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="5" name="hard"/>{hill}{spiral}{camber}{old}</OpenDRIVE>"#
    )
}

fn imported(name: &str, text: &str) -> MapData {
    let roads = RoadMap::parse(text).unwrap();
    let town = import(name, text, &roads, 1, &ImportOptions::default()).unwrap();
    MapData::of_town(&town, roads.into())
}

fn maps() -> Vec<MapData> {
    // The town with roundabouts has slopes; its text is also read as a user's file.
    let slopes = Town::generate("Town03", 1).unwrap();
    let mut maps = vec![
        imported("hard", &hard_roads()),
        imported("slopes", &slopes.open_drive),
    ];
    maps.extend(Town::NAMES.map(|name| MapData::from(&Town::generate(name, 1).unwrap())));
    maps
}

fn roads_of(map: &MapData) -> RoadMap {
    RoadMap::parse(&map.open_drive).unwrap()
}

/// Places on lanes that vehicles drive on, each lane as often as it is long.
fn places(roads: &RoadMap, passes: impl Fn(&Lane) -> bool) -> Vec<LanePosition> {
    let lanes: Vec<&Lane> = roads
        .lanes()
        .iter()
        .filter(|lane| lane.kind.is_drivable() && passes(lane))
        .collect();
    let total: f64 = lanes.iter().map(|lane| lane.length_m).sum();
    let mut random = fastrand::Rng::with_seed(11);
    let mut place = || {
        let mut at = random.f64() * total;
        let lane = lanes.iter().find(|lane| {
            at -= lane.length_m;
            at <= 0.0
        });
        let lane = lane.unwrap_or(&lanes[0]);
        LanePosition {
            lane: lane.key,
            s_m: random.f64() * lane.length_m,
            offset_m: random.f64() - 0.5,
        }
    };
    (0..N_PLACES).map(|_| place()).collect()
}

/// Solid triangles by place: the simplest structure that answers "what lies below this point".
struct Floor {
    triangles: Vec<[Vector3<f64>; 3]>,
    cells: HashMap<(i64, i64), Vec<usize>>,
}

impl Floor {
    fn of(map: &MapData) -> Floor {
        let mut floor = Floor {
            triangles: Vec::new(),
            cells: HashMap::new(),
        };
        for mesh in &map.collision {
            for corners in &mesh.triangles {
                let corners =
                    corners.map(|i| Vector3::from(mesh.vertices_m[i as usize].map(f64::from)));
                let span = |axis: usize| {
                    let (low, high) = corners.iter().fold((f64::MAX, f64::MIN), |(l, h), p| {
                        (l.min(p[axis]), h.max(p[axis]))
                    });
                    (low / CELL_M).floor() as i64..=(high / CELL_M).floor() as i64
                };
                if span(0).count() * span(1).count() > 4000 {
                    continue;
                }
                let idx = floor.triangles.len();
                floor.triangles.push(corners);
                for x in span(0) {
                    span(1).for_each(|y| floor.cells.entry((x, y)).or_default().push(idx));
                }
            }
        }
        floor
    }

    /// Height and upward normal of the first thing below `p`.
    fn below(&self, p: Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
        let cell = ((p.x / CELL_M).floor() as i64, (p.y / CELL_M).floor() as i64);
        let hits = self.cells.get(&cell)?.iter().filter_map(|idx| {
            let [a, b, c] = self.triangles[*idx];
            let normal = (b - a).cross(&(c - a));
            // Walls are not stood on.
            if normal.z <= 1e-9 {
                return None;
            }
            let inside = |u: Vector3<f64>, v: Vector3<f64>| {
                (v.x - u.x) * (p.y - u.y) - (v.y - u.y) * (p.x - u.x) >= -1e-7
            };
            let z = a.z - ((p.x - a.x) * normal.x + (p.y - a.y) * normal.y) / normal.z;
            (inside(a, b) && inside(b, c) && inside(c, a) && z < p.z)
                .then(|| (z, normal.normalize()))
        });
        hits.max_by(|a, b| a.0.total_cmp(&b.0))
    }
}

#[test]
fn the_solid_ground_is_the_lanes_surface() {
    for map in maps() {
        let (roads, floor) = (roads_of(&map), Floor::of(&map));
        let (mut worst_m, mut worst_rad) = (0.0f64, 0.0f64);
        for place in places(&roads, |_| true) {
            let pose = roads.pose(place).unwrap();
            let p = pose.translation.vector - Vector3::from(map.origin_m);
            let (z, normal) = floor
                .below(p + Vector3::z() * 0.6)
                .unwrap_or_else(|| panic!("{}: nothing under {place:?}", map.name));
            let up = pose.rotation * Vector3::z();
            // The distance is taken along the lane's normal, so that slopes do not enlarge it.
            let away = (z - p.z).abs() * up.z;
            assert!(
                away < SURFACE_M,
                "{}: the ground lies {away} m off {place:?}",
                map.name
            );
            (worst_m, worst_rad) = (worst_m.max(away), worst_rad.max(normal.angle(&up)));
        }
        println!(
            "{}: ground within {:.2} mm, normals within {:.3}°",
            map.name,
            worst_m * 1e3,
            worst_rad.to_degrees()
        );
        assert!(
            worst_rad < 1.5f64.to_radians(),
            "{}: a normal is off by {}°",
            map.name,
            worst_rad.to_degrees()
        );
    }
}

/// Every place gets a car, in rounds in which no two are near each other; after two seconds each
/// car stands there.
#[test]
fn a_car_dropped_anywhere_stands_on_its_lane() {
    for map in maps() {
        let roads = roads_of(&map);
        let mut world = World::new(WorldOptions::default());
        let mut open = places(&roads, |_| true);
        // Where a lane ends for good, half of a car would hang over its end.
        open.retain(|place| {
            [3.5, -3.5]
                .iter()
                .all(|away| !roads.advance(*place, *away).is_empty())
        });
        let n_open = open.len();
        let (mut n_stood, mut n_taken, mut worst_m) = (0, 0, 0.0f64);
        while !open.is_empty() {
            world.load(&map).unwrap();
            let mut near: HashMap<(i64, i64), Vec<Vector3<f64>>> = HashMap::new();
            let mut later = Vec::new();
            let mut cars = BTreeMap::new();
            for place in open {
                let pose = roads
                    .pose(LanePosition {
                        offset_m: 0.0,
                        ..place
                    })
                    .unwrap();
                let p = pose.translation.vector;
                let cell = ((p.x / 9.0).floor() as i64, (p.y / 9.0).floor() as i64);
                let around = (cell.0 - 1..=cell.0 + 1)
                    .flat_map(|x| (cell.1 - 1..=cell.1 + 1).map(move |y| (x, y)));
                if around
                    .filter_map(|c| near.get(&c))
                    .flatten()
                    .any(|q| (q - p).norm() < 8.0)
                {
                    later.push(place);
                    continue;
                }
                near.entry(cell).or_default().push(p);
                let above = Pose::from(pose * Isometry3::translation(0.0, 0.0, 0.25));
                // A lane may pass under a tree or end before a wall. Such obstacles are printed and
                // counted.
                match world.spawn("vehicle.tesla.model3", above, None, "", &BTreeMap::new()) {
                    Ok(car) => drop(cars.insert(car, pose)),
                    Err(_) => n_taken += 1,
                }
            }
            for car in cars.keys() {
                world
                    .set_control(
                        *car,
                        VehicleControl {
                            hand_brake: true,
                            brake_ratio: 1.0,
                            ..VehicleControl::default()
                        },
                    )
                    .unwrap();
            }
            (0..40).for_each(|_| world.step(50_000_000));
            for (car, pose) in &cars {
                let at = world.record(*car).unwrap().world_from_actor.isometry();
                let on_lane = pose.inverse() * at;
                let up = on_lane.rotation * Vector3::z();
                let (drift, height) = (
                    on_lane.translation.vector.xy().norm(),
                    on_lane.translation.vector.z.abs(),
                );
                assert!(
                    up.z > 0.9994,
                    "{}: a car leans by {}° at {pose}",
                    map.name,
                    up.z.acos().to_degrees()
                );
                assert!(
                    height < SURFACE_M,
                    "{}: a car stands {height} m off its lane at {pose}",
                    map.name
                );
                assert!(
                    drift < 0.3,
                    "{}: a car moved by {drift} m from {pose}",
                    map.name
                );
                (worst_m, n_stood) = (worst_m.max(height), n_stood + 1);
            }
            open = later;
        }
        println!(
            "{}: {n_stood} cars within {:.1} mm, {n_taken} places taken",
            map.name,
            worst_m * 1e3
        );
        assert!(
            n_open > 900 && n_stood * 100 > n_open * 98,
            "{}: only {n_stood} of {n_open} places took a car",
            map.name
        );
    }
}
