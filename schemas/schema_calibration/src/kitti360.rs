//! KITTI-360's `image_02.yaml`: Mei's model, with OpenCV's first four coefficients.

use schema_types::lens::LensModel;

use crate::camera::{Camera, Matrix};
use crate::fault::{CalibrationError, Fault};
use crate::format::Format;
use crate::said;
use crate::tree::Node;

/// Reads the camera.
pub fn read(root: &Node) -> Result<Vec<Camera>, Fault> {
    let kind = root.need("model_type")?;
    if kind.text() != Some("MEI") {
        return Err(kind.wrong("MEI"));
    }
    let of = |table: &str, key: &str| root.need(table)?.need(key)?.number();
    let mut coefficients = Vec::with_capacity(4);
    for key in ["k1", "k2", "p1", "p2"] {
        coefficients.push(of("distortion_parameters", key)?);
    }
    let model = LensModel::Unified {
        mirror: of("mirror_parameters", "xi")?,
        coefficients,
    };
    let plane = "projection_parameters";
    let matrix = Matrix {
        focal_px: [of(plane, "gamma1")?, of(plane, "gamma2")?],
        centre_px: [of(plane, "u0")?, of(plane, "v0")?],
    };
    let name = root.get("camera_name").and_then(Node::text);
    let name = name.unwrap_or("camera").to_owned();
    let size_px = root.size("image_width", "image_height")?;
    Camera::new(root, name, size_px, model, matrix).map(|camera| vec![camera])
}

/// Writes a camera.
pub fn write(camera: &Camera) -> Result<String, CalibrationError> {
    let Matrix {
        focal_px,
        centre_px,
    } = camera.matrix(Format::Kitti360)?;
    let LensModel::Unified { mirror, .. } = camera.lens.model() else {
        return Err(camera.refused(Format::Kitti360, ""));
    };
    let four = camera.first_four();
    let four = four.ok_or_else(|| camera.refused(Format::Kitti360, "with k3 or more"))?;
    let table = |name: &str, entries: &[(&str, f64)]| {
        let lines = entries
            .iter()
            .map(|(key, value)| format!("   {key}: {}\n", said::number(*value)));
        format!("{name}:\n{}", lines.collect::<String>())
    };
    let [width, height] = camera.size_px;
    let [k1, k2, p1, p2] = four;
    Ok([
        format!(
            "%YAML:1.0\n---\nmodel_type: MEI\ncamera_name: {}\nimage_width: {width}\nimage_height: {height}\n",
            camera.name
        ),
        table("mirror_parameters", &[("xi", *mirror)]),
        table(
            "distortion_parameters",
            &[("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2)],
        ),
        table(
            "projection_parameters",
            &[
                ("gamma1", focal_px[0]),
                ("gamma2", focal_px[1]),
                ("u0", centre_px[0]),
                ("v0", centre_px[1]),
            ],
        ),
    ]
    .concat())
}
