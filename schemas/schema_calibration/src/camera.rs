//! A camera as files of calibration describe it.

use nalgebra::Isometry3;
use schema_types::lens::{Lens, LensModel, Plane};
use schema_types::space::sensor_from_camera;

use crate::fault::{CalibrationError, Fault};
use crate::format::Format;
use crate::tree::Node;

/// From the middle of the first pixel, where these formats count from, to its corner, pixels.
const HALF_PX: f64 = 0.5;

/// A camera: its lens, the size of its images, and where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// As the file calls it.
    pub name: String,
    /// Width and height of its images.
    pub size_px: [u32; 2],
    /// Its lens.
    pub lens: Lens,
    /// Angle to the axis at which the file says that the field ends; `None` if it does not say.
    pub max_angle_rad: Option<f64>,
    /// Where it is on the vehicle, or to the first camera of the file, of which nobody knows more (x
    /// forward, y left, z up); `None` if the file does not say.
    pub carrier_from_sensor: Option<Isometry3<f64>>,
}

/// The numbers of a plane as these formats count.
pub(crate) struct Matrix {
    /// fx and fy.
    pub focal_px: [f64; 2],
    /// cx and cy from the middle of the first pixel.
    pub centre_px: [f64; 2],
}

impl Camera {
    /// A camera whose lens `at` describes.
    pub(crate) fn new(
        at: &Node,
        name: String,
        size_px: [u32; 2],
        model: LensModel,
        matrix: Matrix,
    ) -> Result<Camera, Fault> {
        let plane = Plane {
            focal_px: matrix.focal_px,
            shear_px: [0.0; 2],
            centre_px: matrix.centre_px.map(|it| it + HALF_PX),
        };
        Camera::of_plane(at, name, size_px, model, plane, None)
    }

    /// As [`Camera::new`], with Gantry's own plane.
    pub(crate) fn of_plane(
        at: &Node,
        name: String,
        size_px: [u32; 2],
        model: LensModel,
        plane: Plane,
        max_angle_rad: Option<f64>,
    ) -> Result<Camera, Fault> {
        let lens = Lens::new(model, plane, max_angle_rad)
            .map_err(|error| at.fault(format!("it describes no lens: {error}")))?;
        Ok(Camera {
            name,
            size_px,
            lens,
            max_angle_rad,
            carrier_from_sensor: None,
        })
    }

    /// fx, fy, cx, cy as these formats count.
    pub(crate) fn matrix(&self, format: Format) -> Result<Matrix, CalibrationError> {
        let plane = self.lens.plane();
        if plane.shear_px != [0.0; 2] {
            return Err(self.refused(format, "with shear_px"));
        }
        Ok(Matrix {
            focal_px: plane.focal_px,
            centre_px: self.centre_px(),
        })
    }

    /// cx and cy as these formats count.
    pub(crate) fn centre_px(&self) -> [f64; 2] {
        self.lens.plane().centre_px.map(|it| it - HALF_PX)
    }

    /// OpenCV's fourteen coefficients of a lens that has some, or is a pinhole.
    pub(crate) fn opencv(&self) -> Option<[f64; 14]> {
        opencv(&self.lens)
    }

    /// k1, k2, p1 and p2 if the others are 0.
    pub(crate) fn first_four(&self) -> Option<[f64; 4]> {
        let [k1, k2, p1, p2, rest @ ..] = self.opencv()?;
        (rest == [0.0; 10]).then_some([k1, k2, p1, p2])
    }

    /// The four coefficients of OpenCV's fisheye.
    pub(crate) fn fisheye(&self) -> Option<[f64; 4]> {
        fisheye(&self.lens)
    }

    /// The pose of its optical axes (x to the right, y down, z ahead) on the carrier.
    pub(crate) fn carrier_from_camera(&self) -> Option<Isometry3<f64>> {
        self.carrier_from_sensor.map(|it| it * sensor_from_camera())
    }

    /// Why the format does not hold it.
    pub(crate) fn refused(&self, format: Format, how: &str) -> CalibrationError {
        CalibrationError::Lens {
            camera: self.name.clone(),
            format: format.name(),
            model: match how {
                "" => self.lens.model().name().to_owned(),
                _ => format!("{} {how}", self.lens.model().name()),
            },
            known: format.models(),
        }
    }
}

/// The pose of a camera on its carrier by that of its optical axes.
pub(crate) fn from_optical(carrier_from_camera: Isometry3<f64>) -> Isometry3<f64> {
    carrier_from_camera * sensor_from_camera().inverse()
}

/// OpenCV's fourteen coefficients of a lens that has some, or is a pinhole.
pub(crate) fn opencv(lens: &Lens) -> Option<[f64; 14]> {
    let given = match lens.model() {
        LensModel::Pinhole {} => &[][..],
        LensModel::OpenCv { coefficients } | LensModel::Unified { coefficients, .. } => {
            coefficients
        }
        _ => return None,
    };
    let mut all = [0.0; 14];
    all.get_mut(..given.len())?.copy_from_slice(given);
    Some(all)
}

/// The four coefficients of OpenCV's fisheye.
pub(crate) fn fisheye(lens: &Lens) -> Option<[f64; 4]> {
    match lens.model() {
        LensModel::KannalaBrandt { coefficients } => Some(*coefficients),
        LensModel::Equidistant {} => Some([0.0; 4]),
        _ => None,
    }
}
