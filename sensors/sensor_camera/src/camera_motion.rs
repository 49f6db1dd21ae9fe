//! Where a camera is and where it was at the previous firing.

use std::sync::Arc;

use nalgebra::Isometry3;
use schema_types::SimTime;
use sensor_core::InstancePoses;
use sensor_spec::Intrinsics;

use crate::uniform::{MAX_BLOCKERS, MapPlace, ViewData};

/// Near plane, metres.
pub(crate) const NEAR_M: f64 = 0.1;

/// What flow and events need to know about the previous scheduled firing.
#[derive(Clone, Debug)]
pub(crate) struct Firing {
    pub world_from_camera: Isometry3<f64>,
    pub sim_time: SimTime,
    pub episode: u32,
    pub poses: Arc<InstancePoses>,
}

/// Pose of a camera in this and in the previous firing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CameraMotion {
    pub world_from_camera: Isometry3<f64>,
    pub camera_from_world: Isometry3<f64>,
    /// `camera_from_world` at the previous firing, or the current one if there was none.
    pub previous_camera_from_world: Isometry3<f64>,
}

impl CameraMotion {
    pub fn new(world_from_camera: Isometry3<f64>, previous: Option<&Firing>) -> Self {
        let camera_from_world = world_from_camera.inverse();
        // Equal poses give equal bits, so a camera at rest has a flow of exactly zero.
        let previous_camera_from_world = match previous {
            Some(firing) if firing.world_from_camera != world_from_camera => {
                firing.world_from_camera.inverse()
            }
            _ => camera_from_world,
        };
        CameraMotion {
            world_from_camera,
            camera_from_world,
            previous_camera_from_world,
        }
    }

    pub fn moved(&self) -> bool {
        self.previous_camera_from_world != self.camera_from_world
    }

    /// What shaders get of a view with this lens, without light, targets and places in lists.
    pub fn view_data(&self, lens: &Intrinsics) -> ViewData {
        let mut world_from_camera = rows(&self.world_from_camera);
        let eye = self.world_from_camera.translation.vector;
        // Patterns repeat every 1024 m, so that they stay sharp far from the origin.
        world_from_camera[0][3] = eye.x.rem_euclid(1024.0) as f32;
        world_from_camera[1][3] = eye.y.rem_euclid(1024.0) as f32;
        let turn = self.previous_camera_from_world.rotation * self.world_from_camera.rotation;
        let nowhere = MapPlace {
            tile: [0.0; 2],
            side: 1.0,
            layer: 0,
        };
        ViewData {
            lens_px: lens.as_array().map(|x| x as f32),
            size_px: [lens.width_px as f32, lens.height_px as f32],
            near_m: NEAR_M as f32,
            sky_depth_m: f32::INFINITY,
            world_from_camera,
            previous_from_camera: rows(&Isometry3::from_parts(Default::default(), turn)),
            shadow_from_camera: [[0.0; 4]; 3],
            far_shadow_from_camera: [[0.0; 4]; 3],
            turned: self.moved() as u32 as f32,
            has_shadows: 0.0,
            shadow_texel_depth: 0.0,
            far_shadow_texel_depth: 0.0,
            first_lamp: 0,
            first_lamp_tile: 0,
            layer: 0,
            wanted: 0,
            first_draw: 0,
            n_draws: 0,
            first_pixel: 0,
            n_blockers: 0,
            near_map: nowhere,
            far_map: nowhere,
            blockers: [[0.0; 4]; 2 * MAX_BLOCKERS],
            rest: [0; 4],
        }
    }
}

/// A rigid transform as three rows of `[rotation | translation]`.
pub(crate) fn rows(transform: &Isometry3<f64>) -> [[f32; 4]; 3] {
    let m = transform.to_homogeneous();
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)] as f32))
}
