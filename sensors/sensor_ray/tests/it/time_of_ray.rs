//! Lidars that turn while things move: each ray against a loop over every triangle in `f64`, with
//! all things where they are at the ray's own time.

use crate::common;

use common::{brute_force, cuboid, loose_triangles, moving, random_pose};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use schema_frames::{LidarReturn, SemanticLidarPoint};
use schema_types::noise::Noise;
use schema_types::{Class, ObjectId};
use sensor_core::{DynamicInstance, Mesh, Past, SceneAssets, StaticInstance};
use sensor_gpu::{Gpu, GpuOptions, Place};
use sensor_ray::lidar::azimuth_rad;
use sensor_ray::{GpuRayOptions, GpuRays, Lidar, RayScene, ScanJob, SensorPath};
use sensor_spec::LidarSpec;

/// Ticks of a turn of 100 ms; the last one is shorter than the others.
const AGES_NANOS: [u64; 3] = [20_000_000, 60_000_000, 100_000_000];
const TURN_NANOS: u64 = 100_000_000;

/// Things in a world, and where they were at the ticks before.
struct MovingWorld {
    assets: SceneAssets,
    dynamics: Vec<DynamicInstance>,
    past: Past,
}

impl MovingWorld {
    /// Boxes about a centre, of which every third stands still, among loose triangles. They go up to
    /// 40 m/s and turn up to 15 rad/s, a few of them much faster, as wheels do.
    fn new(rng: &mut fastrand::Rng, centre: [f64; 3], episode: u32) -> MovingWorld {
        let mut assets = SceneAssets {
            episode,
            ..SceneAssets::default()
        };
        let loose = assets.add_mesh(loose_triangles(rng, 100, 1));
        let boxes = assets.add_mesh(cuboid(Class::CAR, [2.2, 0.9, 0.7]));
        assets.statics.push(StaticInstance {
            mesh: loose,
            world_from_mesh: random_pose(rng, centre, 6.0),
            object: ObjectId::scenery(9000),
        });
        let dynamics: Vec<_> = (1..=48)
            .map(|actor| moving(boxes, actor, random_pose(rng, centre, 15.0)))
            .collect();
        let mut past = Past {
            ages_nanos: AGES_NANOS.to_vec(),
            ..Past::default()
        };
        for (place, instance) in (0..).zip(&dynamics).filter(|(place, _)| place % 3 != 0) {
            past.moved.push(place);
            let mut later = instance.world_from_mesh;
            let (mut age_nanos, wheel) = (0, place % 7 == 0);
            for age in AGES_NANOS {
                let secs = (age - age_nanos) as f64 * 1e-9;
                let step_m = common::random_direction(rng) * (40.0 * rng.f64() * secs);
                let radps = if wheel { 70.0 } else { 15.0 };
                let turn = common::random_direction(rng) * (radps * rng.f64() * secs);
                later = Isometry3::from_parts(
                    (later.translation.vector + step_m).into(),
                    later.rotation * UnitQuaternion::from_scaled_axis(turn),
                );
                past.poses.push(later);
                age_nanos = age;
            }
        }
        MovingWorld {
            assets,
            dynamics,
            past,
        }
    }

    /// Everything as it is so long before the tick.
    fn at(&self, age_nanos: f64) -> Vec<(Isometry3<f64>, &Mesh, ObjectId)> {
        let still = self.assets.statics.iter();
        let still = still.map(|s| (s.world_from_mesh, self.assets.mesh(s.mesh), s.object));
        let moving = (0..).zip(&self.dynamics).map(|(place, instance)| {
            let pose = match self.past.moved.binary_search(&place) {
                Ok(row) => {
                    let row = &self.past.poses[row * AGES_NANOS.len()..][..AGES_NANOS.len()];
                    between(&instance.world_from_mesh, row, age_nanos)
                }
                Err(_) => instance.world_from_mesh,
            };
            (pose, self.assets.mesh(instance.mesh), instance.actor.into())
        });
        still.chain(moving).collect()
    }

    fn scene(&self) -> RayScene {
        RayScene::load_for_gpu(&self.assets)
    }
}

/// The pose on the way through earlier ones: origins go straight, rotations turn about one axis.
fn between(now: &Isometry3<f64>, row: &[Isometry3<f64>], age_nanos: f64) -> Isometry3<f64> {
    let (mut later, mut later_age) = (*now, 0.0);
    for (earlier, age) in row.iter().zip(AGES_NANOS.map(|age| age as f64)) {
        if age_nanos <= age {
            let share = (age_nanos - later_age) / (age - later_age);
            let turn = later.rotation.rotation_to(&earlier.rotation);
            let way = earlier.translation.vector - later.translation.vector;
            return Isometry3::from_parts(
                (later.translation.vector + way * share).into(),
                turn.powf(share) * later.rotation,
            );
        }
        (later, later_age) = (*earlier, age);
    }
    later
}

/// Rays, hits, rays that disagree, and rays that would if everything stood as at the tick.
#[derive(Debug, Default)]
struct Score {
    n_rays: usize,
    n_hits: usize,
    n_wrong: usize,
    n_moved: usize,
}

type Found = Option<(f64, ObjectId, Class)>;

fn differ(a: Found, b: Found) -> bool {
    match (a, b) {
        (None, None) => false,
        (Some((a_m, a, a_class)), Some((b_m, b, b_class))) => {
            (a_m - b_m).abs() > 1e-3 || (a, a_class) != (b, b_class)
        }
        _ => true,
    }
}

impl Score {
    fn add(
        &mut self,
        found: Found,
        ray: (&Point3<f64>, &Vector3<f64>, f64),
        world: &MovingWorld,
        age_nanos: f64,
    ) {
        let (origin, direction, max_m) = ray;
        let expected = brute_force(&world.at(age_nanos), origin, direction, max_m);
        let at_tick = brute_force(&world.at(0.0), origin, direction, max_m);
        self.n_rays += 1;
        self.n_hits += usize::from(expected.is_some());
        self.n_wrong += usize::from(differ(found, expected));
        self.n_moved += usize::from(differ(found, at_tick));
    }

    /// Of a thousand rays one may pass an edge within rounding.
    fn judge(&self, n_hits: usize) {
        assert!(self.n_hits > n_hits, "{self:?}");
        assert!(self.n_wrong * 1000 <= self.n_rays, "{self:?}");
        assert!(self.n_moved * 12 > self.n_rays, "nothing moved: {self:?}");
    }
}

fn direction(elevation: f64, azimuth: f64) -> Vector3<f64> {
    Vector3::new(
        elevation.cos() * azimuth.cos(),
        elevation.cos() * azimuth.sin(),
        elevation.sin(),
    )
}

fn even_fan() -> LidarSpec {
    LidarSpec {
        semantic: true,
        channels: 19,
        columns: 90,
        range_m: 60.0,
        upper_fov_deg: 40.0,
        lower_fov_deg: -40.0,
        motion_distortion: true,
        ..LidarSpec::default()
    }
}

fn path(rng: &mut fastrand::Rng, centre: [f64; 3]) -> SensorPath {
    let world_from_sensor = random_pose(rng, centre, 8.0);
    let moved =
        Isometry3::translation(1.0, -0.4, 0.1) * Isometry3::rotation(Vector3::new(0.0, 0.02, 0.05));
    SensorPath {
        world_from_sensor_start: world_from_sensor * moved,
        world_from_sensor,
    }
}

/// Compares points of an even fan, whose columns are fired in even steps of the turn.
fn compare(
    points: &[SemanticLidarPoint],
    spec: &LidarSpec,
    path: &SensorPath,
    world: &MovingWorld,
    score: &mut Score,
) {
    let mut points = points.iter().peekable();
    for channel in 0..spec.channels {
        for column in 0..spec.columns {
            let ray = direction(spec.elevation_rad(channel), azimuth_rad(spec, column));
            let share = f64::from(column + 1) / f64::from(spec.columns);
            let start = &path.world_from_sensor_start;
            let pose = start.try_lerp_slerp(&path.world_from_sensor, share, 1e-9);
            let pose = pose.expect("turned by little");
            let point = points.next_if(|point| {
                let at = Vector3::from(point.hit_in_sensor_m.map(f64::from));
                u32::from(point.channel) == channel
                    && at.cross(&ray).norm() < 1e-5 * at.norm()
                    && at.dot(&ray) >= 0.0
            });
            let found = point.map(|point| {
                let at = Vector3::from(point.hit_in_sensor_m.map(f64::from));
                (at.norm(), ObjectId(point.object_id), Class(point.class))
            });
            let (origin, forward) = (pose.translation.vector.into(), pose.rotation * ray);
            let age_nanos = (1.0 - share) * TURN_NANOS as f64;
            score.add(found, (&origin, &forward, spec.range_m), world, age_nanos);
        }
    }
    assert!(points.next().is_none(), "points left over, or out of order");
}

fn bytes_of(lidar: &mut Lidar, scene: &RayScene, path: &SensorPath) -> Vec<u8> {
    lidar.scan(scene, path, Noise::new(1, 2, 3), None);
    let mut bytes = vec![0; lidar.payload_bytes()];
    lidar.write(&mut bytes);
    bytes
}

#[test]
fn turns_of_the_processor_meet_what_moves_where_it_was_at_the_time_of_the_ray() {
    let (mut rng, mut score) = (fastrand::Rng::with_seed(31), Score::default());
    for round in 0..3 {
        let centre = [700.0 * f64::from(round), -300.0 * f64::from(round), 5.0];
        let world = MovingWorld::new(&mut rng, centre, round);
        let mut scene = world.scene();
        scene.update_moving(&world.dynamics, &world.past);
        let (spec, path) = (even_fan(), path(&mut rng, centre));
        let mut lidar = Lidar::new(spec.clone());
        lidar.set_past(TURN_NANOS);
        let bytes = bytes_of(&mut lidar, &scene, &path);
        let points: Vec<SemanticLidarPoint> = bytemuck::pod_collect_to_vec(&bytes);
        compare(&points, &spec, &path, &world, &mut score);
    }
    score.judge(1500);
}

#[test]
fn turns_of_the_gpu_meet_what_moves_where_it_was_at_the_time_of_the_ray() {
    let gpu = Gpu::open(&GpuOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    let mut rays = GpuRays::new(&gpu, GpuRayOptions::default());
    let (mut rng, mut score) = (fastrand::Rng::with_seed(32), Score::default());
    for round in 0..3 {
        let centre = [700.0 * f64::from(round), -300.0 * f64::from(round), 5.0];
        let world = MovingWorld::new(&mut rng, centre, round);
        let mut scene = world.scene();
        scene.update_for_gpu(&world.dynamics, &world.past);
        rays.update(&scene).unwrap();
        let (spec, path) = (even_fan(), path(&mut rng, centre));
        let at_once = LidarSpec {
            motion_distortion: false,
            ..spec.clone()
        };
        let n_bytes = (spec.channels * spec.columns) as usize * size_of::<SemanticLidarPoint>();
        let mut bytes = vec![vec![0; n_bytes]; 2];
        let mut lidars = [Lidar::new(spec.clone()), Lidar::new(at_once.clone())];
        lidars
            .iter_mut()
            .for_each(|lidar| lidar.set_past(TURN_NANOS));
        let jobs = lidars
            .iter_mut()
            .zip(&mut bytes)
            .map(|(lidar, bytes)| ScanJob {
                lidar,
                path,
                noise: Noise::new(1, 2, 3),
                ignored: None,
                place: Place::Memory(bytes),
            });
        let outcomes = rays.scan(jobs.collect()).wait().unwrap();
        for (bytes, outcome) in bytes.iter_mut().zip(outcomes) {
            bytes.truncate(outcome.n_points as usize * size_of::<SemanticLidarPoint>());
        }
        let points: Vec<SemanticLidarPoint> = bytemuck::pod_collect_to_vec(&bytes[0]);
        compare(&points, &spec, &path, &world, &mut score);

        // Beside it, what looks from one place at one time sees the world as it is at the tick.
        scene.update_for_gpu(&world.dynamics, &Past::default());
        rays.update(&scene).unwrap();
        let mut alone = vec![0; n_bytes];
        let job = ScanJob {
            lidar: &mut Lidar::new(at_once),
            path,
            noise: Noise::new(1, 2, 3),
            ignored: None,
            place: Place::Memory(&mut alone),
        };
        let outcome = rays.scan(vec![job]).wait().unwrap();
        alone.truncate(outcome[0].n_points as usize * size_of::<SemanticLidarPoint>());
        assert!(alone == bytes[1]);
    }
    score.judge(1500);
}

/// Four channels 0.2 ms apart: in that time a thing at 40 m/s goes 24 mm.
#[test]
fn channels_of_a_sold_lidar_each_have_their_own_time() {
    let (mut rng, mut score) = (fastrand::Rng::with_seed(33), Score::default());
    for round in 0..3 {
        let centre = [500.0 * f64::from(round), 80.0, 5.0];
        let world = MovingWorld::new(&mut rng, centre, round);
        let mut scene = world.scene();
        scene.update_moving(&world.dynamics, &world.past);
        let spec = LidarSpec {
            semantic: false,
            returns: true,
            channels: 16,
            columns: 100,
            fire_offsets_ns: vec![0.0, 2e5, 4e5, 6e5],
            clockwise: true,
            attenuation_per_m: 0.0,
            ..even_fan()
        };
        let pose = random_pose(&mut rng, centre, 8.0);
        let mut lidar = Lidar::new(spec.clone());
        lidar.set_window(TURN_NANOS);
        lidar.set_past(TURN_NANOS);
        let bytes = bytes_of(&mut lidar, &scene, &SensorPath::still(pose));
        let points: Vec<LidarReturn> = bytemuck::pod_collect_to_vec(&bytes);
        let mut points = points.iter().peekable();
        for channel in 0..spec.channels {
            for column in 0..spec.columns {
                let fired_nanos = spec.firing_nanos(channel, column);
                let azimuth = azimuth_rad(&spec, column) + spec.aside_rad(channel);
                let ray = direction(spec.elevation_rad(channel), azimuth);
                let is_of_ray = |point: &&LidarReturn| {
                    u32::from(point.ring) == channel
                        && (f64::from(point.time_ns) - fired_nanos).abs() < 1.0
                };
                let found = points.next_if(is_of_ray).map(|point| {
                    let at = Vector3::from(point.hit_in_sensor_m.map(f64::from));
                    assert!(at.cross(&ray).norm() < 1e-5 * at.norm(), "{point:?}");
                    (at.norm(), ObjectId(point.object_id), Class(point.class))
                });
                let (origin, forward) = (pose.translation.vector.into(), pose.rotation * ray);
                score.add(
                    found,
                    (&origin, &forward, spec.range_m),
                    &world,
                    -fired_nanos,
                );
            }
        }
        assert!(points.next().is_none());
    }
    // A bundle walks the hierarchies at the middle of its firings, so a ray near an edge may meet
    // what is 12 mm aside; the distance to what it meets is that of its own time.
    score.judge(1500);
}

#[test]
fn a_world_at_rest_and_a_lidar_that_sees_all_at_once_give_the_same_bytes() {
    let mut rng = fastrand::Rng::with_seed(34);
    let world = MovingWorld::new(&mut rng, [0.0; 3], 0);
    let path = path(&mut rng, [0.0; 3]);
    for motion_distortion in [false, true] {
        let spec = LidarSpec {
            motion_distortion,
            ..even_fan()
        };
        let mut scene = world.scene();
        scene.update(&world.dynamics);
        let rest = bytes_of(&mut Lidar::new(spec.clone()), &scene, &path);
        let mut lidar = Lidar::new(spec.clone());
        lidar.set_past(TURN_NANOS);
        assert!(rest == bytes_of(&mut lidar, &scene, &path));
        scene.update_moving(&world.dynamics, &world.past);
        assert!(rest == bytes_of(&mut Lidar::new(spec), &scene, &path));
        let moving = bytes_of(&mut lidar, &scene, &path);
        assert_eq!(rest == moving, !motion_distortion);
    }
}

/// What turns by exactly half a turn in a tick has no shorter way; any will do, but it is seen.
#[test]
fn poses_that_are_opposite_or_no_numbers_hide_nothing() {
    let mut assets = SceneAssets::default();
    let cube = assets.add_mesh(cuboid(Class::CAR, [1.0; 3]));
    let at = |x: f64, yaw: f64| Isometry3::new(Vector3::new(x, 0.0, 0.0), Vector3::z() * yaw);
    let dynamics = [moving(cube, 1, at(10.0, 0.0))];
    for (earlier, expected_m) in [
        (at(10.0, std::f64::consts::PI), 9.0),
        (at(f64::NAN, 0.0), 9.0),
        (at(8.0, 0.0), 8.0),
    ] {
        let past = Past {
            ages_nanos: vec![TURN_NANOS],
            moved: vec![0],
            poses: vec![earlier],
        };
        let mut scene = RayScene::load(&assets);
        scene.update_moving(&dynamics, &past);
        // Two columns: ahead, half a turn before the end, and behind.
        let mut lidar = Lidar::new(LidarSpec {
            channels: 1,
            columns: 2,
            upper_fov_deg: 0.0,
            ..even_fan()
        });
        lidar.set_past(TURN_NANOS);
        let still = SensorPath::still(Isometry3::identity());
        let bytes = bytes_of(&mut lidar, &scene, &still);
        let points: Vec<SemanticLidarPoint> = bytemuck::pod_collect_to_vec(&bytes);
        assert_eq!(points.len(), 1, "{earlier}");
        let found_m = f64::from(points[0].hit_in_sensor_m[0]);
        assert!((found_m - expected_m).abs() < 1e-4, "{found_m} {earlier}");
    }
}
