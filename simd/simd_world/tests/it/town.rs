//! The world on a generated town: vehicles stand on its roads, its lights keep time, and stop boxes
//! lie before stop lines.

use std::collections::BTreeMap;

use schema_frames::command::{Command, CommandReply};
use schema_frames::{ActorKind, ActorRecord, LightState};
use schema_roads::{LanePosition, RoadMap, SignalKind};
use schema_types::{ActorId, Pose};
use sensor_core::SceneAssets;
use simd_town::Town;
use simd_world::{EgoSpawn, MapData, World, WorldOptions, vehicle_models};

const TICK_NANOS: u64 = 50_000_000;

fn town() -> World {
    let mut world = World::new(WorldOptions::default());
    world
        .load(&MapData::from(&Town::generate("Town10HD", 1).unwrap()))
        .unwrap();
    world
}

/// State of every light by OpenDRIVE id.
fn states(world: &World) -> BTreeMap<String, LightState> {
    let lights = world
        .snapshot_records()
        .iter()
        .filter_map(|record| record.traffic_light());
    lights
        .map(|part| {
            (
                part.opendrive_id().to_owned(),
                LightState::from_code(part.state),
            )
        })
        .collect()
}

#[test]
fn vehicles_stand_upright_on_the_road_for_10_s() {
    let mut world = town();
    let scenario = world
        .spawn_scenario(
            Some(EgoSpawn {
                type_id: "vehicle.tesla.model3",
                spawn_idx: 0,
            }),
            20,
        )
        .unwrap();
    assert_eq!(scenario.others.len(), 20);
    for _ in 0..200 {
        world.step(TICK_NANOS);
        assert!(world.collisions().is_empty(), "{:?}", world.collisions());
    }
    let roads = world.roads().unwrap();
    for actor in scenario.others.iter().chain(&scenario.ego) {
        let record = world.record(*actor).unwrap();
        let part = record.vehicle().unwrap();
        let model = &vehicle_models()[record.catalogue_idx as usize];
        let place = record.world_from_actor;
        let up = place.isometry().rotation * nalgebra::Vector3::z();
        assert!(
            up.z > 0.999 && record.speed_mps() < 0.01,
            "{}: up {up}, {} m/s",
            model.type_id,
            record.speed_mps()
        );
        let lane = roads
            .nearest(place.translation_m, |lane| lane.kind.is_drivable())
            .unwrap();
        let ground_m = roads.pose(lane).unwrap().translation.z;
        assert!(
            (place.translation_m[2] - ground_m).abs() < 0.05,
            "{} stands at {} m, the road is at {ground_m} m",
            model.type_id,
            place.translation_m[2]
        );
        assert_eq!(part.wheels_on_ground, (1 << model.n_wheels()) - 1);
        assert!(part.speed_limit_mps > 5.0, "{}", part.speed_limit_mps);
        assert_eq!(record.flags, ActorRecord::PHYSICS);
    }
}

#[test]
fn every_spawn_point_takes_every_kind_of_vehicle() {
    let mut world = town();
    let points = world.map().spawn_points.clone();
    assert!(points.len() >= 150);
    let mut refused = Vec::new();
    for (idx, point) in points.iter().enumerate() {
        for type_id in [
            "vehicle.mitsubishi.fusorosa",
            "vehicle.carlamotors.firetruck",
            "vehicle.tesla.model3",
            "vehicle.yamaha.yzf",
        ] {
            match world.spawn(type_id, *point, None, "", &BTreeMap::new()) {
                Ok(actor) => drop(world.destroy(actor).unwrap()),
                Err(error) => refused.push(format!("{idx}: {error}")),
            }
        }
    }
    assert!(
        refused.is_empty(),
        "{} refused, e.g. {:#?}",
        refused.len(),
        &refused[..refused.len().min(5)]
    );
}

#[test]
fn lights_keep_time_to_the_tick_and_take_turns() {
    let mut world = town();
    let roads: &RoadMap = &world.roads().unwrap().clone();
    let mut turns: BTreeMap<u32, Vec<(u32, Vec<String>)>> = BTreeMap::new();
    for controller in roads
        .controllers()
        .iter()
        .filter(|controller| controller.junction.is_some())
    {
        turns
            .entry(controller.junction.unwrap())
            .or_default()
            .push((controller.sequence, controller.signals.clone()));
    }
    assert!(!turns.is_empty(), "the town has signalled junctions");
    turns.values_mut().for_each(|turns| turns.sort());
    // Green 10 s, yellow 3 s, all red 2 s make 300 ticks of 50 ms per turn.
    for tick in 0..=1300usize {
        let now = states(&world);
        for turns in turns.values() {
            let (turn, within) = (tick / 300 % turns.len(), tick % 300);
            for (idx, (_, signals)) in turns.iter().enumerate() {
                let expected = match within {
                    _ if idx != turn => LightState::Red,
                    0..200 => LightState::Green,
                    200..260 => LightState::Yellow,
                    _ => LightState::Red,
                };
                for signal in signals.iter().filter(|signal| now.contains_key(*signal)) {
                    assert_eq!(now[signal], expected, "signal {signal} at tick {tick}");
                }
            }
        }
        world.step(TICK_NANOS);
    }
}

#[test]
fn frozen_lights_stand_still_and_a_set_state_lasts_until_the_next_stage() {
    let mut world = town();
    let light = world
        .snapshot_records()
        .iter()
        .find(|record| record.kind() == Some(ActorKind::TrafficLight))
        .unwrap()
        .id;
    let state = |world: &World| {
        LightState::from_code(
            world
                .record(ActorId(light))
                .unwrap()
                .traffic_light()
                .unwrap()
                .state,
        )
    };
    assert_eq!(
        world.apply(&Command::FreezeTrafficLights { frozen: true }),
        CommandReply::Done
    );
    assert_eq!(
        world.apply(&Command::SetTrafficLight {
            actor_id: light,
            state: "off".into()
        }),
        CommandReply::Done
    );
    (0..2000).for_each(|_| world.step(TICK_NANOS));
    assert_eq!(state(&world), LightState::Off);
    assert_eq!(
        world
            .record(ActorId(light))
            .unwrap()
            .traffic_light()
            .unwrap()
            .flags,
        1
    );
    assert_eq!(
        world.apply(&Command::FreezeTrafficLights { frozen: false }),
        CommandReply::Done
    );
    (0..200).for_each(|_| world.step(TICK_NANOS));
    assert_ne!(state(&world), LightState::Off);
}

#[test]
fn vehicle_before_a_stop_line_sees_that_light_and_one_further_back_does_not() {
    let mut world = town();
    let roads = world.roads().unwrap().clone();
    let car = world
        .spawn(
            "vehicle.tesla.model3",
            world.map().spawn_points[0],
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    let half_m = vehicle_models()[0].half_m[0];
    let mut n_checked = 0;
    for signal in roads
        .signals()
        .iter()
        .filter(|signal| signal.kind == SignalKind::TrafficLight)
    {
        for stop in &signal.stops {
            let mut light_at = |front_m: f64| {
                let at = LanePosition {
                    s_m: stop.stop.s_m - front_m - half_m,
                    offset_m: 0.0,
                    ..stop.stop
                };
                world
                    .set_pose(car, Pose::from(roads.pose(at).unwrap()))
                    .unwrap();
                world.record(car).unwrap().vehicle().unwrap().light_actor_id
            };
            if stop.stop.s_m < 2.0 * half_m + 20.0 {
                continue;
            }
            n_checked += 1;
            let seen = light_at(0.5);
            assert_eq!(light_at(15.0), 0, "15 m before signal {}", signal.id);
            let id = world
                .record(ActorId(seen))
                .and_then(|record| record.traffic_light())
                .map(|part| part.opendrive_id().to_owned());
            // Two signals may stand for one lane (another on the far side); this vehicle's light
            // must be one of this lane.
            let for_lane = id.is_some_and(|id| {
                roads
                    .signal_stops(stop.lane)
                    .any(|(other, _)| other.id == id)
            });
            assert!(
                for_lane,
                "signal {} on {}: sees actor {seen}",
                signal.id, stop.lane
            );
        }
    }
    assert!(n_checked > 10, "{n_checked} stop lines");
}

#[test]
fn lamp_heads_show_the_state_of_their_light() {
    let mut world = town();
    world.register_meshes(&mut SceneAssets::default());
    let mut instances = Vec::new();
    for _ in 0..600 {
        world.step(TICK_NANOS);
    }
    world.dynamic_instances(&mut instances);
    assert!(!instances.is_empty());
    for instance in &instances {
        let state = LightState::from_code(
            world
                .record(instance.actor)
                .unwrap()
                .traffic_light()
                .unwrap()
                .state,
        );
        let expected = [1, 2, 4][state as usize];
        assert_eq!(instance.lamps, expected, "{state:?}");
    }
    assert!(
        instances
            .windows(2)
            .all(|pair| pair[0].key() < pair[1].key())
    );
}
