//! What a camera's pixels show: its lens and the size of its images, with both ways between
//! directions and pixels.
//!
//! The header of a frame says it of a camera without a lens's model. The numbers of a model are in
//! `world/info`, whose `crc` is the header's `calibration_crc`.

use schema_types::lens::{LensError, LensModel, Plane};
use schema_types::{Distortion, Lens};
use serde::{Deserialize, Serialize};

use crate::header::FrameHeader;

/// The calibration of a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "CalibrationText", into = "CalibrationText")]
pub struct Calibration {
    size_px: [u32; 2],
    lens: Lens,
    /// CARLA's bending of a pinhole's image.
    distortion: Option<Distortion>,
    crc: u32,
}

/// Where pixels are counted from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PixelOrigin {
    /// The image's upper left corner: the middle of the first pixel is (0.5, 0.5).
    #[default]
    Corner,
}

/// When the rows of an image are exposed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Readout {
    /// All at the frame's `sim_nanos`.
    #[default]
    Global,
}

/// A calibration in JSON.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct CalibrationText {
    size_px: [u32; 2],
    lens: LensModel,
    focal_px: [f64; 2],
    #[serde(default)]
    shear_px: [f64; 2],
    centre_px: [f64; 2],
    max_angle_rad: f64,
    /// As [`FrameHeader::lens`].
    #[serde(default, skip_serializing_if = "is_straight")]
    distortion: [f32; 4],
    #[serde(default)]
    pixel_origin: PixelOrigin,
    crc: u32,
}

fn is_straight(distortion: &[f32; 4]) -> bool {
    *distortion == [0.0; 4]
}

impl TryFrom<CalibrationText> for Calibration {
    type Error = LensError;

    fn try_from(text: CalibrationText) -> Result<Calibration, LensError> {
        let plane = Plane {
            focal_px: text.focal_px,
            shear_px: text.shear_px,
            centre_px: text.centre_px,
        };
        Ok(Calibration {
            size_px: text.size_px,
            lens: Lens::new(text.lens, plane, Some(text.max_angle_rad))?,
            distortion: Distortion::from_array(text.distortion),
            // Of the numbers as they were written: readers of JSON may round the last bit.
            crc: text.crc,
        })
    }
}

impl From<Calibration> for CalibrationText {
    fn from(of: Calibration) -> CalibrationText {
        let plane = *of.lens.plane();
        CalibrationText {
            size_px: of.size_px,
            lens: of.lens.model().clone(),
            focal_px: plane.focal_px,
            shear_px: plane.shear_px,
            centre_px: plane.centre_px,
            max_angle_rad: of.lens.max_angle_rad(),
            distortion: of.distortion.map_or([0.0; 4], |lens| lens.as_array()),
            pixel_origin: PixelOrigin::Corner,
            crc: of.crc,
        }
    }
}

impl Calibration {
    /// The calibration that a header alone says; `None` if it names a lens's model, whose numbers are
    /// in `world/info`, or if the frame is no camera's, or a batch.
    pub fn of(header: &FrameHeader) -> Option<Calibration> {
        let [fx, fy, cx, cy] = header.intrinsics_px;
        if header.lens_model() != 0 || header.is_batch() {
            return None;
        }
        // Lists of events do not carry the size; the middle of the image is on a pinhole's axis.
        let size_px = match header.modality()?.is_image() {
            true => [header.width, header.height],
            false => [cx, cy].map(|it| (2.0 * it).round() as u32),
        };
        Calibration::pinhole([fx, fy, cx, cy], header.distortion(), size_px)
    }

    /// A pinhole's with `[fx, fy, cx, cy]`, whose image CARLA's lens may bend; `None` if these are no
    /// pinhole's numbers.
    pub fn pinhole(
        [fx, fy, cx, cy]: [f64; 4],
        distortion: Option<Distortion>,
        size_px: [u32; 2],
    ) -> Option<Calibration> {
        let plane = Plane {
            focal_px: [fx, fy],
            shear_px: [0.0; 2],
            centre_px: [cx, cy],
        };
        Some(Calibration {
            size_px,
            lens: Lens::new(LensModel::Pinhole {}, plane, None).ok()?,
            distortion,
            crc: 0,
        })
    }

    /// That of a lens with a model.
    pub fn of_lens(lens: Lens, size_px: [u32; 2]) -> Calibration {
        Calibration {
            size_px,
            crc: FrameHeader::crc_of(&lens, size_px),
            lens,
            distortion: None,
        }
    }

    /// Width and height of the images.
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// The lens, without CARLA's bending.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// CARLA's bending of a pinhole's image.
    pub fn distortion(&self) -> Option<&Distortion> {
        self.distortion.as_ref()
    }

    /// `calibration_crc` of the frames' headers: 0 of a camera without a lens's model.
    pub fn crc(&self) -> u32 {
        self.crc
    }

    /// The pixel that shows a direction in the camera's optical axes (x to the right, y down, z
    /// ahead); `None` if none does. It may lie beside the image.
    pub fn project(&self, direction: [f64; 3]) -> Option<[f64; 2]> {
        let straight = self.lens.project(direction)?;
        let Some(distortion) = &self.distortion else {
            return Some(straight);
        };
        let flat = self.in_sides(straight);
        let bent = distortion.unbend(flat);
        // Beyond a fold there is no such place.
        let back = distortion.bend(bent);
        let is_there = (0..2).all(|axis| (back[axis] - flat[axis]).abs() <= 1e-9);
        is_there.then(|| self.in_pixels(bent))
    }

    /// The direction that a pixel shows, of length 1; `None` if it shows none.
    pub fn unproject(&self, at_px: [f64; 2]) -> Option<[f64; 3]> {
        match &self.distortion {
            None => self.lens.unproject(at_px),
            Some(distortion) => {
                let flat = distortion.bend(self.in_sides(at_px));
                self.lens.unproject(self.in_pixels(flat))
            }
        }
    }

    /// A place in sides of the image, from the pixel on the axis.
    fn in_sides(&self, at_px: [f64; 2]) -> [f64; 2] {
        let centre = self.lens.plane().centre_px;
        [0, 1].map(|axis| (at_px[axis] - centre[axis]) / f64::from(self.size_px[axis]))
    }

    fn in_pixels(&self, at: [f64; 2]) -> [f64; 2] {
        let centre = self.lens.plane().centre_px;
        [0, 1].map(|axis| at[axis] * f64::from(self.size_px[axis]) + centre[axis])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Modality;

    fn header() -> FrameHeader {
        let mut header = FrameHeader::new(Modality::Rgb);
        header.set_image(320, 200);
        header.intrinsics_px = [200.0, 210.0, 160.0, 100.0];
        header
    }

    fn fisheye() -> Calibration {
        let plane = Plane {
            focal_px: [240.3, 241.7],
            shear_px: [0.1, 0.0],
            centre_px: [400.1, 299.9],
        };
        let model = LensModel::KannalaBrandt {
            coefficients: [0.083092, 0.011121, 0.008587, 0.000854],
        };
        Calibration::of_lens(Lens::new(model, plane, Some(1.6)).unwrap(), [800, 600])
    }

    #[test]
    fn a_header_says_all_of_a_pinhole_and_nothing_of_a_lens() {
        let found = Calibration::of(&header()).unwrap();
        assert_eq!(found.project([0.2, -0.1, 2.0]), Some([180.0, 89.5]));
        assert_eq!(found.project([0.0, 0.0, -1.0]), None);
        assert_eq!((found.size_px(), found.crc()), ([320, 200], 0));
        let lens = FrameHeader {
            optics: 4,
            ..header()
        };
        assert_eq!(Calibration::of(&lens), None);
        assert_eq!(Calibration::of(&FrameHeader::new(Modality::Imu)), None);
        let mut events = FrameHeader::new(Modality::Dvs);
        events.set_list(17);
        events.intrinsics_px = [200.0, 200.0, 160.0, 100.0];
        assert_eq!(Calibration::of(&events).unwrap().size_px(), [320, 200]);
    }

    /// The formula of the header's `lens`: at p is what a pinhole has at p (1 + k r² + k₃ r³).
    #[test]
    fn a_bent_pinhole_shows_a_direction_where_its_formula_says() {
        let bent = FrameHeader {
            lens: [0.4, 0.1, 1.0, 0.5],
            ..header()
        };
        let found = Calibration::of(&bent).unwrap();
        let p = [0.25, -0.4f64];
        let r2 = p[0] * p[0] + 0.25 * p[1] * p[1];
        let k = [0.4f32, 0.1].map(f64::from);
        let factor = 1.0 + k[0] * r2 + k[1] * r2 * r2.sqrt();
        let direction = [
            p[0] * factor * 320.0 / 200.0,
            p[1] * factor * 200.0 / 210.0,
            1.0,
        ];
        let [x, y] = found.project(direction).unwrap();
        let wanted = [160.0 + 0.25 * 320.0, 100.0 - 0.4 * 200.0];
        assert!((x - wanted[0]).abs() < 1e-9 && (y - wanted[1]).abs() < 1e-9);
        let back = found.unproject(wanted).unwrap();
        for axis in 0..2 {
            assert!((back[axis] / back[2] - direction[axis]).abs() < 1e-12);
        }
        // Of a lens that folds over, what lies beyond the fold is not shown.
        let folding = FrameHeader {
            lens: [-2.0, 0.0, 1.0, 1.0],
            ..header()
        };
        let found = Calibration::of(&folding).unwrap();
        assert_eq!(found.project([1.0, 0.0, 1.0]), None);
        assert!(found.project([0.1, 0.0, 1.0]).is_some());
    }

    #[test]
    fn json_keeps_a_calibration_to_the_last_bit_but_one() {
        let own = fisheye();
        assert_eq!(own.crc(), FrameHeader::crc_of(own.lens(), [800, 600]));
        let text = serde_json::to_string(&own).unwrap();
        assert!(
            text.starts_with(r#"{"size_px":[800,600],"lens":{"model":"kannala_brandt","#),
            "{text}"
        );
        let again: Calibration = serde_json::from_str(&text).unwrap();
        assert_eq!((again.crc(), again.size_px()), (own.crc(), own.size_px()));
        for direction in [[0.1, 0.2, 1.0], [1.0, -0.3, 0.2], [-1.0, 1.0, 0.0]] {
            let [a, b] = [&own, &again].map(|it| it.project(direction).unwrap());
            assert!((a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9);
        }
    }
}
