//! Frames as the messages of a bag.

use consumer_forms::ros2::cdr::Writer;
use consumer_forms::ros2::sensors;
use consumer_forms::ros2::types::{self, Type};
use consumer_truth::ticks::TickFrame;
use schema_frames::{GnssSample, ImuSample, Modality};

use crate::formats::evt3;
use crate::formats::evt3::words::Encoder;

/// Takes a message: its topic, its type, its bytes.
pub type TakeMessage<'a> = dyn FnMut(&str, &Type, &Writer) -> anyhow::Result<()> + 'a;

/// Hands every message of a frame to `take`, each made in the memory of `cdr`. `words` goes on from
/// one frame of an event camera to the next.
///
/// # Errors
/// If the frame is too large for a message, or an error of `take`.
pub fn messages(
    cdr: &mut Writer,
    words: &mut Encoder,
    rig: &str,
    frame: &TickFrame,
    take: &mut TakeMessage<'_>,
) -> anyhow::Result<()> {
    let (header, payload, sensor) = (&frame.header, &frame.payload, frame.sensor());
    let base = format!("/{}/{}", ros_name(rig), ros_name(sensor));
    let own = format!("{rig}/{sensor}");
    let optical = format!("{own}_optical");
    match frame.modality {
        modality if modality.is_image() => {
            let base = format!("{base}/{}", modality.name());
            sensors::image(cdr, header, payload, &optical)?;
            take(&format!("{base}/image_raw"), &types::IMAGE, cdr)?;
            sensors::camera_info(cdr, header, None, (header.width, header.height), &optical);
            take(&format!("{base}/camera_info"), &types::CAMERA_INFO, cdr)
        }
        Modality::Dvs => {
            let size_px = evt3::size_px(header);
            let mut bytes = Vec::new();
            words.encode(&evt3::events(frame), &mut bytes)?;
            words.pass_time(header.sim_nanos / 1000, &mut bytes)?;
            sensors::events(cdr, header, size_px, &bytes, &optical)?;
            take(&format!("{base}/dvs/events"), &types::EVENT_PACKET, cdr)?;
            sensors::camera_info(cdr, header, None, size_px, &optical);
            take(&format!("{base}/dvs/camera_info"), &types::CAMERA_INFO, cdr)
        }
        Modality::Lidar | Modality::SemanticLidar | Modality::LidarReturns | Modality::Radar => {
            let leaf = match frame.modality {
                Modality::Lidar => "points",
                Modality::SemanticLidar => "semantic_points",
                Modality::LidarReturns => "returns",
                _ => "detections",
            };
            sensors::points(cdr, header, payload, &own)?;
            take(&format!("{base}/{leaf}"), &types::POINT_CLOUD, cdr)
        }
        Modality::Imu => {
            for sample in frame.elements::<ImuSample>() {
                sensors::imu(cdr, header, &sample, &own);
                take(&format!("{base}/data"), &types::IMU, cdr)?;
            }
            Ok(())
        }
        Modality::Gnss => {
            for sample in frame.elements::<GnssSample>() {
                sensors::nav_sat_fix(cdr, header, &sample, &own);
                take(&format!("{base}/fix"), &types::NAV_SAT_FIX, cdr)?;
            }
            Ok(())
        }
        _ => Ok(()),
    }
}

/// A name as ROS allows it in topics: letters, digits and `_`, and no digit first.
pub(super) fn ros_name(name: &str) -> String {
    let mut safe: String = name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
        .collect();
    if safe.starts_with(|c: char| c.is_ascii_digit()) || safe.is_empty() {
        safe.insert(0, '_');
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_what_ros_allows() {
        assert_eq!(ros_name("front-left.2"), "front_left_2");
        assert_eq!(ros_name("2nd"), "_2nd");
    }
}
