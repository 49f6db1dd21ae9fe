//! What culling and drawing need to know of meshes and instances.

use nalgebra::{Isometry3, Point3};
use sensor_core::{Mesh, MeshId, SceneAssets};

use super::bounds::Bounds;

/// A draw call's range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MeshDraw {
    pub first_idx: u32,
    pub n_indices: u32,
    pub base_vertex: i32,
    /// Whether any of it may have windows.
    pub has_walls: bool,
}

/// Bounding sphere of a static instance in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sphere {
    pub centre_m: Point3<f64>,
    pub radius_m: f64,
}

impl Sphere {
    pub fn of(mesh: &Mesh, world_from_mesh: &Isometry3<f64>) -> Self {
        let centre = Point3::from(mesh.centre_m.map(f64::from));
        Sphere {
            centre_m: world_from_mesh * centre,
            radius_m: mesh.radius_m as f64,
        }
    }
}

/// Static instances as a structure of arrays, for vectorised culling; poses are rows of `[rotation
/// | translation]`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Still {
    pub bounds: Bounds,
    pub meshes: Vec<MeshId>,
    pub world_from_mesh: Vec<[[f64; 4]; 3]>,
}

impl Still {
    pub fn of(scene_assets: &SceneAssets, spheres: &[Sphere]) -> Still {
        let statics = scene_assets.statics.iter();
        Still {
            bounds: bounds_of(spheres),
            meshes: statics.map(|instance| instance.mesh).collect(),
            world_from_mesh: scene_assets
                .statics
                .iter()
                .map(|instance| matrix_rows(&instance.world_from_mesh))
                .collect(),
        }
    }
}

/// The spheres in the layout that culling uses.
pub(crate) fn bounds_of(spheres: &[Sphere]) -> Bounds {
    Bounds::of(
        spheres
            .iter()
            .map(|sphere| (sphere.centre_m.coords.into(), sphere.radius_m)),
    )
}

/// A rigid transform as three rows of `[rotation | translation]`.
pub(crate) fn matrix_rows(transform: &Isometry3<f64>) -> [[f64; 4]; 3] {
    let m = transform.to_homogeneous();
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)]))
}

/// A rotation as shaders get it.
pub(crate) fn quaternion(transform: &Isometry3<f64>) -> [f32; 4] {
    let q = transform.rotation.quaternion();
    [q.i as f32, q.j as f32, q.k as f32, q.w as f32]
}
