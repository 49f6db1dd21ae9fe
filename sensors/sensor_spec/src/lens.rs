//! Settings of a camera's lens: which directions its pixels show. Without a model a camera is the
//! pinhole of its field of view.

use std::f64::consts::PI;

use schema_types::lens::{Lens, LensModel, Plane, PolynomialDirection};
use serde::{Deserialize, Serialize};

use crate::check::{SpecError, check_range};

/// Half of the widest field that images are made of, degrees.
pub const MAX_ANGLE_DEG: f64 = 110.0;
/// Most numbers of a list.
const MAX_NUMBERS: usize = 4096;
/// Numbers of lists lie between this and its negative.
const MAX_NUMBER: f64 = 1e6;
/// OpenCV's coefficients.
const OPENCV_COEFFICIENTS: usize = 14;

/// Which model a lens has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LensKind {
    /// None: the pinhole of `fov_deg`.
    #[default]
    None,
    /// Straight lines stay straight.
    Pinhole,
    /// OpenCV's pinhole with distortion.
    #[serde(rename = "opencv")]
    OpenCv,
    /// A mirror, or a lens like one: Mei's, with OpenCV's distortion.
    Unified,
    /// OpenCV's fisheye.
    KannalaBrandt,
    /// NVIDIA's polynomial between pixels and angles.
    #[serde(rename = "ftheta")]
    FTheta,
    /// θ.
    Equidistant,
    /// 2 sin(θ / 2).
    Equisolid,
    /// 2 tan(θ / 2).
    Stereographic,
    /// sin θ.
    Orthographic,
    /// Usenko's two spheres.
    DoubleSphere,
    /// Measured radii.
    Table,
}

impl LensKind {
    /// As `model` names it.
    pub fn name(self) -> &'static str {
        match self {
            LensKind::None => "none",
            LensKind::Pinhole => "pinhole",
            LensKind::OpenCv => "opencv",
            LensKind::Unified => "unified",
            LensKind::KannalaBrandt => "kannala_brandt",
            LensKind::FTheta => "ftheta",
            LensKind::Equidistant => "equidistant",
            LensKind::Equisolid => "equisolid",
            LensKind::Stereographic => "stereographic",
            LensKind::Orthographic => "orthographic",
            LensKind::DoubleSphere => "double_sphere",
            LensKind::Table => "table",
        }
    }
}

/// A lens, in calibration's own terms: θ is the angle between a direction and the optical axis, and
/// the middle of the first pixel is (0.5, 0.5). OpenCV counts from there: add 0.5 to its cx and cy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LensSpec {
    /// How it maps directions to its plane; `none` is the pinhole of `fov_deg`, without any other key
    /// of this table.
    pub model: LensKind,
    /// fx and fy: pixels per unit of the lens's plane; of `ftheta`, whose polynomial has pixels, 1.
    pub focal_px: [f64; 2],
    /// cx and cy: the pixel on the optical axis. An empty list is the middle of the image.
    pub centre_px: Vec<f64>,
    /// How much x grows with the plane's y, and y with its x.
    pub shear_px: [f64; 2],
    /// θ beyond which there is no image. A model's field may end before, where it would fold over.
    pub max_angle_deg: f64,
    /// `opencv` and `unified`: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, τx, τy; those that are
    /// left out at the end are 0. `kannala_brandt`: k0 to k3 of θ (1 + k0 θ² + k1 θ⁴ + k2 θ⁶ + k3 θ⁸).
    pub coefficients: Vec<f64>,
    /// `unified`: ξ, how far from the middle of a sphere the point lies that it is seen from.
    pub mirror: f64,
    /// `ftheta`: what its polynomial takes.
    pub direction: PolynomialDirection,
    /// `ftheta`: the polynomial from its constant on, which is 0.
    pub polynomial: Vec<f64>,
    /// `double_sphere`: between the spheres' middles.
    pub xi: f64,
    /// `double_sphere`: between the second sphere's middle and the pinhole.
    pub alpha: f64,
    /// `table`: θ, radians, from 0 on, each greater than the one before.
    pub angles_rad: Vec<f64>,
    /// `table`: radius in the lens's plane for each of them.
    pub radii: Vec<f64>,
}

impl Default for LensSpec {
    fn default() -> Self {
        LensSpec {
            model: LensKind::None,
            focal_px: [0.0; 2],
            centre_px: Vec::new(),
            shear_px: [0.0; 2],
            max_angle_deg: MAX_ANGLE_DEG,
            coefficients: Vec::new(),
            mirror: 0.0,
            direction: PolynomialDirection::AngleToDistance,
            polynomial: Vec::new(),
            xi: 0.0,
            alpha: 0.0,
            angles_rad: Vec::new(),
            radii: Vec::new(),
        }
    }
}

impl LensSpec {
    /// The settings of a lens: [`LensSpec::lens`] makes it again.
    pub fn of(lens: &Lens) -> LensSpec {
        let Plane {
            focal_px,
            shear_px,
            centre_px,
        } = *lens.plane();
        let mut spec = LensSpec {
            focal_px,
            shear_px,
            centre_px: centre_px.into(),
            max_angle_deg: lens.max_angle_rad().to_degrees().min(MAX_ANGLE_DEG),
            ..LensSpec::default()
        };
        spec.model = match lens.model().clone() {
            LensModel::Pinhole {} => LensKind::Pinhole,
            LensModel::OpenCv { coefficients } => {
                spec.coefficients = coefficients;
                LensKind::OpenCv
            }
            LensModel::Unified {
                mirror,
                coefficients,
            } => {
                (spec.mirror, spec.coefficients) = (mirror, coefficients);
                LensKind::Unified
            }
            LensModel::KannalaBrandt { coefficients } => {
                spec.coefficients = coefficients.into();
                LensKind::KannalaBrandt
            }
            LensModel::FTheta {
                direction,
                polynomial,
            } => {
                (spec.direction, spec.polynomial) = (direction, polynomial);
                LensKind::FTheta
            }
            LensModel::Equidistant {} => LensKind::Equidistant,
            LensModel::Equisolid {} => LensKind::Equisolid,
            LensModel::Stereographic {} => LensKind::Stereographic,
            LensModel::Orthographic {} => LensKind::Orthographic,
            LensModel::DoubleSphere { xi, alpha } => {
                (spec.xi, spec.alpha) = (xi, alpha);
                LensKind::DoubleSphere
            }
            LensModel::Table { angles_rad, radii } => {
                (spec.angles_rad, spec.radii) = (angles_rad, radii);
                LensKind::Table
            }
        };
        spec
    }

    /// Whether there is a model.
    pub fn is_some(&self) -> bool {
        self.model != LensKind::None
    }

    /// The lens of a camera with so many pixels; `None` without a model.
    ///
    /// # Errors
    /// The first value that no such lens has.
    pub fn lens(&self, [width_px, height_px]: [u32; 2]) -> Result<Option<Lens>, SpecError> {
        let Some(model) = self.checked_model()? else {
            return Ok(None);
        };
        let centre_px = match self.centre_px[..] {
            [] => [width_px, height_px].map(|side| 0.5 * f64::from(side)),
            [cx, cy] => [cx, cy],
            _ => return Err(self.refused("centre_px", &self.centre_px, "must be [cx, cy]")),
        };
        let plane = Plane {
            focal_px: self.focal_px,
            shear_px: self.shear_px,
            centre_px,
        };
        let lens = Lens::new(model, plane, Some(self.max_angle_deg.to_radians().min(PI)));
        lens.map(Some).map_err(|error| SpecError {
            key: key_of(error.key),
            value: error.value,
            allowed: error.allowed.into(),
        })
    }

    fn checked_model(&self) -> Result<Option<LensModel>, SpecError> {
        use LensKind::*;
        // A key that the model does not have would be silently without effect.
        let lists = [
            ("coefficients", &self.coefficients),
            ("polynomial", &self.polynomial),
            ("angles_rad", &self.angles_rad),
            ("radii", &self.radii),
            ("centre_px", &self.centre_px),
        ];
        for (key, list) in lists {
            let is_known = match key {
                "coefficients" => matches!(self.model, OpenCv | Unified | KannalaBrandt),
                "polynomial" => self.model == FTheta,
                "centre_px" => self.is_some(),
                _ => self.model == Table,
            };
            if !is_known && !list.is_empty() {
                return Err(self.refused(key, list, &self.not_here()));
            }
        }
        let numbers = [
            ("mirror", self.mirror, 0.0, self.model == Unified),
            ("xi", self.xi, 0.0, self.model == DoubleSphere),
            ("alpha", self.alpha, 0.0, self.model == DoubleSphere),
            ("focal_px", self.focal_px[0], 0.0, self.is_some()),
            ("focal_px", self.focal_px[1], 0.0, self.is_some()),
            ("shear_px", self.shear_px[0], 0.0, self.is_some()),
            ("shear_px", self.shear_px[1], 0.0, self.is_some()),
            (
                "max_angle_deg",
                self.max_angle_deg,
                MAX_ANGLE_DEG,
                self.is_some(),
            ),
        ];
        for (key, value, default, is_known) in numbers {
            if !is_known && value != default {
                return Err(self.refused(key, &value, &self.not_here()));
            }
        }
        if self.direction != LensSpec::default().direction && self.model != FTheta {
            return Err(self.refused("direction", &self.direction, &self.not_here()));
        }
        let coefficients = || self.coefficients.clone();
        Ok(Some(match self.model {
            None => return Ok(Option::None),
            Pinhole => LensModel::Pinhole {},
            OpenCv => LensModel::OpenCv {
                coefficients: coefficients(),
            },
            Unified => LensModel::Unified {
                mirror: self.mirror,
                coefficients: coefficients(),
            },
            KannalaBrandt => LensModel::KannalaBrandt {
                coefficients: coefficients().try_into().map_err(|list: Vec<f64>| {
                    self.refused("coefficients", &list, "must be four numbers, k0 to k3")
                })?,
            },
            FTheta => LensModel::FTheta {
                direction: self.direction,
                polynomial: self.polynomial.clone(),
            },
            Equidistant => LensModel::Equidistant {},
            Equisolid => LensModel::Equisolid {},
            Stereographic => LensModel::Stereographic {},
            Orthographic => LensModel::Orthographic {},
            DoubleSphere => LensModel::DoubleSphere {
                xi: self.xi,
                alpha: self.alpha,
            },
            Table => LensModel::Table {
                angles_rad: self.angles_rad.clone(),
                radii: self.radii.clone(),
            },
        }))
    }

    fn not_here(&self) -> String {
        match self.model {
            LensKind::None => {
                "lens.model is none; name the lens's model, or leave this out".to_owned()
            }
            model => format!("a lens of model {} has none; leave it out", model.name()),
        }
    }

    fn refused(&self, key: &'static str, value: &impl std::fmt::Debug, why: &str) -> SpecError {
        SpecError {
            key: key_of(key),
            value: format!("{value:?}"),
            allowed: why.to_owned(),
        }
    }

    /// Checks every value of a camera with so many pixels.
    pub(crate) fn check(&self, size_px: [u32; 2], errors: &mut Vec<SpecError>) {
        let n_errors = errors.len();
        for (key, list, most) in [
            ("coefficients", &self.coefficients, OPENCV_COEFFICIENTS),
            ("polynomial", &self.polynomial, 16),
            ("angles_rad", &self.angles_rad, MAX_NUMBERS),
            ("radii", &self.radii, MAX_NUMBERS),
            ("centre_px", &self.centre_px, 2),
        ] {
            let is_off = |number: &&f64| !(-MAX_NUMBER..=MAX_NUMBER).contains(*number);
            if let Some(number) = list.iter().find(is_off) {
                let allowed = format!("its numbers are {:?} to {MAX_NUMBER:?}", -MAX_NUMBER);
                errors.push(self.refused(key, number, &allowed));
            }
            if list.len() > most {
                let allowed = format!("may be at most {most}");
                errors.push(SpecError {
                    key: key_of(key),
                    value: format!("{} numbers", list.len()),
                    allowed,
                });
            }
        }
        check_range(
            "lens.max_angle_deg",
            self.max_angle_deg,
            1.0,
            MAX_ANGLE_DEG,
            errors,
        );
        if errors.len() > n_errors {
            return;
        }
        errors.extend(self.lens(size_px).err());
    }
}

/// The key of a value of the lens in the camera's table.
fn key_of(key: &str) -> &'static str {
    match key {
        "focal_px" => "lens.focal_px",
        "shear_px" => "lens.shear_px",
        "centre_px" => "lens.centre_px",
        "max_angle_rad" | "max_angle_deg" => "lens.max_angle_deg",
        "coefficients" => "lens.coefficients",
        "mirror" => "lens.mirror",
        "direction" => "lens.direction",
        "polynomial" => "lens.polynomial",
        "xi" => "lens.xi",
        "alpha" => "lens.alpha",
        "angles_rad" => "lens.angles_rad",
        "radii" => "lens.radii",
        _ => "lens",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sentences(spec: &LensSpec) -> Vec<String> {
        let mut errors = Vec::new();
        spec.check([800, 600], &mut errors);
        errors.iter().map(ToString::to_string).collect()
    }

    fn fisheye() -> LensSpec {
        LensSpec {
            model: LensKind::KannalaBrandt,
            focal_px: [240.0, 241.0],
            coefficients: vec![0.08, 0.01, -0.003, 0.0005],
            ..LensSpec::default()
        }
    }

    #[test]
    fn a_lens_without_a_centre_looks_through_the_middle_of_its_image() {
        assert_eq!(sentences(&fisheye()), [""; 0]);
        let lens = fisheye().lens([800, 600]).unwrap().unwrap();
        assert_eq!(lens.project([0.0, 0.0, 1.0]), Some([400.0, 300.0]));
        assert_eq!(LensSpec::default().lens([800, 600]).unwrap(), None);
    }

    #[test]
    fn every_lens_becomes_settings_that_make_it_again() {
        let models = [
            LensModel::Pinhole {},
            LensModel::OpenCv {
                coefficients: vec![-0.3, 0.1, 1e-3],
            },
            LensModel::Unified {
                mirror: 0.9,
                coefficients: vec![-0.1],
            },
            LensModel::KannalaBrandt {
                coefficients: [0.1, 0.0, 0.0, 0.0],
            },
            LensModel::FTheta {
                direction: PolynomialDirection::DistanceToAngle,
                polynomial: vec![0.0, 0.004],
            },
            LensModel::Equidistant {},
            LensModel::Equisolid {},
            LensModel::Stereographic {},
            LensModel::Orthographic {},
            LensModel::DoubleSphere {
                xi: -0.2,
                alpha: 0.6,
            },
            LensModel::Table {
                angles_rad: vec![0.0, 1.0],
                radii: vec![0.0, 0.9],
            },
        ];
        for model in models {
            let plane = Plane {
                focal_px: [300.0, 310.0],
                shear_px: [0.5, 0.0],
                centre_px: [401.25, 299.5],
            };
            let lens = Lens::new(model, plane, Some(1.2)).unwrap();
            let spec = LensSpec::of(&lens);
            assert_eq!(sentences(&spec), [""; 0]);
            let again = spec.lens([800, 600]).unwrap().unwrap();
            assert_eq!((again.model(), again.plane()), (lens.model(), lens.plane()));
            assert!((again.max_angle_rad() - lens.max_angle_rad()).abs() < 1e-12);
        }
    }

    #[test]
    fn what_no_lens_has_is_refused_with_its_key() {
        let of = |change: fn(&mut LensSpec)| {
            let mut spec = fisheye();
            change(&mut spec);
            sentences(&spec)
        };
        assert_eq!(
            of(|it| it.coefficients = vec![0.1]),
            ["lens.coefficients is [0.1], but must be four numbers, k0 to k3"]
        );
        assert_eq!(
            of(|it| it.focal_px = [240.0, 0.0]),
            ["lens.focal_px is [240, 0], but both must be greater than 0"]
        );
        assert_eq!(
            of(|it| it.max_angle_deg = 120.0),
            ["lens.max_angle_deg is 120, but must be 1 to 110"]
        );
        assert_eq!(
            of(|it| it.xi = 0.5),
            ["lens.xi is 0.5, but a lens of model kannala_brandt has none; leave it out"]
        );
        assert_eq!(
            of(|it| it.model = LensKind::None),
            [
                "lens.coefficients is [0.08, 0.01, -0.003, 0.0005], but lens.model is none; name the lens's model, or leave this out"
            ]
        );
        assert_eq!(
            of(|it| it.coefficients[0] = f64::NAN),
            ["lens.coefficients is NaN, but its numbers are -1000000.0 to 1000000.0"]
        );
        assert_eq!(
            of(|it| it.centre_px = vec![1.0]),
            ["lens.centre_px is [1.0], but must be [cx, cy]"]
        );
    }
}
