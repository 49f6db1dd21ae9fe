//! Commands that act on a body: impulses, forces, switches, held velocities, physical data,
//! Ackermann control, friction areas.

use std::collections::BTreeMap;

use schema_frames::command::{Command, CommandReply};
use schema_frames::{
    AckermannControl, ActorRecord, PhysicsAction, PhysicsAnswer, VehicleControl, VehiclePhysics,
};
use schema_types::{ActorId, Pose};
use simd_world::{MapData, World, WorldOptions};

const TICK_NANOS: u64 = 50_000_000;
const TICK_SECS: f64 = 0.05;
const MASS_KG: f64 = 1847.0;

fn standing(type_id: &str) -> (World, ActorId) {
    let mut world = World::new(WorldOptions::default());
    world.load(&MapData::flat(2000.0)).unwrap();
    let car = world
        .spawn(
            type_id,
            Pose::from_xyz_yaw(0.0, 0.0, 0.05, 0.0),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    (0..60).for_each(|_| world.step(TICK_NANOS));
    (world, car)
}

fn act(world: &mut World, car: ActorId, action: PhysicsAction) -> Option<PhysicsAnswer> {
    match world.apply(&Command::Physics {
        actor_id: car.0,
        action,
    }) {
        CommandReply::Done => None,
        CommandReply::Physics { answer } => Some(answer),
        reply => panic!("{reply:?}"),
    }
}

fn refused(world: &mut World, car: ActorId, action: PhysicsAction) -> String {
    match world.apply(&Command::Physics {
        actor_id: car.0,
        action,
    }) {
        CommandReply::Refused { error } => error,
        reply => panic!("{reply:?}"),
    }
}

fn record(world: &World, car: ActorId) -> ActorRecord {
    *world.record(car).unwrap()
}

fn physics(world: &mut World, car: ActorId) -> VehiclePhysics {
    match act(world, car, PhysicsAction::GetVehiclePhysics) {
        Some(PhysicsAnswer::VehiclePhysics(physics)) => *physics,
        answer => panic!("{answer:?}"),
    }
}

fn set(world: &mut World, car: ActorId, change: impl FnOnce(&mut VehiclePhysics)) {
    let mut data = physics(world, car);
    change(&mut data);
    act(
        world,
        car,
        PhysicsAction::SetVehiclePhysics {
            physics: Box::new(data.clone()),
        },
    );
    assert_eq!(physics(world, car), data, "what was set reads back");
}

/// In the air, where only the push acts.
fn floating(type_id: &str) -> (World, ActorId) {
    let (mut world, car) = standing(type_id);
    act(
        &mut world,
        car,
        PhysicsAction::SetGravity { enabled: false },
    );
    world
        .set_pose(car, Pose::from_xyz_yaw(0.0, 0.0, 50.0, 0.0))
        .unwrap();
    world.set_velocity(car, [0.0; 3]).unwrap();
    (world, car)
}

#[test]
fn impulse_over_mass_is_the_change_of_velocity() {
    let (mut world, car) = floating("vehicle.tesla.model3");
    act(
        &mut world,
        car,
        PhysicsAction::AddImpulse {
            impulse_in_world_ns: [MASS_KG, -2.0 * MASS_KG, 3.0 * MASS_KG],
            point_in_world_m: None,
        },
    );
    world.step(TICK_NANOS);
    let velocity = record(&world, car).velocity_in_world_mps;
    for (is, expected) in velocity.into_iter().zip([1.0, -2.0, 3.0]) {
        assert!((is - expected).abs() < 0.01, "{velocity:?}");
    }
    // A push off the centre also turns the body: ω = I⁻¹ (r × J), with the inertia of a box of the
    // body's size.
    let (mut world, car) = floating("vehicle.tesla.model3");
    let centre = physics(&mut world, car).center_of_mass_m.map(f64::from);
    let point = [centre[0] + 2.0, centre[1], centre[2] + 50.0];
    act(
        &mut world,
        car,
        PhysicsAction::AddImpulse {
            impulse_in_world_ns: [0.0, 1000.0, 0.0],
            point_in_world_m: Some(point),
        },
    );
    world.step(TICK_NANOS);
    let inertia = MASS_KG / 12.0 * ((2.0 * 2.396f64).powi(2) + (2.0 * 1.082f64).powi(2));
    let spin = record(&world, car).angular_velocity_in_world_radps;
    assert!(
        (spin[2] / (2000.0 / inertia) - 1.0).abs() < 0.01,
        "{spin:?}, expected {}",
        2000.0 / inertia
    );
}

#[test]
fn force_acts_for_one_tick_and_torque_turns() {
    let (mut world, car) = floating("vehicle.tesla.model3");
    act(
        &mut world,
        car,
        PhysicsAction::AddForce {
            force_in_world_n: [0.0, 0.0, 10.0 * MASS_KG],
            point_in_world_m: None,
        },
    );
    (0..3).for_each(|_| world.step(TICK_NANOS));
    let rise_mps = record(&world, car).velocity_in_world_mps[2];
    assert!((rise_mps - 10.0 * TICK_SECS).abs() < 0.01, "{rise_mps}");
    let inertia = MASS_KG / 12.0 * ((2.0 * 2.396f64).powi(2) + (2.0 * 1.082f64).powi(2));
    act(
        &mut world,
        car,
        PhysicsAction::AddTorque {
            torque_in_world_nm: [0.0, 0.0, inertia],
        },
    );
    act(
        &mut world,
        car,
        PhysicsAction::AddAngularImpulse {
            angular_impulse_in_world_nms: [0.0, 0.0, 0.5 * inertia],
        },
    );
    (0..3).for_each(|_| world.step(TICK_NANOS));
    let spin = record(&world, car).angular_velocity_in_world_radps[2];
    assert!((spin - (TICK_SECS + 0.5)).abs() < 0.01, "{spin}");
    act(
        &mut world,
        car,
        PhysicsAction::SetAngularVelocity {
            angular_velocity_in_world_radps: [0.0, 0.0, -1.0],
        },
    );
    world.step(TICK_NANOS);
    assert!((record(&world, car).angular_velocity_in_world_radps[2] + 1.0).abs() < 0.01);
}

#[test]
fn without_gravity_it_floats_and_with_it_falls() {
    let (mut world, car) = floating("vehicle.tesla.model3");
    (0..40).for_each(|_| world.step(TICK_NANOS));
    assert!((record(&world, car).world_from_actor.translation_m[2] - 50.0).abs() < 0.01);
    act(&mut world, car, PhysicsAction::SetGravity { enabled: true });
    (0..20).for_each(|_| world.step(TICK_NANOS));
    let fall_mps = record(&world, car).velocity_in_world_mps[2];
    assert!((fall_mps + 9.81).abs() < 0.1, "{fall_mps}");
}

#[test]
fn held_velocity_is_held_on_the_ground_in_the_vehicles_axes() {
    let (mut world, car) = standing("vehicle.tesla.model3");
    world
        .set_pose(car, Pose::from_xyz_yaw(0.0, 0.0, 0.0, 1.0))
        .unwrap();
    act(
        &mut world,
        car,
        PhysicsAction::HoldVelocity {
            velocity_in_vehicle_mps: Some([7.0, 0.0, 0.0]),
        },
    );
    world
        .set_control(
            car,
            VehicleControl {
                brake_ratio: 1.0,
                ..Default::default()
            },
        )
        .unwrap();
    for _ in 0..100 {
        world.step(TICK_NANOS);
        assert!(
            (record(&world, car).speed_mps() - 7.0).abs() < 0.05,
            "{}",
            record(&world, car).speed_mps()
        );
    }
    let [x, y, _] = record(&world, car).world_from_actor.translation_m;
    assert!(
        (x - 35.0 * 1f64.cos()).abs() < 0.5 && (y - 35.0 * 1f64.sin()).abs() < 0.5,
        "{x} {y}"
    );
    act(
        &mut world,
        car,
        PhysicsAction::HoldVelocity {
            velocity_in_vehicle_mps: None,
        },
    );
    (0..40).for_each(|_| world.step(TICK_NANOS));
    assert!(
        record(&world, car).speed_mps() < 0.01,
        "the brake is there again"
    );
}

#[test]
fn without_physics_only_poses_move_it_and_its_velocity_is_its_displacement() {
    let (mut world, car) = standing("vehicle.tesla.model3");
    world.set_velocity(car, [10.0, 0.0, 0.0]).unwrap();
    act(
        &mut world,
        car,
        PhysicsAction::SetSimulated { enabled: false },
    );
    (0..10).for_each(|_| world.step(TICK_NANOS));
    let at = record(&world, car);
    assert_eq!(at.flags & ActorRecord::PHYSICS, 0);
    assert!(
        at.speed_mps() == 0.0 && at.world_from_actor.translation_m[0].abs() < 0.01,
        "{at:?}"
    );
    for tick in 1..=20 {
        let pose = Pose::from_xyz_yaw(0.4 * f64::from(tick), 0.0, 0.0, 0.0);
        world.set_pose(car, pose).unwrap();
        world.step(TICK_NANOS);
        let at = record(&world, car);
        assert!((at.world_from_actor.translation_m[0] - pose.translation_m[0]).abs() < 1e-5);
        assert!(
            tick == 1 || (at.velocity_in_world_mps[0] - 8.0).abs() < 0.01,
            "{:?}",
            at.velocity_in_world_mps
        );
    }
    // A teleport gives no velocity.
    world
        .set_pose(car, Pose::from_xyz_yaw(500.0, 0.0, 0.0, 0.0))
        .unwrap();
    world.step(TICK_NANOS);
    assert_eq!(record(&world, car).speed_mps(), 0.0);
    act(
        &mut world,
        car,
        PhysicsAction::SetSimulated { enabled: true },
    );
    world.set_velocity(car, [5.0, 0.0, 0.0]).unwrap();
    (0..20).for_each(|_| world.step(TICK_NANOS));
    let at = record(&world, car);
    assert!(
        at.speed_mps() > 4.0 && at.world_from_actor.translation_m[0] > 504.0,
        "it drives on: {at:?}"
    );
}

#[test]
fn a_car_that_is_put_elsewhere_jumps_with_all_it_carries_and_one_that_commands_move_does_not() {
    let (mut world, car) = standing("vehicle.tesla.model3");
    let pose = Pose::from_xyz_yaw(0.0, 0.0, 1.5, 0.0);
    let load = world.spawn("static.prop.box01", pose, Some(car), "", &BTreeMap::new());
    let load = load.unwrap();
    let away = Pose::from_xyz_yaw(9.0, 0.0, 0.05, 0.0);
    world.set_pose(car, away).unwrap();
    // The way there ends with the coming step.
    assert!(world.jumped().is_empty());
    world.step(TICK_NANOS);
    assert_eq!(world.jumped(), [car, load]);
    world.step(TICK_NANOS);
    assert!(world.jumped().is_empty());
    act(
        &mut world,
        car,
        PhysicsAction::SetSimulated { enabled: false },
    );
    world.set_pose(car, pose).unwrap();
    world.step(TICK_NANOS);
    assert!(world.jumped().is_empty());
}

#[test]
fn without_collisions_two_cars_pass_through_each_other_on_their_wheels() {
    for collides in [true, false] {
        let (mut world, car) = standing("vehicle.tesla.model3");
        let other = world
            .spawn(
                "vehicle.audi.tt",
                Pose::from_xyz_yaw(15.0, 0.0, 0.05, 0.0),
                None,
                "",
                &BTreeMap::new(),
            )
            .unwrap();
        act(
            &mut world,
            other,
            PhysicsAction::SetCollisions { enabled: collides },
        );
        world.set_velocity(car, [15.0, 0.0, 0.0]).unwrap();
        let mut touched = false;
        for _ in 0..40 {
            world.step(TICK_NANOS);
            touched |= !world.collisions().is_empty();
            assert!(collides || !touched, "{:?}", world.collisions());
        }
        assert_eq!(touched, collides);
        assert!(record(&world, other).world_from_actor.translation_m[2].abs() < 0.05);
        let ahead_m = record(&world, car).world_from_actor.translation_m[0]
            - record(&world, other).world_from_actor.translation_m[0];
        assert_eq!(ahead_m > 0.0, !collides, "{ahead_m}");
    }
}

fn speed_after_3_s(change: impl FnOnce(&mut VehiclePhysics)) -> f64 {
    let (mut world, car) = standing("vehicle.lincoln.mkz_2020");
    set(&mut world, car, change);
    world
        .set_control(
            car,
            VehicleControl {
                throttle_ratio: 0.6,
                ..Default::default()
            },
        )
        .unwrap();
    (0..60).for_each(|_| world.step(TICK_NANOS));
    record(&world, car).speed_mps()
}

#[test]
fn every_field_of_the_drive_train_acts() {
    let usual = speed_after_3_s(|_| {});
    let slower = |name: &str, change: fn(&mut VehiclePhysics), most: f64| {
        let speed = speed_after_3_s(change);
        assert!(speed < most * usual, "{name}: {speed} m/s, usually {usual}");
    };
    slower("mass", |p| p.mass_kg *= 2.0, 0.7);
    slower(
        "torque",
        |p| p.torque_curve.iter_mut().for_each(|point| point[1] *= 0.5),
        0.7,
    );
    slower("largest speed", |p| p.max_rpm = 2500.0, 0.9);
    slower("inertia", |p| p.engine_inertia_kgm2 *= 20.0, 0.9);
    slower(
        "friction of the engine",
        |p| p.damping_full_throttle_nms = 0.8,
        0.95,
    );
    slower("clutch", |p| p.clutch_strength_nms = 1.0, 0.6);
    slower("final ratio", |p| p.final_ratio *= 0.5, 0.8);
    slower(
        "gears",
        |p| {
            p.forward_gears
                .iter_mut()
                .for_each(|gear| gear.ratio *= 0.5)
        },
        0.8,
    );
    slower(
        "time to shift",
        |p| {
            p.gear_switch_secs = 2.0;
            p.forward_gears
                .iter_mut()
                .for_each(|gear| gear.up_ratio = 0.35);
        },
        0.9,
    );
    slower("drag", |p| p.drag_coefficient = 20.0, 0.95);
    slower(
        "friction of the wheels",
        |p| {
            p.wheels
                .iter_mut()
                .for_each(|wheel| wheel.damping_nms = 20.0)
        },
        0.95,
    );
    slower(
        "grip",
        |p| p.wheels.iter_mut().for_each(|wheel| wheel.friction = 0.1),
        0.6,
    );
    // Twice the mass gives half the acceleration, apart from rotating parts and the clutch at the
    // start.
    let heavy = speed_after_3_s(|p| p.mass_kg *= 2.0);
    assert!((heavy / usual - 0.5).abs() < 0.1, "{heavy} {usual}");
}

#[test]
fn engine_braking_follows_its_damping() {
    let slowed = |damping: f32| {
        let (mut world, car) = standing("vehicle.tesla.model3");
        set(&mut world, car, |p| p.damping_closed_engaged_nms = damping);
        world.set_velocity(car, [15.0, 0.0, 0.0]).unwrap();
        (0..20).for_each(|_| world.step(TICK_NANOS));
        15.0 - record(&world, car).speed_mps()
    };
    // m' dv/dt = −D (ratio / r)² · v, beside air and rolling: the difference between two settings.
    let (ratio, radius) = (9.0, 0.34);
    let mass_kg = MASS_KG * 1.04 + 0.04 * ratio * ratio / (radius * radius);
    let rate = (0.12 - 0.02) * ratio * ratio / (radius * radius) / mass_kg;
    let expected = 15.0 * (1.0 - f64::exp(-rate));
    let measured = slowed(0.12) - slowed(0.02);
    assert!(
        (measured / expected - 1.0).abs() < 0.05,
        "{measured} m/s, expected {expected}"
    );
}

#[test]
fn brakes_hand_brake_and_steering_follow_their_data() {
    let stop_m = |change: fn(&mut VehiclePhysics), control: VehicleControl| {
        let (mut world, car) = standing("vehicle.tesla.model3");
        set(&mut world, car, change);
        world.set_velocity(car, [15.0, 0.0, 0.0]).unwrap();
        world.set_control(car, control).unwrap();
        (0..400).for_each(|_| world.step(TICK_NANOS));
        record(&world, car).world_from_actor.translation_m[0]
    };
    let foot = VehicleControl {
        brake_ratio: 0.5,
        ..Default::default()
    };
    let (usual, weak) = (
        stop_m(|_| {}, foot),
        stop_m(
            |p| {
                p.wheels
                    .iter_mut()
                    .for_each(|wheel| wheel.max_brake_nm *= 0.5)
            },
            foot,
        ),
    );
    assert!(weak > 1.6 * usual && weak < 2.1 * usual, "{usual} {weak}");
    let hand = VehicleControl {
        hand_brake: true,
        ..Default::default()
    };
    let (usual, weak) = (
        stop_m(|_| {}, hand),
        stop_m(
            |p| {
                p.wheels
                    .iter_mut()
                    .for_each(|wheel| wheel.max_hand_brake_nm *= 0.25)
            },
            hand,
        ),
    );
    assert!(weak > 1.6 * usual, "{usual} {weak}");
    let angle = |change: fn(&mut VehiclePhysics), speed_mps: f64| {
        let (mut world, car) = standing("vehicle.tesla.model3");
        set(&mut world, car, change);
        act(
            &mut world,
            car,
            PhysicsAction::HoldVelocity {
                velocity_in_vehicle_mps: Some([speed_mps, 0.0, 0.0]),
            },
        );
        world
            .set_control(
                car,
                VehicleControl {
                    steer_ratio: 0.1,
                    ..Default::default()
                },
            )
            .unwrap();
        (0..20).for_each(|_| world.step(TICK_NANOS));
        record(&world, car).vehicle().unwrap().wheel_steer_rad
    };
    let lock = 70f32.to_radians();
    assert!((angle(|_| {}, 0.1) - 0.1 * lock).abs() < 0.002);
    assert!(
        (angle(|_| {}, 33.4) - 0.05 * lock).abs() < 0.002,
        "the steering curve halves it at 120 km/h"
    );
    assert!(
        (angle(
            |p| p
                .wheels
                .iter_mut()
                .for_each(|wheel| wheel.max_steer_rad *= 0.5),
            0.1
        ) - 0.05 * lock)
            .abs()
            < 0.002
    );
    assert!((angle(|p| p.steering_curve = vec![[0.0, 0.2]], 20.0) - 0.02 * lock).abs() < 0.002);
}

#[test]
fn tyre_stiffness_changes_slip_and_the_centre_of_mass_changes_loads() {
    let telemetry = |change: fn(&mut VehiclePhysics)| {
        let (mut world, car) = standing("vehicle.tesla.model3");
        set(&mut world, car, change);
        world.set_velocity(car, [15.0, 0.0, 0.0]).unwrap();
        world
            .set_control(
                car,
                VehicleControl {
                    steer_ratio: 0.03,
                    ..Default::default()
                },
            )
            .unwrap();
        (0..40).for_each(|_| world.step(TICK_NANOS));
        match act(&mut world, car, PhysicsAction::GetTelemetry) {
            Some(PhysicsAnswer::Telemetry(telemetry)) => telemetry,
            answer => panic!("{answer:?}"),
        }
    };
    let usual = telemetry(|_| {});
    let soft = telemetry(|p| {
        p.wheels
            .iter_mut()
            .for_each(|wheel| wheel.lat_stiffness_per_rad *= 0.5)
    });
    let slip = |t: &schema_frames::VehicleTelemetry| {
        t.wheels[2].lat_slip_rad.abs() / t.wheels[2].lat_n.abs()
    };
    assert!(
        (slip(&soft) / slip(&usual) - 2.0).abs() < 0.2,
        "{} {}",
        slip(&soft),
        slip(&usual)
    );
    let load: f32 = usual.wheels.iter().map(|wheel| wheel.load_n).sum();
    assert!(
        (f64::from(load) / (MASS_KG * 9.81) - 1.0).abs() < 0.01,
        "{load} N"
    );
    assert!(
        (usual.speed_mps - 15.0).abs() < 1.0
            && usual.engine_rpm > 3000.0
            && usual.gear == 1
            && usual.drag_n > 50.0
    );
    let back = telemetry(|p| p.center_of_mass_m[0] = -0.5);
    let rear = |t: &schema_frames::VehicleTelemetry| {
        (t.wheels[2].load_n + t.wheels[3].load_n) / t.wheels.iter().map(|w| w.load_n).sum::<f32>()
    };
    assert!(
        (rear(&back) - (0.5 + 0.5 / 2.875)).abs() < 0.03,
        "{}",
        rear(&back)
    );
}

#[test]
fn ackermann_control_holds_speed_angle_and_limits() {
    for (type_id, target_mps) in [
        ("vehicle.tesla.model3", 8.0),
        ("vehicle.lincoln.mkz_2020", 8.0),
        ("vehicle.mercedes.sprinter", 15.0),
        ("vehicle.tesla.model3", -4.0),
    ] {
        let (mut world, car) = standing(type_id);
        let control = AckermannControl {
            speed_mps: target_mps,
            ..Default::default()
        };
        act(&mut world, car, PhysicsAction::ControlAckermann { control });
        (0..600).for_each(|_| world.step(TICK_NANOS));
        for _ in 0..100 {
            world.step(TICK_NANOS);
            let speed =
                f64::from(target_mps.signum()) * record(&world, car).velocity_in_world_mps[0];
            assert!(
                (speed / f64::from(target_mps.abs()) - 1.0).abs() < 0.05,
                "{type_id}: {speed} m/s for {target_mps}"
            );
        }
        let control = AckermannControl {
            speed_mps: 0.0,
            ..Default::default()
        };
        act(&mut world, car, PhysicsAction::ControlAckermann { control });
        (0..300).for_each(|_| world.step(TICK_NANOS));
        assert!(
            record(&world, car).speed_mps() < 0.01,
            "{type_id} stands again"
        );
    }
    let (mut world, car) = standing("vehicle.tesla.model3");
    let control = AckermannControl {
        steer_rad: 0.4,
        steer_rate_radps: 0.2,
        speed_mps: 5.0,
        acceleration_mps2: 0.5,
        jerk_mps3: 0.0,
    };
    act(&mut world, car, PhysicsAction::ControlAckermann { control });
    let mut fastest: f64 = 0.0;
    for tick in 1..=100 {
        world.step(TICK_NANOS);
        let part = record(&world, car).vehicle().unwrap();
        let expected = (0.2 * 0.05 * tick as f32).min(0.4);
        assert!(
            (part.wheel_steer_rad - expected).abs() < 0.03,
            "tick {tick}: {} rad",
            part.wheel_steer_rad
        );
        fastest = fastest.max(record(&world, car).speed_mps());
    }
    assert!(
        fastest < 5.0 * 0.5 * 1.25 + 0.3,
        "{fastest} m/s after 5 s at 0.5 m/s²"
    );
    // Any plain control ends the Ackermann control.
    world
        .set_control(
            car,
            VehicleControl {
                brake_ratio: 1.0,
                ..Default::default()
            },
        )
        .unwrap();
    (0..60).for_each(|_| world.step(TICK_NANOS));
    assert!(record(&world, car).speed_mps() < 0.01);
}

#[test]
fn a_friction_area_lengthens_braking_and_only_inside() {
    let stop_m = |friction: Option<&str>| {
        let (mut world, car) = standing("vehicle.tesla.model3");
        if let Some(friction) = friction {
            let attributes = [
                ("friction", friction),
                ("extent_x", "50000"),
                ("extent_y", "1000"),
                ("extent_z", "200"),
            ];
            let attributes = attributes
                .map(|(name, value)| (name.to_owned(), value.to_owned()))
                .into();
            world
                .spawn(
                    "static.trigger.friction",
                    Pose::from_xyz_yaw(510.0, 0.0, 0.0, 0.0),
                    None,
                    "",
                    &attributes,
                )
                .unwrap();
        }
        world.set_velocity(car, [15.0, 0.0, 0.0]).unwrap();
        (0..20).for_each(|_| world.step(TICK_NANOS));
        let start = record(&world, car).world_from_actor.translation_m[0];
        world
            .set_control(
                car,
                VehicleControl {
                    brake_ratio: 1.0,
                    ..Default::default()
                },
            )
            .unwrap();
        (0..300).for_each(|_| world.step(TICK_NANOS));
        record(&world, car).world_from_actor.translation_m[0] - start
    };
    let (usual, icy) = (stop_m(None), stop_m(Some("0.3")));
    assert!(
        (icy / usual - 1.0 / 0.3).abs() < 0.35,
        "{usual} m, {icy} m on ice"
    );
    let mut world = standing("vehicle.tesla.model3").0;
    let wrong = [("friction".to_owned(), "slippery".to_owned())].into();
    let error = world
        .spawn("static.trigger.friction", Pose::IDENTITY, None, "", &wrong)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("\"friction\" is \"slippery\", but it must be a number"),
        "{error}"
    );
}

/// A kerb: a ray under the middle of a wheel finds it only when the middle is above it, a whole
/// wheel as soon as it touches.
#[test]
fn swept_wheels_feel_a_kerb_earlier_and_stand_as_high_on_the_level() {
    let first_lift_m = |sweep: bool| {
        let mut map = MapData::flat(200.0);
        let mut step = simd_world::CollisionMesh::default();
        for (x, z) in [(20.0, 0.0), (20.0, 0.1), (60.0, 0.1)] {
            step.vertices_m.extend([[x, -20.0, z], [x, 20.0, z]]);
        }
        step.triangles = vec![[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]];
        map.collision.push(step);
        let mut world = World::new(WorldOptions::default());
        world.load(&map).unwrap();
        let car = world
            .spawn(
                "vehicle.tesla.model3",
                Pose::from_xyz_yaw(10.0, 0.0, 0.05, 0.0),
                None,
                "",
                &BTreeMap::new(),
            )
            .unwrap();
        set(&mut world, car, |p| p.sweep_wheels = sweep);
        (0..60).for_each(|_| world.step(TICK_NANOS));
        assert!(
            record(&world, car).world_from_actor.translation_m[2].abs() < 0.02,
            "stands {:?}",
            record(&world, car).world_from_actor
        );
        act(
            &mut world,
            car,
            PhysicsAction::HoldVelocity {
                velocity_in_vehicle_mps: Some([2.0, 0.0, 0.0]),
            },
        );
        for _ in 0..2000 {
            world.step(5_000_000);
            let at = record(&world, car);
            if at.vehicle().unwrap().wheel_travel_m[0] > 0.02 {
                return at.world_from_actor.translation_m[0] + 0.5 * 2.875;
            }
        }
        panic!("never felt the kerb");
    };
    let (ray, swept) = (first_lift_m(false), first_lift_m(true));
    // A wheel of 0.34 m meets a step of 0.1 m with its middle √(0.34² − 0.24²) = 0.24 m before it.
    assert!(
        (20.0 - ray).abs() < 0.06 && (19.70..19.90).contains(&swept),
        "{ray} {swept}"
    );
}

#[test]
fn shown_wheels_do_not_steer_and_refusals_are_sentences() {
    let (mut world, car) = standing("vehicle.tesla.model3");
    act(
        &mut world,
        car,
        PhysicsAction::ShowWheelSteer {
            wheel: 0,
            steer_rad: 0.5,
        },
    );
    act(
        &mut world,
        car,
        PhysicsAction::ShowWheelRoll {
            wheel: 1,
            roll_rad: 1.0,
        },
    );
    assert!((record(&world, car).vehicle().unwrap().wheel_spin_rad[1] - 1.0).abs() < 1e-6);
    let Some(PhysicsAnswer::Telemetry(told)) = act(&mut world, car, PhysicsAction::GetTelemetry)
    else {
        panic!("no telemetry");
    };
    assert_eq!(
        [told.wheels[0].steer_rad, told.wheels[1].steer_rad],
        [0.5, 0.0]
    );
    world.set_velocity(car, [5.0, 0.0, 0.0]).unwrap();
    (0..20).for_each(|_| world.step(TICK_NANOS));
    assert!(record(&world, car).world_from_actor.translation_m[1].abs() < 0.01);
    assert_eq!(
        refused(
            &mut world,
            car,
            PhysicsAction::ShowWheelSteer {
                wheel: 4,
                steer_rad: 0.0
            }
        ),
        "wheel is 4, but must be 0 to 3"
    );
    let impulse = PhysicsAction::AddImpulse {
        impulse_in_world_ns: [f64::NAN; 3],
        point_in_world_m: None,
    };
    assert!(refused(&mut world, car, impulse.clone()).contains("impulse of actor"));
    let spectator = world.spectator();
    assert!(
        refused(&mut world, spectator, PhysicsAction::GetVehiclePhysics)
            .contains("needs a vehicle")
    );
    assert!(
        refused(&mut world, ActorId(999), PhysicsAction::GetTelemetry)
            .contains("actor 999 not found")
    );
    let mut data = physics(&mut world, car);
    data.wheels.pop();
    let error = refused(
        &mut world,
        car,
        PhysicsAction::SetVehiclePhysics {
            physics: Box::new(data),
        },
    );
    assert_eq!(error, "number of wheels is 3, but must stay 4");
}

#[test]
fn a_car_on_its_roof_says_so() {
    let (mut world, car) = standing("vehicle.tesla.model3");
    let flags = |world: &World| record(world, car).vehicle().unwrap().control_flags >> 8 & 3;
    assert_eq!(flags(&world), 0);
    let upside_down = nalgebra::UnitQuaternion::from_axis_angle(
        &nalgebra::Vector3::x_axis(),
        std::f64::consts::PI,
    );
    world
        .set_pose(
            car,
            nalgebra::Isometry3::from_parts(
                nalgebra::Translation3::new(0.0, 0.0, 2.0),
                upside_down,
            )
            .into(),
        )
        .unwrap();
    (0..60).for_each(|_| world.step(TICK_NANOS));
    assert_eq!(flags(&world), 1);
}
