//! Small pictures of coded payloads, for programs that cannot decode them: half the size, as PNG;
//! of points every sixteenth. They are for looking at; nothing reads them back.

use bytemuck::pod_read_unaligned;
use foxglove::messages as fox;
use schema_frames::{DvsEvent, FrameHeader, Modality};
use schema_recording::messages::{Content, Entry};

use crate::palette::{self, ObjectColours};

use super::frames::{TopicName, cloud_head, image_size_px, timestamp, with_data};

/// Of so many points one is shown.
const POINTS_STEP: usize = 16;
/// Largest picture of a list of events: a header may claim any size.
const MAX_PIXELS: u64 = 64 << 20;
/// Distance that is shown half as bright as distance 0, metres.
const HALF_BRIGHT_M: f32 = 10.0;

/// Whether frames of this kind get a preview.
pub fn has_preview(modality: Modality) -> bool {
    use Modality::{Depth, Dvs, Instance, Lidar, LidarReturns, SemanticLidar};
    matches!(
        modality,
        Depth | Instance | Dvs | Lidar | SemanticLidar | LidarReturns
    )
}

/// A preview of a frame; `None` of what has none.
pub fn preview(
    name: &TopicName,
    header: &FrameHeader,
    modality: Modality,
    payload: &[u8],
) -> Option<Entry> {
    match modality {
        Modality::Depth => {
            let size = half(header)?;
            let pixels = sampled(header, payload, |bytes| {
                let distance_m = f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
                (255.0 * HALF_BRIGHT_M / (HALF_BRIGHT_M + distance_m.max(0.0))) as u8
            });
            let png = png(size, None, &pixels)?;
            Some(compressed(name, header, "png", &png))
        }
        Modality::Instance => {
            let size = half(header)?;
            let mut objects = ObjectColours::default();
            let pixels = sampled(header, payload, |bytes| {
                objects.number_of(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
            });
            let png = png(size, Some(objects.colours()), &pixels)?;
            Some(compressed(name, header, "png", &png))
        }
        Modality::Dvs => {
            let [width, height] = image_size_px(header)?;
            let size = [width.div_ceil(2), height.div_ceil(2)];
            if size[0] as u64 * size[1] as u64 > MAX_PIXELS {
                return None;
            }
            let pixels = last_events(size, payload);
            let png = png(size, Some(&palette::EVENTS), &pixels)?;
            Some(compressed(name, header, "png", &png))
        }
        Modality::Lidar | Modality::SemanticLidar | Modality::LidarReturns => {
            let element_bytes = modality.element_bytes();
            let points: Vec<u8> = payload
                .chunks_exact(element_bytes)
                .step_by(POINTS_STEP)
                .flatten()
                .copied()
                .collect();
            let head = cloud_head(name, header, modality);
            Some(Entry {
                topic: name.channel.clone(),
                content: Content::PointCloud,
                bytes: with_data(&head, &points, &mut |n| Vec::with_capacity(n)),
            })
        }
        _ => None,
    }
}

/// A message with an image file.
pub fn compressed(name: &TopicName, header: &FrameHeader, format: &str, data: &[u8]) -> Entry {
    let message = fox::CompressedImage {
        timestamp: Some(timestamp(header.sim_nanos)),
        frame_id: name.optical_frame_id(),
        data: data.to_vec().into(),
        format: format.to_string(),
    };
    Entry::foxglove(name.channel.clone(), Content::CompressedImage, &message)
}

fn half(header: &FrameHeader) -> Option<[u32; 2]> {
    let size = [header.width.div_ceil(2), header.height.div_ceil(2)];
    (size[0] > 0 && size[1] > 0).then_some(size)
}

/// One number for every second pixel of every second row.
fn sampled(header: &FrameHeader, payload: &[u8], mut of: impl FnMut(&[u8]) -> u8) -> Vec<u8> {
    let (stride, row_bytes) = (header.row_stride as usize, header.width as usize * 4);
    let mut pixels = Vec::with_capacity(payload.len() / 16 + header.width as usize);
    for y in (0..header.height as usize).step_by(2) {
        let row = &payload[y * stride..][..row_bytes];
        pixels.extend(row.chunks(8).map(&mut of));
    }
    pixels
}

/// The last event of each group of four pixels: 0 none, 1 darker, 2 brighter.
fn last_events(size: [u32; 2], payload: &[u8]) -> Vec<u8> {
    let [width, height] = size.map(|px| px as usize);
    let mut pixels = vec![0u8; width * height];
    for bytes in payload.chunks_exact(size_of::<DvsEvent>()) {
        let event: DvsEvent = pod_read_unaligned(bytes);
        let (x, y) = (event.x_px as usize / 2, event.y_px as usize / 2);
        if x < width && y < height {
            pixels[y * width + x] = 1 + (event.polarity == 1) as u8;
        }
    }
    pixels
}

/// Numbers of `colours`, or without them brightness.
fn png(size: [u32; 2], colours: Option<&[[u8; 3]]>, pixels: &[u8]) -> Option<Vec<u8>> {
    let mut file = Vec::with_capacity(pixels.len() / 4 + 1024);
    let mut encoder = png::Encoder::new(&mut file, size[0], size[1]);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fastest);
    match colours {
        Some(colours) => {
            encoder.set_color(png::ColorType::Indexed);
            encoder.set_palette(colours.concat());
        }
        None => encoder.set_color(png::ColorType::Grayscale),
    }
    let written = encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(pixels));
    written.ok().map(|()| file)
}
