//! One sensor of a rig, whatever its kind.

use schema_frames::Modality;
use serde::{Deserialize, Serialize};

use crate::camera::CameraSpec;
use crate::check::SpecError;
use crate::events::{CollisionSpec, LaneInvasionSpec, MAX_EVENTS_PER_TICK, ObstacleSpec};
use crate::gnss::GnssSpec;
use crate::imu::ImuSpec;
use crate::lidar::LidarSpec;
use crate::mount::MountSpec;
use crate::optics::ExposureMode;
use crate::radar::RadarSpec;

/// One sensor of a rig: `[sensor.NAME]` in a launch file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum SensorSpec {
    /// A view with any of the camera modalities.
    Camera(CameraSpec),
    /// Lidar, plain or semantic.
    Lidar(LidarSpec),
    /// Inertial measurement unit.
    Imu(ImuSpec),
    /// Satellite positioning.
    Gnss(GnssSpec),
    /// Radar.
    Radar(RadarSpec),
    /// Obstacle detector.
    Obstacle(ObstacleSpec),
    /// Collision detector.
    Collision(CollisionSpec),
    /// Lane invasion detector.
    LaneInvasion(LaneInvasionSpec),
}

impl SensorSpec {
    /// Kinds as the key `kind` names them.
    pub const KINDS: [&str; 8] = [
        "camera",
        "lidar",
        "imu",
        "gnss",
        "radar",
        "obstacle",
        "collision",
        "lane_invasion",
    ];

    /// The defaults of a kind, one of [`SensorSpec::KINDS`].
    pub fn default_of(kind: &str) -> Option<SensorSpec> {
        Some(match kind {
            "camera" => SensorSpec::Camera(CameraSpec::default()),
            "lidar" => SensorSpec::Lidar(LidarSpec::default()),
            "imu" => SensorSpec::Imu(ImuSpec::default()),
            "gnss" => SensorSpec::Gnss(GnssSpec::default()),
            "radar" => SensorSpec::Radar(RadarSpec::default()),
            "obstacle" => SensorSpec::Obstacle(ObstacleSpec::default()),
            "collision" => SensorSpec::Collision(CollisionSpec::default()),
            "lane_invasion" => SensorSpec::LaneInvasion(LaneInvasionSpec::default()),
            _ => return None,
        })
    }

    /// Firings per second of simulated time; `None` for sensors that fire at every tick and have no
    /// key to change that.
    pub fn rate_hz(&self) -> Option<f64> {
        match self {
            SensorSpec::Camera(spec) => Some(spec.rate_hz),
            SensorSpec::Lidar(spec) => Some(spec.rate_hz),
            SensorSpec::Imu(spec) => Some(spec.rate_hz),
            SensorSpec::Gnss(spec) => Some(spec.rate_hz),
            SensorSpec::Radar(spec) => Some(spec.rate_hz),
            SensorSpec::Obstacle(spec) => Some(spec.rate_hz),
            SensorSpec::Collision(_) | SensorSpec::LaneInvasion(_) => None,
        }
    }

    /// Where the sensor sits on its carrier.
    pub fn mount(&self) -> &MountSpec {
        match self {
            SensorSpec::Camera(spec) => &spec.mount,
            SensorSpec::Lidar(spec) => &spec.mount,
            SensorSpec::Imu(spec) => &spec.mount,
            SensorSpec::Gnss(spec) => &spec.mount,
            SensorSpec::Radar(spec) => &spec.mount,
            SensorSpec::Obstacle(spec) => &spec.mount,
            SensorSpec::Collision(spec) => &spec.mount,
            SensorSpec::LaneInvasion(spec) => &spec.mount,
        }
    }

    /// The modalities it publishes, one topic each.
    pub fn modalities(&self) -> Vec<Modality> {
        match self {
            SensorSpec::Camera(spec) => spec.modalities.clone(),
            SensorSpec::Lidar(spec) => vec![match (spec.returns, spec.semantic) {
                (true, _) => Modality::LidarReturns,
                (false, true) => Modality::SemanticLidar,
                (false, false) => Modality::Lidar,
            }],
            SensorSpec::Imu(_) => vec![Modality::Imu],
            SensorSpec::Gnss(_) => vec![Modality::Gnss],
            SensorSpec::Radar(_) => vec![Modality::Radar],
            SensorSpec::Obstacle(_) => vec![Modality::Obstacle],
            SensorSpec::Collision(_) => vec![Modality::Collision],
            SensorSpec::LaneInvasion(_) => vec![Modality::LaneInvasion],
        }
    }

    /// Whether it is a camera whose lens has a model.
    pub fn has_lens(&self) -> bool {
        matches!(self, SensorSpec::Camera(camera) if camera.lens.is_some())
    }

    /// Whether a frame of `modality` depends on whether the one before it was made: event cameras
    /// and automatic exposure begin anew after a pause.
    pub fn remembers(&self, modality: Modality) -> bool {
        match self {
            SensorSpec::Camera(camera) => match modality {
                Modality::Dvs => true,
                Modality::Rgb => {
                    camera.optics.exposure.mode == ExposureMode::Histogram
                        && camera.optics.postprocess
                }
                _ => false,
            },
            _ => false,
        }
    }

    /// Largest number of payload bytes that a frame of `modality` can have after a tick of
    /// `tick_secs`.
    pub fn max_payload_bytes(&self, modality: Modality, tick_secs: f64) -> usize {
        let n_elements = match self {
            SensorSpec::Camera(spec) if modality == Modality::Dvs => spec.max_events() as usize,
            SensorSpec::Camera(spec) => spec.width_px as usize * spec.height_px as usize,
            SensorSpec::Lidar(spec) => spec.points_per_frame(tick_secs).max(1) as usize,
            SensorSpec::Radar(spec) => spec.rays_per_frame(tick_secs).max(1) as usize,
            SensorSpec::Imu(_) | SensorSpec::Gnss(_) | SensorSpec::Obstacle(_) => 1,
            SensorSpec::Collision(_) | SensorSpec::LaneInvasion(_) => MAX_EVENTS_PER_TICK,
        };
        n_elements * modality.element_bytes()
    }

    /// Checks every value; `tick_hz` is the launch file's tick rate.
    ///
    /// # Errors
    /// All problems found, each naming key, value and what is allowed.
    pub fn check(&self, tick_hz: f64) -> Result<(), Vec<SpecError>> {
        let mut errors = Vec::new();
        if let Some(rate_hz) = self.rate_hz() {
            check_rate(rate_hz, tick_hz, &mut errors);
        }
        self.mount().check(&mut errors);
        match self {
            SensorSpec::Camera(spec) => spec.check(&mut errors),
            SensorSpec::Lidar(spec) => spec.check(&mut errors),
            SensorSpec::Imu(spec) => spec.check(&mut errors),
            SensorSpec::Gnss(spec) => spec.check(&mut errors),
            SensorSpec::Radar(spec) => spec.check(&mut errors),
            SensorSpec::Obstacle(spec) => spec.check(&mut errors),
            SensorSpec::Collision(_) | SensorSpec::LaneInvasion(_) => {}
        }
        if errors.is_empty() {
            Ok(())
        } else {
            Err(errors)
        }
    }
}

/// A launch file's rate must divide the tick rate.
fn check_rate(rate_hz: f64, tick_hz: f64, errors: &mut Vec<SpecError>) {
    if !(rate_hz > 0.0 && rate_hz <= tick_hz) {
        errors.push(SpecError {
            key: "rate_hz",
            value: rate_hz.to_string(),
            allowed: format!("must be above 0 and at most the tick rate {tick_hz}"),
        });
        return;
    }
    let ticks = tick_hz / rate_hz;
    if (ticks - ticks.round()).abs() > 1e-9 * ticks {
        let nearest = [ticks.floor(), ticks.ceil()].map(|n| format!("{}", tick_hz / n));
        let allowed = format!(
            "must divide the tick rate {tick_hz}; try {} or {}",
            nearest[0], nearest[1]
        );
        errors.push(SpecError {
            key: "rate_hz",
            value: rate_hz.to_string(),
            allowed,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rate_that_does_not_divide_the_tick_rate_is_refused_with_neighbours() {
        let spec = SensorSpec::Imu(ImuSpec {
            rate_hz: 30.0,
            ..Default::default()
        });
        let errors = spec.check(100.0).unwrap_err();
        assert_eq!(
            errors[0].to_string(),
            "rate_hz is 30, but must divide the tick rate 100; try 33.333333333333336 or 25"
        );
        assert!(
            SensorSpec::Imu(ImuSpec {
                rate_hz: 25.0,
                ..Default::default()
            })
            .check(100.0)
            .is_ok()
        );
    }

    #[test]
    fn nan_is_refused() {
        let spec = SensorSpec::Gnss(GnssSpec {
            rate_hz: f64::NAN,
            noise_altitude_stddev_m: f64::NAN,
            ..Default::default()
        });
        assert_eq!(spec.check(20.0).unwrap_err().len(), 2);
    }
}
