//! Speed limits as CARLA's server has them: 30 km/h until a sign is passed, then that of the last
//! one.

use std::collections::BTreeMap;
use std::sync::Arc;

use schema_roads::RoadMap;
use schema_types::Pose;
use simd_town::imported::{ImportOptions, import};
use simd_world::{MapData, World, WorldOptions};

const ROAD: &str = r#"<OpenDRIVE><header revMajor="1" revMinor="4" vendor="VectorZero"/><road id="1" length="200" junction="-1">
<type s="0" type="town"><speed max="55" unit="mph"/></type>
<planView><geometry s="0" x="0" y="0" hdg="0" length="200"><line/></geometry></planView>
<lanes><laneSection s="0"><left><lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left><center><lane id="0"/></center><right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection></lanes>
<objects><object id="7" name="Speed_60" s="80" t="-4" hdg="0" orientation="-" type="-1"/><object id="8" name="Speed_90" s="120" t="4" hdg="3.14159" orientation="+" type="-1"/></objects>
</road></OpenDRIVE>"#;

fn world(text: &str) -> World {
    let roads = RoadMap::parse(text).unwrap();
    let town = import("road", text, &roads, 1, &ImportOptions::default()).unwrap();
    let mut world = World::new(WorldOptions::default());
    world
        .load(&MapData::of_import(&town, Arc::new(roads)))
        .unwrap();
    world
}

/// The limits, km/h, of a car that is put from place to place along a lane.
fn limits(world: &mut World, y_m: f64, yaw: f64, xs: &[f64]) -> Vec<f64> {
    let pose = |x: f64| Pose::from_xyz_yaw(x, y_m, 0.3, yaw);
    let car = world
        .spawn(
            "vehicle.tesla.model3",
            pose(xs[0]),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    xs.iter()
        .map(|x| {
            world.set_pose(car, pose(*x)).unwrap();
            world.step(50_000_000);
            let part = world.record(car).unwrap().vehicle().unwrap();
            (f64::from(part.speed_limit_mps) * 3.6).round()
        })
        .collect()
}

#[test]
fn a_limit_holds_from_its_sign_to_the_next() {
    let mut world = world(ROAD);
    let there = limits(
        &mut world,
        -1.75,
        0.0,
        &[30.0, 60.0, 80.0, 100.0, 119.0, 150.0],
    );
    assert_eq!(there, [30.0, 30.0, 60.0, 60.0, 60.0, 60.0]);
    // The other way has the other sign; its own lies 80 m after its start.
    let back = limits(
        &mut world,
        1.75,
        std::f64::consts::PI,
        &[170.0, 140.0, 120.0, 80.0, 40.0],
    );
    assert_eq!(back, [30.0, 30.0, 90.0, 90.0, 90.0]);
}

#[test]
fn without_signs_the_lane_says_the_limit() {
    let text = ROAD.replace("Speed_", "Bench_");
    let mut world = world(&text);
    assert_eq!(limits(&mut world, -1.75, 0.0, &[30.0, 150.0]), [89.0, 89.0]);
}
