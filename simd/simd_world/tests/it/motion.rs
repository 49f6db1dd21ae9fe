//! Compares the motion of vehicles with closed forms of mechanics.

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
/// Inertia of the wheels as a share of the mass: wheels of 5 % of the mass, at 0.8 r².
const WHEELS_RATIO: f64 = 0.04;

fn model(type_id: &str) -> &'static VehicleModel {
    vehicle_models()
        .iter()
        .find(|model| model.type_id == type_id)
        .unwrap()
}

/// A world on level ground with one vehicle that has stood for 3 s.
fn standing(type_id: &str) -> (World, ActorId) {
    let mut world = World::new(WorldOptions::default());
    world.load(&MapData::flat(3000.0)).unwrap();
    let car = world
        .spawn(
            type_id,
            Pose::from_xyz_yaw(0.0, 0.0, 0.1, 0.0),
            None,
            "",
            &BTreeMap::new(),
        )
        .unwrap();
    run(&mut world, 60);
    (world, car)
}

fn run(world: &mut World, n_ticks: usize) {
    (0..n_ticks).for_each(|_| world.step(TICK_NANOS));
}

fn place(world: &World, car: ActorId) -> ([f64; 3], f64, f64) {
    let record = world.record(car).unwrap();
    (
        record.world_from_actor.translation_m,
        record.world_from_actor.yaw_rad(),
        record.speed_mps(),
    )
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
        let moved_m = (0..3)
            .map(|axis| (end[axis] - start[axis]).powi(2))
            .sum::<f64>()
            .sqrt();
        let id = model.type_id;
        assert!(end[2].abs() < 0.02, "{id} rests at {} m", end[2]);
        assert!(
            moved_m < 0.002 && (end_yaw - start_yaw).abs() < 1e-3,
            "{id} moved {moved_m} m"
        );
        assert!(fastest_mps < 0.002, "{id} jitters at {fastest_mps} m/s");
        let up = world
            .record(car)
            .unwrap()
            .world_from_actor
            .isometry()
            .rotation
            * nalgebra::Vector3::z();
        assert!(up.z > 0.9999, "{id} leans: {up}");
        let part = world.record(car).unwrap().vehicle().unwrap();
        assert_eq!(part.wheels_on_ground, (1 << model.n_wheels()) - 1, "{id}");
    }
}

/// Time from 0 to `target_mps` at full throttle from the torque curve: dt = m dv / F in the gear
/// that accelerates best, with grip, air, rolling resistance and all that has to be spun up.
fn ideal_secs(model: &VehicleModel, target_mps: f64) -> f64 {
    let (engine, radius_m) = (&model.engine, model.wheel_radius_m);
    let curve = |rpm: f64| {
        let points = engine.torque_curve;
        let after = points.iter().position(|(at, _)| f64::from(*at) >= rpm)?;
        let (b, high) = points[after];
        let (a, low) = if after == 0 {
            (b - 1.0, high)
        } else {
            points[after - 1]
        };
        Some(f64::from(low) + f64::from(high - low) * (rpm - f64::from(a)) / f64::from(b - a))
    };
    let driven = if model.front_driven && model.rear_driven {
        1.0
    } else if model.front_driven {
        model.front_load_ratio()
    } else {
        1.0 - model.front_load_ratio()
    };
    let (dv, mut speed_mps, mut secs) = (0.01, 0.0, 0.0);
    while speed_mps < target_mps {
        let resist_n = 0.5 * AIR_KGPM3 * model.drag_area_m2 * speed_mps * speed_mps
            + ROLLING_RATIO * model.mass_kg * GRAVITY_MPS2;
        let accel_in = |ratio: &f32| {
            let overall = f64::from(ratio * engine.final_ratio);
            let geared_rpm = speed_mps / radius_m * overall * 60.0 / std::f64::consts::TAU;
            let slips = geared_rpm < f64::from(engine.launch_rpm);
            let torque_nm = if geared_rpm > f64::from(engine.max_rpm) {
                0.0
            } else {
                curve(geared_rpm.max(engine.launch_rpm.into())).unwrap_or(0.0)
            };
            let force_n = torque_nm * overall * f64::from(engine.efficiency_ratio) / radius_m;
            // Grip of the driven wheels, with the load that acceleration moves to or from them.
            let height = model.mass_height_m() / model.wheelbase_m
                * if model.rear_driven { 1.0 } else { -1.0 };
            let shift = if driven == 1.0 {
                1.0
            } else {
                driven / (1.0 - FRICTION * height)
            };
            let grip_n = FRICTION * model.mass_kg * GRAVITY_MPS2 * shift.min(1.0);
            let spun_kg = if slips {
                0.0
            } else {
                f64::from(engine.inertia_kgm2) * overall * overall / (radius_m * radius_m)
            };
            (force_n.min(grip_n) - resist_n) / (model.mass_kg * (1.0 + WHEELS_RATIO) + spun_kg)
        };
        let best = engine.ratios.iter().map(accel_in).fold(0.0, f64::max);
        secs += dv / best;
        speed_mps += dv;
    }
    secs
}

#[test]
fn full_throttle_reaches_100_kmh_in_the_time_the_torque_curve_allows() {
    for type_id in [
        "vehicle.tesla.model3",
        "vehicle.lincoln.mkz_2020",
        "vehicle.citroen.c3",
        "vehicle.mercedes.sprinter",
        "vehicle.nissan.patrol",
        "vehicle.kawasaki.ninja",
    ] {
        let (mut world, car) = standing(type_id);
        world
            .set_control(
                car,
                VehicleControl {
                    throttle_ratio: 1.0,
                    ..Default::default()
                },
            )
            .unwrap();
        let mut secs = 0.0;
        while place(&world, car).2 < 100.0 / 3.6 {
            world.step(TICK_NANOS);
            secs += TICK_SECS;
            assert!(
                secs < 60.0,
                "{type_id} never gets there: {:?}",
                place(&world, car)
            );
        }
        let ideal = ideal_secs(model(type_id), 100.0 / 3.6);
        println!("{type_id}: 0-100 km/h in {secs:.2} s, torque-curve integral {ideal:.2} s");
        // Without a gearbox only the curve counts; shifts cost time, and the chosen gear is not
        // always the best.
        let n_shifts = model(type_id).engine.ratios.len() as f64 - 1.0;
        let most = if n_shifts == 0.0 {
            1.03 * ideal + TICK_SECS
        } else {
            1.15 * ideal + 0.5 + 0.3 * n_shifts
        };
        assert!(
            secs > 0.97 * ideal && secs < most,
            "{type_id}: {secs} s, ideal {ideal} s"
        );
        assert!(
            (place(&world, car).0[1]).abs() < 0.5,
            "{type_id} leaves its line"
        );
    }
}

#[test]
fn full_brake_stops_in_v_squared_over_two_mu_g() {
    for (type_id, speed_mps, friction) in [
        ("vehicle.tesla.model3", 15.0, 1.0),
        ("vehicle.tesla.model3", 30.0, 1.0),
        ("vehicle.tesla.model3", 20.0, 0.3),
        ("vehicle.citroen.c3", 20.0, 1.0),
        ("vehicle.carlamotors.european_hgv", 20.0, 1.0),
    ] {
        let (mut world, car) = standing(type_id);
        let mut physics = world.vehicle_physics(car).unwrap().clone();
        physics
            .wheels
            .iter_mut()
            .for_each(|wheel| wheel.friction = friction);
        world.set_vehicle_physics(car, &physics).unwrap();
        run(&mut world, 10);
        roll(&mut world, car, speed_mps);
        let start = place(&world, car).0;
        world
            .set_control(
                car,
                VehicleControl {
                    brake_ratio: 1.0,
                    ..Default::default()
                },
            )
            .unwrap();
        run(&mut world, 200);
        let (end, _, speed) = place(&world, car);
        let distance_m = end[0] - start[0];
        // Air drag helps: m v dv/dx = −(µ m g + k v²) gives x = m/2k · ln(1 + k v² / (µ m g)).
        let k = 0.5 * AIR_KGPM3 * model(type_id).drag_area_m2;
        let mu_m_g = f64::from(friction) * model(type_id).mass_kg * GRAVITY_MPS2;
        let expected_m =
            model(type_id).mass_kg / (2.0 * k) * (1.0 + k * speed_mps * speed_mps / mu_m_g).ln();
        println!(
            "{type_id} from {speed_mps} m/s at {friction}: {distance_m:.2} m, expected {expected_m:.2} m"
        );
        assert!(speed < 0.002, "{type_id} still moves at {speed} m/s");
        assert!(
            (distance_m / expected_m - 1.0).abs() < 0.05,
            "{type_id}: {distance_m} m, expected {expected_m} m"
        );
    }
}

/// Drives a bend at a held speed; returns the radius of the origin's path, the lateral acceleration
/// and the mean angle of the front wheels.
fn bend(world: &mut World, car: ActorId, speed_mps: f64, steer_rad: f64) -> (f64, f64, f64) {
    roll(world, car, speed_mps);
    let (mut turned_rad, mut way_m, mut steered_rad) = (0.0, 0.0, 0.0);
    let (n_ticks, n_first) = (240, 120);
    for tick in 0..n_ticks {
        let (_, yaw, speed) = place(world, car);
        let part = world.record(car).unwrap().vehicle().unwrap();
        // The available share of full lock falls with speed, so the shown angle of the wheels is
        // used.
        let steer_ratio =
            (part.steer_ratio + 0.3 * (steer_rad as f32 - part.wheel_steer_rad)).clamp(-1.0, 1.0);
        let throttle_ratio = ((speed_mps - speed) * 0.8 + 0.1).clamp(0.0, 1.0) as f32;
        world
            .set_control(
                car,
                VehicleControl {
                    steer_ratio,
                    throttle_ratio,
                    ..Default::default()
                },
            )
            .unwrap();
        world.step(TICK_NANOS);
        if tick >= n_first {
            turned_rad += (place(world, car).1 - yaw + 3.0 * std::f64::consts::PI)
                .rem_euclid(std::f64::consts::TAU)
                - std::f64::consts::PI;
            way_m += place(world, car).2 * TICK_SECS;
            steered_rad += f64::from(part.wheel_steer_rad) / f64::from(n_ticks - n_first);
        }
    }
    let speed = way_m / (TICK_SECS * f64::from(n_ticks - n_first));
    (
        way_m / turned_rad,
        speed * turned_rad / (TICK_SECS * f64::from(n_ticks - n_first)),
        steered_rad,
    )
}

#[test]
fn slow_bends_have_the_radius_of_ackermann() {
    for (type_id, steer_rad) in [
        ("vehicle.tesla.model3", 0.05),
        ("vehicle.tesla.model3", 0.2),
        ("vehicle.tesla.model3", -0.4),
        ("vehicle.citroen.c3", 0.3),
        ("vehicle.carlamotors.carlacola", 0.3),
    ] {
        let (mut world, car) = standing(type_id);
        let (radius_m, _, steered_rad) = bend(&mut world, car, 2.0, steer_rad);
        let base_m = model(type_id).wheelbase_m;
        // The rear axle's path has the radius base / tan(angle); that of the origin between the
        // axles is a little larger.
        let expected_m = (base_m / steered_rad.tan()).hypot(0.5 * base_m) * steered_rad.signum();
        println!(
            "{type_id} at {steered_rad:.3} rad: radius {radius_m:.2} m, expected {expected_m:.2} m"
        );
        assert!(
            (radius_m / expected_m - 1.0).abs() < 0.03,
            "{type_id}: {radius_m} m, expected {expected_m} m"
        );
    }
}

/// Steady cornering of the bicycle model: δ = L / R + (Wf / Cf − Wr / Cr) · a / g, with the
/// cornering stiffness C of each axle.
#[test]
fn fast_bends_understeer_as_the_tyres_say() {
    for (type_id, speed_mps, steer_rad) in [
        ("vehicle.tesla.model3", 15.0, 0.05),
        ("vehicle.tesla.model3", 20.0, 0.03),
        ("vehicle.mini.cooper_s", 12.0, 0.06),
    ] {
        let (mut world, car) = standing(type_id);
        let (radius_m, lateral_mps2, steered_rad) = bend(&mut world, car, speed_mps, steer_rad);
        let physics = world.vehicle_physics(car).unwrap().clone();
        // Stiffness over load: per radian, saturating with load as (1 − (1 − load / limit)³) at the
        // load at rest.
        let over_load = |wheel: usize| {
            let wheel = &physics.wheels[wheel];
            f64::from(wheel.lat_stiffness_per_rad)
                * (1.0 - (1.0 - 1.0 / f64::from(wheel.lat_load_limit)).powi(3))
        };
        let gradient = 1.0 / over_load(0) - 1.0 / over_load(2);
        let base_m = model(type_id).wheelbase_m;
        let expected_m = base_m / (steered_rad - gradient * lateral_mps2 / GRAVITY_MPS2);
        println!(
            "{type_id} at {speed_mps} m/s, {steered_rad:.4} rad, {:.2} g: radius {radius_m:.1} m, expected {expected_m:.1} m, geometric {:.1} m",
            lateral_mps2 / GRAVITY_MPS2,
            base_m / steered_rad
        );
        assert!(
            (radius_m / expected_m - 1.0).abs() < 0.05,
            "{type_id}: {radius_m} m, expected {expected_m} m"
        );
    }
}

#[test]
fn no_bend_has_more_than_grip() {
    let (mut world, car) = standing("vehicle.tesla.model3");
    // By geometry alone, 14 m/s at 0.35 rad would be 2.5 g.
    let (radius_m, lateral_mps2, _) = bend(&mut world, car, 14.0, 0.35);
    println!(
        "radius {radius_m:.1} m at {:.2} g",
        lateral_mps2 / GRAVITY_MPS2
    );
    assert!(
        (0.8..1.02).contains(&(lateral_mps2 / (FRICTION * GRAVITY_MPS2))),
        "{radius_m} m, {lateral_mps2} m/s²"
    );
}

#[test]
fn two_wheelers_lean_as_the_bend_needs() {
    for type_id in [
        "vehicle.kawasaki.ninja",
        "vehicle.harley-davidson.low_rider",
        "vehicle.bh.crossbike",
    ] {
        for (speed_mps, steer_rad) in [(5.0, 0.08), (8.0, -0.05), (6.0, 0.1)] {
            let (mut world, bike) = standing(type_id);
            let (radius_m, lateral_mps2, _) = bend(&mut world, bike, speed_mps, steer_rad);
            let left = world
                .record(bike)
                .unwrap()
                .world_from_actor
                .isometry()
                .rotation
                * nalgebra::Vector3::y();
            let (lean_rad, expected_rad) = (-left.z.asin(), (lateral_mps2 / GRAVITY_MPS2).atan());
            println!(
                "{type_id} at {speed_mps} m/s on {radius_m:.1} m: leans {:.1}°, expected {:.1}°",
                lean_rad.to_degrees(),
                expected_rad.to_degrees()
            );
            assert!(
                (lean_rad - expected_rad).abs() < 0.02,
                "{type_id}: {lean_rad} rad, expected {expected_rad} rad"
            );
            assert!(expected_rad.abs() > 0.08 && expected_rad * steer_rad > 0.0);
        }
    }
}

#[test]
fn coasting_in_neutral_follows_drag_and_rolling_resistance() {
    for type_id in ["vehicle.tesla.model3", "vehicle.mercedes.sprinter"] {
        let (mut world, car) = standing(type_id);
        world
            .set_control(
                car,
                VehicleControl {
                    manual_gear_shift: true,
                    gear: 0,
                    ..Default::default()
                },
            )
            .unwrap();
        run(&mut world, 2);
        roll(&mut world, car, 30.0);
        let kind = model(type_id);
        // m' dv/dt = −(a + b v²): v(t) = √(a/b) · tan(atan(v₀ √(b/a)) − √(ab) t / m').
        let a = ROLLING_RATIO * kind.mass_kg * GRAVITY_MPS2;
        let b = 0.5 * AIR_KGPM3 * kind.drag_area_m2;
        let mass_kg = kind.mass_kg * (1.0 + WHEELS_RATIO);
        for seconds in 1..=20 {
            run(&mut world, 20);
            let expected_mps = (a / b).sqrt()
                * ((30.0 * (b / a).sqrt()).atan() - (a * b).sqrt() * seconds as f64 / mass_kg)
                    .tan();
            let speed_mps = place(&world, car).2;
            assert!(
                (speed_mps / expected_mps - 1.0).abs() < 0.01,
                "{type_id} after {seconds} s: {speed_mps} m/s, expected {expected_mps}"
            );
        }
    }
}

#[test]
fn without_friction_and_drag_the_speed_stays() {
    for model in vehicle_models() {
        let (mut world, car) = standing(model.type_id);
        let mut physics = world.vehicle_physics(car).unwrap().clone();
        physics.drag_coefficient = 0.0;
        physics
            .wheels
            .iter_mut()
            .for_each(|wheel| (wheel.friction, wheel.damping_nms) = (0.0, 0.0));
        world.set_vehicle_physics(car, &physics).unwrap();
        roll(&mut world, car, 20.0);
        for _ in 0..100 {
            let before_mps = place(&world, car).2;
            world.step(TICK_NANOS);
            let after_mps = place(&world, car).2;
            assert!(
                (after_mps - before_mps).abs() < 1e-3,
                "{}: {before_mps} to {after_mps} m/s",
                model.type_id
            );
        }
        assert!(
            (place(&world, car).2 - 20.0).abs() < 0.01,
            "{}: {}",
            model.type_id,
            place(&world, car).2
        );
    }
}

/// A world whose ground rises along x with this slope.
fn slope(rise: f64, type_id: &str, yaw: f64) -> (World, ActorId) {
    let mut map = MapData::flat(500.0);
    for corner in &mut map.collision[0].vertices_m {
        corner[2] = rise as f32 * corner[0];
    }
    let mut world = World::new(WorldOptions::default());
    world.load(&map).unwrap();
    let tilt =
        nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), -rise.atan());
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), yaw);
    let pose =
        nalgebra::Isometry3::from_parts(nalgebra::Translation3::new(0.0, 0.0, 0.1), tilt * turn);
    let car = world
        .spawn(type_id, pose.into(), None, "", &BTreeMap::new())
        .unwrap();
    (world, car)
}

#[test]
fn hand_brake_holds_every_model_on_a_slope_of_fifteen_percent() {
    for model in vehicle_models() {
        for yaw in [0.0, 1.0, std::f64::consts::FRAC_PI_2, std::f64::consts::PI] {
            let (mut world, car) = slope(0.15, model.type_id, yaw);
            world
                .set_control(
                    car,
                    VehicleControl {
                        hand_brake: true,
                        ..Default::default()
                    },
                )
                .unwrap();
            run(&mut world, 100);
            let start = place(&world, car).0;
            let mut fastest_mps: f64 = 0.0;
            for _ in 0..400 {
                world.step(TICK_NANOS);
                fastest_mps = fastest_mps.max(place(&world, car).2);
            }
            let end = place(&world, car).0;
            let moved_m = (0..3)
                .map(|axis| (end[axis] - start[axis]).powi(2))
                .sum::<f64>()
                .sqrt();
            assert!(
                moved_m < 0.003 && fastest_mps < 0.003,
                "{} at {yaw}: {moved_m} m in 20 s, up to {fastest_mps} m/s",
                model.type_id
            );
        }
    }
}

#[test]
fn without_brakes_a_car_rolls_down_as_gravity_says() {
    let (mut world, car) = slope(0.15, "vehicle.tesla.model3", 0.0);
    world
        .set_control(
            car,
            VehicleControl {
                manual_gear_shift: true,
                gear: 0,
                hand_brake: true,
                ..Default::default()
            },
        )
        .unwrap();
    run(&mut world, 60);
    world
        .set_control(
            car,
            VehicleControl {
                manual_gear_shift: true,
                gear: 0,
                ..Default::default()
            },
        )
        .unwrap();
    run(&mut world, 40);
    let angle = 0.15f64.atan();
    let expected_mps =
        2.0 * GRAVITY_MPS2 * (angle.sin() - ROLLING_RATIO * angle.cos()) / (1.0 + WHEELS_RATIO);
    let speed_mps = place(&world, car).2;
    assert!(
        (speed_mps / expected_mps - 1.0).abs() < 0.03,
        "{speed_mps} m/s, expected {expected_mps}"
    );
}

/// CARLA's Traffic Manager is tuned to these limits: its throttle is at most 0.85, its brake 0.7.
#[test]
fn cars_answer_to_pedals_as_the_traffic_manager_expects() {
    for model in vehicle_models()
        .iter()
        .filter(|model| model.base_type == "car")
    {
        let (mut world, car) = standing(model.type_id);
        world
            .set_control(
                car,
                VehicleControl {
                    throttle_ratio: 0.85,
                    ..Default::default()
                },
            )
            .unwrap();
        run(&mut world, 40);
        let speed_mps = place(&world, car).2;
        world
            .set_control(
                car,
                VehicleControl {
                    throttle_ratio: 0.0,
                    ..Default::default()
                },
            )
            .unwrap();
        roll(&mut world, car, 14.0);
        world
            .set_control(
                car,
                VehicleControl {
                    brake_ratio: 0.7,
                    ..Default::default()
                },
            )
            .unwrap();
        run(&mut world, 20);
        let brake_mps2 = 14.0 - place(&world, car).2;
        println!(
            "{}: {:.2} m/s² at throttle 0.85, {brake_mps2:.2} m/s² at brake 0.7",
            model.type_id,
            speed_mps / 2.0
        );
        assert!(
            (2.2..4.6).contains(&(speed_mps / 2.0)),
            "{}: {} m/s after 2 s",
            model.type_id,
            speed_mps
        );
        assert!(
            (6.0..8.3).contains(&brake_mps2),
            "{}: {brake_mps2} m/s²",
            model.type_id
        );
        assert!((model.max_steer_rad().to_degrees() - 70.0).abs() < 1e-9);
    }
}

#[test]
fn reverse_drives_backwards_and_full_lock_at_speed_does_not_roll_anything_over() {
    for model in vehicle_models() {
        let (mut world, car) = standing(model.type_id);
        world
            .set_control(
                car,
                VehicleControl {
                    throttle_ratio: 0.5,
                    reverse: true,
                    ..Default::default()
                },
            )
            .unwrap();
        run(&mut world, 40);
        assert!(
            place(&world, car).0[0] < -0.3,
            "{} does not reverse: {:?}",
            model.type_id,
            place(&world, car)
        );
        roll(&mut world, car, 20.0);
        world
            .set_control(
                car,
                VehicleControl {
                    steer_ratio: 1.0,
                    brake_ratio: 0.3,
                    ..Default::default()
                },
            )
            .unwrap();
        for _ in 0..120 {
            world.step(TICK_NANOS);
            let up = world
                .record(car)
                .unwrap()
                .world_from_actor
                .isometry()
                .rotation
                * nalgebra::Vector3::z();
            let least = if model.is_two_wheeler() { 0.6 } else { 0.9 };
            assert!(up.z > least, "{} tips over: {up}", model.type_id);
        }
    }
}
