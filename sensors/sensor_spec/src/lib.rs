//! What a launch file or a blueprint may ask of each sensor, and the checks. No GPU, no scene.
//!
//! Each kind of sensor has a struct whose fields are the keys of its table in a launch file; units
//! are in the keys. [`SensorSpec`] is one sensor of any kind. A check reports every problem at
//! once: the key, the value found, and what is allowed.
//!
//! Modules in reading order: `check` ([`SpecError`]), `mount` (where a sensor sits), `intrinsics`
//! (the pinhole camera) with `distortion`, `film` and `blur`, which `optics` joins, `lens` (which
//! directions pixels show), one per kind (`camera` with `optics` and `dvs`, `lidar`, `radar`, `imu`,
//! `gnss`, `events`), and `sensor`
//! ([`SensorSpec`]).
//!
//! ```
//! use sensor_spec::{ImuSpec, SensorSpec};
//!
//! let imu = SensorSpec::Imu(ImuSpec { rate_hz: 30.0, ..ImuSpec::default() });
//! let errors = imu.check(100.0).unwrap_err();
//! assert_eq!(
//!     errors[0].to_string(),
//!     "rate_hz is 30, but must divide the tick rate 100; try 33.333333333333336 or 25"
//! );
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod blur;
mod camera;
mod check;
mod distortion;
mod dvs;
mod events;
mod film;
mod gnss;
mod imu;
mod intrinsics;
mod lens;
mod lidar;
mod mount;
mod optics;
mod radar;
mod sensor;

pub use blur::{FocusSpec, MotionBlurSpec};
pub use camera::{CameraSpec, SIDE_PX};
pub use check::SpecError;
pub use distortion::drawn_by;
pub use dvs::{DvsMode, DvsSpec};
pub use events::{CollisionSpec, LaneInvasionSpec, MAX_EVENTS_PER_TICK, ObstacleSpec};
pub use film::{FilmCurve, FilmParts, FilmSpec};
pub use gnss::{Datum, GnssSpec};
pub use imu::ImuSpec;
pub use intrinsics::Intrinsics;
pub use lens::{LensKind, LensSpec, MAX_ANGLE_DEG};
pub use lidar::{LidarScan, LidarSpec, MAX_CHANNELS, MAX_POINTS_PER_SECOND};
pub use mount::{Attachment, MountSpec};
pub use optics::{ExposureMode, ExposureSpec, OpticsSpec};
pub use radar::RadarSpec;
pub use sensor::SensorSpec;
