//! Traffic lights by CARLA's clock, their groups, and the boxes on lanes before lights and signs.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Point3;
use schema_frames::{ActorKind, Command, CommandReply, LightState, TrafficLightPart};
use schema_roads::SignalKind;
use schema_types::{ActorId, Pose};
use simd_world::{MapData, World, WorldOptions};

const TICK_NANOS: u64 = 50_000_000;
const TICK_SECS: f32 = 0.05;

fn town(name: &str) -> World {
    let mut world = World::new(WorldOptions::default());
    world
        .load(&MapData::from(&simd_town::Town::generate(name, 1).unwrap()))
        .unwrap();
    world
}

fn lights(world: &World) -> BTreeMap<u32, TrafficLightPart> {
    world
        .snapshot_records()
        .iter()
        .filter_map(|record| Some((record.id, record.traffic_light()?)))
        .collect()
}

fn part(world: &World, id: u32) -> TrafficLightPart {
    world.record(ActorId(id)).unwrap().traffic_light().unwrap()
}

/// Ticks until the light shows `state`.
fn ticks_until(world: &mut World, id: u32, state: LightState) -> u64 {
    for tick in 0..4000 {
        if part(world, id).state == state as u32 {
            return tick;
        }
        world.step(TICK_NANOS);
    }
    panic!("light {id} never becomes {}", state.name());
}

#[test]
fn a_controller_is_green_ten_seconds_yellow_three_and_all_are_red_for_two() {
    let mut world = town("Town10HD");
    let start = lights(&world);
    let first = *start
        .iter()
        .find(|(_, light)| light.state == LightState::Green as u32)
        .unwrap()
        .0;
    let group = start[&first].group;
    assert_eq!(
        (
            start[&first].green_secs,
            start[&first].yellow_secs,
            start[&first].red_secs
        ),
        (10.0, 3.0, 2.0)
    );
    assert_eq!(ticks_until(&mut world, first, LightState::Yellow), 200);
    assert_eq!(ticks_until(&mut world, first, LightState::Red), 60);
    let members: Vec<u32> = start
        .iter()
        .filter(|(_, light)| light.group == group)
        .map(|(id, _)| *id)
        .collect();
    assert!(members.len() > 1);
    for tick in 0..40 {
        assert!(
            members
                .iter()
                .all(|id| part(&world, *id).state == LightState::Red as u32),
            "tick {tick} of the red stage"
        );
        assert!((part(&world, first).elapsed_secs - tick as f32 * TICK_SECS).abs() < 1e-4);
        world.step(TICK_NANOS);
    }
    let green: Vec<u32> = members
        .iter()
        .copied()
        .filter(|id| part(&world, *id).state == LightState::Green as u32)
        .collect();
    assert!(
        !green.is_empty() && !green.contains(&first),
        "the next controller's turn: {green:?} after {first}"
    );
    let poles: BTreeSet<u32> = members
        .iter()
        .map(|id| part(&world, *id).pole_idx)
        .collect();
    assert_eq!(
        poles,
        (0..members.len() as u32).collect(),
        "pole indices count a group's lights"
    );
}

#[test]
fn times_are_the_controllers_and_reset_begins_its_first_turn() {
    let mut world = town("Town10HD");
    let start = lights(&world);
    let first = *start
        .iter()
        .find(|(_, light)| light.state == LightState::Green as u32)
        .unwrap()
        .0;
    let together: Vec<u32> = start
        .iter()
        .filter(|(_, light)| {
            light.group == start[&first].group && light.state == start[&first].state
        })
        .map(|(id, _)| *id)
        .collect();
    for (state, secs) in [("green", 2.0), ("yellow", 0.5), ("red", 1.0)] {
        let set = Command::SetTrafficLightTime {
            actor_id: *together.last().unwrap(),
            state: state.into(),
            secs,
        };
        assert_eq!(world.apply(&set), CommandReply::Done);
    }
    for id in &together {
        let light = part(&world, *id);
        assert_eq!(
            (light.green_secs, light.yellow_secs, light.red_secs),
            (2.0, 0.5, 1.0),
            "all lights of one controller"
        );
    }
    let other = *start
        .iter()
        .find(|(_, light)| light.group != start[&first].group)
        .unwrap()
        .0;
    assert_eq!(part(&world, other).green_secs, 10.0);
    assert_eq!(ticks_until(&mut world, first, LightState::Yellow), 40);
    assert_eq!(ticks_until(&mut world, first, LightState::Red), 10);
    world.step(TICK_NANOS);
    assert_eq!(
        world.apply(&Command::ResetTrafficLights {
            actor_id: Some(other)
        }),
        CommandReply::Done
    );
    assert_eq!(
        part(&world, first).state,
        LightState::Red as u32,
        "another group's reset is not this one's"
    );
    assert_eq!(
        world.apply(&Command::ResetTrafficLights {
            actor_id: Some(first)
        }),
        CommandReply::Done
    );
    for (id, light) in lights(&world)
        .into_iter()
        .filter(|(_, light)| light.group == start[&first].group)
    {
        assert_eq!((light.state, light.elapsed_secs), (start[&id].state, 0.0));
    }
    assert_eq!(
        ticks_until(&mut world, first, LightState::Yellow),
        40,
        "times stay"
    );
    assert_eq!(
        world.apply(&Command::ResetTrafficLights { actor_id: None }),
        CommandReply::Done
    );
    assert_eq!(part(&world, first).state, LightState::Green as u32);
    let refused = |command| match World::new(WorldOptions::default()).apply(&command) {
        CommandReply::Refused { error } => error,
        other => panic!("{other:?}"),
    };
    assert!(refused(Command::ResetTrafficLights { actor_id: Some(99) }).contains("99"));
    let secs = Command::SetTrafficLightTime {
        actor_id: first,
        state: "green".into(),
        secs: f64::NAN,
    };
    let CommandReply::Refused { error } = world.apply(&secs) else {
        panic!("NaN was taken")
    };
    assert!(error.contains("must be 0.01 to"), "{error}");
}

#[test]
fn frozen_lights_stand_still_and_set_states_hold() {
    let mut world = town("Town10HD");
    let start = lights(&world);
    let first = *start.keys().next().unwrap();
    world.apply(&Command::FreezeTrafficLights { frozen: true });
    for (state, name) in [
        (LightState::Off, "off"),
        (LightState::Unknown, "unknown"),
        (LightState::Yellow, "yellow"),
    ] {
        assert_eq!(
            world.apply(&Command::SetTrafficLight {
                actor_id: first,
                state: name.into()
            }),
            CommandReply::Done
        );
        for _ in 0..400 {
            world.step(TICK_NANOS);
        }
        let light = part(&world, first);
        assert_eq!(
            (light.state, light.elapsed_secs, light.flags & 1),
            (state as u32, 0.0, 1)
        );
    }
    assert!(
        lights(&world)
            .iter()
            .all(|(id, light)| *id == first || light.state == start[id].state)
    );
}

#[test]
fn trigger_boxes_lie_on_the_lanes_and_name_the_light_to_cars_in_them() {
    for name in ["Town10HD", "Town03"] {
        let mut world = town(name);
        let roads = world.roads().unwrap().clone();
        let list = world.actor_list();
        let mut n_cars = 0;
        for signal in roads.signals() {
            let actor = list
                .actors
                .iter()
                .find(|actor| actor.attributes.get("opendrive_id") == Some(&signal.id))
                .unwrap();
            let record = *world.record(ActorId(actor.id)).unwrap();
            match record.kind().unwrap() {
                ActorKind::TrafficLight => {
                    assert_eq!(record.traffic_light().unwrap().opendrive_id(), signal.id)
                }
                _ => assert_eq!(record.traffic_sign().unwrap().opendrive_id(), signal.id),
            }
            if signal.stops.is_empty() {
                assert_eq!(actor.trigger_box, None);
                continue;
            }
            let trigger = actor
                .trigger_box
                .unwrap_or_else(|| panic!("signal {} has no box", signal.id));
            for stop in &signal.stops {
                let upstream_m =
                    if matches!(signal.kind, SignalKind::SpeedLimit | SignalKind::Other) {
                        0.0
                    } else {
                        3.0
                    };
                let at = schema_roads::LanePosition {
                    s_m: (stop.stop.s_m - upstream_m).max(0.0),
                    ..stop.stop
                };
                let lane = roads.pose(at).unwrap();
                let local = record
                    .world_from_actor
                    .isometry()
                    .inverse_transform_point(&(lane * Point3::new(0.0, 0.0, 0.5)));
                for axis in 0..3 {
                    let off = (local[axis] as f32 - trigger.centre_m[axis]).abs();
                    assert!(
                        off <= trigger.half_m[axis] + 1e-3,
                        "{name} signal {}: {off} m off along {axis}",
                        signal.id
                    );
                }
                if signal.kind == SignalKind::TrafficLight && n_cars < 40 {
                    let mut pose = Pose::from(lane);
                    pose.translation_m[2] += 0.3;
                    if let Ok(car) =
                        world.spawn("vehicle.mini.cooper_s", pose, None, "", &BTreeMap::new())
                    {
                        world.step(TICK_NANOS);
                        let vehicle = world.record(car).unwrap().vehicle().unwrap();
                        let seen = part(&world, vehicle.light_actor_id.max(1));
                        assert_eq!(seen.opendrive_id(), signal.id, "{name}");
                        assert_eq!(vehicle.light_state, seen.state);
                        world.destroy(car).unwrap();
                        n_cars += 1;
                    }
                }
            }
        }
        assert!(n_cars > 5, "{name}: {n_cars}");
    }
}

#[test]
fn lamp_heads_have_boxes_above_the_road() {
    let mut world = town("Town10HD");
    for id in lights(&world).into_keys() {
        let CommandReply::Boxes { boxes } = world.apply(&Command::LightBoxes { actor_id: id })
        else {
            panic!("no boxes")
        };
        assert!(!boxes.is_empty());
        for head in boxes {
            let ground = world
                .roads()
                .unwrap()
                .nearest(head.pose.translation_m, |_| true)
                .and_then(|at| world.roads().unwrap().pose(at))
                .unwrap();
            let above_m = head.pose.translation_m[2] - ground.translation.z;
            assert!(
                (1.5..9.0).contains(&above_m),
                "a head hangs {above_m} m above the lane"
            );
            assert!(
                head.half_m.iter().all(|half| (0.02..1.0).contains(half)),
                "{:?}",
                head.half_m
            );
        }
    }
    assert!(matches!(
        world.apply(&Command::LightBoxes { actor_id: 1 }),
        CommandReply::Refused { .. }
    ));
}
