//! The formats, one module each, and what several of them share.

mod coco;
mod dsec;
mod evt3;
mod family;
mod kitti;
mod kitti360;
mod nuscenes;
mod objects;
pub mod rosbag;
mod semantickitti;
mod trajectory;
mod yolo;

pub use crate::exporter::Format;

use crate::exporter::Exporter;
use crate::options::Options;

/// The exporter of a format.
///
/// # Errors
/// A sentence if the options do not fit the format.
pub fn exporter(format: Format, options: &Options) -> anyhow::Result<Box<dyn Exporter>> {
    Ok(match format {
        Format::Kitti => Box::new(kitti::Kitti::new(options)),
        Format::SemanticKitti => Box::new(semantickitti::SemanticKitti::new(options)),
        Format::Nuscenes => Box::new(nuscenes::NuScenes::new(options)),
        Format::Kitti360 => Box::new(kitti360::Kitti360::new(options)),
        Format::Coco => Box::new(coco::Coco::new(options)),
        Format::Yolo => Box::new(yolo::Yolo::new(options)),
        Format::Dsec => Box::new(dsec::Dsec::new(options)?),
        Format::Evt3 => Box::new(evt3::Evt3::new(options)),
        Format::Ros2Bag => Box::new(rosbag::Ros2Bag::new(options)),
    })
}
