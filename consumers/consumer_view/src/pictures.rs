//! Images into the recording, in the form that the user chose: raw, or coded in little time of the
//! processor and a twentieth of the size.
//!
//! What cannot be coded, because its size is none for a picture, goes raw, which is said once.

use std::borrow::Cow;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use consumer_forms::palette;
use consumer_forms::picture::PictureError;
use consumer_forms::picture::depth::{PER_METRE, depth};
use consumer_forms::picture::h264::{H264, Planes};
use consumer_forms::picture::indexed::{indexed, overlay};
use consumer_forms::picture::jpeg::{Pixels, jpeg};
use rerun::components::{Colormap, MediaType, VideoCodec};
use rerun::{AsComponents, ChannelDatatype, ColorModel, RecordingStream};
use schema_frames::{FrameHeader, Modality};
use schema_stages::Stage;

use crate::ids::Ids;
use crate::images;
use crate::look::{Images, Look};
use crate::rerun;

static ENCODE: Stage = Stage::new("encode");
static LOG: Stage = Stage::new("log");

/// Depth that is shown in the last colour of the colour map, metres.
pub(crate) const DEPTH_RANGE_M: f64 = 60.0;
/// Quantiser of video: good, some 27 kB an image of 800 × 600.
const QUANTISER: u8 = 23;

/// Puts images into a recording.
pub(crate) struct Pictures {
    look: Look,
    videos: BTreeMap<String, Video>,
    /// Entities whose images go raw because they could not be coded.
    raw: BTreeSet<String>,
}

/// How a picture lies over another.
#[derive(Clone, Copy)]
pub(crate) struct Over {
    /// 0 is clear, 1 hides what is below.
    pub(crate) opacity: f32,
    /// Higher ones are drawn later.
    pub(crate) order: f32,
}

struct Video {
    encoder: H264,
    size_px: [u32; 2],
    picture: Planes,
    /// Simulated second of the newest image.
    second: u64,
}

impl Pictures {
    pub(crate) fn new(look: Look) -> Pictures {
        Pictures {
            look,
            videos: BTreeMap::new(),
            raw: BTreeSet::new(),
        }
    }

    pub(crate) fn look(&self) -> &Look {
        &self.look
    }

    /// Drops what is kept of an entity; its next image begins anew.
    pub(crate) fn forget(&mut self, path: &str) {
        self.videos.remove(path);
        self.raw.remove(path);
    }

    fn is_raw(&self, path: &str) -> bool {
        self.look.images == Images::Raw || self.raw.contains(path)
    }

    /// What `code` makes, or nothing where it is to be sent raw.
    fn encoded(
        &mut self,
        path: &str,
        code: impl FnOnce(&Look) -> Result<Vec<u8>, PictureError>,
    ) -> Option<Vec<u8>> {
        if self.is_raw(path) {
            return None;
        }
        let coded = {
            let _span = ENCODE.span();
            code(&self.look)
        };
        self.coded(path, coded)
    }

    /// What was coded, or nothing and from now on raw.
    fn coded(&mut self, path: &str, coded: Result<Vec<u8>, PictureError>) -> Option<Vec<u8>> {
        coded
            .inspect_err(|error| {
                tracing::warn!(entity = path, %error, "sent raw, because it cannot be coded");
                self.raw.insert(path.to_owned());
            })
            .ok()
    }

    /// A colour image, blue first and with a fourth byte.
    pub(crate) fn bgra(
        &mut self,
        rec: &RecordingStream,
        path: &str,
        header: &FrameHeader,
        payload: &[u8],
    ) -> anyhow::Result<()> {
        let size = [header.width, header.height];
        if self.look.images == Images::H264 && !self.raw.contains(path) {
            let video = {
                let _span = ENCODE.span();
                self.video(path, header, payload)
            };
            let video = video.map(|(sample, is_key)| {
                let stream = rerun::VideoStream::new(VideoCodec::H264).with_sample(sample);
                stream.with_is_keyframe(is_key)
            });
            match video {
                Ok(stream) => return log(rec, path, &stream),
                Err(error) => drop(self.coded(path, Err(error))),
            }
        }
        let pixels = images::tight(header, payload);
        self.colour(rec, path, size, Pixels::Bgra, pixels)
    }

    /// A colour image, red first.
    pub(crate) fn rgb(
        &mut self,
        rec: &RecordingStream,
        path: &str,
        size: [u32; 2],
        pixels: Vec<u8>,
    ) -> anyhow::Result<()> {
        self.colour(rec, path, size, Pixels::Rgb, Cow::Owned(pixels))
    }

    fn colour(
        &mut self,
        rec: &RecordingStream,
        path: &str,
        size: [u32; 2],
        order: Pixels,
        pixels: Cow<'_, [u8]>,
    ) -> anyhow::Result<()> {
        if let Some(file) = self.encoded(path, |look| jpeg(size, order, &pixels, look.quality)) {
            return log(rec, path, &picture(file, MediaType::JPEG));
        }
        let model = match order {
            Pixels::Bgra => ColorModel::BGRA,
            Pixels::Rgb => ColorModel::RGB,
        };
        let of = ChannelDatatype::U8;
        let image = rerun::Image::from_color_model_and_bytes(pixels.into_owned(), size, model, of);
        log(rec, path, &image)
    }

    /// The next access unit of an image's video, and whether it is a key frame: the first of every
    /// simulated second is.
    fn video(
        &mut self,
        path: &str,
        header: &FrameHeader,
        payload: &[u8],
    ) -> Result<(Vec<u8>, bool), PictureError> {
        let size_px = [header.width, header.height];
        let second = header.sim_nanos / 1_000_000_000;
        let other_size = |video: &Video| video.size_px != size_px;
        if self.videos.get(path).is_some_and(other_size) {
            self.videos.remove(path);
        }
        let (video, is_new) = match self.videos.entry(path.to_owned()) {
            Entry::Occupied(known) => (known.into_mut(), false),
            Entry::Vacant(vacant) => {
                let fresh = Video {
                    encoder: H264::new(size_px, QUANTISER)?,
                    size_px,
                    picture: Planes::default(),
                    second,
                };
                (vacant.insert(fresh), true)
            }
        };
        let is_key = is_new || video.second != second;
        video.second = second;
        let stride = header.row_stride as usize;
        video.picture.set_bgra(size_px, stride, payload);
        let mut sample = Vec::with_capacity(payload.len() / 32);
        video.encoder.encode(&video.picture, is_key, &mut sample)?;
        Ok((sample, is_key))
    }

    /// Distances along the optical axis.
    pub(crate) fn depth(
        &mut self,
        rec: &RecordingStream,
        path: &str,
        header: &FrameHeader,
        payload: &[u8],
    ) -> anyhow::Result<()> {
        let size = [header.width, header.height];
        if let Some(file) = self.encoded(path, |_| depth(size, header.row_stride as usize, payload))
        {
            let image = rerun::EncodedDepthImage::new(file)
                .with_media_type(MediaType::from(MediaType::PNG))
                .with_meter(PER_METRE)
                .with_colormap(Colormap::Turbo)
                .with_depth_range([0.0, DEPTH_RANGE_M * PER_METRE as f64]);
            return log(rec, path, &image);
        }
        let pixels = images::tight(header, payload).into_owned();
        let image = rerun::DepthImage::from_data_type_and_bytes(pixels, size, ChannelDatatype::F32)
            .with_meter(1.0)
            .with_colormap(Colormap::Turbo)
            .with_depth_range([0.0, DEPTH_RANGE_M]);
        log(rec, path, &image)
    }

    /// Classes by the simulator's numbers.
    pub(crate) fn classes(
        &mut self,
        rec: &RecordingStream,
        path: &str,
        header: &FrameHeader,
        payload: &[u8],
    ) -> anyhow::Result<()> {
        let size = [header.width, header.height];
        if !self.is_raw(path) {
            let numbers = images::tight(header, payload);
            return self.numbered(rec, path, size, &class_colours(), &numbers);
        }
        let format = rerun::components::ImageFormat::segmentation(size, ChannelDatatype::U8);
        let pixels = images::tight(header, payload).into_owned();
        log(rec, path, &rerun::SegmentationImage::new(pixels, format))
    }

    /// Object ids, which have been read.
    pub(crate) fn ids(
        &mut self,
        rec: &RecordingStream,
        path: &str,
        size: [u32; 2],
        ids: &Ids,
    ) -> anyhow::Result<()> {
        self.numbered(rec, path, size, ids.palette.colours(), &ids.numbers)
    }

    /// Numbers of colours.
    pub(crate) fn numbered(
        &mut self,
        rec: &RecordingStream,
        path: &str,
        size: [u32; 2],
        colours: &[[u8; 3]],
        numbers: &[u8],
    ) -> anyhow::Result<()> {
        if let Some(file) = self.encoded(path, |_| indexed(size, colours, numbers)) {
            return log(rec, path, &picture(file, MediaType::PNG));
        }
        let pixels = images::rgb_of(colours, numbers);
        log(rec, path, &rerun::Image::from_rgb24(pixels, size))
    }

    /// Numbers of colours over another image; what has number 0 is clear.
    pub(crate) fn overlay(
        &mut self,
        rec: &RecordingStream,
        path: &str,
        size: [u32; 2],
        colours: &[[u8; 3]],
        numbers: &[u8],
        over: Over,
    ) -> anyhow::Result<()> {
        if let Some(file) = self.encoded(path, |_| overlay(size, colours, numbers)) {
            let image = picture(file, MediaType::PNG)
                .with_opacity(over.opacity)
                .with_draw_order(over.order);
            return log(rec, path, &image);
        }
        let pixel = |number: &u8| {
            let [r, g, b] = colours.get(*number as usize).copied().unwrap_or_default();
            [r, g, b, if *number == 0 { 0 } else { 255 }]
        };
        let pixels: Vec<u8> = numbers.iter().flat_map(pixel).collect();
        let image = rerun::Image::from_rgba32(pixels, size)
            .with_opacity(over.opacity)
            .with_draw_order(over.order);
        log(rec, path, &image)
    }

    /// One image of a camera of this modality; `false` if it has no form of its own here.
    pub(crate) fn show(
        &mut self,
        rec: &RecordingStream,
        path: &str,
        modality: Modality,
        header: &FrameHeader,
        payload: &[u8],
    ) -> anyhow::Result<bool> {
        let size = [header.width, header.height];
        match modality {
            Modality::Rgb => self.bgra(rec, path, header, payload)?,
            Modality::Depth => self.depth(rec, path, header, payload)?,
            Modality::Semantic => self.classes(rec, path, header, payload)?,
            Modality::Instance => {
                let ids = Ids::read(size, &images::tight(header, payload));
                self.ids(rec, path, size, &ids)?;
            }
            Modality::Flow => {
                let pixels = {
                    let _span = ENCODE.span();
                    let full_px = images::flow_full_px(header, payload);
                    images::flow_rgb(header, payload, full_px)
                };
                self.rgb(rec, path, size, pixels)?;
            }
            Modality::Normals => {
                let pixels = images::normals_rgb(header, payload);
                self.rgb(rec, path, size, pixels)?;
            }
            _ => return Ok(false),
        }
        Ok(true)
    }
}

fn log(rec: &RecordingStream, path: &str, what: &impl AsComponents) -> anyhow::Result<()> {
    let _span = LOG.span();
    Ok(rec.log(path, what)?)
}

fn picture(file: Vec<u8>, of: &'static str) -> rerun::EncodedImage {
    rerun::EncodedImage::new(file).with_media_type(MediaType::from(of))
}

/// A colour for every number that a class can have.
fn class_colours() -> [[u8; 3]; 256] {
    std::array::from_fn(|number| palette::class(number as u32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_video_that_was_forgotten_begins_with_a_key_frame() {
        let look = Look {
            images: Images::H264,
            ..Look::default()
        };
        let mut pictures = Pictures::new(look);
        let mut header = FrameHeader::new(Modality::Rgb);
        header.set_image(64, 48);
        let payload = vec![90; 64 * 48 * 4];
        let mut is_key = || pictures.video("/a", &header, &payload).unwrap().1;
        assert_eq!([is_key(), is_key()], [true, false]);
        pictures.forget("/a");
        assert!(pictures.videos.is_empty());
        assert!(pictures.video("/a", &header, &payload).unwrap().1);
    }
}
