//! `cam_to_cam.yaml`: pinholes without distortion, and where the cameras are to one another. Camera 0
//! is the left event camera, 1 the left image camera, 2 and 3 the right ones.

use std::fmt::Write as _;

use schema_frames::FrameHeader;

/// A pinhole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Focal lengths and principal point from pixel centres: fx, fy, cx, cy.
    pub matrix_px: [f64; 4],
    /// Width and height.
    pub size_px: (u32, u32),
}

impl Pinhole {
    /// The pinhole of a frame; ours count from the corner of the first pixel, DSEC from its centre.
    pub fn new(header: &FrameHeader, size_px: (u32, u32)) -> Pinhole {
        let [fx, fy, cx, cy] = header.intrinsics_px;
        Pinhole {
            matrix_px: [fx, fy, cx - 0.5, cy - 0.5],
            size_px,
        }
    }
}

/// The text of the file; `baseline_m` if there is a camera on the right.
pub fn yaml(camera: Pinhole, baseline_m: Option<f64>) -> String {
    let [fx, fy, cx, cy] = camera.matrix_px;
    let (width, height) = camera.size_px;
    let n_cameras = if baseline_m.is_some() { 4 } else { 2 };
    let mut text = String::from("intrinsics:\n");
    for name in ["cam", "camRect"] {
        for i in 0..n_cameras {
            let _ = write!(
                text,
                "  {name}{i}:\n    camera_model: pinhole\n    camera_matrix: [{fx}, {fy}, {cx}, {cy}]\n    resolution: [{width}, {height}]\n"
            );
            if name == "cam" {
                text +=
                    "    distortion_coeffs: [0.0, 0.0, 0.0, 0.0]\n    distortion_model: radtan\n";
            }
        }
    }
    text += "extrinsics:\n";
    let mut pose = |name: &str, x_m: f64| {
        let _ = write!(
            text,
            "  {name}:\n  - [1.0, 0.0, 0.0, {x_m:?}]\n  - [0.0, 1.0, 0.0, 0.0]\n  - [0.0, 0.0, 1.0, 0.0]\n  - [0.0, 0.0, 0.0, 1.0]\n"
        );
    };
    pose("T_10", 0.0);
    if let Some(baseline_m) = baseline_m {
        pose("T_21", -baseline_m);
        pose("T_32", 0.0);
    }
    for i in 0..n_cameras {
        let _ = write!(
            text,
            "  R_rect{i}:\n  - [1.0, 0.0, 0.0]\n  - [0.0, 1.0, 0.0]\n  - [0.0, 0.0, 1.0]\n"
        );
    }
    if let Some(baseline_m) = baseline_m {
        text += "disparity_to_depth:\n";
        for pair in ["cams_03", "cams_12"] {
            let _ = write!(
                text,
                "  {pair}:\n  - [1.0, 0.0, 0.0, {:?}]\n  - [0.0, 1.0, 0.0, {:?}]\n  - [0.0, 0.0, 0.0, {fx:?}]\n  - [0.0, 0.0, {:?}, 0.0]\n",
                -cx,
                -cy,
                1.0 / baseline_m
            );
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_camera_has_no_right_one() {
        let camera = Pinhole {
            matrix_px: [320.0, 320.0, 319.5, 239.5],
            size_px: (640, 480),
        };
        let single = yaml(camera, None);
        assert!(single.contains("camera_matrix: [320, 320, 319.5, 239.5]"));
        assert!(!single.contains("T_21") && !single.contains("cam2"));
        let pair = yaml(camera, Some(0.5));
        assert!(pair.contains("[1.0, 0.0, 0.0, -0.5]") && pair.contains("[0.0, 0.0, 2.0, 0.0]"));
    }
}
