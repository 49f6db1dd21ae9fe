//! What the pixels of frames show. A header says it of a pinhole; the numbers of a lens with a model
//! are in `world/info`.

use std::collections::BTreeMap;
use std::sync::Arc;

use schema_bus::{Bus, BusError, names};
use schema_frames::{Calibration, FrameHeader, WorldInfo};

use crate::document::FollowedDocument;

/// The calibrations of a world's cameras, live or of a recording.
///
/// ```no_run
/// # use consumer_kit::{Calibrations, Follower, Take};
/// # let mut follower = Follower::open("gantry", "my-consumer")?;
/// # let camera = follower.follow("ego/front/rgb", Take::Newest);
/// let mut calibrations = Calibrations::new();
/// if let Some(frame) = follower.take(camera)?
///     && let Some(calibration) = calibrations.of(follower.bus(), frame.header())?
/// {
///     println!("{:?}", calibration.unproject([400.0, 300.0]));
/// }
/// # Ok::<(), schema_bus::BusError>(())
/// ```
#[derive(Debug)]
pub struct Calibrations {
    info: FollowedDocument,
    /// Lenses of the newest `world/info`, by the headers' `calibration_crc`.
    known: BTreeMap<u32, Arc<Calibration>>,
}

impl Default for Calibrations {
    fn default() -> Self {
        Calibrations::new()
    }
}

impl Calibrations {
    /// Knows no lens yet.
    pub fn new() -> Calibrations {
        Calibrations {
            info: FollowedDocument::optional(names::WORLD_INFO),
            known: BTreeMap::new(),
        }
    }

    /// Takes over what a `world/info` says, for example of a recording.
    pub fn take(&mut self, info: &WorldInfo) {
        let lenses = info.cameras.iter().map(|camera| &camera.calibration);
        let named = lenses.filter(|it| it.crc() != 0);
        self.known = named.map(|it| (it.crc(), Arc::new(it.clone()))).collect();
    }

    /// The calibration of a frame; `None` if it is no camera's, or of a batch, or if no `world/info` so
    /// far describes its lens.
    pub fn known(&self, header: &FrameHeader) -> Option<Arc<Calibration>> {
        match header.lens_model() {
            0 => Calibration::of(header).map(Arc::new),
            _ => self.known.get(&header.calibration_crc).cloned(),
        }
    }

    /// As [`Calibrations::known`], and looks for a new `world/info` if the lens is not known.
    ///
    /// # Errors
    /// What waiting cannot heal.
    pub fn of(
        &mut self,
        bus: &Bus,
        header: &FrameHeader,
    ) -> Result<Option<Arc<Calibration>>, BusError> {
        if header.lens_model() != 0
            && !self.known.contains_key(&header.calibration_crc)
            && let Some(document) = self.info.changed(bus)?
        {
            // What another version wrote describes no lens.
            if let Ok(info) = document.json::<WorldInfo>() {
                self.take(&info);
            }
        }
        Ok(self.known(header))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_frames::Modality;
    use schema_types::lens::{Lens, LensModel, Plane};

    #[test]
    fn a_lens_is_known_by_its_crc_once_world_info_described_it() {
        let plane = Plane {
            focal_px: [240.0; 2],
            shear_px: [0.0; 2],
            centre_px: [400.0, 300.0],
        };
        let lens = Lens::new(LensModel::Equidistant {}, plane, None).unwrap();
        let own = Calibration::of_lens(lens, [800, 600]);
        let mut header = FrameHeader::new(Modality::Rgb);
        header.set_image(800, 600);
        header.optics = 6;
        header.calibration_crc = own.crc();
        let mut calibrations = Calibrations::new();
        assert_eq!(calibrations.known(&header), None);
        let info = format!(
            r#"{{"source":"live","version":"1","epoch":"1","episode":1,"map":"","seed":0,
            "mode":"stepped","period_nanos":1,"episode_start_nanos":0,"lockstep":[],"weather":{{}},
            "adapter":"","cpu_copies":0,"cameras":[{{"name":"ego/front","sensor_id":7,"mount":null,
            "calibration":{}}}]}}"#,
            serde_json::to_string(&own).unwrap()
        );
        calibrations.take(&serde_json::from_str(&info).unwrap());
        assert_eq!(calibrations.known(&header).as_deref(), Some(&own));
        header.calibration_crc ^= 1;
        assert_eq!(calibrations.known(&header), None);
        header.optics = 0;
        header.intrinsics_px = [100.0, 100.0, 400.0, 300.0];
        assert_eq!(calibrations.known(&header).unwrap().crc(), 0);
    }
}
