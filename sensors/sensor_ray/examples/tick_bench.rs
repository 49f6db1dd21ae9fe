//! CPU time for lidars in a tick before rays are cast: placing people of twelve parts and cars of
//! five, and uploading them to the GPU; and what the hierarchy over them costs the rays.
//!
//! `cargo run --release -p sensor_ray --example tick_bench [PEOPLE] [CARS] [TICKS] [--json FILE]`
//! prints CPU time of this thread, best and median.

use std::process::ExitCode;

use launch_cli::bench::{self, BenchResult, Samples, anyhow, clap, thread_cpu_secs};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use schema_types::noise::Noise;
use schema_types::{ActorId, Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{
    DynamicInstance, Material, Mesh, MeshBuilder, MeshId, Past, SceneAssets, StaticInstance,
};
use sensor_gpu::{Gpu, GpuOptions};
use sensor_ray::lidar::{Lidar, SensorPath};
use sensor_ray::{GpuRayOptions, GpuRays, RayScene};
use sensor_spec::LidarSpec;

/// Middles of a person's parts over the ground and half their sides, metres: hips, chest, head,
/// then limb by limb.
const PARTS: [([f64; 3], [f32; 3]); 12] = [
    ([0.0, 0.0, 0.95], [0.12, 0.17, 0.12]),
    ([0.0, 0.0, 1.3], [0.13, 0.2, 0.25]),
    ([0.0, 0.0, 1.65], [0.1, 0.09, 0.13]),
    ([0.0, 0.25, 1.3], [0.05, 0.05, 0.16]),
    ([0.0, 0.27, 1.0], [0.04, 0.04, 0.16]),
    ([0.0, -0.25, 1.3], [0.05, 0.05, 0.16]),
    ([0.0, -0.27, 1.0], [0.04, 0.04, 0.16]),
    ([0.0, 0.1, 0.65], [0.08, 0.08, 0.22]),
    ([0.0, 0.1, 0.25], [0.06, 0.06, 0.22]),
    ([0.0, -0.1, 0.65], [0.08, 0.08, 0.22]),
    ([0.0, -0.1, 0.25], [0.06, 0.06, 0.22]),
    ([0.06, 0.0, 0.03], [0.14, 0.14, 0.03]),
];

/// Times what a tick asks of lidars before rays are cast
#[derive(Debug, clap::Args)]
struct Args {
    #[arg(default_value_t = 40)]
    people: usize,
    #[arg(default_value_t = 21)]
    cars: usize,
    #[arg(default_value_t = 200)]
    ticks: usize,
}

fn main() -> ExitCode {
    bench::run("tick_bench", measure)
}

fn measure(args: &Args, result: &mut BenchResult) -> anyhow::Result<()> {
    let (n_people, n_cars, n_ticks) = (args.people, args.cars, args.ticks);
    let assets = place();
    let mut scene = RayScene::load_for_gpu(&assets);
    let gpu = Gpu::open(&GpuOptions::default())?;
    result.set_gpu(gpu.name());
    let mut rays = GpuRays::new(&gpu, GpuRayOptions::default());
    let (mut placed, mut told, mut for_cpu) = (Vec::new(), Vec::new(), Vec::new());
    for tick in 0..n_ticks {
        let instances = crowd(n_people, n_cars, tick as f64 * 0.05);
        placed.push(micros(|| {
            scene.update_for_gpu(&instances, &Past::default())
        }));
        let _ = rays.update(&scene);
        let later = crowd(n_people, n_cars, (tick as f64 + 0.5) * 0.05);
        scene.update_for_gpu(&later, &Past::default());
        told.push(micros(|| {
            assert!(format!("{:?}", rays.update(&scene)).len() > 1)
        }));
        for_cpu.push(micros(|| scene.update(&instances)));
    }
    let n = crowd(n_people, n_cars, 0.0).len();
    for (what, times) in [
        ("place", placed),
        ("tell the GPU", told),
        ("for the processor's rays", for_cpu),
    ] {
        let times: Samples = times.into_iter().collect();
        println!(
            "sensor_ray/tick/{what}: {n} parts, best {:.0} µs, median {:.0} µs",
            times.best(),
            times.median()
        );
        result.row(
            what,
            &[
                ("n_parts", n as f64),
                ("best_us", times.best()),
                ("median_us", times.median()),
            ],
        );
    }
    let mut lidar = Lidar::new(LidarSpec::default());
    let path = SensorPath::still(Isometry3::translation(0.0, 0.0, 1.8));
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let turns = one.install(|| {
        Samples::of(25, || {
            micros(|| assert!(lidar.scan(&scene, &path, Noise::new(1, 2, 3), None) > 1000))
        })
    });
    println!(
        "sensor_ray/tick/turn: 64x2000 rays, one thread, best {:.0} µs, median {:.0} µs",
        turns.best(),
        turns.median()
    );
    result.row(
        "turn",
        &[("best_us", turns.best()), ("median_us", turns.median())],
    );
    Ok(())
}

/// CPU time of this thread.
fn micros(work: impl FnOnce()) -> f64 {
    let started = thread_cpu_secs();
    work();
    (thread_cpu_secs() - started) * 1e6
}

fn body(class: Class, half_m: [f32; 3]) -> Mesh {
    let mut builder = MeshBuilder::new("part");
    for k in 0..8 {
        let lift = half_m[2] * (2.0 * k as f32 + 1.0) / 8.0 - half_m[2];
        builder.cuboid(
            Surface::new(class, Material::Matte, [128; 3]),
            [0.0, 0.0, lift],
            [half_m[0], half_m[1], half_m[2] / 8.0],
        );
    }
    builder.finish()
}

/// A square with a wall; parts of people, then a car's body and a wheel.
fn place() -> SceneAssets {
    let mut assets = SceneAssets::default();
    let mut builder = MeshBuilder::new("square");
    let ground = Surface::new(Class::ROADS, Material::Asphalt, [90; 3]);
    for (x, y) in (-20..20).flat_map(|x| (-20..20).map(move |y| (x as f32 * 5.0, y as f32 * 5.0))) {
        builder.quad(
            ground,
            [
                [x, y, 0.0],
                [x + 5.0, y, 0.0],
                [x + 5.0, y + 5.0, 0.0],
                [x, y + 5.0, 0.0],
            ],
            [[0.0; 2]; 4],
        );
    }
    let mesh = assets.add_mesh(builder.finish());
    assets.statics.push(StaticInstance {
        mesh,
        world_from_mesh: Isometry3::identity(),
        object: ObjectId::scenery(1),
    });
    for (_, half_m) in PARTS {
        assets.add_mesh(body(Class::PEDESTRIANS, half_m));
    }
    assets.add_mesh(body(Class::CAR, [2.3, 0.9, 0.6]));
    assets.add_mesh(body(Class::CAR, [0.33, 0.12, 0.33]));
    assets
}

/// Everybody walks and drives in circles.
fn crowd(n_people: usize, n_cars: usize, secs: f64) -> Vec<DynamicInstance> {
    let mut instances = Vec::new();
    let mut add = |actor: usize, part: usize, mesh: usize, world_from_mesh: Isometry3<f64>| {
        instances.push(DynamicInstance {
            actor: ActorId(actor as u32 + 1),
            part: part as u16,
            mesh: MeshId(mesh as u32),
            world_from_mesh,
            tint_rgb: [0; 3],
            lamps: 0,
            velocity_in_world_mps: Vector3::zeros(),
        });
    };
    let on_circle = |i: usize, n: usize, radius_m: f64, speed_mps: f64| {
        let angle = i as f64 * 2.399 + speed_mps / radius_m * secs;
        let reach = radius_m * (0.2 + 0.8 * (i as f64 / n as f64).sqrt());
        Isometry3::new(
            Vector3::new(reach * angle.cos(), reach * angle.sin(), 0.0),
            Vector3::z() * (angle + 1.57),
        )
    };
    for i in 0..n_people {
        let world_from_person = on_circle(i, n_people, 40.0, 1.4);
        for (part, (middle, _)) in PARTS.into_iter().enumerate() {
            let swing = 0.5 * (secs * 6.0 + i as f64 + part as f64).sin() * (part > 2) as u8 as f64;
            let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), swing);
            let at = Point3::from(middle) + Vector3::x() * (0.2 * swing);
            add(
                i,
                part,
                1 + part,
                world_from_person * Isometry3::from_parts(at.into(), turn),
            );
        }
    }
    for i in 0..n_cars {
        let world_from_car = on_circle(i, n_cars, 90.0, 10.0);
        add(
            n_people + i,
            0,
            1 + PARTS.len(),
            world_from_car * Isometry3::translation(0.0, 0.0, 0.75),
        );
        for (wheel, (x, y)) in [(1.4, 0.8), (1.4, -0.8), (-1.4, 0.8), (-1.4, -0.8)]
            .into_iter()
            .enumerate()
        {
            add(
                n_people + i,
                1 + wheel,
                2 + PARTS.len(),
                world_from_car * Isometry3::translation(x, y, 0.33),
            );
        }
    }
    instances
}
