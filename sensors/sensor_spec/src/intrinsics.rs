//! The pinhole camera: pixels and focal length.

/// Pinhole camera: pixels, no distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Image width.
    pub width_px: u32,
    /// Image height.
    pub height_px: u32,
    /// Focal length, pixels, both axes.
    pub focal_px: f64,
}

impl Intrinsics {
    /// From the horizontal field of view: f = W / (2 tan(fov/2)).
    pub fn from_fov(width_px: u32, height_px: u32, fov_rad: f64) -> Self {
        Intrinsics {
            width_px,
            height_px,
            focal_px: width_px as f64 / (2.0 * (0.5 * fov_rad).tan()),
        }
    }

    /// `[fx, fy, cx, cy]`, principal point from the image's outer corner.
    pub fn as_array(&self) -> [f64; 4] {
        [
            self.focal_px,
            self.focal_px,
            0.5 * self.width_px as f64,
            0.5 * self.height_px as f64,
        ]
    }
}
