//! Goal: images of cameras with a lens show what their rays meet: a box's corners where the lens
//! projects them, distances along the ray, fronts alone, nothing beyond the field.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use schema_types::lens::{Lens, LensModel, Plane};
use schema_types::space::sensor_from_camera;
use schema_types::{ActorId, Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, SceneAssets, StaticInstance};
use sensor_ray::{LabelImages, RayCamera, RayScene};

const WIDTH: usize = 800;
const HEIGHT: usize = 600;

/// What a camera saw.
struct Seen {
    depth: Vec<f32>,
    class: Vec<u8>,
    instance: Vec<u32>,
}

fn look(scene: &RayScene, lens: &Lens, pose: &Isometry3<f64>, hidden: &[ActorId]) -> Seen {
    let n = WIDTH * HEIGHT;
    let (mut depth, mut class, mut instance) = (vec![0; 4 * n], vec![9; n], vec![7; 4 * n]);
    let camera = RayCamera::new(lens, [WIDTH as u32, HEIGHT as u32]);
    let images = LabelImages {
        depth: Some(&mut depth),
        class: Some(&mut class),
        instance: Some(&mut instance),
        normals: None,
    };
    camera.cast(scene, pose, hidden, images);
    Seen {
        depth: bytemuck::pod_collect_to_vec(&depth),
        class,
        instance: bytemuck::pod_collect_to_vec(&instance),
    }
}

fn lens(model: LensModel, focal_px: f64, max_deg: f64) -> Lens {
    let plane = Plane {
        focal_px: [focal_px, focal_px],
        shear_px: [0.0; 2],
        centre_px: [402.25, 297.5],
    };
    Lens::new(model, plane, Some(f64::to_radians(max_deg))).unwrap()
}

fn fisheye(max_deg: f64) -> Lens {
    let coefficients = [0.0831, -0.0111, 0.0086, -0.0009];
    lens(LensModel::KannalaBrandt { coefficients }, 160.0, max_deg)
}

/// A box about a place, in world axes.
fn boxes(places: &[([f64; 3], [f64; 3])]) -> RayScene {
    let mut assets = SceneAssets::default();
    for (i, (centre, half)) in places.iter().enumerate() {
        let mut builder = MeshBuilder::new("box");
        let surface = Surface::new(Class::WALLS, Material::Concrete, [128; 3]);
        builder.cuboid(surface, centre.map(|x| x as f32), half.map(|x| x as f32));
        let mesh = assets.add_mesh(builder.finish());
        assets.statics.push(StaticInstance {
            mesh,
            world_from_mesh: Isometry3::identity(),
            object: ObjectId::scenery(i as u32 + 1),
        });
    }
    RayScene::load(&assets)
}

fn pose() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_euler_angles(0.05, -0.1, 0.3);
    Isometry3::from_parts(Vector3::new(1.0, -2.0, 1.5).into(), turn)
}

/// Oracle: the lens's own projection of the box's eight corners. The outline of what is seen reaches
/// as far in each direction as the corner that lies outermost there.
#[test]
fn corners_of_a_box_are_where_a_lens_of_190_degrees_projects_them() {
    let lens = fisheye(95.0);
    let pose = pose();
    // One ahead, one nearly aside: 80° from the axis.
    for towards_deg in [5.0f64, 80.0] {
        let (sin, cos) = towards_deg.to_radians().sin_cos();
        let middle = pose * Point3::new(6.0 * cos, 6.0 * sin, 0.2);
        let half = [0.7, 0.5, 0.6];
        let scene = boxes(&[(middle.coords.into(), half)]);
        let seen = look(&scene, &lens, &pose, &[]);
        let in_image = |at: Point3<f64>| {
            let in_camera = sensor_from_camera().inverse() * (pose.inverse() * at).coords;
            lens.project(in_camera.into()).unwrap()
        };
        // The outline's own corners: of the image's extremes in many directions.
        let corners: Vec<[f64; 2]> = (0..8)
            .map(|i| {
                let sign = [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { -1.0 } else { 1.0 });
                let off = Vector3::new(sign[0] * half[0], sign[1] * half[1], sign[2] * half[2]);
                in_image(middle + off)
            })
            .collect();
        let on: Vec<[f64; 2]> = (0..WIDTH * HEIGHT)
            .filter(|pixel| seen.instance[*pixel] == ObjectId::scenery(1).0)
            .map(|pixel| [(pixel % WIDTH) as f64 + 0.5, (pixel / WIDTH) as f64 + 0.5])
            .collect();
        assert!(on.len() > 100, "{} pixels at {towards_deg}", on.len());
        // Straight edges bend, but hardly over the size of this box: an extreme lies at a corner.
        for step in 0..16 {
            let (s, c) = (std::f64::consts::TAU * f64::from(step) / 16.0).sin_cos();
            let most = |points: &[[f64; 2]]| {
                let along = points.iter().map(|p| p[0] * c + p[1] * s);
                along.fold(f64::MIN, f64::max)
            };
            let [expected, found] = [most(&corners), most(&on)];
            // The outermost pixel's middle lies up to half a pixel, along a diagonal 0.71, inside; a
            // sharp corner between pixels loses as much again.
            assert!(
                found < expected + 0.5 && found > expected - 1.5,
                "{towards_deg}° {step}: {found} instead of {expected}"
            );
        }
        // The pixel that holds the box's middle is on it, and its class is the box's.
        let [x, y] = in_image(middle).map(|it| it as usize);
        assert_eq!(seen.class[y * WIDTH + x], Class::WALLS.0);
    }
}

/// Oracle: the ray's own equation with a plane.
#[test]
fn depth_is_the_distance_along_the_ray_also_behind_the_camera() {
    let lens = fisheye(110.0);
    let pose = pose();
    // A floor 1.5 m below the camera and wide enough to lie behind it.
    let scene = boxes(&[([0.0, 0.0, -0.5], [400.0, 400.0, 0.5])]);
    let seen = look(&scene, &lens, &pose, &[]);
    let (mut n, mut n_behind, mut n_beyond) = (0, 0, 0);
    for pixel in 0..WIDTH * HEIGHT {
        let at = [(pixel % WIDTH) as f64 + 0.5, (pixel / WIDTH) as f64 + 0.5];
        let Some(direction) = lens.unproject(at) else {
            n_beyond += 1;
            let nothing = (seen.depth[pixel], seen.class[pixel], seen.instance[pixel]);
            assert_eq!(nothing, (f32::INFINITY, 0, 0));
            continue;
        };
        let ray = pose.rotation * (sensor_from_camera() * Vector3::from(direction));
        let expected = -pose.translation.vector.z / ray.z;
        if expected.is_nan() || expected <= 0.0 {
            assert_eq!((seen.depth[pixel], seen.class[pixel]), (f32::INFINITY, 11));
        } else if expected < 100.0 {
            let error = (f64::from(seen.depth[pixel]) - expected).abs();
            assert!(
                error <= 1e-3,
                "{at:?}: {} instead of {expected}",
                seen.depth[pixel]
            );
            n += 1;
            n_behind += usize::from(direction[2] < 0.0);
        }
    }
    assert!(
        n > 50_000 && n_behind > 500 && n_beyond > 1000,
        "{n} {n_behind} {n_beyond}"
    );
}

#[test]
fn from_within_a_box_its_walls_are_not_seen() {
    let scene = boxes(&[
        ([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
        ([6.0, 0.0, 0.0], [0.5, 9.0, 9.0]),
    ]);
    let seen = look(&scene, &fisheye(95.0), &Isometry3::identity(), &[]);
    let middle = 297 * WIDTH + 402;
    assert_eq!(seen.instance[middle], ObjectId::scenery(2).0);
    assert!(
        (seen.depth[middle] - 5.5).abs() < 1e-3,
        "{}",
        seen.depth[middle]
    );
    assert!(!seen.instance.contains(&ObjectId::scenery(1).0));
}

/// Images so small that a tile's rays spread over half a sphere.
#[test]
fn images_of_few_pixels_have_all_their_rays() {
    let scene = boxes(&[([0.0, 0.0, -0.5], [400.0, 400.0, 0.5])]);
    let plane = Plane {
        focal_px: [4.2, 4.2],
        shear_px: [0.0; 2],
        centre_px: [8.0, 8.0],
    };
    let lens = Lens::new(LensModel::Equidistant {}, plane, Some(1.9)).unwrap();
    let camera = RayCamera::new(&lens, [16, 16]);
    let mut depth = vec![0u8; 4 * 256];
    let pose = Isometry3::translation(0.0, 0.0, 2.0);
    camera.cast(
        &scene,
        &pose,
        &[],
        LabelImages {
            depth: Some(&mut depth),
            ..Default::default()
        },
    );
    let depth: Vec<f32> = bytemuck::pod_collect_to_vec(&depth);
    for (pixel, depth) in depth.iter().enumerate() {
        let at = [(pixel % 16) as f64 + 0.5, (pixel / 16) as f64 + 0.5];
        let direction = lens.unproject(at);
        let down = direction.map_or(0.0, |it| (sensor_from_camera() * Vector3::from(it)).z);
        let expected = if down < -0.01 {
            (2.0 / -down) as f32
        } else {
            f32::INFINITY
        };
        if !(-0.01..0.0).contains(&down) {
            assert!(
                (depth - expected).abs() < 1e-2 || *depth == expected,
                "{at:?} {depth} {expected}"
            );
        }
    }
}
