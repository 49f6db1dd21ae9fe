//! Units, spaces, poses, time, ids and classes that every crate shares.
//!
//! Everything here is plain data or pure arithmetic: no clock, no allocation in hot paths, and no
//! I/O but for [`files`], the one way in which programs open what others wrote.
//! [`space`] defines the coordinate systems, [`pose`] the transforms between them, [`lens`] the
//! models of cameras' lenses, [`time`] ticks and clocks, [`id`] and [`class`] what a pixel or a ray
//! can show, and [`noise`] random numbers that do not depend on who else draws some.
//!
//! ```
//! use schema_types::time::TickClock;
//! use schema_types::{Pose, SimTime, Tick};
//!
//! // A camera 2 m in front of a vehicle that stands at (10, 0) and looks north.
//! let north_rad = std::f64::consts::FRAC_PI_2;
//! let world_from_vehicle = Pose::from_xyz_yaw(10.0, 0.0, 0.0, north_rad).isometry();
//! let vehicle_from_sensor = Pose::from_xyz_yaw(2.0, 0.0, 1.5, 0.0).isometry();
//! let world_from_sensor = Pose::from(world_from_vehicle * vehicle_from_sensor);
//! let [x_m, y_m, z_m] = world_from_sensor.translation_m;
//! assert!((x_m - 10.0).abs() < 1e-9 && (y_m - 2.0).abs() < 1e-9 && z_m == 1.5);
//!
//! // Time is counted in integer nanoseconds, so it never drifts.
//! let clock = TickClock::new(50_000_000);
//! assert_eq!(clock.time_of(Tick(3)), SimTime(150_000_000));
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

// Where and when.
pub mod distortion;
pub mod lens;
pub mod pose;
pub mod space;
pub mod time;

// What it is.
pub mod class;
pub mod id;

pub mod noise;

// What others wrote.
pub mod files;

pub use class::Class;
pub use distortion::Distortion;
pub use id::{ActorId, ObjectId};
pub use lens::{Lens, LensModel};
pub use pose::Pose;
pub use time::{MonoTime, SimTime, Tick};
