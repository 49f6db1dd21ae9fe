//! OpenCV's `FileStorage` in YAML, with the keys of its own programs of calibration.

use std::fmt::Write as _;

use schema_types::lens::LensModel;

use crate::camera::{Camera, Matrix};
use crate::fault::{CalibrationError, Fault};
use crate::format::Format;
use crate::said;
use crate::tree::Node;

/// Keys of the camera's matrix, in OpenCV's samples and in what people write.
const MATRIX: [&str; 4] = ["camera_matrix", "cameraMatrix", "camera_Matrix", "K"];
/// Keys of the coefficients.
const COEFFICIENTS: [&str; 6] = [
    "distortion_coefficients",
    "distortionCoefficients",
    "Distortion_Coefficients",
    "dist_coeffs",
    "distCoeffs",
    "D",
];
/// Keys of width and height.
const SIZES: [[&str; 2]; 3] = [
    ["image_width", "image_height"],
    ["image_Width", "image_Height"],
    ["imageWidth", "imageHeight"],
];

/// Reads the camera.
pub fn read(root: &Node) -> Result<Vec<Camera>, Fault> {
    let matrix = matrix_of(one_of(root, &MATRIX)?)?;
    let at = one_of(root, &COEFFICIENTS)?;
    let given = at.need("data")?.numbers()?;
    let sizes = SIZES.iter().find(|[width, _]| root.get(width).is_some());
    let Some([width, height]) = sizes else {
        return Err(root.fault("the file has no image_width and image_height; write them into it"));
    };
    let size_px = root.size(width, height)?;
    let is_fisheye = match root.get("fisheye_model") {
        None => None,
        Some(node) => Some(node.number()? != 0.0),
    };
    let four = |meaning: &str| -> Result<[f64; 4], Fault> { at.need("data")?.exactly(meaning) };
    let model = match (root.get("xi"), is_fisheye) {
        (Some(xi), _) => {
            let mirror = match xi.get("data") {
                Some(data) => data.exactly::<1>("xi")?[0],
                None => xi.number()?,
            };
            LensModel::Unified {
                mirror,
                coefficients: four("k1, k2, p1, p2 of cv2.omnidir")?.into(),
            }
        }
        (None, Some(true)) => LensModel::KannalaBrandt {
            coefficients: four("k1 to k4 of cv2.fisheye")?,
        },
        (None, None) if given.len() == 4 && given.iter().any(|it| *it != 0.0) => {
            return Err(at.fault(format!(
                "{} has four numbers, which are k1, k2, p1, p2 of cv2.calibrateCamera or k1 to k4 of cv2.fisheye; write fisheye_model: 0 or fisheye_model: 1 into the file",
                at.name()
            )));
        }
        _ => coefficients(at, given, &[4, 5, 8, 12, 14])?,
    };
    let name = root.get("camera_name").and_then(Node::text);
    let name = name.unwrap_or("camera").to_owned();
    Camera::new(root, name, size_px, model, matrix).map(|camera| vec![camera])
}

/// OpenCV's pinhole with so many coefficients as it knows.
pub fn coefficients(at: &Node, given: Vec<f64>, known: &[usize]) -> Result<LensModel, Fault> {
    if given.iter().all(|it| *it == 0.0) {
        return Ok(LensModel::Pinhole {});
    }
    if !known.contains(&given.len()) {
        let known: Vec<String> = known.iter().map(usize::to_string).collect();
        return Err(at.fault(format!(
            "{} has {} numbers, but must have {}",
            at.name(),
            given.len(),
            known.join(", ")
        )));
    }
    Ok(LensModel::OpenCv {
        coefficients: given,
    })
}

/// The first of these keys that is there.
fn one_of<'n>(root: &'n Node, keys: &[&str]) -> Result<&'n Node, Fault> {
    let found = keys.iter().find_map(|key| root.get(key));
    found.ok_or_else(|| root.fault(format!("the file has none of {}", keys.join(", "))))
}

/// A camera's matrix, `rows`, `cols` and `data`.
pub fn matrix_of(at: &Node) -> Result<Matrix, Fault> {
    let k: [f64; 9] = at
        .need("data")?
        .exactly("a matrix of 3 × 3, row after row")?;
    let [fx, skew, cx, zero, fy, cy, last @ ..] = k;
    if [skew, zero, last[0], last[1], last[2] - 1.0] != [0.0; 5] {
        return Err(at.fault(format!(
            "{} must be [fx, 0, cx, 0, fy, cy, 0, 0, 1]; OpenCV ignores all its other numbers",
            at.name()
        )));
    }
    Ok(Matrix {
        focal_px: [fx, fy],
        centre_px: [cx, cy],
    })
}

/// Writes a camera.
pub fn write(camera: &Camera) -> Result<String, CalibrationError> {
    let Matrix {
        focal_px: [fx, fy],
        centre_px: [cx, cy],
    } = camera.matrix(Format::OpenCv)?;
    let (fisheye_model, given, xi) = match camera.lens.model() {
        LensModel::Unified { mirror, .. } => match camera.first_four() {
            Some(four) => (0, four.to_vec(), Some(*mirror)),
            None => return Err(camera.refused(Format::OpenCv, "with k3 or more")),
        },
        _ => match (camera.fisheye(), camera.opencv()) {
            (Some(four), _) => (1, four.to_vec(), None),
            (None, Some(all)) => (0, shortest(&all).to_vec(), None),
            (None, None) => return Err(camera.refused(Format::OpenCv, "")),
        },
    };
    let [width, height] = camera.size_px;
    let mut text = format!(
        "%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\nfisheye_model: {fisheye_model}\n"
    );
    let k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    matrix(&mut text, "camera_matrix", 3, &k);
    matrix(&mut text, "distortion_coefficients", given.len(), &given);
    if let Some(xi) = xi {
        let _ = writeln!(text, "xi: {}", said::number(xi));
    }
    Ok(text)
}

/// As few coefficients as OpenCV takes.
fn shortest(all: &[f64; 14]) -> &[f64] {
    let n = all.iter().rposition(|it| *it != 0.0).map_or(0, |it| it + 1);
    let n = [5, 8, 12, 14].into_iter().find(|known| *known >= n);
    &all[..n.unwrap_or(14)]
}

fn matrix(text: &mut String, name: &str, rows: usize, data: &[f64]) {
    let cols = data.len() / rows;
    let _ = writeln!(
        text,
        "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: {}",
        said::list(data)
    );
}
