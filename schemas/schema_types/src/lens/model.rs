//! Models of lenses, and values that none has.

use serde::{Deserialize, Serialize};

/// How a lens maps directions to its plane; θ is the angle to the optical axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "model", rename_all = "snake_case", deny_unknown_fields)]
pub enum LensModel {
    /// Straight lines stay straight: tan θ.
    Pinhole {},
    /// OpenCV's pinhole with distortion.
    #[serde(rename = "opencv")]
    OpenCv {
        /// k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, τx, τy, in OpenCV's order; those that
        /// are left out at the end are 0.
        coefficients: Vec<f64>,
    },
    /// A mirror, or a lens like one, about which Mei and Rives wrote: a sphere seen from a point
    /// that is `mirror` away from its middle, then OpenCV's distortion.
    Unified {
        /// ξ; 0 is a pinhole.
        mirror: f64,
        /// As those of `opencv`.
        coefficients: Vec<f64>,
    },
    /// Kannala and Brandt's, OpenCV's fisheye: θ (1 + k0 θ² + k1 θ⁴ + k2 θ⁶ + k3 θ⁸).
    KannalaBrandt {
        /// k0 to k3.
        coefficients: [f64; 4],
    },
    /// NVIDIA's f-theta: a polynomial between pixels from the centre and θ.
    #[serde(rename = "ftheta")]
    FTheta {
        /// From which to which.
        direction: PolynomialDirection,
        /// From the constant on, which is 0.
        polynomial: Vec<f64>,
    },
    /// θ.
    Equidistant {},
    /// 2 sin(θ / 2).
    Equisolid {},
    /// 2 tan(θ / 2).
    Stereographic {},
    /// sin θ.
    Orthographic {},
    /// Usenko's: two spheres, one after the other, and a pinhole.
    DoubleSphere {
        /// Between the spheres' middles.
        xi: f64,
        /// Between the second sphere's middle and the pinhole.
        alpha: f64,
    },
    /// Measured radii, joined by straight lines.
    Table {
        /// θ, radians: the first is 0, and each is greater than the one before.
        angles_rad: Vec<f64>,
        /// Radius in the lens's plane for each of them.
        radii: Vec<f64>,
    },
}

impl LensModel {
    /// Its number in headers of frames; 0 is that of no model.
    pub fn number(&self) -> u8 {
        match self {
            LensModel::Pinhole {} => 1,
            LensModel::OpenCv { .. } => 2,
            LensModel::Unified { .. } => 3,
            LensModel::KannalaBrandt { .. } => 4,
            LensModel::FTheta { .. } => 5,
            LensModel::Equidistant {} => 6,
            LensModel::Equisolid {} => 7,
            LensModel::Stereographic {} => 8,
            LensModel::Orthographic {} => 9,
            LensModel::DoubleSphere { .. } => 10,
            LensModel::Table { .. } => 11,
        }
    }

    /// Its name in settings and documents.
    pub fn name(&self) -> &'static str {
        match self {
            LensModel::Pinhole {} => "pinhole",
            LensModel::OpenCv { .. } => "opencv",
            LensModel::Unified { .. } => "unified",
            LensModel::KannalaBrandt { .. } => "kannala_brandt",
            LensModel::FTheta { .. } => "ftheta",
            LensModel::Equidistant {} => "equidistant",
            LensModel::Equisolid {} => "equisolid",
            LensModel::Stereographic {} => "stereographic",
            LensModel::Orthographic {} => "orthographic",
            LensModel::DoubleSphere { .. } => "double_sphere",
            LensModel::Table { .. } => "table",
        }
    }

    /// The model of this name with these [`LensModel::numbers`]; `None` if no model has the name, or
    /// not so many numbers.
    pub fn of(name: &str, numbers: &[f64]) -> Option<LensModel> {
        Some(match (name, numbers) {
            ("pinhole", []) => LensModel::Pinhole {},
            ("opencv", _) => LensModel::OpenCv {
                coefficients: numbers.to_vec(),
            },
            ("unified", [mirror, coefficients @ ..]) => LensModel::Unified {
                mirror: *mirror,
                coefficients: coefficients.to_vec(),
            },
            ("kannala_brandt", _) => LensModel::KannalaBrandt {
                coefficients: numbers.try_into().ok()?,
            },
            ("ftheta", [direction, polynomial @ ..]) => LensModel::FTheta {
                direction: match *direction {
                    0.0 => PolynomialDirection::DistanceToAngle,
                    1.0 => PolynomialDirection::AngleToDistance,
                    _ => return None,
                },
                polynomial: polynomial.to_vec(),
            },
            ("equidistant", []) => LensModel::Equidistant {},
            ("equisolid", []) => LensModel::Equisolid {},
            ("stereographic", []) => LensModel::Stereographic {},
            ("orthographic", []) => LensModel::Orthographic {},
            ("double_sphere", [xi, alpha]) => LensModel::DoubleSphere {
                xi: *xi,
                alpha: *alpha,
            },
            ("table", _) if numbers.len().is_multiple_of(2) => {
                let (angles_rad, radii) = numbers.split_at(numbers.len() / 2);
                LensModel::Table {
                    angles_rad: angles_rad.to_vec(),
                    radii: radii.to_vec(),
                }
            }
            _ => return None,
        })
    }

    /// Its own numbers, in the order of its fields; an f-theta polynomial's direction is 0 from
    /// distances, 1 from angles.
    pub fn numbers(&self) -> Vec<f64> {
        match self {
            LensModel::OpenCv { coefficients } => coefficients.clone(),
            LensModel::Unified {
                mirror,
                coefficients,
            } => [&[*mirror], &coefficients[..]].concat(),
            LensModel::KannalaBrandt { coefficients } => coefficients.to_vec(),
            LensModel::FTheta {
                direction,
                polynomial,
            } => [&[f64::from(*direction as u8)], &polynomial[..]].concat(),
            LensModel::DoubleSphere { xi, alpha } => vec![*xi, *alpha],
            LensModel::Table { angles_rad, radii } => [&angles_rad[..], radii].concat(),
            LensModel::Pinhole {}
            | LensModel::Equidistant {}
            | LensModel::Equisolid {}
            | LensModel::Stereographic {}
            | LensModel::Orthographic {} => Vec::new(),
        }
    }
}

/// What an f-theta polynomial takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PolynomialDirection {
    /// The distance from the centre, and gives the angle.
    DistanceToAngle,
    /// The angle, and gives the distance.
    AngleToDistance,
}

/// A value that no lens has.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{key} is {value}, but {allowed}")]
pub struct LensError {
    /// Which one.
    pub key: &'static str,
    /// What it is.
    pub value: String,
    /// What it may be.
    pub allowed: &'static str,
}
