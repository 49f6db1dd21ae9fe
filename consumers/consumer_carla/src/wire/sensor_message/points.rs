//! Lists: events of event cameras, points of lidars, detections of radars.

use schema_frames::{DvsEvent, FrameHeader, LidarPoint, RadarDetection, SemanticLidarPoint};

/// Bytes of an event on the wire.
pub const DVS_EVENT_BYTES: usize = 13;

/// Events as packed x, y, time and polarity. `window_start_nanos` counts from the begin of the
/// episode.
pub fn dvs(out: &mut Vec<u8>, events: &[DvsEvent], window_start_nanos: u64) {
    out.reserve(events.len() * DVS_EVENT_BYTES);
    for event in events {
        out.extend(event.x_px.to_le_bytes());
        out.extend(event.y_px.to_le_bytes());
        out.extend((window_start_nanos + u64::from(event.nanos_in_window)).to_le_bytes());
        out.push(event.polarity);
    }
}

/// The head's angle (clockwise from where a turn of `fov_rad` begins), the number of channels, and
/// the number of points of each.
fn push_header(
    head: &mut Vec<u8>,
    header: &FrameHeader,
    fov_rad: f32,
    channels: impl Iterator<Item = u16>,
) {
    let mut counts = vec![0u32; header.n_channels as usize];
    for channel in channels {
        if let Some(count) = counts.get_mut(usize::from(channel)) {
            *count += 1;
        }
    }
    head.extend((0.5 * fov_rad - header.azimuth_rad).to_le_bytes());
    head.extend(header.n_channels.to_le_bytes());
    counts
        .iter()
        .for_each(|count| head.extend(count.to_le_bytes()));
}

fn push_place(out: &mut Vec<u8>, [x, y, z]: [f32; 3]) {
    [x, -y, z]
        .into_iter()
        .for_each(|metres| out.extend(metres.to_le_bytes()));
}

/// Points in the sensor's space, with intensity.
pub fn lidar(
    head: &mut Vec<u8>,
    out: &mut Vec<u8>,
    header: &FrameHeader,
    fov_rad: f32,
    points: &[LidarPoint],
) {
    push_header(
        head,
        header,
        fov_rad,
        points.iter().map(|point| point.channel),
    );
    out.reserve(points.len() * 16);
    for point in points {
        push_place(out, point.hit_in_sensor_m);
        out.extend((f32::from(point.intensity) / 65535.0).to_le_bytes());
    }
}

/// Points with the cosine of the angle of incidence, the actor that was hit (0 for scenery) and its
/// class.
pub fn semantic_lidar(
    head: &mut Vec<u8>,
    out: &mut Vec<u8>,
    header: &FrameHeader,
    fov_rad: f32,
    points: &[SemanticLidarPoint],
) {
    push_header(
        head,
        header,
        fov_rad,
        points.iter().map(|point| point.channel),
    );
    out.reserve(points.len() * 24);
    for point in points {
        push_place(out, point.hit_in_sensor_m);
        out.extend(point.cos_incidence.to_le_bytes());
        let actor = if point.object_id >> 31 == 0 {
            point.object_id
        } else {
            0
        };
        out.extend(actor.to_le_bytes());
        out.extend(u32::from(point.class).to_le_bytes());
    }
}

/// Velocity, azimuth (positive to the right), altitude, distance.
pub fn radar(out: &mut Vec<u8>, detections: &[RadarDetection]) {
    out.reserve(detections.len() * 16);
    for detection in detections {
        let numbers = [
            detection.velocity_mps,
            -detection.azimuth_rad,
            detection.altitude_rad,
            detection.depth_m,
        ];
        numbers
            .into_iter()
            .for_each(|number| out.extend(number.to_le_bytes()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable as _;
    use schema_frames::Modality;

    #[test]
    fn an_event_is_thirteen_bytes() {
        let mut out = Vec::new();
        let event = DvsEvent {
            nanos_in_window: 5,
            x_px: 0x102,
            y_px: 3,
            polarity: 1,
            ..DvsEvent::zeroed()
        };
        dvs(&mut out, &[event], 1 << 40);
        assert_eq!(out, [2, 1, 3, 0, 5, 0, 0, 0, 0, 1, 0, 0, 1]);
    }

    #[test]
    fn points_are_counted_by_channel_and_mirrored() {
        let header = FrameHeader {
            n_channels: 3,
            azimuth_rad: -0.5,
            ..FrameHeader::new(Modality::Lidar)
        };
        let point = |channel, intensity| LidarPoint {
            hit_in_sensor_m: [1.0, 2.0, 3.0],
            intensity,
            channel,
        };
        let (mut head, mut out) = (Vec::new(), Vec::new());
        lidar(
            &mut head,
            &mut out,
            &header,
            3.0,
            &[point(0, 65535), point(2, 0), point(2, 0)],
        );
        let words: Vec<u32> = head
            .as_chunks::<4>()
            .0
            .iter()
            .map(|word| u32::from_le_bytes(*word))
            .collect();
        assert_eq!(
            (f32::from_bits(words[0]), &words[1..]),
            (2.0, &[3, 1, 0, 2][..])
        );
        let floats: Vec<f32> = out
            .as_chunks::<4>()
            .0
            .iter()
            .map(|word| f32::from_le_bytes(*word))
            .collect();
        assert_eq!(floats[..4], [1.0, -2.0, 3.0, 1.0]);
        assert_eq!(floats.len(), 12);
    }

    #[test]
    fn a_detection_to_the_left_has_a_negative_azimuth() {
        let mut out = Vec::new();
        radar(
            &mut out,
            &[RadarDetection {
                velocity_mps: -3.0,
                azimuth_rad: 0.25,
                altitude_rad: 0.5,
                depth_m: 9.0,
                ..RadarDetection::zeroed()
            }],
        );
        let floats: Vec<f32> = out
            .as_chunks::<4>()
            .0
            .iter()
            .map(|word| f32::from_le_bytes(*word))
            .collect();
        assert_eq!(floats, [-3.0, -0.25, 0.5, 9.0]);
    }

    #[test]
    fn scenery_has_no_actor() {
        let header = FrameHeader {
            n_channels: 1,
            ..FrameHeader::new(Modality::SemanticLidar)
        };
        let point = |object_id| SemanticLidarPoint {
            object_id,
            class: 14,
            cos_incidence: 0.25,
            ..SemanticLidarPoint::zeroed()
        };
        let mut out = Vec::new();
        semantic_lidar(
            &mut Vec::new(),
            &mut out,
            &header,
            3.0,
            &[point(77), point(1 << 31 | 5)],
        );
        let words: Vec<u32> = out
            .as_chunks::<4>()
            .0
            .iter()
            .map(|word| u32::from_le_bytes(*word))
            .collect();
        assert_eq!(
            (
                f32::from_bits(words[3]),
                words[4],
                words[5],
                words[10],
                words[11]
            ),
            (0.25, 77, 14, 0, 14)
        );
    }
}
