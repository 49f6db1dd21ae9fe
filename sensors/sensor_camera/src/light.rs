//! Light of the weather: sun, sky, air and exposure, and how materials look in it.

mod material;
mod sky;
mod weather_light;

pub(crate) use material::{noise_levels, noise_texture};
pub(crate) use weather_light::{Light, upload_sky};
