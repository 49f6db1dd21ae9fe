//! Compares cameras and lidars with the ray caster in random scenes: boxes, shards and balls with
//! levels of detail, with random poses and motion, near the origin and ten kilometres from it.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use schema_frames::SemanticLidarPoint;
use schema_frames::document::Weather;
use schema_types::noise::Noise;
use schema_types::{ActorId, Class, ObjectId, SimTime, Tick};
use sensor_camera::{CameraRenderer, Quality};
use sensor_core::mesh::Surface;
use sensor_core::{
    DynamicInstance, Material, Mesh, MeshBuilder, MeshId, Scene, SceneAssets, StaticInstance,
};
use sensor_gpu::{Gpu, GpuOptions};
use sensor_ray::{Lidar, RayScene, SensorPath};
use sensor_spec::{Intrinsics, LidarSpec};
use test_render::exact::{Errors, check_camera, check_lidar, two_firings};

/// A seeded sequence of random numbers.
struct Chance(Noise, u64);

impl Chance {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.1 += 1;
        low + (high - low) * self.0.uniform(self.1)
    }

    fn vector(&mut self, half: [f64; 3]) -> Vector3<f64> {
        Vector3::from(half.map(|half| self.between(-half, half)))
    }

    fn pose(&mut self, half_m: [f64; 3]) -> Isometry3<f64> {
        let at = self.vector(half_m);
        let turn = UnitQuaternion::new(self.vector([3.0; 3]));
        Isometry3::from_parts(Translation3::from(at), turn)
    }
}

fn surface(chance: &mut Chance, object: ObjectId) -> Surface {
    let classes = [
        Class::BUILDINGS,
        Class::CAR,
        Class::ROADS,
        Class::VEGETATION,
        Class::POLES,
    ];
    let class = classes[chance.between(0.0, 4.999) as usize];
    Surface::new(class, Material::Matte, [120; 3]).of(object)
}

/// A ball of rounded quads.
fn ball(builder: &mut MeshBuilder, surface: Surface, radius_m: f32, n: usize) {
    let at = |i: usize, k: usize| {
        let (theta, phi) = (
            i as f32 / n as f32 * std::f32::consts::PI,
            k as f32 / n as f32 * std::f32::consts::TAU,
        );
        [
            theta.sin() * phi.cos(),
            theta.sin() * phi.sin(),
            theta.cos(),
        ]
    };
    for i in 0..n {
        for k in 0..n {
            let normals = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)];
            builder.polygon_with_normals(
                surface,
                &normals.map(|x| x.map(|x| x * radius_m)),
                &normals,
                &[[0.0; 2]; 4],
            );
        }
    }
}

fn mesh(chance: &mut Chance, number: u32) -> Mesh {
    let mut builder = MeshBuilder::new(format!("thing {number}"));
    let object = if chance.between(0.0, 1.0) < 0.5 {
        ObjectId::BACKGROUND
    } else {
        ObjectId::scenery(1000 + number)
    };
    let surface = surface(chance, object);
    let size = |chance: &mut Chance| [0; 3].map(|_| chance.between(0.2, 3.0) as f32);
    match number % 3 {
        0 => {
            let half = size(chance);
            builder.cuboid(surface, [0.3, -0.2, 0.1], half);
            builder.cuboid(surface, [0.0, 1.5, 0.4], half.map(|x| 0.4 * x));
            builder.end_level(14.0);
            builder.cuboid(surface, [0.2, 0.1, 0.2], half);
            builder.end_level(60.0);
        }
        1 => {
            for _ in 0..12 {
                let corners = [0; 3].map(|_| size(chance).map(|x| x - 1.5));
                builder.triangle(surface, corners);
                builder.triangle(surface, [corners[0], corners[2], corners[1]]);
            }
        }
        _ => {
            let radius_m = chance.between(0.5, 2.5) as f32;
            ball(&mut builder, surface, radius_m, 8);
            builder.end_level(20.0);
            ball(&mut builder, surface, radius_m, 5);
        }
    }
    builder.finish()
}

fn scene(assets: &Arc<SceneAssets>, tick: u64, dynamics: Vec<DynamicInstance>) -> Scene {
    Scene {
        tick: Tick(tick),
        sim_time: SimTime(tick * 50_000_000),
        period_nanos: 50_000_000,
        assets: assets.clone(),
        dynamics,
        past: Default::default(),
        weather: Weather::default(),
        lidar_extinction_per_m: 0.0,
        debug: Vec::new(),
        overlay: Default::default(),
    }
}

struct Shot {
    scenes: [Scene; 2],
    poses: [Isometry3<f64>; 2],
    lens: Intrinsics,
}

fn shot(seed: u64) -> Shot {
    let mut chance = Chance(Noise::new(seed, 9, 9), 0);
    let origin = if seed.is_multiple_of(2) {
        Vector3::zeros()
    } else {
        chance.vector([10_000.0, 10_000.0, 300.0])
    };
    let mut assets = SceneAssets {
        episode: 1,
        ..SceneAssets::default()
    };
    let meshes: Vec<MeshId> = (0..30)
        .map(|i| assets.add_mesh(mesh(&mut chance, i)))
        .collect();
    let away = Isometry3::from_parts(Translation3::from(origin), UnitQuaternion::identity());
    const HALF_M: [f64; 3] = [30.0, 30.0, 8.0];
    for (i, mesh) in meshes.iter().enumerate().chain(meshes.iter().enumerate()) {
        let world_from_mesh = away * chance.pose(HALF_M);
        assets.statics.push(StaticInstance {
            mesh: *mesh,
            world_from_mesh,
            object: ObjectId::scenery(i as u32),
        });
    }
    let assets = Arc::new(assets);
    let mut dynamics = [Vec::new(), Vec::new()];
    for i in 0..40 {
        let before = away * chance.pose([20.0, 20.0, 5.0]);
        let step = Isometry3::new(chance.vector([1.0, 1.0, 0.3]), chance.vector([0.2; 3]));
        for (list, world_from_mesh) in dynamics.iter_mut().zip([before, before * step]) {
            list.push(DynamicInstance {
                actor: ActorId(1 + i / 2),
                part: (i % 2) as u16,
                mesh: meshes[(i as usize * 7) % meshes.len()],
                world_from_mesh,
                tint_rgb: [90; 3],
                lamps: 0,
                velocity_in_world_mps: Vector3::zeros(),
            });
        }
    }
    let [before, now] = dynamics;
    let pose = away * chance.pose([6.0, 6.0, 3.0]);
    let turn = Isometry3::new(chance.vector([0.8; 3]), chance.vector([0.06; 3]));
    let fov_rad = chance.between(0.1, 0.4) * TAU;
    Shot {
        scenes: [scene(&assets, 1, before), scene(&assets, 2, now)],
        poses: [pose, pose * turn],
        lens: Intrinsics::from_fov(176, 132, fov_rad),
    }
}

#[test]
fn cameras_and_lidar_agree_with_rays_in_random_scenes() {
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let (mut sum, mut n_hits) = (Errors::default(), 0);
    for seed in 0..10 {
        let Shot {
            scenes: [before, now],
            poses,
            lens,
        } = shot(seed);
        let mut renderer = CameraRenderer::new(
            &gpu,
            [Quality::Low, Quality::High][(seed % 4 == 3) as usize],
        );
        let frames = two_firings(&gpu, &mut renderer, lens, [&before, &now], poses);
        let errors = check_camera(&frames, [&before, &now], poses);
        println!("seed {seed}: {errors:?}");
        assert!(errors.is_exact(), "seed {seed}: {errors:#?}");
        (sum.n, sum.n_moving, sum.n_flowing) = (
            sum.n + errors.n,
            sum.n_moving + errors.n_moving,
            sum.n_flowing + errors.n_flowing,
        );

        let mut rays = RayScene::load(&now.assets);
        rays.update(&now.dynamics);
        let spec = LidarSpec {
            semantic: true,
            channels: 16,
            columns: 200,
            range_m: 60.0,
            upper_fov_deg: 40.0,
            lower_fov_deg: -40.0,
            ..Default::default()
        };
        let mut lidar = Lidar::new(spec.clone());
        lidar.scan(
            &rays,
            &SensorPath::still(poses[1]),
            Noise::new(1, 2, 3),
            None,
        );
        let mut bytes = vec![0; lidar.payload_bytes()];
        let n_bytes = lidar.write(&mut bytes);
        let points: Vec<SemanticLidarPoint> = bytemuck::pod_collect_to_vec(&bytes[..n_bytes]);
        let errors = check_lidar(&points, &spec, &now, &poses[1]);
        println!("seed {seed}: {errors:?}");
        assert!(
            errors.n_wrong == 0 && errors.n_labels_off == 0 && errors.worst_m <= 1e-3,
            "seed {seed}: {errors:?}"
        );
        n_hits += errors.n_hits;
    }
    assert!(
        sum.n > 100_000 && sum.n_moving > 20_000 && sum.n_flowing > 80_000 && n_hits > 6_000,
        "{sum:?}, {n_hits}"
    );
}

/// The comparison notices a point that is off by a centimetre.
#[test]
fn the_comparison_finds_what_is_off() {
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let Shot {
        scenes: [before, now],
        poses,
        lens,
    } = shot(4);
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let frames = two_firings(&gpu, &mut renderer, lens, [&before, &now], poses);
    let aside = [poses[0], poses[1] * Isometry3::translation(0.01, 0.0, 0.0)];
    let errors = check_camera(&frames, [&before, &now], aside);
    assert!(
        !errors.is_exact() && errors.n_depth_off > 2000,
        "{errors:?}"
    );
    let mut late = before.clone();
    late.dynamics.iter_mut().for_each(|instance| {
        instance.world_from_mesh.translation.vector += Vector3::new(0.0, 0.05, 0.0)
    });
    let errors = check_camera(&frames, [&late, &now], poses);
    assert!(
        errors.worst_flow_px > 0.1 && errors.n_depth_off == 0,
        "{errors:?}"
    );
    let eye = Point3::from(poses[1].translation.vector);
    assert!(eye.coords.norm() < 20.0, "seed 4 is near the origin");
}
