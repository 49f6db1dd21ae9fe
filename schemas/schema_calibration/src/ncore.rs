//! NCore's JSON of an f-theta camera: two polynomials, of which one is the reference and the other
//! an approximation of its inverse, and a linear part `[[c, d], [e, 1]]`.

use nalgebra::{DMatrix, DVector};
use schema_types::lens::{Lens, LensModel, Plane, PolynomialDirection};

use crate::camera::Camera;
use crate::fault::{CalibrationError, Fault};
use crate::format::Format;
use crate::said;
use crate::tree::Node;

/// Coefficients of NCore's polynomials, from the constant on.
const COEFFICIENTS: usize = 6;
/// Samples that the other polynomial is fitted to.
const SAMPLES: usize = 1000;
/// From the middle of the first pixel to its corner.
const HALF_PX: f64 = 0.5;

/// Reads the camera, by its reference polynomial.
pub fn read(root: &Node) -> Result<Vec<Camera>, Fault> {
    let is_it = |it: &&Node| it.get("reference_poly").is_some();
    let nested = root.entries().map(|(_, node)| node).find(is_it);
    let at = Some(root).filter(is_it).or(nested);
    let at =
        at.ok_or_else(|| root.fault("the file has no reference_poly, as an f-theta camera has"))?;
    let reference = at.need("reference_poly")?;
    let (direction, key) = match reference.text() {
        Some("PIXELDIST_TO_ANGLE") => (
            PolynomialDirection::DistanceToAngle,
            "pixeldist_to_angle_poly",
        ),
        Some("ANGLE_TO_PIXELDIST") => (
            PolynomialDirection::AngleToDistance,
            "angle_to_pixeldist_poly",
        ),
        _ => return Err(reference.wrong("PIXELDIST_TO_ANGLE or ANGLE_TO_PIXELDIST")),
    };
    let mut polynomial = at.need(key)?.numbers()?;
    while polynomial.len() > 2 && polynomial.last() == Some(&0.0) {
        polynomial.pop();
    }
    let [c, d, e] = match at.get("linear_cde") {
        Some(linear) => linear.exactly("c, d, e")?,
        None => [1.0, 0.0, 0.0],
    };
    let [cx, cy]: [f64; 2] = at.need("principal_point")?.exactly("x and y")?;
    let [width, height] = at.need("resolution")?.exactly::<2>("width and height")?;
    let is_size = |it: f64| it.fract() == 0.0 && (1.0..=65536.0).contains(&it);
    if !(is_size(width) && is_size(height)) {
        return Err(at
            .need("resolution")?
            .wrong("two whole numbers of pixels, 1 to 65536"));
    }
    let max_angle_rad = at.get("max_angle").map(Node::number).transpose()?;
    let plane = Plane {
        focal_px: [c, 1.0],
        shear_px: [d, e],
        centre_px: [cx + HALF_PX, cy + HALF_PX],
    };
    let model = LensModel::FTheta {
        direction,
        polynomial,
    };
    let size_px = [width as u32, height as u32];
    Camera::of_plane(at, "camera".into(), size_px, model, plane, max_angle_rad)
        .map(|camera| vec![camera])
}

/// Writes a camera; the polynomial that is not the reference is fitted.
pub fn write(camera: &Camera) -> Result<String, CalibrationError> {
    let LensModel::FTheta {
        direction,
        polynomial,
    } = camera.lens.model()
    else {
        return Err(camera.refused(Format::NCore, ""));
    };
    if polynomial.len() > COEFFICIENTS {
        return Err(camera.refused(Format::NCore, "with more"));
    }
    let Plane {
        focal_px: [fx, fy],
        shear_px: [dx, dy],
        ..
    } = *camera.lens.plane();
    // The last number of the linear part is 1, so that the polynomial has the pixels.
    let mut own = [0.0; COEFFICIENTS];
    for (power, (to, from)) in own.iter_mut().zip(polynomial).enumerate() {
        *to = match direction {
            PolynomialDirection::AngleToDistance => from * fy,
            PolynomialDirection::DistanceToAngle => from / fy.powi(power as i32),
        };
    }
    let max_angle_rad = camera.lens.max_angle_rad();
    let other = inverse(camera, *direction, &own, max_angle_rad)?;
    let (name, [to_angle, to_distance]) = match direction {
        PolynomialDirection::DistanceToAngle => ("PIXELDIST_TO_ANGLE", [own, other]),
        PolynomialDirection::AngleToDistance => ("ANGLE_TO_PIXELDIST", [other, own]),
    };
    let [width, height] = camera.size_px;
    Ok(format!(
        "{{\n  \"camera_model_type\": \"ftheta\",\n  \"camera_model_parameters\": {{\n    \"resolution\": [{width}, {height}],\n    \"shutter_type\": \"GLOBAL\",\n    \"principal_point\": {},\n    \"reference_poly\": \"{name}\",\n    \"pixeldist_to_angle_poly\": {},\n    \"angle_to_pixeldist_poly\": {},\n    \"max_angle\": {},\n    \"linear_cde\": {}\n  }}\n}}\n",
        said::list(&camera.centre_px()),
        said::list(&to_angle),
        said::list(&to_distance),
        said::number(max_angle_rad),
        said::list(&[fx / fy, dx / fy, dy / fy]),
    ))
}

/// The polynomial without a constant that comes nearest to the inverse of another one, by least
/// squares over the field.
fn inverse(
    camera: &Camera,
    direction: PolynomialDirection,
    own: &[f64; COEFFICIENTS],
    max_angle_rad: f64,
) -> Result<[f64; COEFFICIENTS], CalibrationError> {
    let model = LensModel::FTheta {
        direction,
        polynomial: own.to_vec(),
    };
    let plane = Plane {
        focal_px: [1.0; 2],
        shear_px: [0.0; 2],
        centre_px: [0.0; 2],
    };
    let refused = || camera.refused(Format::NCore, "whose polynomial has no inverse");
    let round = Lens::new(model, plane, Some(max_angle_rad)).map_err(|_| refused())?;
    let (mut from, mut to) = (Vec::new(), Vec::new());
    for sample in 1..=SAMPLES {
        let angle = max_angle_rad * sample as f64 / SAMPLES as f64;
        let Some([distance, _]) = round.project([angle.sin(), 0.0, angle.cos()]) else {
            continue;
        };
        let (x, y) = match direction {
            PolynomialDirection::AngleToDistance => (distance, angle),
            PolynomialDirection::DistanceToAngle => (angle, distance),
        };
        from.push(x);
        to.push(y);
    }
    // In parts of the greatest, so that high powers stay near 1.
    let most = from.iter().copied().fold(0.0, f64::max);
    if most <= 0.0 || from.len() < COEFFICIENTS {
        return Err(refused());
    }
    let powers = DMatrix::from_fn(from.len(), COEFFICIENTS - 1, |row, column| {
        (from[row] / most).powi(column as i32 + 1)
    });
    let found = powers
        .svd(true, true)
        .solve(&DVector::from_vec(to), 1e-14)
        .map_err(|_| refused())?;
    let mut other = [0.0; COEFFICIENTS];
    for (power, value) in found.iter().enumerate() {
        other[power + 1] = value / most.powi(power as i32 + 1);
    }
    Ok(other)
}
