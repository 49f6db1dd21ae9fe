//! Compares lidars on the GPU with the CPU's, point by point, and with a loop over every triangle;
//! and imported with staged memory.

#![expect(
    unsafe_code,
    reason = "targets are raw memory; each block carries its proof"
)]

use crate::common;

use std::sync::Arc;

use common::{brute_force, cuboid, loose_triangles, moving, random_pose};
use nalgebra::{Isometry3, Vector3};
use schema_frames::{LidarPoint, SemanticLidarPoint};
use schema_types::noise::Noise;
use schema_types::{ActorId, Class, ObjectId};
use sensor_core::{Past, SceneAssets, StaticInstance};
use sensor_gpu::{Gpu, GpuOptions, Place, ShmTarget};
use sensor_ray::lidar::azimuth_rad;
use sensor_ray::{GpuRayOptions, GpuRays, Lidar, RayScene, ScanJob, ScanOutcome, SensorPath};
use sensor_spec::{LidarScan, LidarSpec};

fn gpu() -> Gpu {
    Gpu::open(&GpuOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

fn rays(gpu: &Gpu) -> GpuRays {
    GpuRays::new(gpu, GpuRayOptions::default())
}

/// Loose triangles and moving boxes about a centre.
fn world(
    rng: &mut fastrand::Rng,
    centre: [f64; 3],
) -> (SceneAssets, RayScene, Vec<sensor_core::DynamicInstance>) {
    let mut assets = SceneAssets::default();
    let loose = assets.add_mesh(loose_triangles(rng, 400, 1));
    let boxes = assets.add_mesh(cuboid(Class::CAR, [2.2, 0.9, 0.7]));
    for i in 0..2 {
        let world_from_mesh = random_pose(rng, centre, 6.0);
        assets.statics.push(StaticInstance {
            mesh: loose,
            world_from_mesh,
            object: ObjectId::scenery(9000 + i),
        });
    }
    let dynamics: Vec<_> = (1..=30)
        .map(|actor| moving(boxes, actor, random_pose(rng, centre, 15.0)))
        .collect();
    let mut scene = RayScene::load_for_gpu(&assets);
    scene.update(&dynamics);
    (assets, scene, dynamics)
}

fn spec(semantic: bool, channels: u32, columns: u32) -> LidarSpec {
    LidarSpec {
        semantic,
        channels,
        columns,
        range_m: 50.0,
        upper_fov_deg: 20.0,
        lower_fov_deg: -25.0,
        ..Default::default()
    }
}

fn scan(
    rays: &mut GpuRays,
    scene: &RayScene,
    spec: &LidarSpec,
    path: &SensorPath,
    ignored: Option<ActorId>,
) -> Vec<u8> {
    let mut lidar = Lidar::new(spec.clone());
    let mut bytes = vec![0; (spec.channels * spec.columns) as usize * 24];
    rays.update(scene).unwrap();
    let job = ScanJob {
        lidar: &mut lidar,
        path: *path,
        noise: Noise::new(1, 2, 3),
        ignored,
        place: Place::Memory(&mut bytes),
    };
    let outcome = rays.scan(vec![job]).wait().unwrap();
    bytes.truncate(outcome[0].n_points as usize * if spec.semantic { 24 } else { 16 });
    bytes
}

fn scan_on_cpu(
    scene: &RayScene,
    spec: &LidarSpec,
    path: &SensorPath,
    ignored: Option<ActorId>,
) -> Vec<u8> {
    let mut lidar = Lidar::new(spec.clone());
    lidar.scan(scene, path, Noise::new(1, 2, 3), ignored);
    let mut bytes = vec![0; lidar.payload_bytes()];
    lidar.write(&mut bytes);
    bytes
}

fn moving_path(rng: &mut fastrand::Rng, centre: [f64; 3]) -> SensorPath {
    let world_from_sensor = random_pose(rng, centre, 12.0);
    let moved =
        Isometry3::translation(1.0, -0.4, 0.1) * Isometry3::rotation(Vector3::new(0.0, 0.02, 0.05));
    SensorPath {
        world_from_sensor_start: world_from_sensor * moved,
        world_from_sensor,
    }
}

/// A ray that passes an edge within rounding may differ, so one in ten thousand may disagree.
#[test]
fn semantic_turns_agree_with_brute_force_to_a_millimetre() {
    let (gpu, mut rng) = (gpu(), fastrand::Rng::with_seed(21));
    let mut gpu_rays = rays(&gpu);
    let (mut n_hits, mut n_wrong, mut n_rays) = (0, 0, 0);
    for round in 0..6 {
        let centre = [800.0 * round as f64, -250.0 * round as f64, 10.0];
        let (mut assets, mut scene, dynamics) = world(&mut rng, centre);
        assets.episode = round;
        scene = {
            let _ = scene;
            let mut scene = RayScene::load_for_gpu(&assets);
            scene.update_for_gpu(&dynamics, &Past::default());
            scene
        };
        let mut everything: Vec<_> = assets
            .statics
            .iter()
            .map(|s| (s.world_from_mesh, assets.mesh(s.mesh), s.object))
            .collect();
        everything.extend(
            dynamics
                .iter()
                .map(|d| (d.world_from_mesh, assets.mesh(d.mesh), d.actor.into())),
        );
        let spec = LidarSpec {
            motion_distortion: round % 2 == 1,
            ..spec(true, 17, 75)
        };
        let path = moving_path(&mut rng, centre);
        let points: Vec<SemanticLidarPoint> =
            bytemuck::pod_collect_to_vec(&scan(&mut gpu_rays, &scene, &spec, &path, None));
        let mut points = points.iter().peekable();
        for (channel, column) in (0..spec.channels)
            .flat_map(|channel| (0..spec.columns).map(move |column| (channel, column)))
        {
            let (elevation, azimuth) = (spec.elevation_rad(channel), azimuth_rad(&spec, column));
            let ray = Vector3::new(
                elevation.cos() * azimuth.cos(),
                elevation.cos() * azimuth.sin(),
                elevation.sin(),
            );
            let share = if spec.motion_distortion {
                (column + 1) as f64 / spec.columns as f64
            } else {
                1.0
            };
            let pose = path
                .world_from_sensor_start
                .try_lerp_slerp(&path.world_from_sensor, share, 1e-9)
                .expect("turned by little");
            let expected = brute_force(
                &everything,
                &pose.translation.vector.into(),
                &(pose.rotation * ray),
                spec.range_m,
            );
            let point = points.next_if(|point| {
                let at = Vector3::from(point.hit_in_sensor_m.map(f64::from));
                point.channel as u32 == channel
                    && at.cross(&ray).norm() < 1e-5 * at.norm()
                    && at.dot(&ray) >= 0.0
            });
            let found = point.map(|p| {
                (
                    Vector3::from(p.hit_in_sensor_m.map(f64::from)).norm(),
                    ObjectId(p.object_id),
                    Class(p.class),
                )
            });
            n_rays += 1;
            n_hits += expected.is_some() as u32;
            n_wrong += match (found, expected) {
                (None, None) => 0,
                (Some((a_m, object, class)), Some((b_m, b, c))) => {
                    ((a_m - b_m).abs() > 1e-3 || (object, class) != (b, c)) as u32
                }
                _ => 1,
            };
        }
        assert!(
            points.next().is_none(),
            "points left over that lie on no ray, or out of order"
        );
    }
    assert!(n_hits > 3000, "{n_hits} hits");
    assert!(
        n_wrong * 10_000 <= n_rays,
        "{n_wrong} of {n_rays} rays disagree"
    );
}

/// The GPU loses the same rays, adds the same noise to the same ranges, and keeps points in the same
/// order.
#[test]
fn losses_and_noise_are_the_cpus() {
    let (gpu, mut rng) = (gpu(), fastrand::Rng::with_seed(22));
    let (_, scene, _) = world(&mut rng, [0.0; 3]);
    let mut gpu_rays = rays(&gpu);
    let plain = spec(false, 32, 300);
    let losses = [
        plain.clone(),
        LidarSpec {
            dropoff_general_ratio: 0.45,
            ..plain.clone()
        },
        LidarSpec {
            noise_range_stddev_m: 0.05,
            ..plain.clone()
        },
        LidarSpec {
            dropoff_intensity_limit: 0.95,
            dropoff_zero_intensity_ratio: 0.6,
            attenuation_per_m: 0.02,
            ..plain.clone()
        },
        LidarSpec {
            dropoff_general_ratio: 1.0,
            ..plain
        },
    ];
    for spec in losses {
        let path = SensorPath::still(random_pose(&mut rng, [0.0; 3], 8.0));
        let ours: Vec<LidarPoint> = bytemuck::pod_collect_to_vec(&scan(
            &mut gpu_rays,
            &scene,
            &spec,
            &path,
            Some(ActorId(7)),
        ));
        let theirs: Vec<LidarPoint> =
            bytemuck::pod_collect_to_vec(&scan_on_cpu(&scene, &spec, &path, Some(ActorId(7))));
        assert_eq!(
            theirs.len() > 500,
            spec.dropoff_general_ratio < 1.0,
            "{} points",
            theirs.len()
        );
        assert_eq!(ours.len(), theirs.len(), "{spec:?}");
        let far = |(a, b): &(&LidarPoint, &LidarPoint)| {
            let gap = Vector3::from(a.hit_in_sensor_m) - Vector3::from(b.hit_in_sensor_m);
            gap.norm() > 1e-4 || a.channel != b.channel || a.intensity.abs_diff(b.intensity) > 1
        };
        let n_far = ours.iter().zip(&theirs).filter(far).count();
        assert!(
            n_far * 2000 <= ours.len(),
            "{n_far} of {} points differ: {spec:?}",
            ours.len()
        );
    }
}

/// Page-aligned memory that lives as long as the test process.
fn segment(n_bytes: usize) -> (*mut u8, usize) {
    let len = n_bytes.next_multiple_of(4096);
    let memory: &'static mut [u8] = vec![0u8; len + 4096].leak();
    let aligned = memory.as_ptr().align_offset(4096);
    (memory[aligned..aligned + len].as_mut_ptr(), len)
}

fn target(gpu: &Gpu, n_bytes: usize, is_imported: bool) -> (Arc<ShmTarget>, &'static [u8]) {
    let (base, len) = segment(n_bytes);
    // SAFETY: the memory is leaked, and read only after scans are done.
    unsafe {
        let target = if is_imported {
            ShmTarget::import(gpu, base, len, ())
        } else {
            ShmTarget::staged(base, len, ())
        };
        (Arc::new(target), std::slice::from_raw_parts(base, len))
    }
}

fn scan_to(
    target: &Arc<ShmTarget>,
    rays: &mut GpuRays,
    lidars: &mut [Lidar],
    path: &SensorPath,
) -> Vec<ScanOutcome> {
    // SAFETY: ranges of a leaked segment that do not overlap, and are looked at after the wait.
    let place = |i: usize| unsafe { target.place(384 + i * 300_000, 290_000) };
    let job = |(i, lidar)| ScanJob {
        lidar,
        path: *path,
        noise: Noise::new(i as u64, 5, 6),
        ignored: None,
        place: place(i),
    };
    rays.scan(lidars.iter_mut().enumerate().map(job).collect())
        .wait()
        .unwrap()
}

/// The bytes do not depend on the way they take: written by the shader, copied by the GPU or by the
/// CPU, in one group or in several.
#[test]
fn many_lidars_in_one_submission_bring_the_same_bytes_alone_twice_and_by_every_way() {
    let (gpu, mut rng) = (gpu(), fastrand::Rng::with_seed(23));
    let (_, scene, _) = world(&mut rng, [0.0; 3]);
    let path = moving_path(&mut rng, [0.0; 3]);
    let sweep = LidarSpec {
        scan: LidarScan::Sweep,
        points_per_second: 60_000,
        ..spec(false, 16, 1)
    };
    let specs = [
        spec(false, 40, 111),
        spec(true, 7, 999),
        LidarSpec {
            motion_distortion: true,
            ..spec(false, 16, 500)
        },
        sweep,
    ];
    let fresh = || -> Vec<Lidar> {
        let mut lidars: Vec<_> = specs.iter().cloned().map(Lidar::new).collect();
        lidars
            .iter_mut()
            .for_each(|lidar| lidar.turn_head(50_000_000, 100_000));
        lidars
    };
    let default = GpuRayOptions::default();
    let ways = [
        (default, true),
        (
            GpuRayOptions {
                group_rays: 5000,
                ..default
            },
            true,
        ),
        (
            GpuRayOptions {
                group_rays: 1,
                block_columns: 4,
                ..default
            },
            true,
        ),
        (
            GpuRayOptions {
                writes_directly: false,
                ..default
            },
            true,
        ),
        (default, false),
    ];
    let mut runs = Vec::new();
    for (options, is_imported) in ways {
        let mut gpu_rays = GpuRays::new(&gpu, options);
        gpu_rays.update(&scene).unwrap();
        for _ in 0..2 {
            let (target, memory) = target(&gpu, 1_300_000, is_imported);
            let outcomes = scan_to(&target, &mut gpu_rays, &mut fresh(), &path);
            assert!(
                outcomes
                    .iter()
                    .all(|outcome| outcome.cpu_copies == target.cpu_copies())
            );
            let bytes = |(i, outcome): (usize, &ScanOutcome)| {
                let n_bytes = outcome.n_points as usize * if specs[i].semantic { 24 } else { 16 };
                memory[384 + i * 300_000..][..n_bytes].to_vec()
            };
            runs.push(outcomes.iter().enumerate().map(bytes).collect::<Vec<_>>());
        }
    }
    assert!(
        runs[0].iter().all(|bytes| bytes.len() > 5000),
        "{:?}",
        runs[0].iter().map(Vec::len).collect::<Vec<_>>()
    );
    for (i, run) in runs.iter().enumerate() {
        assert!(*run == runs[0], "run {i}: {:?}", ways[i / 2]);
    }
    let mut gpu_rays = rays(&gpu);
    gpu_rays.update(&scene).unwrap();
    for (i, mut lidar) in fresh().into_iter().enumerate() {
        let mut bytes = vec![0; 300_000];
        let noise = Noise::new(i as u64, 5, 6);
        let job = ScanJob {
            lidar: &mut lidar,
            path,
            noise,
            ignored: None,
            place: Place::Memory(&mut bytes),
        };
        assert!(gpu_rays.scan(vec![job]).wait().is_ok());
        assert!(
            bytes[..runs[0][i].len()] == runs[0][i][..],
            "lidar {i} alone"
        );
    }
}

/// Each topic has a segment of its own, and more of them fire than one dispatch can write to. A
/// submission leaves nothing behind for the next one.
#[test]
fn lidars_with_memory_of_their_own_write_there_and_nowhere_else() {
    let (gpu, mut rng) = (gpu(), fastrand::Rng::with_seed(24));
    let (_, scene, _) = world(&mut rng, [0.0; 3]);
    let mut gpu_rays = rays(&gpu);
    gpu_rays.update(&scene).unwrap();
    let spec = LidarSpec {
        dropoff_general_ratio: 0.3,
        ..spec(false, 16, 130)
    };
    let paths: Vec<_> = (0..19)
        .map(|_| SensorPath::still(random_pose(&mut rng, [0.0; 3], 8.0)))
        .collect();
    let capacity_bytes = (16 * 16 * 130) as usize;
    for n in [19, 3, 19, 1, 8] {
        let targets: Vec<_> = (0..n)
            .map(|_| target(&gpu, 4096 + 2 * capacity_bytes, true))
            .collect();
        let mut lidars: Vec<_> = (0..n).map(|_| Lidar::new(spec.clone())).collect();
        let offset_bytes = 4 * rng.usize(1..500);
        let job = |(i, lidar): (usize, _)| {
            // SAFETY: ranges of a leaked segment that do not overlap, and are looked at after the wait.
            let place = unsafe { targets[i].0.place(offset_bytes, capacity_bytes) };
            ScanJob {
                lidar,
                path: paths[i],
                noise: Noise::new(i as u64, 5, 6),
                ignored: None,
                place,
            }
        };
        let outcomes = gpu_rays
            .scan(lidars.iter_mut().enumerate().map(job).collect())
            .wait()
            .unwrap();
        for (i, outcome) in outcomes.iter().enumerate() {
            let end = offset_bytes + 16 * outcome.n_points as usize;
            let mut lidar = Lidar::new(spec.clone());
            lidar.scan(&scene, &paths[i], Noise::new(i as u64, 5, 6), None);
            assert_eq!(lidar.payload_bytes(), end - offset_bytes, "{n} lidars, {i}");
            let mut expected = vec![0; end - offset_bytes];
            lidar.write(&mut expected);
            let points = |bytes: &[u8]| bytemuck::pod_collect_to_vec::<u8, LidarPoint>(bytes);
            let gap = |(a, b): (&LidarPoint, &LidarPoint)| {
                (Vector3::from(a.hit_in_sensor_m) - Vector3::from(b.hit_in_sensor_m)).norm()
            };
            let (ours, theirs) = (points(&targets[i].1[offset_bytes..end]), points(&expected));
            let n_far = ours
                .iter()
                .zip(&theirs)
                .map(gap)
                .filter(|gap| *gap > 1e-3)
                .count();
            assert!(
                n_far * 1000 <= ours.len() && outcome.n_points > 100,
                "{n} lidars, {i}: {n_far} of {} points are elsewhere",
                ours.len()
            );
            let outside = targets[i].1[..offset_bytes]
                .iter()
                .chain(&targets[i].1[offset_bytes + capacity_bytes..]);
            assert!(
                outside.copied().all(|byte| byte == 0),
                "{n} lidars, {i}: bytes outside its place"
            );
        }
    }
}

/// After hiding, the GPU sees the scene without the hidden objects, in the buffers that were uploaded
/// before.
#[test]
fn hidden_objects_let_rays_through_and_come_back() {
    let (gpu, mut rng) = (gpu(), fastrand::Rng::with_seed(26));
    let (whole, mut scene, dynamics) = world(&mut rng, [0.0; 3]);
    let mut gpu_rays = rays(&gpu);
    let path = SensorPath::still(random_pose(&mut rng, [0.0; 3], 2.0));
    let spec = spec(true, 32, 300);
    let mut seen = Vec::new();
    let sets: [&mut dyn Iterator<Item = u32>; 5] = [
        &mut (0..0),
        &mut (1..120),
        &mut (60..240),
        &mut (9001..9002),
        &mut (0..0),
    ];
    for objects in sets {
        // Triangles of the loose meshes are objects 1 to 400, and the instances 9000 and 9001 have
        // none of their own.
        let assets = whole.without(&objects.map(ObjectId::scenery).collect());
        assert!(scene.hide(&assets));
        scene.update(&dynamics);
        let mut anew = RayScene::load_for_gpu(&assets);
        anew.update(&dynamics);
        let points = scan(&mut gpu_rays, &scene, &spec, &path, None);
        let expected = scan(&mut rays(&gpu), &anew, &spec, &path, None);
        assert!(
            points == expected,
            "{} hidden: {} bytes, without them {}",
            assets.hidden.len(),
            points.len(),
            expected.len()
        );
        assert!(
            scan_on_cpu(&scene, &spec, &path, None) == scan_on_cpu(&anew, &spec, &path, None),
            "on the CPU"
        );
        seen.push(points);
    }
    assert!(seen[0] == seen[4] && (1..4).all(|i| seen[i] != seen[0]) && seen[1] != seen[2]);
}

/// Two scenes of one episode are not confused with one another.
#[test]
fn another_scene_of_the_same_episode_is_uploaded() {
    let (gpu, mut rng) = (gpu(), fastrand::Rng::with_seed(27));
    let mut gpu_rays = rays(&gpu);
    let path = SensorPath::still(random_pose(&mut rng, [0.0; 3], 2.0));
    for _ in 0..2 {
        let (_, scene, _) = world(&mut rng, [0.0; 3]);
        let own = scan(&mut rays(&gpu), &scene, &spec(true, 16, 200), &path, None);
        assert!(scan(&mut gpu_rays, &scene, &spec(true, 16, 200), &path, None) == own);
    }
}

/// A GPU scene that gets only what changed equals one that is uploaded whole.
#[test]
fn moving_things_that_stop_come_and_go_are_where_they_are() {
    let (gpu, mut rng) = (gpu(), fastrand::Rng::with_seed(28));
    let (_, mut scene, mut dynamics) = world(&mut rng, [0.0; 3]);
    let mut gpu_rays = rays(&gpu);
    let path = SensorPath::still(random_pose(&mut rng, [0.0; 3], 2.0));
    for turn in 0..12 {
        match turn % 4 {
            0 => dynamics[rng.usize(0..20)].world_from_mesh = random_pose(&mut rng, [0.0; 3], 8.0),
            1 => dynamics.truncate(dynamics.len() - 2),
            2 => {}
            _ => drop(dynamics.remove(rng.usize(0..10))),
        }
        scene.update(&dynamics);
        let own = scan(&mut rays(&gpu), &scene, &spec(true, 16, 200), &path, None);
        assert!(
            scan(&mut gpu_rays, &scene, &spec(true, 16, 200), &path, None) == own,
            "turn {turn}"
        );
    }
}

#[test]
fn a_world_without_triangles_returns_nothing() {
    let gpu = gpu();
    let mut gpu_rays = rays(&gpu);
    let scene = RayScene::load_for_gpu(&SceneAssets::default());
    let still = SensorPath::still(Isometry3::identity());
    assert!(scan(&mut gpu_rays, &scene, &spec(false, 4, 100), &still, None).is_empty());
    // A head that has not turned has no rays.
    let mut lidar = Lidar::new(LidarSpec {
        scan: LidarScan::Sweep,
        ..spec(false, 4, 1)
    });
    let job = ScanJob {
        lidar: &mut lidar,
        path: still,
        noise: Noise::new(1, 2, 3),
        ignored: None,
        place: Place::Memory(&mut []),
    };
    assert_eq!(
        gpu_rays.scan(vec![job]).wait().unwrap(),
        [ScanOutcome {
            n_points: 0,
            cpu_copies: 0
        }]
    );
}
