//! Settings of a camera: resolution, field of view, modalities.

use schema_frames::{Calibration, Modality};
use schema_types::Lens;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::check::{SpecError, check_range};
use crate::dvs::DvsSpec;
use crate::intrinsics::Intrinsics;
use crate::lens::LensSpec;
use crate::mount::MountSpec;
use crate::optics::OpticsSpec;

/// Smallest and largest image side, pixels.
pub const SIDE_PX: (u32, u32) = (16, 4096);

/// A camera: one pose and lens, any of the camera modalities.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraSpec {
    /// Firings per second.
    pub rate_hz: f64,
    /// Place on the vehicle.
    pub mount: MountSpec,
    /// Image width, pixels.
    pub width_px: u32,
    /// Image height, pixels.
    pub height_px: u32,
    /// Horizontal field of view, degrees; a lens of another model than `none` has its own.
    pub fov_deg: f64,
    /// Which directions its pixels show.
    pub lens: LensSpec,
    /// Modalities to publish.
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
            lens: LensSpec::default(),
            modalities: vec![Modality::Rgb],
            optics: OpticsSpec::default(),
            dvs: DvsSpec::default(),
        }
    }
}

impl CameraSpec {
    /// Pinhole parameters; of a camera with a [`CameraSpec::lens`] only the size has a meaning.
    pub fn intrinsics(&self) -> Intrinsics {
        Intrinsics::from_fov(self.width_px, self.height_px, self.fov_deg.to_radians())
    }

    /// Its lens; `None` for the pinhole of its field of view, and for values that
    /// [`crate::SensorSpec::check`] refuses.
    pub fn lens(&self) -> Option<Lens> {
        self.lens
            .lens([self.width_px, self.height_px])
            .ok()
            .flatten()
    }

    /// What its pixels show; `None` for values that [`crate::SensorSpec::check`] refuses.
    pub fn calibration(&self) -> Option<Calibration> {
        let size_px = [self.width_px, self.height_px];
        match self.lens.lens(size_px).ok()? {
            Some(lens) => Some(Calibration::of_lens(lens, size_px)),
            None => Calibration::pinhole(
                self.intrinsics().as_array(),
                self.optics.distortion(),
                size_px,
            ),
        }
    }

    /// Largest number of events in one frame of `dvs`.
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
        self.lens.check([self.width_px, self.height_px], errors);
        if self.lens.is_some() {
            self.check_with_lens(errors);
        }
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

    /// What a camera with a lens does not have beside it.
    fn check_with_lens(&self, errors: &mut Vec<SpecError>) {
        let mut refuse = |key, value: String, allowed: &str| {
            errors.push(SpecError {
                key,
                value,
                allowed: allowed.into(),
            });
        };
        if self.fov_deg != CameraSpec::default().fov_deg {
            let allowed = "lens.model says the field of view; leave fov_deg out";
            refuse("fov_deg", self.fov_deg.to_string(), allowed);
        }
        let optics = &self.optics;
        if optics.distortion().is_some() {
            let (key, value) = match optics.distortion_k == 0.0 {
                true => ("optics.distortion_k_cubed", optics.distortion_k_cubed),
                false => ("optics.distortion_k", optics.distortion_k),
            };
            let allowed = "lens.model bends the image already; leave it out";
            refuse(key, value.to_string(), allowed);
        }
        if optics.is_blurred() {
            let focus = &optics.focus;
            let (key, value) = match (optics.smears_motion(), focus.distance_m > 0.0) {
                (true, _) => {
                    let shutter_secs = optics.motion_blur.shutter_secs;
                    ("optics.motion_blur.shutter_secs", shutter_secs)
                }
                (false, true) => ("optics.focus.distance_m", focus.distance_m),
                (false, false) => ("optics.focus.haze_px", focus.haze_px),
            };
            let allowed = "pictures through lens.model are not blurred; leave it out";
            refuse(key, value.to_string(), allowed);
        }
        let unseen = |it: &&Modality| matches!(it, Modality::Flow | Modality::Dvs);
        if let Some(modality) = self.modalities.iter().find(unseen) {
            let allowed = "a camera with lens.model makes only rgb, depth, semantic, instance, normals; name these";
            refuse("modalities", format!("{:?}", modality.name()), allowed);
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::LensKind;

    fn sentences(change: impl Fn(&mut CameraSpec)) -> Vec<String> {
        let mut spec = CameraSpec::default();
        spec.lens.model = LensKind::Equidistant;
        spec.lens.focal_px = [200.0; 2];
        change(&mut spec);
        let mut errors = Vec::new();
        spec.check(&mut errors);
        errors.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn what_no_picture_through_a_lens_has_is_refused() {
        assert_eq!(sentences(|_| ()), [""; 0]);
        for (change, wanted) in [
            (
                (|it| it.modalities.push(Modality::Flow)) as fn(&mut CameraSpec),
                "modalities is \"flow\", but a camera with lens.model makes only rgb, depth, semantic, instance, normals; name these",
            ),
            (
                |it| it.optics.motion_blur.shutter_secs = 0.01,
                "optics.motion_blur.shutter_secs is 0.01, but pictures through lens.model are not blurred; leave it out",
            ),
            (
                |it| it.optics.focus.distance_m = 5.0,
                "optics.focus.distance_m is 5, but pictures through lens.model are not blurred; leave it out",
            ),
            (
                |it| it.optics.distortion_k = 0.1,
                "optics.distortion_k is 0.1, but lens.model bends the image already; leave it out",
            ),
        ] {
            assert_eq!(sentences(change), [wanted]);
        }
    }
}
