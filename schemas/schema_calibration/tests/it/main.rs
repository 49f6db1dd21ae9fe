//! Files of calibration, read and written.

mod files;
mod round_trip;
