//! nuScenes' `calibrated_sensor.json`: pinholes, and where they are on the vehicle.

use std::fmt::Write as _;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use schema_types::lens::LensModel;

use crate::camera::{Camera, Matrix, from_optical};
use crate::fault::{CalibrationError, Fault};
use crate::format::Format;
use crate::kitti::size_or_fault;
use crate::said;
use crate::tree::Node;

/// Reads the cameras; lidars and radars have no matrix.
pub fn read(root: &Node, size_px: Option<[u32; 2]>) -> Result<Vec<Camera>, Fault> {
    let sensors = root
        .list()
        .ok_or_else(|| root.wrong("a list of calibrated sensors"))?;
    let is_camera = |it: &&Node| {
        it.get("camera_intrinsic")
            .and_then(Node::list)
            .is_some_and(|it| !it.is_empty())
    };
    let mut cameras = Vec::new();
    for (idx, at) in sensors.iter().filter(is_camera).enumerate() {
        let k: [[f64; 3]; 3] = at.need("camera_intrinsic")?.matrix()?;
        let matrix = Matrix {
            focal_px: [k[0][0], k[1][1]],
            centre_px: [k[0][2], k[1][2]],
        };
        let name = format!("camera_{idx}");
        let size_px = size_or_fault(at, size_px, Format::NuScenes)?;
        let mut camera = Camera::new(at, name, size_px, LensModel::Pinhole {}, matrix)?;
        let [w, x, y, z] = at.need("rotation")?.exactly("w, x, y, z")?;
        let [tx, ty, tz] = at.need("translation")?.exactly("x, y, z")?;
        let turn = Quaternion::new(w, x, y, z);
        if (turn.norm() - 1.0).abs() > 1e-3 {
            return Err(at
                .need("rotation")?
                .wrong("a quaternion w, x, y, z of length 1"));
        }
        camera.carrier_from_sensor = Some(from_optical(Isometry3::from_parts(
            Translation3::new(tx, ty, tz),
            UnitQuaternion::from_quaternion(turn),
        )));
        cameras.push(camera);
    }
    Ok(cameras)
}

/// Writes every camera.
pub fn write(cameras: &[Camera]) -> Result<String, CalibrationError> {
    let mut text = String::from("[\n");
    for (idx, camera) in cameras.iter().enumerate() {
        let Matrix {
            focal_px: [fx, fy],
            centre_px: [cx, cy],
        } = camera.matrix(Format::NuScenes)?;
        if camera.opencv() != Some([0.0; 14])
            || matches!(camera.lens.model(), LensModel::Unified { .. })
        {
            return Err(camera.refused(Format::NuScenes, ""));
        }
        let pose = camera.carrier_from_camera().unwrap_or_default();
        let [x, y, z, w]: [f64; 4] = pose.rotation.coords.into();
        let rows = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]].map(|it| said::list(&it));
        let _ = write!(
            text,
            "{{\n\"token\": \"{0}\",\n\"sensor_token\": \"{0}\",\n\"translation\": {1},\n\"rotation\": {2},\n\"camera_intrinsic\": [{3}]\n}}",
            camera.name,
            said::list(pose.translation.vector.as_slice()),
            said::list(&[w, x, y, z]),
            rows.join(", ")
        );
        text.push_str(if idx + 1 < cameras.len() { ",\n" } else { "\n" });
    }
    text.push_str("]\n");
    Ok(text)
}
