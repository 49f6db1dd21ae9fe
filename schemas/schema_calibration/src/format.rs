//! Formats of calibrations, and the lenses that each has words for.

/// A format of calibrations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Kalibr's `camchain.yaml`.
    Kalibr,
    /// OpenCV's `FileStorage` in YAML.
    OpenCv,
    /// ROS's `camera_info` in YAML, as `camera_calibration_parsers` writes it.
    Ros,
    /// nuScenes' `calibrated_sensor.json`.
    NuScenes,
    /// KITTI's text of projection matrices.
    Kitti,
    /// KITTI-360's `image_02.yaml`: Mei's model.
    Kitti360,
    /// NCore's JSON of f-theta cameras.
    NCore,
}

impl Format {
    /// All formats.
    pub const ALL: [Format; 7] = [
        Format::Kalibr,
        Format::OpenCv,
        Format::Ros,
        Format::NuScenes,
        Format::Kitti,
        Format::Kitti360,
        Format::NCore,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Format::Kalibr => "kalibr",
            Format::OpenCv => "opencv",
            Format::Ros => "ros",
            Format::NuScenes => "nuscenes",
            Format::Kitti => "kitti",
            Format::Kitti360 => "kitti360",
            Format::NCore => "ncore",
        }
    }

    /// The format of this name.
    pub fn from_name(name: &str) -> Option<Format> {
        Format::ALL.into_iter().find(|format| format.name() == name)
    }

    /// Whether a file of it holds several cameras.
    pub fn holds_several(self) -> bool {
        matches!(self, Format::Kalibr | Format::NuScenes)
    }

    /// The lenses that it has words for.
    pub const fn models(self) -> &'static str {
        match self {
            Format::Kalibr => {
                "pinhole, opencv with k1, k2, p1, p2 alone, unified with the same, kannala_brandt, equidistant and double_sphere"
            }
            Format::OpenCv => {
                "pinhole, opencv, unified with k1, k2, p1, p2, kannala_brandt and equidistant"
            }
            Format::Ros => "pinhole, opencv with k1 to k6, p1, p2, kannala_brandt and equidistant",
            Format::NuScenes | Format::Kitti => "pinhole",
            Format::Kitti360 => "unified with k1, k2, p1, p2 alone",
            Format::NCore => "ftheta with at most six coefficients",
        }
    }
}
