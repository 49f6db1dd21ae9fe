//! Where a camera is and where it was at the previous firing.

use std::sync::Arc;

use nalgebra::Isometry3;
use schema_types::SimTime;
use sensor_core::InstancePoses;

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
}

/// A rigid transform as three rows of `[rotation | translation]`.
pub(crate) fn rows(transform: &Isometry3<f64>) -> [[f32; 4]; 3] {
    let m = transform.to_homogeneous();
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)] as f32))
}
