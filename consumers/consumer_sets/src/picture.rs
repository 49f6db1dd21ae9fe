//! Encoders of images. The same pixels always give the same bytes.

use anyhow::Context as _;

use crate::options::ImageForm;
use consumer_truth::ticks::TickFrame;

/// A colour frame (B G R A) as tight R G B.
pub fn rgb_of(frame: &TickFrame) -> Vec<u8> {
    let pixels = frame.elements::<[u8; 4]>();
    pixels
        .iter()
        .flat_map(|[b, g, r, _]| [*r, *g, *b])
        .collect()
}

/// A colour image in the form that was asked for.
///
/// # Errors
/// If the encoder refuses the size.
pub fn colour(frame: &TickFrame, form: ImageForm) -> anyhow::Result<Vec<u8>> {
    let (width, height) = (frame.header.width, frame.header.height);
    let pixels = rgb_of(frame);
    match form {
        ImageForm::Png => png(
            &pixels,
            width,
            height,
            png::ColorType::Rgb,
            png::BitDepth::Eight,
        ),
        ImageForm::Jpeg(quality) => {
            let mut bytes = Vec::new();
            image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality)
                .encode(&pixels, width, height, image::ExtendedColorType::Rgb8)
                .with_context(|| format!("cannot encode a JPEG of {width} × {height}"))?;
            Ok(bytes)
        }
    }
}

/// A PNG of R G B pixels.
///
/// # Errors
/// If the encoder refuses the size.
pub fn rgb8(pixels: &[u8], width: u32, height: u32) -> anyhow::Result<Vec<u8>> {
    png(
        pixels,
        width,
        height,
        png::ColorType::Rgb,
        png::BitDepth::Eight,
    )
}

/// A PNG of single bytes.
///
/// # Errors
/// If the encoder refuses the size.
pub fn gray8(pixels: &[u8], width: u32, height: u32) -> anyhow::Result<Vec<u8>> {
    png(
        pixels,
        width,
        height,
        png::ColorType::Grayscale,
        png::BitDepth::Eight,
    )
}

/// A PNG of 16-bit numbers.
///
/// # Errors
/// If the encoder refuses the size.
pub fn gray16(pixels: &[u16], width: u32, height: u32) -> anyhow::Result<Vec<u8>> {
    let bytes: Vec<u8> = pixels
        .iter()
        .flat_map(|value| value.to_be_bytes())
        .collect();
    png(
        &bytes,
        width,
        height,
        png::ColorType::Grayscale,
        png::BitDepth::Sixteen,
    )
}

/// A PNG of triples of 16-bit numbers.
///
/// # Errors
/// If the encoder refuses the size.
pub fn rgb16(pixels: &[[u16; 3]], width: u32, height: u32) -> anyhow::Result<Vec<u8>> {
    let bytes: Vec<u8> = pixels
        .iter()
        .flatten()
        .flat_map(|value| value.to_be_bytes())
        .collect();
    png(
        &bytes,
        width,
        height,
        png::ColorType::Rgb,
        png::BitDepth::Sixteen,
    )
}

fn png(
    bytes: &[u8],
    width: u32,
    height: u32,
    colour: png::ColorType,
    depth: png::BitDepth,
) -> anyhow::Result<Vec<u8>> {
    let refused = || format!("cannot encode a PNG of {width} × {height}");
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header().with_context(refused)?;
    writer.write_image_data(bytes).with_context(refused)?;
    writer.finish().with_context(refused)?;
    Ok(out)
}
