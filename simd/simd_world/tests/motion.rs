//! How vehicles move, against closed forms of mechanics.

use std::collections::BTreeMap;

use schema_frames::VehicleControl;
use schema_types::{ActorId, Pose};
use simd_world::{MapData, VehicleModel, World, WorldOptions, vehicle_models};

const TICK_NANOS: u64 = 50_000_000;
const TICK_SECS: f64 = 0.05;
const GRAVITY_MPS2: f64 = 9.81;
/// The tyre and air constants of the vehicle model.
const FRICTION: f64 = 1.0;
const ROLLING_RATIO: f64 = 0.012;
const AIR_KGPM3: f64 = 1.2;

fn model(type_id: &str) -> &'static VehicleModel {
    vehicle_models().iter().find(|model| model.type_id == type_id).unwrap()
}

/// A world on level ground with one vehicle that has stood for 3 s.
fn standing(type_id: &str) -> (World, ActorId) {
    let mut world = World::new(WorldOptions::default());
    world.load(&MapData::flat(3000.0)).unwrap();
    let car = world.spawn(type_id, Pose::from_xyz_yaw(0.0, 0.0, 0.1, 0.0), None, "", &BTreeMap::new()).unwrap();
    run(&mut world, 60);
    (world, car)
}

fn run(world: &mut World, n_ticks: usize) {
    (0..n_ticks).for_each(|_| world.step(TICK_NANOS));
}

fn place(world: &World, car: ActorId) -> ([f64; 3], f64, f64) {
    let record = world.record(car).unwrap();
    (record.world_from_actor.translation_m, record.world_from_actor.yaw_rad(), record.speed_mps())
}

fn roll(world: &mut World, car: ActorId, speed_mps: f64) {
    world.set_velocity(car, [speed_mps, 0.0, 0.0]).unwrap();
}

#[test]
fn every_model_rests_at_height_zero_and_does_not_drift_for_20_s() {
    for model in vehicle_models() {
        let (mut world, car) = standing(model.type_id);
        let (start, start_yaw, _) = place(&world, car);
        let mut fastest_mps: f64 = 0.0;
        for _ in 0..400 {
            world.step(TICK_NANOS);
            fastest_mps = fastest_mps.max(place(&world, car).2);
        }
        let (end, end_yaw, _) = place(&world, car);
        let moved_m = (0..3).map(|axis| (end[axis] - start[axis]).powi(2)).sum::<f64>().sqrt();
        let id = model.type_id;
        assert!(end[2].abs() < 0.02, "{id} rests at {} m", end[2]);
        assert!(moved_m < 0.002 && (end_yaw - start_yaw).abs() < 1e-3, "{id} moved {moved_m} m");
        assert!(fastest_mps < 0.002, "{id} jitters at {fastest_mps} m/s");
        let up = world.record(car).unwrap().world_from_actor.isometry().rotation * nalgebra::Vector3::z();
        assert!(up.z > 0.9999, "{id} leans: {up}");
        let part = world.record(car).unwrap().vehicle().unwrap();
        assert_eq!(part.wheels_on_ground, (1 << model.n_wheels()) - 1, "{id}");
    }
}

/// Time from 0 to `target_mps` at full throttle from the torque curve: dt = m dv / F, the best gear at every speed, grip and air counted.
fn ideal_secs(model: &VehicleModel, target_mps: f64) -> f64 {
    let (engine, radius_m) = (&model.engine, model.wheel_radius_m);
    let (dv, mut speed_mps, mut secs) = (0.01, 0.0, 0.0);
    while speed_mps < target_mps {
        let force_in = |gear: i32| {
            let ratio = engine.overall_ratio(gear) as f64;
            let rpm = (speed_mps / radius_m * ratio * 60.0 / std::f64::consts::TAU).max(engine.launch_rpm as f64);
            engine.torque_nm(rpm as f32) as f64 * ratio * engine.efficiency_ratio as f64 / radius_m
        };
        let best_n = (1..=engine.ratios.len() as i32).map(force_in).fold(0.0, f64::max);
        let driven_share = if model.front_driven && model.rear_driven { 1.0 } else { 0.5 };
        let grip_n = FRICTION * model.mass_kg * GRAVITY_MPS2 * driven_share;
        let resist_n = 0.5 * AIR_KGPM3 * model.drag_area_m2 * speed_mps * speed_mps + ROLLING_RATIO * model.mass_kg * GRAVITY_MPS2;
        secs += dv * model.mass_kg / (best_n.min(grip_n) - resist_n);
        speed_mps += dv;
    }
    secs
}

#[test]
fn full_throttle_reaches_100_kmh_in_the_time_the_torque_curve_allows() {
    for type_id in
        ["vehicle.tesla.model3", "vehicle.lincoln.mkz_2020", "vehicle.citroen.c3", "vehicle.mercedes.sprinter", "vehicle.nissan.patrol"]
    {
        let (mut world, car) = standing(type_id);
        world.set_control(car, VehicleControl { throttle_ratio: 1.0, ..Default::default() }).unwrap();
        let mut secs = 0.0;
        while place(&world, car).2 < 100.0 / 3.6 {
            world.step(TICK_NANOS);
            secs += TICK_SECS;
            assert!(secs < 60.0, "{type_id} never gets there: {:?}", place(&world, car));
        }
        let ideal = ideal_secs(model(type_id), 100.0 / 3.6);
        println!("{type_id}: 0-100 km/h in {secs:.2} s, torque-curve integral {ideal:.2} s");
        // Above: shifts cost time and gears are not always the best; below: load moves to driven rear wheels, which then grip better.
        assert!(secs > 0.9 * ideal && secs < 1.35 * ideal + 0.5, "{type_id}: {secs} s, ideal {ideal} s");
        assert!((place(&world, car).0[1]).abs() < 0.5, "{type_id} leaves its line");
    }
}

#[test]
fn full_brake_stops_in_v_squared_over_two_mu_g() {
    for (type_id, speed_mps) in [
        ("vehicle.tesla.model3", 15.0),
        ("vehicle.tesla.model3", 30.0),
        ("vehicle.citroen.c3", 20.0),
        ("vehicle.carlamotors.european_hgv", 20.0),
    ] {
        let (mut world, car) = standing(type_id);
        roll(&mut world, car, speed_mps);
        let start = place(&world, car).0;
        world.set_control(car, VehicleControl { brake_ratio: 1.0, ..Default::default() }).unwrap();
        run(&mut world, 160);
        let (end, _, speed) = place(&world, car);
        let distance_m = end[0] - start[0];
        // Air helps: m v dv/dx = −(µ m g + k v²) gives x = m/2k · ln(1 + k v² / (µ m g)).
        let k = 0.5 * AIR_KGPM3 * model(type_id).drag_area_m2;
        let mu_m_g = FRICTION * model(type_id).mass_kg * GRAVITY_MPS2;
        let expected_m = model(type_id).mass_kg / (2.0 * k) * (1.0 + k * speed_mps * speed_mps / mu_m_g).ln();
        println!("{type_id} from {speed_mps} m/s: {distance_m:.2} m, expected {expected_m:.2} m");
        assert!(speed < 0.002, "{type_id} still moves at {speed} m/s");
        assert!((distance_m / expected_m - 1.0).abs() < 0.05, "{type_id}: {distance_m} m, expected {expected_m} m");
    }
}

#[test]
fn slow_circle_has_the_radius_of_its_steering_angle() {
    for (type_id, steer_ratio) in [("vehicle.tesla.model3", 0.5), ("vehicle.tesla.model3", -0.9), ("vehicle.mitsubishi.fusorosa", 0.6)] {
        let (mut world, car) = standing(type_id);
        let mut control = VehicleControl { steer_ratio, ..Default::default() };
        let mut headings = Vec::new();
        let mut way_m = 0.0;
        for tick in 0..600 {
            let (_, yaw, speed) = place(&world, car);
            control.throttle_ratio = ((3.0 - speed) * 0.3).clamp(0.0, 0.5) as f32;
            world.set_control(car, control).unwrap();
            world.step(TICK_NANOS);
            if tick >= 200 {
                headings.push(
                    (place(&world, car).1 - yaw + 3.0 * std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI,
                );
                way_m += place(&world, car).2 * TICK_SECS;
            }
        }
        let turned_rad: f64 = headings.iter().sum();
        let (base_m, steer_rad) = (model(type_id).wheelbase_m, steer_ratio as f64 * model(type_id).max_steer_rad());
        // The origin lies half a wheelbase before the rear axle, whose centre runs on L / tan δ.
        let rear_m = base_m / steer_rad.tan();
        let expected_m = rear_m.hypot(0.5 * base_m) * steer_rad.signum();
        let radius_m = way_m / turned_rad;
        println!("{type_id} at {steer_rad:.3} rad: radius {radius_m:.2} m, expected {expected_m:.2} m");
        assert!((radius_m / expected_m - 1.0).abs() < 0.05, "{type_id}: {radius_m} m, expected {expected_m} m");
    }
}

#[test]
fn coasting_in_neutral_follows_drag_and_rolling_resistance() {
    for type_id in ["vehicle.tesla.model3", "vehicle.mercedes.sprinter"] {
        let (mut world, car) = standing(type_id);
        world.set_control(car, VehicleControl { manual_gear_shift: true, gear: 0, ..Default::default() }).unwrap();
        run(&mut world, 2);
        roll(&mut world, car, 30.0);
        let kind = model(type_id);
        // m dv/dt = −(a + b v²): v(t) = √(a/b) · tan(atan(v₀ √(b/a)) − √(ab) t / m).
        let a = ROLLING_RATIO * kind.mass_kg * GRAVITY_MPS2;
        let b = 0.5 * AIR_KGPM3 * kind.drag_area_m2;
        for seconds in 1..=20 {
            run(&mut world, 20);
            let expected_mps = (a / b).sqrt() * ((30.0 * (b / a).sqrt()).atan() - (a * b).sqrt() * seconds as f64 / kind.mass_kg).tan();
            let speed_mps = place(&world, car).2;
            assert!((speed_mps / expected_mps - 1.0).abs() < 0.01, "{type_id} after {seconds} s: {speed_mps} m/s, expected {expected_mps}");
        }
    }
}

#[test]
fn parked_car_stays_on_a_slope_of_ten_percent() {
    for yaw in [0.0, 1.0, std::f64::consts::FRAC_PI_2] {
        let mut map = MapData::flat(500.0);
        for corner in &mut map.collision[0].vertices_m {
            corner[2] = 0.1 * corner[0];
        }
        let mut world = World::new(WorldOptions::default());
        world.load(&map).unwrap();
        let tilt = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), -0.1f64.atan());
        let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), yaw);
        let pose = nalgebra::Isometry3::from_parts(nalgebra::Translation3::new(0.0, 0.0, 0.1), tilt * turn);
        let car = world.spawn("vehicle.tesla.model3", pose.into(), None, "", &BTreeMap::new()).unwrap();
        world.set_control(car, VehicleControl { hand_brake: true, ..Default::default() }).unwrap();
        run(&mut world, 100);
        let start = place(&world, car).0;
        run(&mut world, 400);
        let end = place(&world, car).0;
        let moved_m = (0..3).map(|axis| (end[axis] - start[axis]).powi(2)).sum::<f64>().sqrt();
        assert!(moved_m < 0.01, "heading {yaw}: slid {moved_m} m in 20 s");
    }
}

#[test]
fn reverse_drives_backwards_and_full_lock_at_speed_does_not_roll_anything_over() {
    for model in vehicle_models() {
        let (mut world, car) = standing(model.type_id);
        world.set_control(car, VehicleControl { throttle_ratio: 0.5, reverse: true, ..Default::default() }).unwrap();
        run(&mut world, 40);
        assert!(place(&world, car).0[0] < -0.3, "{} does not reverse: {:?}", model.type_id, place(&world, car));
        roll(&mut world, car, 20.0);
        world.set_control(car, VehicleControl { steer_ratio: 1.0, brake_ratio: 0.3, ..Default::default() }).unwrap();
        for _ in 0..120 {
            world.step(TICK_NANOS);
            let up = world.record(car).unwrap().world_from_actor.isometry().rotation * nalgebra::Vector3::z();
            assert!(up.z > 0.9, "{} tips over: {up}", model.type_id);
        }
    }
}

#[test]
fn fast_bend_holds_its_radius_up_to_grip_and_runs_wide_beyond() {
    // Lateral acceleration v²/R against µ g.
    for (speed_mps, steer_rad, holds) in [(8.0, 0.2, true), (10.0, 0.12, true), (12.0, 0.09, true), (14.0, 0.35, false)] {
        let (mut world, car) = standing("vehicle.tesla.model3");
        let kind = model("vehicle.tesla.model3");
        roll(&mut world, car, speed_mps);
        let steer_ratio = (steer_rad / kind.max_steer_rad()) as f32;
        let (mut turned_rad, mut way_m) = (0.0, 0.0);
        for tick in 0..100 {
            let (_, yaw, speed) = place(&world, car);
            let throttle_ratio = ((speed_mps - speed) * 0.5).clamp(0.0, 1.0) as f32;
            world.set_control(car, VehicleControl { steer_ratio, throttle_ratio, ..Default::default() }).unwrap();
            world.step(TICK_NANOS);
            if tick >= 20 {
                turned_rad +=
                    (place(&world, car).1 - yaw + 3.0 * std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
                way_m += place(&world, car).2 * TICK_SECS;
            }
        }
        let (radius_m, expected_m) = (way_m / turned_rad, (kind.wheelbase_m / f64::tan(steer_rad)).hypot(0.5 * kind.wheelbase_m));
        let lateral_g = speed_mps * speed_mps / expected_m / GRAVITY_MPS2;
        println!("{speed_mps} m/s at {steer_rad} rad ({lateral_g:.2} g): radius {radius_m:.1} m, geometric {expected_m:.1} m");
        assert_eq!((radius_m / expected_m - 1.0).abs() < 0.1, holds, "{radius_m} against {expected_m}");
    }
}
