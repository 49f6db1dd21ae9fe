//! KITTI's text of projection matrices, `P2: …`: pinholes beside one another.

use nalgebra::{Isometry3, Translation3, Vector3};
use schema_types::lens::LensModel;
use schema_types::space::sensor_from_camera;

use crate::camera::{Camera, Matrix};
use crate::fault::{CalibrationError, Fault};
use crate::format::Format;
use crate::said;
use crate::tree::Node;

/// Whether a key names a projection: `P2` of the benchmarks, `P_rect_02` of the raw data.
pub fn is_projection(key: &str) -> bool {
    camera_of(key).is_some()
}

/// The camera of a projection: `02`.
fn camera_of(key: &str) -> Option<String> {
    let digits = key.strip_prefix("P_rect_").or(key.strip_prefix('P'))?;
    let number: u32 = digits.parse().ok()?;
    Some(format!("{number:02}"))
}

/// Numbers of a line behind its colon.
fn numbers<const N: usize>(at: &Node) -> Result<[f64; N], Fault> {
    let found: Option<Vec<f64>> = at
        .text()
        .map(|text| text.split_whitespace().map(|it| it.parse().ok()).collect())
        .unwrap_or_default();
    let found = found.filter(|it: &Vec<f64>| it.iter().all(|it| it.is_finite()));
    let all = found.and_then(|it| it.try_into().ok());
    all.ok_or_else(|| at.wrong(&format!("{N} numbers with spaces between")))
}

/// Reads every projection as a camera; places count from the camera 0.
pub fn read(root: &Node, size_px: Option<[u32; 2]>) -> Result<Vec<Camera>, Fault> {
    let mut cameras = Vec::new();
    for (key, at) in root.entries() {
        let Some(number) = camera_of(key) else {
            continue;
        };
        let p: [f64; 12] = numbers(at)?;
        let [fx, skew, cx, tx, zero, fy, cy, ty, a, b, one, tz] = p;
        if [skew, zero, a, b, one - 1.0] != [0.0; 5] {
            return Err(at.fault(format!(
                "{} must be fx 0 cx tx 0 fy cy ty 0 0 1 tz",
                at.name()
            )));
        }
        let own = match root.get(&format!("S_rect_{number}")) {
            Some(size) => {
                let [width, height] = numbers::<2>(size)?;
                Some([width.round() as u32, height.round() as u32])
            }
            None => size_px,
        };
        let size_px = size_or_fault(at, own, Format::Kitti)?;
        let matrix = Matrix {
            focal_px: [fx, fy],
            centre_px: [cx, cy],
        };
        let name = format!("image_{number}");
        let mut camera = Camera::new(at, name, size_px, LensModel::Pinhole {}, matrix)?;
        // A point of camera 0 is seen at K (point + shift).
        let shift = Vector3::new((tx - cx * tz) / fx, (ty - cy * tz) / fy, tz);
        let place = sensor_from_camera() * -shift;
        camera.carrier_from_sensor = Some(Isometry3::from_parts(
            Translation3::from(place),
            nalgebra::UnitQuaternion::identity(),
        ));
        cameras.push(camera);
    }
    Ok(cameras)
}

/// The size of images that a format does not tell.
pub fn size_or_fault(
    at: &Node,
    size_px: Option<[u32; 2]>,
    format: Format,
) -> Result<[u32; 2], Fault> {
    size_px.ok_or_else(|| {
        at.fault(format!(
            "files of {} do not tell how large the images are; add --size, e.g. --size 1242x375",
            format.name()
        ))
    })
}

/// Writes a camera as `P2`, at the place of camera 0.
pub fn write(camera: &Camera) -> Result<String, CalibrationError> {
    let Matrix {
        focal_px: [fx, fy],
        centre_px: [cx, cy],
    } = camera.matrix(Format::Kitti)?;
    if camera.opencv() != Some([0.0; 14])
        || matches!(camera.lens.model(), LensModel::Unified { .. })
    {
        return Err(camera.refused(Format::Kitti, ""));
    }
    let line = |key: &str, data: &[f64]| {
        let texts: Vec<String> = data.iter().map(|it| said::number(*it)).collect();
        format!("{key}: {}\n", texts.join(" "))
    };
    let p = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
    let turn = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    Ok([line("P2", &p), line("R0_rect", &turn)].concat())
}
