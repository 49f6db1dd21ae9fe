//! What a shadow map shows: its cell of the ground, its sides, and the casters that reach into it.

use nalgebra::{Isometry3, Matrix4, Point3, Vector3};
use sensor_core::{DynamicInstance, MeshId, Scene};

use super::caster::{Caster, Casters, MatrixRows, top_rows};
use crate::assets::{Meshes, Sphere};
use crate::quality::Quality;

/// One cascade.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cascade {
    /// Side of a cell, metres.
    pub cell_m: f64,
    /// Half the side of the area that a map covers, metres. A camera in the corner of its cell sees
    /// shadows up to this distance less 0.7 cells.
    pub half_side_m: f64,
    /// Half the depth of what a map covers, metres.
    pub half_depth_m: f64,
    /// Casters have the level of detail of this distance, or of their distance from the cell's
    /// centre if that is larger.
    pub caster_distance_m: f64,
    pub side_px: u32,
    pub casters: Casters,
}

impl Cascade {
    /// The map around the camera.
    pub fn near(quality: Quality) -> Cascade {
        let side_px = match quality {
            Quality::Low => 2048,
            Quality::High => 4096,
        };
        Cascade {
            cell_m: 32.0,
            half_side_m: 82.0,
            half_depth_m: 250.0,
            caster_distance_m: 25.0,
            side_px,
            casters: Casters::StillAndMoving,
        }
    }

    /// The map for shadows further away.
    pub fn far() -> Cascade {
        Cascade {
            cell_m: 128.0,
            half_side_m: 400.0,
            half_depth_m: 500.0,
            caster_distance_m: 110.0,
            side_px: 4096,
            casters: Casters::Still,
        }
    }
}

/// Cameras of at least this focal length get the largest map. With half the length, shadows are
/// half as sharp and half the side is enough.
const SHARP_FOCAL_PX: f64 = 300.0;
/// Smallest side of a map.
const MIN_SIDE_PX: u32 = 1024;

/// Unit vectors to the right and down in the map, and along the light.
fn axes(sun_towards: Vector3<f64>) -> [Vector3<f64>; 3] {
    let along = -sun_towards;
    let right = if along.x.abs() + along.y.abs() > 1e-6 {
        along.cross(&Vector3::z()).normalize()
    } else {
        Vector3::x()
    };
    [right, along.cross(&right), along]
}

/// A moving instance with its bounding sphere.
pub(crate) struct MovingCaster<'s> {
    instance: &'s DynamicInstance,
    sphere: Sphere,
}

impl<'s> MovingCaster<'s> {
    pub fn all_of(assets: &Meshes, scene: &'s Scene) -> Vec<MovingCaster<'s>> {
        let sphere = |instance: &DynamicInstance| {
            Sphere::of(
                assets.scene_assets.mesh(instance.mesh),
                &instance.world_from_mesh,
            )
        };
        scene
            .dynamics
            .iter()
            .map(|instance| MovingCaster {
                instance,
                sphere: sphere(instance),
            })
            .collect()
    }
}

impl Cascade {
    /// The same for a camera of this focal length.
    pub fn seen_with(&self, focal_px: f64) -> Cascade {
        let mut side_px = self.side_px;
        let mut sharp_px = SHARP_FOCAL_PX;
        while focal_px < sharp_px && side_px / 2 >= MIN_SIDE_PX {
            (side_px, sharp_px) = (side_px / 2, sharp_px / 2.0);
        }
        Cascade { side_px, ..*self }
    }

    /// Sizes that its maps can have.
    pub fn n_sizes(&self) -> u64 {
        1 + u64::from((self.side_px / MIN_SIDE_PX).max(1).ilog2())
    }

    pub fn cell_of(&self, eye: &Isometry3<f64>) -> [i64; 3] {
        std::array::from_fn(|axis| (eye.translation.vector[axis] / self.cell_m).round() as i64)
    }

    fn centre_m(&self, cell: [i64; 3]) -> Vector3<f64> {
        Vector3::from(cell.map(|i| i as f64 * self.cell_m))
    }

    /// World to (u, v, depth), each 0..=1 inside the map.
    pub fn shadow_from_world(&self, cell: [i64; 3], sun_towards: Vector3<f64>) -> Matrix4<f64> {
        let centre = self.centre_m(cell);
        let scales = [
            0.5 / self.half_side_m,
            0.5 / self.half_side_m,
            0.5 / self.half_depth_m,
        ];
        let mut matrix = Matrix4::identity();
        for (row, (axis, scale)) in axes(sun_towards).into_iter().zip(scales).enumerate() {
            for column in 0..3 {
                matrix[(row, column)] = axis[column] * scale;
            }
            matrix[(row, 3)] = 0.5 - axis.dot(&centre) * scale;
        }
        matrix
    }

    /// A texel in units of the map's depth.
    pub fn texel_depth(&self) -> f32 {
        let texel_m = 2.0 * self.half_side_m / self.side_px as f64;
        (texel_m / (2.0 * self.half_depth_m)) as f32
    }

    /// The rows by which a camera looks a cell's map up: u, v, depth.
    pub fn shadow_from_camera(
        &self,
        cell: [i64; 3],
        sun_towards: Vector3<f64>,
        world_from_camera: &Isometry3<f64>,
    ) -> MatrixRows {
        let shadow_from_world = self.shadow_from_world(cell, sun_towards);
        top_rows(&(shadow_from_world * world_from_camera.to_homogeneous()))
    }

    fn touches(&self, sphere: &Sphere, cell: [i64; 3], axes: &[Vector3<f64>; 3]) -> bool {
        let offset = sphere.centre_m - Point3::from(self.centre_m(cell));
        let half = [self.half_side_m, self.half_side_m, self.half_depth_m];
        axes.iter()
            .zip(half)
            .all(|(axis, half)| axis.dot(&offset).abs() < half + sphere.radius_m)
    }

    pub fn still_casters(
        &self,
        assets: &Meshes,
        cell: [i64; 3],
        sun_towards: Vector3<f64>,
    ) -> Vec<Caster> {
        let (axes, matrix) = (axes(sun_towards), self.shadow_from_world(cell, sun_towards));
        let instances = assets.scene_assets.statics.iter().zip(&assets.spheres);
        instances
            .filter(|(instance, sphere)| {
                assets.casts_shadow(instance.mesh) && self.touches(sphere, cell, &axes)
            })
            .filter_map(|(instance, sphere)| {
                self.caster(
                    assets,
                    instance.mesh,
                    &instance.world_from_mesh,
                    sphere,
                    cell,
                    &matrix,
                )
            })
            .collect()
    }

    pub fn moving_casters(
        &self,
        assets: &Meshes,
        moving: &[MovingCaster<'_>],
        cell: [i64; 3],
        sun_towards: Vector3<f64>,
    ) -> Vec<Caster> {
        let (axes, matrix) = (axes(sun_towards), self.shadow_from_world(cell, sun_towards));
        let near = moving
            .iter()
            .filter(|moving| self.touches(&moving.sphere, cell, &axes));
        near.filter_map(|MovingCaster { instance, sphere }| {
            self.caster(
                assets,
                instance.mesh,
                &instance.world_from_mesh,
                sphere,
                cell,
                &matrix,
            )
        })
        .collect()
    }

    fn caster(
        &self,
        assets: &Meshes,
        mesh: MeshId,
        world_from_mesh: &Isometry3<f64>,
        sphere: &Sphere,
        cell: [i64; 3],
        shadow_from_world: &Matrix4<f64>,
    ) -> Option<Caster> {
        let away_m = (sphere.centre_m - Point3::from(self.centre_m(cell))).norm() - sphere.radius_m;
        let mesh = assets.level(mesh, away_m.max(self.caster_distance_m))?;
        let centre = shadow_from_world.transform_point(&sphere.centre_m);
        let (side_px, radius_px) = (
            self.side_px as f64,
            sphere.radius_m / (2.0 * self.half_side_m) * self.side_px as f64 + 1.0,
        );
        let span = |middle: f64| {
            let low = (middle * side_px - radius_px).clamp(0.0, side_px - 1.0);
            let high = (middle * side_px + radius_px).clamp(low, side_px - 1.0);
            (low as u32, high as u32 - low as u32 + 1)
        };
        let ((x, width), (y, height)) = (span(centre.x), span(centre.y));
        let matrix = top_rows(&(shadow_from_world * world_from_mesh.to_homogeneous()));
        Some(Caster {
            mesh,
            matrix,
            rect_px: [x, y, width, height],
        })
    }
}
