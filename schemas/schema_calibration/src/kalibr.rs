//! Kalibr's `camchain.yaml`.

use std::fmt::Write as _;

use nalgebra::{Isometry3, Matrix4, Rotation3, Translation3, UnitQuaternion};
use schema_types::lens::LensModel;

use crate::camera::{Camera, Matrix, from_optical};
use crate::fault::{CalibrationError, Fault};
use crate::format::Format;
use crate::said;
use crate::tree::Node;

/// How far the rotation of a transform may be from one, each number.
const ROTATION_WITHIN: f64 = 1e-3;

/// Reads every camera. The first is where the chain begins.
pub fn read(root: &Node) -> Result<Vec<Camera>, Fault> {
    let mut cameras = Vec::new();
    let mut first_from_camera = Isometry3::identity();
    for (name, at) in root.entries() {
        let mut camera = one(name, at)?;
        if let Some(step) = at.get("T_cn_cnm1") {
            let camera_from_previous = transform(step)?;
            first_from_camera *= camera_from_previous.inverse();
            camera.carrier_from_sensor = Some(in_sensor_axes(first_from_camera));
        } else if cameras.is_empty() {
            camera.carrier_from_sensor = Some(Isometry3::identity());
        }
        cameras.push(camera);
    }
    Ok(cameras)
}

/// The pose of a camera's own axes in those of the first one.
fn in_sensor_axes(first_from_camera: Isometry3<f64>) -> Isometry3<f64> {
    schema_types::space::sensor_from_camera() * from_optical(first_from_camera)
}

fn one(name: &str, at: &Node) -> Result<Camera, Fault> {
    let model = at.need("camera_model")?;
    let intrinsics = at.need("intrinsics")?;
    let distortion = at.need("distortion_model")?;
    let four = || -> Result<[f64; 4], Fault> {
        match at.get("distortion_coeffs") {
            Some(list) => list.exactly("the coefficients of distortion_model"),
            None => Err(at.fault(format!("{} has no distortion_coeffs", at.name()))),
        }
    };
    let plane = |[fu, fv, pu, pv]: [f64; 4]| Matrix {
        focal_px: [fu, fv],
        centre_px: [pu, pv],
    };
    let (model, matrix) = match (model.text(), distortion.text()) {
        (Some("pinhole"), Some("none")) => (
            LensModel::Pinhole {},
            plane(intrinsics.exactly("fu, fv, pu, pv")?),
        ),
        (Some("pinhole"), Some("radtan")) => (
            LensModel::OpenCv {
                coefficients: four()?.into(),
            },
            plane(intrinsics.exactly("fu, fv, pu, pv")?),
        ),
        (Some("pinhole"), Some("equidistant" | "equi")) => (
            LensModel::KannalaBrandt {
                coefficients: four()?,
            },
            plane(intrinsics.exactly("fu, fv, pu, pv")?),
        ),
        (Some("omni"), Some(kind @ ("none" | "radtan"))) => {
            let [xi, rest @ ..]: [f64; 5] = intrinsics.exactly("xi, fu, fv, pu, pv")?;
            let coefficients = match kind {
                "none" => Vec::new(),
                _ => four()?.into(),
            };
            let model = LensModel::Unified {
                mirror: xi,
                coefficients,
            };
            (model, plane(rest))
        }
        (Some("ds"), Some("none")) => {
            let [xi, alpha, rest @ ..]: [f64; 6] =
                intrinsics.exactly("xi, alpha, fu, fv, pu, pv")?;
            (LensModel::DoubleSphere { xi, alpha }, plane(rest))
        }
        (Some("pinhole" | "omni" | "ds"), _) => {
            return Err(distortion.wrong(
                "none, radtan or equidistant with pinhole, none or radtan with omni, none with ds",
            ));
        }
        _ => return Err(model.wrong("pinhole, omni or ds")),
    };
    let [width, height] = at
        .need("resolution")?
        .exactly::<2>("width and height")
        .map(|size| size.map(|it| it.round()))?;
    let is_size = |it: f64| (1.0..=65536.0).contains(&it);
    if !(is_size(width) && is_size(height)) {
        return Err(at
            .need("resolution")?
            .wrong("two numbers of pixels, 1 to 65536"));
    }
    Camera::new(
        at,
        name.to_owned(),
        [width as u32, height as u32],
        model,
        matrix,
    )
}

fn transform(at: &Node) -> Result<Isometry3<f64>, Fault> {
    let rows: [[f64; 4]; 4] = at.matrix()?;
    let matrix = Matrix4::from_fn(|row, column| rows[row][column]);
    let turn = matrix.fixed_view::<3, 3>(0, 0).into_owned();
    let off = (turn * turn.transpose() - nalgebra::Matrix3::identity()).amax();
    if !(off < ROTATION_WITHIN && turn.determinant() > 0.0) {
        return Err(at.fault(format!("the rotation in {} is none", at.name())));
    }
    let rotation = Rotation3::from_matrix_eps(&turn, 1e-15, 100, Rotation3::identity());
    Ok(Isometry3::from_parts(
        Translation3::new(rows[0][3], rows[1][3], rows[2][3]),
        UnitQuaternion::from_rotation_matrix(&rotation),
    ))
}

/// Writes every camera. The chain has the way from each to the one before.
pub fn write(cameras: &[Camera]) -> Result<String, CalibrationError> {
    let mut text = String::new();
    let mut previous: Option<Isometry3<f64>> = None;
    for (idx, camera) in cameras.iter().enumerate() {
        let Matrix {
            focal_px: [fu, fv],
            centre_px: [pu, pv],
        } = camera.matrix(Format::Kalibr)?;
        let plane = [fu, fv, pu, pv];
        let (model, distortion, coefficients, intrinsics) = match camera.lens.model() {
            LensModel::Pinhole {} => ("pinhole", "none", Vec::new(), plane.to_vec()),
            LensModel::OpenCv { .. } => match camera.first_four() {
                Some(four) => ("pinhole", "radtan", four.into(), plane.to_vec()),
                None => return Err(camera.refused(Format::Kalibr, "with k3 or more")),
            },
            LensModel::Unified { mirror, .. } => match camera.first_four() {
                Some(four) => (
                    "omni",
                    "radtan",
                    four.into(),
                    [&[*mirror], &plane[..]].concat(),
                ),
                None => return Err(camera.refused(Format::Kalibr, "with k3 or more")),
            },
            LensModel::DoubleSphere { xi, alpha } => (
                "ds",
                "none",
                Vec::new(),
                [&[*xi, *alpha], &plane[..]].concat(),
            ),
            _ => match camera.fisheye() {
                Some(four) => ("pinhole", "equidistant", four.into(), plane.to_vec()),
                None => return Err(camera.refused(Format::Kalibr, "")),
            },
        };
        let [width, height] = camera.size_px;
        let _ = write!(
            text,
            "cam{idx}:\n  camera_model: {model}\n  distortion_coeffs: {}\n  distortion_model: {distortion}\n  intrinsics: {}\n  resolution: [{width}, {height}]\n  rostopic: /{}/image_raw\n",
            said::list(&coefficients),
            said::list(&intrinsics),
            camera.name
        );
        let own = camera.carrier_from_camera();
        if let (Some(before), Some(own)) = (previous, own) {
            let step = (own.inverse() * before).to_homogeneous();
            let _ = writeln!(text, "  T_cn_cnm1:");
            for row in step.row_iter() {
                let row: Vec<f64> = row.iter().copied().collect();
                let _ = writeln!(text, "  - {}", said::list(&row));
            }
        }
        previous = own;
    }
    Ok(text)
}
