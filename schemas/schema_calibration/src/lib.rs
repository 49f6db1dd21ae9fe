//! Files of calibration that other programs write and read: cameras with a lens, a size and a place.
//!
//! [`read`] makes [`Camera`]s of a text, [`write`] a text of cameras. A format that has no words for
//! a lens refuses it, with the models that it can say. Pixels of all these formats count from the
//! middle of the first pixel, Gantry's from its corner, so 0.5 is added and subtracted here and
//! nowhere else.
//!
//! Modules in reading order: `format`, `fault`, [`camera`], `tree` (YAML and JSON with their lines), `opencv`
//! (coefficients), and a module for each format.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod camera;
mod fault;
mod format;
mod tree;

mod said;

mod kalibr;
mod kitti;
mod kitti360;
mod ncore;
mod nuscenes;
mod opencv;
pub mod ros;

pub use camera::Camera;
pub use fault::{CalibrationError, Fault};
pub use format::Format;

use tree::Node;

/// The format that a text looks like.
fn format_of(root: &Node) -> Option<Format> {
    if let Some(list) = root.list() {
        let is_nuscenes = list.iter().any(|it| it.get("camera_intrinsic").is_some());
        return is_nuscenes.then_some(Format::NuScenes);
    }
    let has = |key: &str| root.get(key).is_some();
    let each = || root.entries().map(|(_, node)| node);
    if has("reference_poly") || each().any(|it| it.get("reference_poly").is_some()) {
        Some(Format::NCore)
    } else if has("mirror_parameters") || has("model_type") {
        Some(Format::Kitti360)
    } else if has("distortion_model") {
        Some(Format::Ros)
    } else if each().any(|it| it.get("camera_model").is_some()) {
        Some(Format::Kalibr)
    } else if each().any(|it| it.get("rows").is_some() && it.get("data").is_some()) {
        Some(Format::OpenCv)
    } else if root.entries().any(|(key, _)| kitti::is_projection(key)) {
        Some(Format::Kitti)
    } else {
        None
    }
}

/// Reads a file's text. `size_px` is the size of the images where the format does not tell it.
///
/// # Errors
/// What is wrong, with its line.
pub fn read(
    text: &str,
    format: Option<Format>,
    size_px: Option<[u32; 2]>,
) -> Result<(Format, Vec<Camera>), Fault> {
    let root = tree::parse(text)?;
    let Some(format) = format.or_else(|| format_of(&root)) else {
        let known = Format::ALL.map(Format::name).join(", ");
        return Err(Fault::new(format!(
            "this is no calibration of a known format; name the format with --format, one of {known}"
        )));
    };
    let cameras = match format {
        Format::Kalibr => kalibr::read(&root),
        Format::OpenCv => opencv::read(&root),
        Format::Ros => ros::read(&root),
        Format::NuScenes => nuscenes::read(&root, size_px),
        Format::Kitti => kitti::read(&root, size_px),
        Format::Kitti360 => kitti360::read(&root),
        Format::NCore => ncore::read(&root),
    }?;
    if cameras.is_empty() {
        return Err(Fault::new(format!(
            "no camera is described in this file of {}",
            format.name()
        )));
    }
    Ok((format, cameras))
}

/// Writes cameras as the text of a file.
///
/// # Errors
/// [`CalibrationError`] if the format has no words for one of them, or not for so many.
pub fn write(format: Format, cameras: &[Camera]) -> Result<String, CalibrationError> {
    let one = || match cameras {
        [camera] => Ok(camera),
        _ => Err(CalibrationError::Several {
            format: format.name(),
            names: cameras.iter().map(|it| it.name.clone()).collect(),
        }),
    };
    match format {
        Format::Kalibr => kalibr::write(cameras),
        Format::NuScenes => nuscenes::write(cameras),
        Format::OpenCv => opencv::write(one()?),
        Format::Ros => ros::write(one()?),
        Format::Kitti => kitti::write(one()?),
        Format::Kitti360 => kitti360::write(one()?),
        Format::NCore => ncore::write(one()?),
    }
}
