//! Time of one lidar turn (64 × 2000 rays) in a made-up street of 250 000 triangles with 200 moving
//! cars, which once stand still during the turn and once drive.
//!
//! `cargo run --release -p sensor_ray --example turn_bench [turns] [threads] [--json FILE]` prints
//! CPU time (best and median) and the best wall time.

use std::process::ExitCode;
use std::time::Instant;

use launch_cli::bench::{self, BenchResult, Samples, clap, process_cpu_secs};
use nalgebra::{Isometry3, Vector3};
use schema_types::noise::Noise;
use schema_types::{ActorId, Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{DynamicInstance, Material, MeshBuilder, Past, SceneAssets, StaticInstance};
use sensor_ray::RayScene;
use sensor_ray::lidar::{Lidar, SensorPath};
use sensor_spec::LidarSpec;

/// Time of a turn.
const TURN_NANOS: u64 = 100_000_000;

/// Times a lidar's turn in a street
#[derive(Debug, clap::Args)]
struct Args {
    #[arg(default_value_t = 15)]
    turns: usize,
    #[arg(default_value_t = 1)]
    threads: usize,
}

fn main() -> ExitCode {
    bench::run("turn_bench", |args: &Args, result| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(args.threads)
            .build()?;
        pool.install(|| run(args, result));
        Ok(())
    })
}

fn run(args: &Args, result: &mut BenchResult) {
    let (turns, threads) = (args.turns, args.threads);
    let assets = street();
    let started = process_cpu_secs();
    let mut scene = RayScene::load(&assets);
    let build_ms = (process_cpu_secs() - started) * 1e3;
    println!(
        "sensor_ray/load: {} triangles in {build_ms:.0} ms",
        scene.n_static_triangles()
    );
    result.row("build", &[("ms", build_ms)]);
    let instances = traffic(&assets);
    let millis = measure(turns, || scene.update(&instances));
    println!(
        "sensor_ray/update/{}: best {:.3} ms, median {:.3} ms",
        instances.len(),
        millis.cpu_best,
        millis.cpu_median
    );
    for (name, semantic, motion_distortion, is_moving) in [
        ("plain", false, false, false),
        ("semantic", true, false, false),
        ("distorted", false, true, false),
        ("moving", false, true, true),
    ] {
        if is_moving {
            let past = past(&instances);
            let millis = measure(turns, || scene.update_moving(&instances, &past));
            println!("sensor_ray/update/moving: best {:.3} ms", millis.cpu_best);
        }
        let mut lidar = Lidar::new(LidarSpec {
            semantic,
            motion_distortion,
            ..Default::default()
        });
        lidar.set_past(TURN_NANOS);
        let path = SensorPath {
            world_from_sensor_start: Isometry3::translation(-1.0, 0.0, 2.0),
            world_from_sensor: Isometry3::translation(0.0, 0.0, 2.0),
        };
        let mut n_points = 0;
        let millis = measure(turns, || {
            n_points = lidar.scan(&scene, &path, Noise::new(1, 2, 3), None)
        });
        assert!(n_points > 100_000, "the street returns most rays");
        let Millis {
            cpu_best,
            cpu_median,
            wall_best,
        } = millis;
        println!(
            "sensor_ray/turn/{name}/64x2000/{threads}: CPU best {cpu_best:.1} ms, median {cpu_median:.1} ms, wall best {wall_best:.1} ms, {n_points} points"
        );
        result.row(
            name,
            &[
                ("n_threads", threads as f64),
                ("cpu_best_ms", cpu_best),
                ("cpu_median_ms", cpu_median),
                ("wall_best_ms", wall_best),
            ],
        );
    }
}

/// What a repeated piece of work took.
struct Millis {
    cpu_best: f64,
    cpu_median: f64,
    wall_best: f64,
}

fn measure(turns: usize, mut work: impl FnMut()) -> Millis {
    let mut wall_best = f64::INFINITY;
    let cpu = Samples::of(turns, || {
        let (started, at) = (process_cpu_secs(), Instant::now());
        work();
        wall_best = wall_best.min(at.elapsed().as_secs_f64() * 1e3);
        (process_cpu_secs() - started) * 1e3
    });
    Millis {
        cpu_best: cpu.best(),
        cpu_median: cpu.median(),
        wall_best,
    }
}

/// A straight street: road and pavement grid, houses with window boxes, trees of leaves, lamp
/// posts.
fn street() -> SceneAssets {
    let mut assets = SceneAssets::default();
    let mut rng = fastrand::Rng::with_seed(1);
    for chunk in -10..10 {
        let mut builder = MeshBuilder::new("chunk");
        let surface = |class: Class| Surface::new(class, Material::Matte, [128; 3]);
        for i in 0..20 {
            for j in 0..24 {
                let (x, y) = (i as f32 * 2.0, j as f32 - 12.0);
                let class = if y.abs() < 7.0 {
                    Class::ROADS
                } else {
                    Class::SIDEWALKS
                };
                builder.quad(
                    surface(class),
                    [
                        [x, y, 0.],
                        [x + 2., y, 0.],
                        [x + 2., y + 1., 0.],
                        [x, y + 1., 0.],
                    ],
                    [[0.0; 2]; 4],
                );
            }
        }
        for side in [-1.0f32, 1.0] {
            for house in 0..2 {
                let x = house as f32 * 20.0 + 10.0;
                builder.cuboid(
                    surface(Class::BUILDINGS),
                    [x, side * 20.0, 8.0],
                    [9.0, 8.0, 8.0],
                );
                for window in 0..160 {
                    let (column, floor) = (window % 20, window / 20);
                    let at = [
                        x - 8.5 + column as f32 * 0.9,
                        side * 12.0,
                        1.5 + floor as f32 * 1.9,
                    ];
                    builder.cuboid(surface(Class::BUILDINGS), at, [0.3, 0.1, 0.6]);
                }
            }
            for tree in 0..4 {
                let x = tree as f32 * 10.0 + 5.0;
                builder.cuboid(
                    surface(Class::VEGETATION),
                    [x, side * 9.0, 1.5],
                    [0.15, 0.15, 1.5],
                );
                for _ in 0..500 {
                    let mut at = |scale: f32| (rng.f32() - 0.5) * scale;
                    let leaf = [x + at(4.0), side * 9.0 + at(4.0), 4.5 + at(3.0)];
                    let corners = std::array::from_fn(|_| {
                        [leaf[0] + at(0.5), leaf[1] + at(0.5), leaf[2] + at(0.5)]
                    });
                    builder.triangle(surface(Class::VEGETATION), corners);
                }
            }
        }
        let mesh = assets.add_mesh(builder.finish());
        let world_from_mesh = Isometry3::translation(chunk as f64 * 40.0, 0.0, 0.0);
        assets.statics.push(StaticInstance {
            mesh,
            world_from_mesh,
            object: ObjectId::scenery((chunk + 10) as u32),
        });
    }
    let mut builder = MeshBuilder::new("car");
    for i in 0..150 {
        let at = [
            (i % 15) as f32 * 0.3 - 2.1,
            (i / 15 % 5) as f32 * 0.4 - 0.8,
            0.4 + (i / 75) as f32 * 0.6,
        ];
        builder.cuboid(
            Surface::new(Class::CAR, Material::CarPaint, [200; 3]),
            at,
            [0.15, 0.2, 0.3],
        );
    }
    assets.add_mesh(builder.finish());
    assets
}

/// Two hundred cars in four lanes.
fn traffic(assets: &SceneAssets) -> Vec<DynamicInstance> {
    let mesh = sensor_core::MeshId(assets.meshes.len() as u32 - 1);
    let place = |k: u32| {
        Isometry3::translation(
            -390.0 + k as f64 * 3.9 + 2.5,
            [-5.2, -1.8, 1.8, 5.2][k as usize % 4],
            0.0,
        )
    };
    (0..200)
        .map(|k| DynamicInstance {
            actor: ActorId(k + 1),
            part: 0,
            mesh,
            world_from_mesh: place(k),
            tint_rgb: [0; 3],
            lamps: 0,
            velocity_in_world_mps: Vector3::zeros(),
        })
        .collect()
}

/// All cars drove here at 15 m/s, which two ticks of a turn tell.
fn past(instances: &[DynamicInstance]) -> Past {
    let ages_nanos = vec![TURN_NANOS / 2, TURN_NANOS];
    let way = |instance: &DynamicInstance| {
        [0.05, 0.1]
            .map(|secs| Isometry3::translation(-15.0 * secs, 0.0, 0.0) * instance.world_from_mesh)
    };
    Past {
        ages_nanos,
        moved: (0..instances.len() as u32).collect(),
        poses: instances.iter().flat_map(way).collect(),
    }
}
