//! Where cars may be parked, measured on the finished town and its OpenDRIVE text: nothing of the
//! code that places them is asked.

use std::collections::BTreeSet;

use nalgebra::{Isometry3, Point2, Point3, Vector2};
use schema_roads::{LanePosition, RoadMap};
use schema_types::Class;
use simd_town::{MapLayer, SceneryObject, Town};

/// Distance between two stations of a lane, metres.
const STEP_M: f64 = 0.5;
/// Distance between two points across a lane, metres.
const ACROSS_M: f64 = 0.25;
/// What lies further above or below the middle of a car is on another level, metres.
const LEVEL_M: f64 = 2.5;
/// Half length and width of the vehicle for which a spawn point needs room: a lorry's width and a
/// long car's length, metres.
const SPAWN_HALF_M: [f64; 2] = [2.6, 1.1];

/// A rectangle on the ground with its height.
#[derive(Clone, Copy)]
struct Footprint {
    middle: Point2<f64>,
    along: Vector2<f64>,
    half_m: [f64; 2],
    z_m: f64,
}

impl Footprint {
    fn new(pose: &Isometry3<f64>, half_m: [f64; 2]) -> Footprint {
        let middle = pose.translation.vector;
        let along = (pose.rotation * nalgebra::Vector3::x()).xy().normalize();
        Footprint {
            middle: Point2::new(middle.x, middle.y),
            along,
            half_m,
            z_m: middle.z,
        }
    }

    fn of(car: &SceneryObject) -> Footprint {
        let half = car.box_half_m;
        Footprint::new(&car.box_pose.isometry(), [half[0], half[1]])
    }

    fn aside(&self) -> Vector2<f64> {
        Vector2::new(-self.along.y, self.along.x)
    }

    fn reach_m(&self) -> f64 {
        self.half_m[0].hypot(self.half_m[1])
    }

    fn corners(&self) -> Vec<Point2<f64>> {
        [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
            .map(|(u, v)| {
                self.middle
                    + self.along * (u * self.half_m[0])
                    + self.aside() * (v * self.half_m[1])
            })
            .to_vec()
    }

    fn holds(&self, p: &Point3<f64>) -> bool {
        let from = Point2::new(p.x, p.y) - self.middle;
        (p.z - self.z_m).abs() < LEVEL_M
            && from.dot(&self.along).abs() < self.half_m[0]
            && from.dot(&self.aside()).abs() < self.half_m[1]
    }

    /// Whether a convex polygon and the rectangle share area: no line parts them.
    fn meets(&self, polygon: &[Point2<f64>]) -> bool {
        let own = self.corners();
        let edges = (0..polygon.len()).map(|i| polygon[(i + 1) % polygon.len()] - polygon[i]);
        let normals = edges.map(|edge| Vector2::new(-edge.y, edge.x));
        let span = |points: &[Point2<f64>], normal: &Vector2<f64>| {
            let at = points.iter().map(|p| p.coords.dot(normal));
            at.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                (low.min(x), high.max(x))
            })
        };
        normals
            .chain([self.along, self.aside()])
            .filter(|normal| normal.norm() > 1e-6)
            .all(|normal| {
                let (a, b) = (span(&own, &normal), span(polygon, &normal));
                a.0 < b.1 && b.0 < a.1
            })
    }
}

fn parked(town: &Town) -> Vec<&SceneryObject> {
    let cars = town.objects.iter();
    cars.filter(|object| object.name.starts_with("parked_car"))
        .collect()
}

/// Cars that reach into a lane where vehicles drive, each with the place.
fn in_lanes(cars: &[(String, Footprint)], roads: &RoadMap) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for lane in roads.lanes().iter().filter(|lane| lane.kind.is_drivable()) {
        let n = (lane.length_m / STEP_M).ceil().max(1.0) as usize;
        for i in 0..=n {
            let at = LanePosition::new(lane.key, lane.length_m * i as f64 / n as f64);
            let Some(pose) = roads.pose(at) else { continue };
            let middle = pose.translation.vector;
            let half_m = 0.5 * roads.width_m(at);
            let near = cars.iter().filter(|(_, car)| {
                (car.middle.coords - middle.xy()).norm() < car.reach_m() + half_m
            });
            let sides = (half_m / ACROSS_M).ceil() as i32;
            for (name, car) in near {
                let enters = (-sides..=sides).any(|k| {
                    let aside_m = half_m * f64::from(k) / f64::from(sides.max(1));
                    car.holds(&(pose * Point3::new(0.0, aside_m, 0.0)))
                });
                if enters {
                    found.insert(format!("{name} reaches into {:?}", lane.key));
                }
            }
        }
    }
    found
}

/// Cars that stand where a vehicle is put into the world, on a crossing, or in each other.
fn in_the_way(cars: &[(String, Footprint)], town: &Town, roads: &RoadMap) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (i, (name, car)) in cars.iter().enumerate() {
        for (idx, spawn) in town.spawn_points.iter().enumerate() {
            let spawn = Footprint::new(&spawn.isometry(), SPAWN_HALF_M);
            if (spawn.z_m - car.z_m).abs() < LEVEL_M && car.meets(&spawn.corners()) {
                found.insert(format!("{name} stands on spawn point {idx}"));
            }
        }
        for crosswalk in roads.crosswalks() {
            let corners = crosswalk.corners.iter();
            let corners: Vec<_> = corners.map(|c| Point2::new(c[0], c[1])).collect();
            if car.meets(&corners) {
                found.insert(format!("{name} stands on a crossing"));
            }
        }
        for (other, that) in &cars[i + 1..] {
            if (that.z_m - car.z_m).abs() < LEVEL_M && car.meets(&that.corners()) {
                found.insert(format!("{name} stands in {other}"));
            }
        }
    }
    found
}

fn footprints(town: &Town) -> Vec<(String, Footprint)> {
    let cars = parked(town).into_iter();
    cars.map(|car| (car.name.clone(), Footprint::of(car)))
        .collect()
}

#[test]
fn parked_cars_leave_lanes_spawn_points_crossings_and_each_other_free() {
    for (name, seed) in Town::NAMES
        .into_iter()
        .flat_map(|name| [(name, 1), (name, 2)])
    {
        let town = Town::generate(name, seed).expect("a name of the list");
        let roads = RoadMap::parse(&town.open_drive).expect("a town's own text");
        let cars = footprints(&town);
        assert!(cars.len() >= 3, "{name}: {} parked cars", cars.len());
        let mut found = in_lanes(&cars, &roads);
        found.append(&mut in_the_way(&cars, &town, &roads));
        assert!(found.is_empty(), "{name}, seed {seed}: {found:#?}");
    }
}

/// The check sees a car that is moved onto a lane, a spawn point, another car.
#[test]
fn a_car_in_the_way_is_found() {
    let town = Town::generate("Town10HD", 1).expect("a name of the list");
    let roads = RoadMap::parse(&town.open_drive).expect("a town's own text");
    let half_m = [2.3, 1.0];
    let on_spawn = Footprint::new(&town.spawn_points[0].isometry(), half_m);
    let crosswalk = &roads.crosswalks()[0].corners;
    let n = crosswalk.len() as f64;
    let middle = crosswalk.iter().fold(Vector2::zeros(), |sum, c| {
        sum + Vector2::new(c[0], c[1]) / n
    });
    let on_crossing = Footprint {
        middle: Point2::from(middle),
        ..on_spawn
    };
    let cars = [
        ("a".to_owned(), on_spawn),
        ("b".to_owned(), on_spawn),
        ("c".to_owned(), on_crossing),
    ];
    let lanes = in_lanes(&cars, &roads);
    assert!(lanes.iter().any(|it| it.starts_with("a reaches into")));
    let found = in_the_way(&cars, &town, &roads);
    for wanted in [
        "a stands on spawn point 0",
        "a stands in b",
        "c stands on a crossing",
    ] {
        assert!(found.contains(wanted), "{wanted}: {found:#?}");
    }
}

/// Every parked car is of class car, in the layer that can be switched, drawn, and solid.
#[test]
fn every_parked_car_has_label_layer_mesh_and_collider() {
    for name in Town::NAMES {
        let town = Town::generate(name, 1).expect("a name of the list");
        let drawn: BTreeSet<u32> = town.assets.statics.iter().map(|it| it.object.0).collect();
        let solid: BTreeSet<u32> = town
            .collision
            .iter()
            .flat_map(|mesh| mesh.objects.iter().map(|id| id.0))
            .collect();
        let mut ids = BTreeSet::new();
        for car in parked(&town) {
            assert_eq!(car.class, Class::CAR, "{name}: {}", car.name);
            assert_eq!(
                car.layer,
                Some(MapLayer::ParkedVehicles),
                "{name}: {}",
                car.name
            );
            assert!(
                drawn.contains(&car.id.0),
                "{name}: {} is not drawn",
                car.name
            );
            assert!(
                solid.contains(&car.id.0),
                "{name}: {} is not solid",
                car.name
            );
            assert!(ids.insert(car.id.0), "{name}: {} shares its id", car.name);
        }
    }
}
