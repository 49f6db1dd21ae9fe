//! Images and tensors in views of their own.

use bytemuck::Pod;
use consumer_kit::items::Figures;
use rerun::components::ImageFormat;
use rerun::{ChannelDatatype, ColorModel, TensorBuffer, TensorData};
use schema_frames::{ElementType, FrameHeader, Modality, PixelFormat, ResultHeader};

use super::canvas::Canvas;
use super::state::Results;
use crate::images;
use crate::layout::ViewKind;
use crate::pictures::Pictures;
use crate::rerun;

/// Longest tensor that is sent to the viewer; of longer ones only the histogram is.
const MAX_TENSOR_BYTES: usize = 64 << 20;

impl Results {
    pub(super) fn picture(
        &mut self,
        canvas: &Canvas<'_>,
        pictures: &mut Pictures,
    ) -> anyhow::Result<()> {
        let (header, body) = (canvas.parts.header, canvas.parts.body);
        let Some(format) = header.pixel_format() else {
            return Ok(());
        };
        let size = [header.width, header.height];
        if size.contains(&0) {
            return Ok(());
        }
        self.need(canvas.parts, ViewKind::Picture);
        let path = canvas.own_path();
        let like = frame_like(header, format);
        let frame_kind = match format {
            PixelFormat::Bgra8 => Some(Modality::Rgb),
            PixelFormat::Depth => Some(Modality::Depth),
            PixelFormat::Id => Some(Modality::Instance),
            PixelFormat::Flow => Some(Modality::Flow),
            PixelFormat::Normals => Some(Modality::Normals),
            // A topic's own classes have their names in the viewer only if their numbers go there.
            _ => None,
        };
        if let Some(kind) = frame_kind {
            self.note_drawn(canvas, &path);
            pictures.show(canvas.rec, &path, kind, &like, body)?;
            return Ok(());
        }
        if format == PixelFormat::Rgb8 {
            self.note_drawn(canvas, &path);
            let pixels = images::tight(&like, body).into_owned();
            return pictures.rgb(canvas.rec, &path, size, pixels);
        }
        let pixels = images::tight(&like, body).into_owned();
        if format == PixelFormat::Class {
            self.name_classes(canvas, &path)?;
            let of = ImageFormat::segmentation(size, ChannelDatatype::U8);
            let classes = rerun::SegmentationImage::new(pixels, of);
            return self.draw(canvas, &path, false, &classes);
        }
        let (model, of) = match format {
            PixelFormat::Bgr8 => (ColorModel::BGR, ChannelDatatype::U8),
            PixelFormat::Rgba8 => (ColorModel::RGBA, ChannelDatatype::U8),
            PixelFormat::Mono16 => (ColorModel::L, ChannelDatatype::U16),
            PixelFormat::Mono32f => (ColorModel::L, ChannelDatatype::F32),
            _ => (ColorModel::L, ChannelDatatype::U8),
        };
        let image = rerun::Image::from_color_model_and_bytes(pixels, size, model, of);
        self.draw(canvas, &path, false, &image)
    }

    pub(super) fn tensor(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        let (header, body) = (canvas.parts.header, canvas.parts.body);
        let (Some(element), false) = (header.element_type(), body.is_empty()) else {
            return Ok(());
        };
        let path = canvas.own_path();
        if header.shape().is_empty() {
            self.need(canvas.parts, ViewKind::Series);
            let value = consumer_kit::items::number(element, body);
            return canvas.log(&format!("{path}/value"), &rerun::Scalars::single(value));
        }
        use ElementType::{F16, F32, F64};
        if matches!(element, F16 | F32 | F64) {
            self.histogram(canvas, &Figures::of(element, body))?;
        }
        if body.len() > MAX_TENSOR_BYTES {
            return Ok(());
        }
        match as_image(element, header.shape(), body) {
            Some(image) => {
                self.need(canvas.parts, ViewKind::Picture);
                self.draw(canvas, &path, false, &image)
            }
            None => {
                self.need(canvas.parts, ViewKind::Tensor);
                let shape: Vec<u64> = header.shape().iter().map(|size| *size as u64).collect();
                let data = TensorData::new(shape, buffer(element, body));
                self.draw(canvas, &path, false, &rerun::Tensor::new(data))
            }
        }
    }

    fn histogram(&mut self, canvas: &Canvas<'_>, figures: &Figures) -> anyhow::Result<()> {
        let n_bins = figures.histogram.len() as u64;
        if n_bins == 0 {
            return Ok(());
        }
        self.need(canvas.parts, ViewKind::Histogram);
        let counts = TensorBuffer::U64(figures.histogram.clone().into());
        let bins = TensorBuffer::F64(figures.bins().into());
        let chart = rerun::BarChart::new(TensorData::new(vec![n_bins], counts))
            .with_abscissa(TensorData::new(vec![n_bins], bins));
        let path = format!("{}/histogram", canvas.own_path());
        self.draw(canvas, &path, false, &chart)
    }
}

/// A header of a frame with these pixels.
fn frame_like(header: &ResultHeader, format: PixelFormat) -> FrameHeader {
    let modality = Modality::from_code(format as u16).unwrap_or(Modality::Rgb);
    let mut like = FrameHeader::new(modality);
    (like.width, like.height) = (header.width, header.height);
    (like.row_stride, like.element_bytes) = (header.row_stride, header.element_bytes);
    like.payload_bytes = header.body_bytes;
    like
}

/// Tensors of two dimensions are grey images; of bytes with 1, 3 or 4 of them last, colour images.
fn as_image(element: ElementType, shape: &[u32], body: &[u8]) -> Option<rerun::Image> {
    let (height, width, model) = match (shape, element) {
        ([height, width], _) | ([height, width, 1], ElementType::U8) => {
            (*height, *width, ColorModel::L)
        }
        ([height, width, 3], ElementType::U8) => (*height, *width, ColorModel::RGB),
        ([height, width, 4], ElementType::U8) => (*height, *width, ColorModel::RGBA),
        _ => return None,
    };
    let of = match element {
        ElementType::U8 | ElementType::Bool => ChannelDatatype::U8,
        ElementType::I8 => ChannelDatatype::I8,
        ElementType::U16 => ChannelDatatype::U16,
        ElementType::I16 => ChannelDatatype::I16,
        ElementType::U32 => ChannelDatatype::U32,
        ElementType::I32 => ChannelDatatype::I32,
        ElementType::U64 => ChannelDatatype::U64,
        ElementType::I64 => ChannelDatatype::I64,
        ElementType::F16 => ChannelDatatype::F16,
        ElementType::F32 => ChannelDatatype::F32,
        ElementType::F64 => ChannelDatatype::F64,
    };
    let pixels: Vec<u8> = match element {
        ElementType::Bool => body.iter().map(|byte| (*byte != 0) as u8 * 255).collect(),
        _ => body.to_vec(),
    };
    let size = [width, height];
    Some(rerun::Image::from_color_model_and_bytes(
        pixels, size, model, of,
    ))
}

fn buffer(element: ElementType, body: &[u8]) -> TensorBuffer {
    fn all<T: Pod>(body: &[u8]) -> Vec<T> {
        body.chunks_exact(size_of::<T>())
            .map(bytemuck::pod_read_unaligned)
            .collect()
    }
    match element {
        ElementType::U8 | ElementType::Bool => TensorBuffer::U8(body.to_vec().into()),
        ElementType::I8 => TensorBuffer::I8(all::<i8>(body).into()),
        ElementType::U16 => TensorBuffer::U16(all::<u16>(body).into()),
        ElementType::I16 => TensorBuffer::I16(all::<i16>(body).into()),
        ElementType::U32 => TensorBuffer::U32(all::<u32>(body).into()),
        ElementType::I32 => TensorBuffer::I32(all::<i32>(body).into()),
        ElementType::U64 => TensorBuffer::U64(all::<u64>(body).into()),
        ElementType::I64 => TensorBuffer::I64(all::<i64>(body).into()),
        // Every half is a float, too.
        ElementType::F16 => {
            let halves = all::<u16>(body).into_iter();
            let floats: Vec<f32> = halves
                .map(|bits| half::f16::from_bits(bits).to_f32())
                .collect();
            TensorBuffer::F32(floats.into())
        }
        ElementType::F32 => TensorBuffer::F32(all::<f32>(body).into()),
        ElementType::F64 => TensorBuffer::F64(all::<f64>(body).into()),
    }
}
