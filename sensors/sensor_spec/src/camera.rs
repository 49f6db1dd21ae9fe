//! Cameras: resolution, lens, modalities, event camera.

use schema_frames::Modality;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::{MountSpec, OpticsSpec, SpecError, check_range};

/// Smallest and largest image side, pixels.
pub const SIDE_PX: (u32, u32) = (16, 4096);

/// A view: one pose and lens, any of the camera modalities.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraSpec {
    /// Firings per second.
    pub rate_hz: f64,
    /// Place on the vehicle.
    pub mount: MountSpec,
    /// Image width.
    pub width_px: u32,
    /// Image height.
    pub height_px: u32,
    /// Horizontal field of view.
    pub fov_deg: f64,
    /// What to publish.
    #[serde(serialize_with = "names", deserialize_with = "from_names")]
    pub modalities: Vec<Modality>,
    /// Exposure, lens and white balance of `rgb`.
    pub optics: OpticsSpec,
    /// Event camera, used if `modalities` has `dvs`.
    pub dvs: DvsSpec,
}

impl Default for CameraSpec {
    fn default() -> Self {
        CameraSpec {
            rate_hz: 20.0,
            mount: MountSpec::default(),
            width_px: 800,
            height_px: 600,
            fov_deg: 90.0,
            modalities: vec![Modality::Rgb],
            optics: OpticsSpec::default(),
            dvs: DvsSpec::default(),
        }
    }
}

impl CameraSpec {
    /// Pinhole parameters.
    pub fn intrinsics(&self) -> Intrinsics {
        Intrinsics::from_fov(self.width_px, self.height_px, self.fov_deg.to_radians())
    }

    /// Most events one frame of `dvs` can carry.
    pub fn max_events(&self) -> u32 {
        self.dvs.max_events_of(self.width_px, self.height_px)
    }

    pub(crate) fn check(&self, errors: &mut Vec<SpecError>) {
        check_range("width_px", self.width_px, SIDE_PX.0, SIDE_PX.1, errors);
        check_range("height_px", self.height_px, SIDE_PX.0, SIDE_PX.1, errors);
        if !(self.fov_deg > 0.0 && self.fov_deg < 180.0) {
            errors.push(SpecError {
                key: "fov_deg",
                value: self.fov_deg.to_string(),
                allowed: "must lie between 0 and 180, both excluded".into(),
            });
        }
        self.optics.check(errors);
        for (i, modality) in self.modalities.iter().enumerate() {
            if self.modalities[..i].contains(modality) {
                errors.push(SpecError {
                    key: "modalities",
                    value: format!("{:?} twice", modality.name()),
                    allowed: "each may be named once".into(),
                });
            }
        }
        if self.modalities.is_empty() {
            errors.push(SpecError {
                key: "modalities",
                value: "empty".into(),
                allowed:
                    "must name at least one of rgb, depth, semantic, instance, flow, normals, dvs"
                        .into(),
            });
        }
        self.dvs.check(errors);
    }
}

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

/// How brightness is followed between two firings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DvsMode {
    /// Along the motion field: edges cross a pixel when they do.
    #[default]
    Motion,
    /// In a straight line at every pixel: CARLA's model.
    TwoFrame,
}

/// Event camera: a contrast threshold crossed makes an event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DvsSpec {
    /// How brightness is followed between two firings.
    pub mode: DvsMode,
    /// Rise of the level per event.
    pub positive_threshold: f32,
    /// Fall of the level per event.
    pub negative_threshold: f32,
    /// Standard deviation of the thresholds from pixel to pixel.
    pub threshold_mismatch_stddev: f32,
    /// Standard deviation of the positive threshold from window to window, at every pixel anew.
    pub sigma_positive_threshold: f32,
    /// The same of the negative threshold.
    pub sigma_negative_threshold: f32,
    /// Time a pixel stays silent after an event.
    pub refractory_nanos: u32,
    /// Level is ln(luminance + `log_eps`) with luminance 0..=1; otherwise 255 · luminance.
    pub use_log: bool,
    /// Added to luminance (0..=1) before the logarithm.
    pub log_eps: f32,
    /// Events of rising brightness per second and pixel that come without any change.
    pub leak_rate_hz: f32,
    /// Events per second and pixel of either polarity by chance in the dark; a quarter of that in
    /// full light.
    pub shot_noise_rate_hz: f32,
    /// Longest path of a point over the image between two samples of its brightness.
    pub substep_px: f32,
    /// Most events one frame can carry; what is beyond is dropped from its end and counted. 0: one
    /// per pixel, at least 4096.
    pub max_events: u32,
    /// Tells the noise of otherwise equal event cameras apart.
    pub noise_seed: u64,
}

impl Default for DvsSpec {
    fn default() -> Self {
        DvsSpec {
            mode: DvsMode::Motion,
            positive_threshold: 0.3,
            negative_threshold: 0.3,
            threshold_mismatch_stddev: 0.0,
            sigma_positive_threshold: 0.0,
            sigma_negative_threshold: 0.0,
            refractory_nanos: 0,
            use_log: true,
            log_eps: 0.001,
            leak_rate_hz: 0.0,
            shot_noise_rate_hz: 0.0,
            substep_px: 1.0,
            max_events: 0,
            noise_seed: 0,
        }
    }
}

impl DvsSpec {
    /// Most events one frame of a picture of this size can carry.
    pub fn max_events_of(&self, width_px: u32, height_px: u32) -> u32 {
        match self.max_events {
            0 => (width_px * height_px).max(4096),
            n => n,
        }
    }

    fn check(&self, errors: &mut Vec<SpecError>) {
        // In grey levels of 255 without the logarithm.
        let (least, most) = if self.use_log {
            (0.01, 10.0)
        } else {
            (0.1, 255.0)
        };
        check_range(
            "dvs.positive_threshold",
            self.positive_threshold,
            least,
            most,
            errors,
        );
        check_range(
            "dvs.negative_threshold",
            self.negative_threshold,
            least,
            most,
            errors,
        );
        check_range(
            "dvs.threshold_mismatch_stddev",
            self.threshold_mismatch_stddev,
            0.0,
            most,
            errors,
        );
        check_range(
            "dvs.sigma_positive_threshold",
            self.sigma_positive_threshold,
            0.0,
            most,
            errors,
        );
        check_range(
            "dvs.sigma_negative_threshold",
            self.sigma_negative_threshold,
            0.0,
            most,
            errors,
        );
        check_range(
            "dvs.refractory_nanos",
            self.refractory_nanos,
            0,
            1_000_000_000,
            errors,
        );
        check_range("dvs.log_eps", self.log_eps, 1e-6, 1.0, errors);
        check_range("dvs.leak_rate_hz", self.leak_rate_hz, 0.0, 1000.0, errors);
        check_range(
            "dvs.shot_noise_rate_hz",
            self.shot_noise_rate_hz,
            0.0,
            1000.0,
            errors,
        );
        check_range("dvs.substep_px", self.substep_px, 0.1, 64.0, errors);
        check_range("dvs.max_events", self.max_events, 0, 50_000_000, errors);
    }
}

fn names<S: Serializer>(modalities: &[Modality], out: S) -> Result<S::Ok, S::Error> {
    out.collect_seq(modalities.iter().map(|m| m.name()))
}

fn from_names<'de, D: Deserializer<'de>>(input: D) -> Result<Vec<Modality>, D::Error> {
    let camera = |m: &Modality| m.sensor_kind() == schema_frames::SensorKind::Camera;
    let names = Vec::<String>::deserialize(input)?;
    names
        .into_iter()
        .map(|name| {
            Modality::from_name(&name).filter(camera).ok_or_else(|| {
                let known: Vec<_> = Modality::ALL
                    .iter()
                    .filter(|m| camera(m))
                    .map(|m| m.name())
                    .collect();
                serde::de::Error::custom(format!(
                    "must name only {}; {name:?} is none of them",
                    known.join(", ")
                ))
            })
        })
        .collect()
}
