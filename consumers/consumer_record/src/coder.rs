//! Codes frames on their way into the file: the lossless message holds a smaller payload, and other
//! programs get a picture that they can show. Colour may be stored as JPEG or video instead, which
//! is smaller and not lossless.

use std::sync::Arc;

use image::codecs::jpeg::JpegEncoder;
use schema_frames::{FrameHeader, Modality};
use schema_recording::codec::{Encoder, PNG};
use schema_recording::messages::Entry;

use crate::options::{Coding, KEY_EVERY_NANOS};
use crate::stages;
use crate::video::{H264_NAME, Videos};
use consumer_forms::foxglove::frames::{TopicName, frame, frame_entries};
use consumer_forms::foxglove::previews::{compressed, has_preview, preview};

/// Name of JPEG in `foxglove.CompressedImage` and `gantry.Frame`.
pub const JPEG: &str = "jpeg";

/// Codes frame after frame; every thread has its own.
pub struct FrameCoder {
    coding: Coding,
    encoder: Option<Encoder>,
    videos: Option<Arc<Videos>>,
}

impl FrameCoder {
    /// A coder.
    ///
    /// # Errors
    /// If zstd cannot be set up.
    pub fn new(coding: Coding) -> anyhow::Result<FrameCoder> {
        let encoder = coding.lossless.then(Encoder::new).transpose()?;
        let videos = coding.video_qp.map(|qp| Arc::new(Videos::new(qp)));
        Ok(FrameCoder {
            coding,
            encoder,
            videos,
        })
    }

    /// One for another thread, which goes on with the same videos.
    ///
    /// # Errors
    /// If zstd cannot be set up.
    pub fn another(&self) -> anyhow::Result<FrameCoder> {
        Ok(FrameCoder {
            videos: self.videos.clone(),
            ..FrameCoder::new(self.coding)?
        })
    }

    /// The messages of a frame; `payload` and `header` as for [`frame_entries`].
    pub fn entries(
        &mut self,
        name: &TopicName,
        header: &FrameHeader,
        payload: &[u8],
        reuse: &mut dyn FnMut(usize) -> Vec<u8>,
    ) -> Vec<Entry> {
        let second = header.sim_nanos / KEY_EVERY_NANOS;
        self.entries_in(second, name, header, payload, reuse)
    }

    /// The same, of a frame that is filed in a certain simulated second.
    pub fn entries_in(
        &mut self,
        second: u64,
        name: &TopicName,
        header: &FrameHeader,
        payload: &[u8],
        reuse: &mut dyn FnMut(usize) -> Vec<u8>,
    ) -> Vec<Entry> {
        let _span = stages::CODE.span();
        let Some(modality) = header.modality() else {
            return Vec::new();
        };
        if modality == Modality::Rgb
            && let Some(quality) = self.coding.jpeg_quality
            && let Some(file) = jpeg(header, payload, quality)
        {
            return vec![
                elsewhere(name, header, JPEG, reuse),
                compressed(name, header, JPEG, &file),
            ];
        }
        if modality == Modality::Rgb
            && let Some(videos) = &self.videos
            && let Some(video) = videos.entry(name, header, payload, second)
        {
            return vec![elsewhere(name, header, H264_NAME, reuse), video];
        }
        let coded = self
            .encoder
            .as_mut()
            .and_then(|encoder| encoder.encode(header, payload));
        let (codec, bytes) = match coded {
            Some(coded) => coded,
            // What other programs see of a topic keeps its type, however small a frame is.
            None if self.coding.lossless && has_preview(modality) => ("", payload),
            None => return frame_entries(name, header, payload, reuse),
        };
        if codec == PNG {
            let picture = compressed(name, header, PNG, bytes);
            return vec![elsewhere(name, header, PNG, reuse), picture];
        }
        let mut entries = vec![frame(name, header, Some(bytes), false, codec, reuse)];
        if self.coding.previews {
            let _span = stages::PREVIEW.span();
            entries.extend(preview(name, header, modality, payload));
        }
        entries
    }
}

/// The lossless message of a frame whose coded payload is the other message's `data`.
pub(crate) fn elsewhere(
    name: &TopicName,
    header: &FrameHeader,
    codec: &str,
    reuse: &mut dyn FnMut(usize) -> Vec<u8>,
) -> Entry {
    frame(name, header, None, true, codec, reuse)
}

/// A JPEG file of a colour image; `None` if it is larger than JPEG allows.
fn jpeg(header: &FrameHeader, payload: &[u8], quality: u8) -> Option<Vec<u8>> {
    let pixels = rgb_pixels(header, payload);
    let mut file = Vec::with_capacity(pixels.len() / 8);
    JpegEncoder::new_with_quality(&mut file, quality)
        .encode(
            &pixels,
            header.width,
            header.height,
            image::ExtendedColorType::Rgb8,
        )
        .ok()
        .map(|()| file)
}

/// Red, green and blue of each pixel of a colour image.
pub(crate) fn rgb_pixels(header: &FrameHeader, payload: &[u8]) -> Vec<u8> {
    let (width, height) = (header.width as usize, header.height as usize);
    // The reader has compared these with the payload, which is longer than any of the products.
    let (bgra_bytes, rgb_bytes) = (width.saturating_mul(4), width.saturating_mul(3));
    let mut pixels = vec![0u8; rgb_bytes.saturating_mul(height)];
    let lines = payload.chunks((header.row_stride as usize).max(1));
    for (row, line) in pixels.chunks_exact_mut(rgb_bytes.max(1)).zip(lines) {
        let bgra = line[..bgra_bytes].chunks_exact(4);
        for (rgb, bgra) in row.chunks_exact_mut(3).zip(bgra) {
            rgb.copy_from_slice(&[bgra[2], bgra[1], bgra[0]]);
        }
    }
    pixels
}
