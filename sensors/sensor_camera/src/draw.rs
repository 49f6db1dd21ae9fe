//! What a view sees: culling, level of detail, front-to-back order, and the matrices of what is left.

use nalgebra::{Isometry3, Vector3};
use sensor_core::Scene;
use sensor_spec::Intrinsics;

use crate::assets::{GpuAssets, MeshDraw, Sphere};
use crate::uniform::InstanceData;
use crate::view::Firing;

/// One draw call: a mesh range and the number of its instance among those of the view.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DrawCall {
    pub mesh: MeshDraw,
    pub instance_idx: u32,
    distance_m: f64,
}

/// What a view draws.
#[derive(Clone, Debug, Default)]
pub(crate) struct Drawn {
    /// Nearest first.
    pub calls: Vec<DrawCall>,
    pub instances: Vec<InstanceData>,
    /// Where the view's instances begin in the list of all views'.
    pub first_instance: u32,
}

/// Near plane, metres.
pub(crate) const NEAR_M: f64 = 0.1;

/// Pose of a camera in this and in the previous firing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraMotion {
    pub world_from_camera: Isometry3<f64>,
    pub camera_from_world: Isometry3<f64>,
    /// As `camera_from_world` at the previous firing; the same one if there was none.
    pub previous_camera_from_world: Isometry3<f64>,
}

impl CameraMotion {
    pub fn new(world_from_camera: Isometry3<f64>, previous: Option<&Firing>) -> Self {
        let camera_from_world = world_from_camera.inverse();
        // Equal poses give equal bits, so a camera at rest has a flow of exactly zero.
        let previous_camera_from_world = match previous {
            Some(firing) if firing.world_from_camera != world_from_camera => firing.world_from_camera.inverse(),
            _ => camera_from_world,
        };
        CameraMotion { world_from_camera, camera_from_world, previous_camera_from_world }
    }

    pub fn moved(&self) -> bool {
        self.previous_camera_from_world != self.camera_from_world
    }
}

/// The four side planes of a pinhole camera, unit normals inwards, camera space.
struct Frustum([Vector3<f64>; 4]);

impl Frustum {
    fn new(lens: &Intrinsics) -> Self {
        let (x, y) = (0.5 * lens.width_px as f64 / lens.focal_px, 0.5 * lens.height_px as f64 / lens.focal_px);
        Frustum([
            Vector3::new(1.0, 0.0, x).normalize(),
            Vector3::new(-1.0, 0.0, x).normalize(),
            Vector3::new(0.0, 1.0, y).normalize(),
            Vector3::new(0.0, -1.0, y).normalize(),
        ])
    }

    fn sees(&self, centre: &Vector3<f64>, radius_m: f64) -> bool {
        centre.z > NEAR_M - radius_m && self.0.iter().all(|normal| normal.dot(centre) > -radius_m)
    }
}

/// The visible instances of `scene`, in the memory of an earlier call.
pub(crate) fn visible(
    scene: &Scene,
    assets: &GpuAssets,
    lens: &Intrinsics,
    motion: &CameraMotion,
    previous: Option<&Firing>,
    Drawn { calls, instances, first_instance }: &mut Drawn,
) {
    calls.clear();
    instances.clear();
    *first_instance = 0;
    let frustum = Frustum::new(lens);
    let level_if_seen = |sphere: &Sphere, mesh| {
        let centre = (motion.camera_from_world * sphere.centre_m).coords;
        let distance_m = (centre.norm() - sphere.radius_m).max(0.0);
        if frustum.sees(&centre, sphere.radius_m) { assets.level(mesh, distance_m).map(|level| (level, distance_m)) } else { None }
    };
    let static_previous = rows(&(motion.previous_camera_from_world * motion.world_from_camera));
    for (instance, sphere) in assets.scene_assets.statics.iter().zip(&assets.spheres) {
        let Some((mesh, distance_m)) = level_if_seen(sphere, instance.mesh) else { continue };
        calls.push(DrawCall { mesh, instance_idx: instances.len() as u32, distance_m });
        instances.push(InstanceData {
            camera_from_mesh: rows(&(motion.camera_from_world * instance.world_from_mesh)),
            previous_from_camera: static_previous,
            world_from_mesh_xyzw: quaternion(&instance.world_from_mesh),
            object_id: instance.object.0,
            tint: [0; 4],
            lamps: 0,
            moved: motion.moved() as u32,
        });
    }
    for instance in &scene.dynamics {
        let sphere = Sphere::of(assets.scene_assets.mesh(instance.mesh), &instance.world_from_mesh);
        let Some((mesh, distance_m)) = level_if_seen(&sphere, instance.mesh) else { continue };
        let before = previous.and_then(|firing| firing.poses.get(instance.key())).copied().unwrap_or(instance.world_from_mesh);
        let moved = motion.moved() || before != instance.world_from_mesh;
        let mesh_from_camera = instance.world_from_mesh.inverse() * motion.world_from_camera;
        let [r, g, b] = instance.tint_rgb;
        calls.push(DrawCall { mesh, instance_idx: instances.len() as u32, distance_m });
        instances.push(InstanceData {
            camera_from_mesh: rows(&(motion.camera_from_world * instance.world_from_mesh)),
            previous_from_camera: rows(&(motion.previous_camera_from_world * before * mesh_from_camera)),
            world_from_mesh_xyzw: quaternion(&instance.world_from_mesh),
            object_id: instance.actor.0,
            tint: [r, g, b, 255],
            lamps: instance.lamps,
            moved: moved as u32,
        });
    }
    calls.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
}

/// A rigid transform as three rows of `[rotation | translation]`.
pub(crate) fn rows(transform: &Isometry3<f64>) -> [[f32; 4]; 3] {
    let m = transform.to_homogeneous();
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)] as f32))
}

fn quaternion(transform: &Isometry3<f64>) -> [f32; 4] {
    let q = transform.rotation.quaternion();
    [q.i as f32, q.j as f32, q.k as f32, q.w as f32]
}
