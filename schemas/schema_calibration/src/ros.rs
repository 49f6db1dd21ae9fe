//! ROS's `sensor_msgs/CameraInfo`, and its file in YAML.

use schema_types::lens::{Lens, LensModel};

use crate::camera::{Camera, Matrix, fisheye, opencv};
use crate::fault::{CalibrationError, Fault};
use crate::format::Format;
use crate::opencv::{coefficients, matrix_of};
use crate::said;
use crate::tree::Node;

/// What a `CameraInfo` says of a lens: its model and the coefficients D.
#[derive(Clone, Debug, PartialEq)]
pub struct Distortion {
    /// `plumb_bob`, `rational_polynomial` or `equidistant`.
    pub model: &'static str,
    /// 5, 8 or 4 of them.
    pub coefficients: Vec<f64>,
}

/// What ROS has words for; `None` if it has none for this lens.
pub fn distortion(lens: &Lens) -> Option<Distortion> {
    if lens.plane().shear_px != [0.0; 2] || matches!(lens.model(), LensModel::Unified { .. }) {
        return None;
    }
    if let Some(four) = fisheye(lens) {
        return Some(Distortion {
            model: "equidistant",
            coefficients: four.into(),
        });
    }
    let all = opencv(lens)?;
    let (radial, prism_and_tilt) = all.split_at(8);
    if prism_and_tilt.iter().any(|it| *it != 0.0) {
        return None;
    }
    let (model, n) = match radial[5..] == [0.0; 3] {
        true => ("plumb_bob", 5),
        false => ("rational_polynomial", 8),
    };
    Some(Distortion {
        model,
        coefficients: radial[..n].into(),
    })
}

/// Reads the camera. Rectification and projection are those of another image, and not read.
pub fn read(root: &Node) -> Result<Vec<Camera>, Fault> {
    let size_px = root.size("image_width", "image_height")?;
    let matrix = matrix_of(root.need("camera_matrix")?)?;
    let at = root.need("distortion_coefficients")?;
    let given = at.need("data")?.numbers()?;
    let kind = root.need("distortion_model")?;
    let model = match kind.text() {
        Some("plumb_bob") => coefficients(at, given, &[4, 5])?,
        Some("rational_polynomial") => coefficients(at, given, &[8, 12, 14])?,
        Some("equidistant" | "fisheye") => LensModel::KannalaBrandt {
            coefficients: at.need("data")?.exactly("k1 to k4")?,
        },
        _ => return Err(kind.wrong("plumb_bob, rational_polynomial or equidistant")),
    };
    let name = root.get("camera_name").and_then(Node::text);
    let name = name.unwrap_or("camera").to_owned();
    Camera::new(root, name, size_px, model, matrix).map(|camera| vec![camera])
}

/// Writes a camera.
pub fn write(camera: &Camera) -> Result<String, CalibrationError> {
    let Matrix {
        focal_px: [fx, fy],
        centre_px: [cx, cy],
    } = camera.matrix(Format::Ros)?;
    let how = match camera.lens.model() {
        LensModel::OpenCv { .. } => "with s1 to s4 or a tilt",
        _ => "",
    };
    let said = distortion(&camera.lens).ok_or_else(|| camera.refused(Format::Ros, how))?;
    let [width, height] = camera.size_px;
    let table = |name: &str, rows: usize, data: &[f64]| {
        let cols = data.len() / rows;
        let data = said::list(data);
        format!("{name}:\n  rows: {rows}\n  cols: {cols}\n  data: {data}\n")
    };
    Ok([
        format!(
            "image_width: {width}\nimage_height: {height}\ncamera_name: {}\n",
            camera.name
        ),
        table(
            "camera_matrix",
            3,
            &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        ),
        format!("distortion_model: {}\n", said.model),
        table("distortion_coefficients", 1, &said.coefficients),
        table(
            "rectification_matrix",
            3,
            &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        ),
        table(
            "projection_matrix",
            3,
            &[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ),
    ]
    .concat())
}
