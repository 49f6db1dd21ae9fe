//! Images that other programs show as they are: PNG files that hold every byte of a payload.

use std::io::Cursor;

use schema_frames::{FrameHeader, Modality};
use schema_types::class::CLASSES;

use super::error::CodecError;

/// Replaces `coded` by a PNG file; `false` if the image cannot be one.
pub(super) fn encode(
    header: &FrameHeader,
    modality: Modality,
    payload: &[u8],
    coded: &mut Vec<u8>,
) -> bool {
    let element_bytes = if modality == Modality::Rgb { 4 } else { 1 };
    let (width, height) = (header.width as usize, header.height as usize);
    let row_bytes = width * element_bytes;
    if row_bytes == 0
        || header.element_bytes as usize != element_bytes
        || header.row_stride as usize != row_bytes
        || row_bytes.checked_mul(height) != Some(payload.len())
        || payload.is_empty()
    {
        return false;
    }
    coded.clear();
    let written = if modality == Modality::Rgb {
        colour(header, payload, coded)
    } else {
        classes(header, payload, coded)
    };
    written.is_ok()
}

fn colour(
    header: &FrameHeader,
    payload: &[u8],
    coded: &mut Vec<u8>,
) -> Result<(), png::EncodingError> {
    let opaque = payload.chunks_exact(4).all(|bgra| bgra[3] == 255);
    let mut encoder = png::Encoder::new(coded, header.width, header.height);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fastest);
    encoder.set_filter(png::Filter::Paeth);
    let pixels: Vec<u8> = if opaque {
        encoder.set_color(png::ColorType::Rgb);
        let mut pixels = vec![0; payload.len() / 4 * 3];
        for (rgb, bgra) in pixels.chunks_exact_mut(3).zip(payload.chunks_exact(4)) {
            rgb.copy_from_slice(&[bgra[2], bgra[1], bgra[0]]);
        }
        pixels
    } else {
        encoder.set_color(png::ColorType::Rgba);
        let mut pixels = vec![0; payload.len()];
        for (rgba, bgra) in pixels.chunks_exact_mut(4).zip(payload.chunks_exact(4)) {
            rgba.copy_from_slice(&[bgra[2], bgra[1], bgra[0], bgra[3]]);
        }
        pixels
    };
    encoder.write_header()?.write_image_data(&pixels)
}

/// An indexed image: the index is the class number, the palette its colour.
fn classes(
    header: &FrameHeader,
    payload: &[u8],
    coded: &mut Vec<u8>,
) -> Result<(), png::EncodingError> {
    let mut palette = vec![255u8; 3 * 256];
    for (entry, class) in palette.chunks_exact_mut(3).zip(CLASSES) {
        entry.copy_from_slice(&class.rgb);
    }
    let mut encoder = png::Encoder::new(coded, header.width, header.height);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_palette(palette);
    encoder.set_compression(png::Compression::Fastest);
    encoder.write_header()?.write_image_data(payload)
}

/// Decodes a PNG file into BGRA pixels or class numbers.
pub(super) fn decode(header: &FrameHeader, coded: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
    let wrong =
        |error: png::DecodingError| CodecError(format!("this is no whole PNG file: {error}"));
    let mut options = png::DecodeOptions::default();
    options.set_ignore_checksums(false);
    let mut decoder = png::Decoder::new_with_options(Cursor::new(coded), options);
    decoder.set_limits(png::Limits {
        bytes: out.len().saturating_add(1 << 20),
    });
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(wrong)?;
    let info = reader.info();
    let n_pixels = info.width as u64 * info.height as u64;
    let bytes_out = match info.color_type {
        png::ColorType::Rgb | png::ColorType::Rgba => 4,
        png::ColorType::Indexed => 1,
        _ => 0,
    };
    let fits = (info.width, info.height) == (header.width, header.height)
        && info.bit_depth == png::BitDepth::Eight
        && header.element_bytes == bytes_out
        && n_pixels.checked_mul(bytes_out as u64) == Some(out.len() as u64);
    if !fits {
        return Err(CodecError(format!(
            "the PNG file is {}×{} {:?}, which is not the frame of {}×{} pixels",
            info.width, info.height, info.color_type, header.width, header.height
        )));
    }
    let color = info.color_type;
    let mut row_at = 0;
    while let Some(row) = reader.next_row().map_err(wrong)? {
        let row = row.data();
        let row_out = header.width as usize * bytes_out as usize;
        let place = out
            .get_mut(row_at..row_at + row_out)
            .ok_or("the PNG file has more rows than it says")?;
        match color {
            png::ColorType::Rgb => {
                for (bgra, rgb) in place.chunks_exact_mut(4).zip(row.chunks_exact(3)) {
                    bgra.copy_from_slice(&[rgb[2], rgb[1], rgb[0], 255]);
                }
            }
            png::ColorType::Rgba => {
                for (bgra, rgba) in place.chunks_exact_mut(4).zip(row.chunks_exact(4)) {
                    bgra.copy_from_slice(&[rgba[2], rgba[1], rgba[0], rgba[3]]);
                }
            }
            _ => place.copy_from_slice(row),
        }
        row_at += row_out;
    }
    if row_at != out.len() {
        return Err("the PNG file ends before its last row".into());
    }
    reader.finish().map_err(wrong)
}
