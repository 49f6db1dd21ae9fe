//! Images that other programs show as they are: PNG files that hold every byte of a payload.

use std::io::Cursor;

use schema_frames::{FrameHeader, Modality};
use schema_types::class::CLASSES;

use super::deflate;
use super::error::CodecError;

/// Memory of the encoder, kept for the next picture.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// Colours of a row and of the one above, behind one pixel of zeros.
    now: Vec<u8>,
    above: Vec<u8>,
    /// What the filter leaves of all rows.
    filtered: Vec<u8>,
    /// Where the compressor writes.
    room: Vec<u8>,
}

/// Replaces `coded` by a PNG file; `false` if the image cannot be one.
pub(super) fn encode(
    header: &FrameHeader,
    modality: Modality,
    payload: &[u8],
    rows: &mut Rows,
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
        if rows.opaque(payload, row_bytes) {
            rows.write(header, coded);
            return true;
        }
        translucent(header, payload, coded)
    } else {
        classes(header, payload, coded)
    };
    written.is_ok()
}

/// Bytes of an opaque pixel.
const RGB: usize = 3;

impl Rows {
    /// Filters an image of BGRA pixels, each as its difference from what its neighbours let expect;
    /// `false` if some let shine through what is behind them.
    fn opaque(&mut self, payload: &[u8], row_bytes: usize) -> bool {
        let n_bytes = row_bytes / 4 * RGB;
        for row in [&mut self.now, &mut self.above] {
            row.clear();
            row.resize(RGB + n_bytes, 0);
        }
        self.filtered
            .resize((1 + n_bytes) * (payload.len() / row_bytes), 0);
        let rows = self.filtered.chunks_exact_mut(1 + n_bytes);
        for (out, row) in rows.zip(payload.chunks_exact(row_bytes)) {
            let mut alpha = 255;
            let (pixels, _) = row.as_chunks::<4>();
            let (colours, _) = self.now[RGB..].as_chunks_mut::<RGB>();
            for (rgb, [b, g, r, a]) in colours.iter_mut().zip(pixels) {
                *rgb = [*r, *g, *b];
                alpha &= a;
            }
            if alpha != 255 {
                return false;
            }
            let (kind, out) = out.split_at_mut(1);
            kind[0] = png::Filter::Paeth as u8;
            let now = self.now.iter().zip(&self.now[RGB..]);
            let above = self.above.iter().zip(&self.above[RGB..]);
            for (out, ((left, here), (above_left, above))) in out.iter_mut().zip(now.zip(above)) {
                *out = here.wrapping_sub(expected(*left, *above, *above_left));
            }
            std::mem::swap(&mut self.now, &mut self.above);
        }
        true
    }

    /// Replaces `coded` by the file of what was filtered.
    fn write(&mut self, header: &FrameHeader, coded: &mut Vec<u8>) {
        const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
        coded.clear();
        coded.extend_from_slice(SIGNATURE);
        chunk(coded, *b"IHDR", |coded| {
            coded.extend_from_slice(&header.width.to_be_bytes());
            coded.extend_from_slice(&header.height.to_be_bytes());
            // Eight bits, colours, and the only ways of compressing, filtering and ordering.
            coded.extend_from_slice(&[8, 2, 0, 0, 0]);
        });
        chunk(coded, *b"IDAT", |coded| {
            deflate::zlib(&self.filtered, &mut self.room, coded);
        });
        chunk(coded, *b"IEND", |_| {});
    }
}

/// Paeth's guess: which of the three lies next to left + above − above left.
#[inline(always)]
fn expected(left: u8, above: u8, above_left: u8) -> u8 {
    let [a, b, c] = [left, above, above_left].map(i16::from);
    let to_left = b.wrapping_sub(c).wrapping_abs();
    let to_above = a.wrapping_sub(c).wrapping_abs();
    let to_both = a
        .wrapping_add(b)
        .wrapping_sub(c)
        .wrapping_sub(c)
        .wrapping_abs();
    let upper = if to_above <= to_both {
        above
    } else {
        above_left
    };
    if to_left <= to_above && to_left <= to_both {
        left
    } else {
        upper
    }
}

/// Appends a part of a PNG file: length, kind, what `fill` appends, checksum.
fn chunk(file: &mut Vec<u8>, kind: [u8; 4], fill: impl FnOnce(&mut Vec<u8>)) {
    let at = file.len();
    file.extend_from_slice(&[0; 4]);
    file.extend_from_slice(&kind);
    fill(file);
    let n_bytes = (file.len() - at - 8) as u32;
    file[at..at + 4].copy_from_slice(&n_bytes.to_be_bytes());
    let crc = crc32fast::hash(&file[at + 4..]);
    file.extend_from_slice(&crc.to_be_bytes());
}

fn translucent(
    header: &FrameHeader,
    payload: &[u8],
    coded: &mut Vec<u8>,
) -> Result<(), png::EncodingError> {
    let mut encoder = png::Encoder::new(coded, header.width, header.height);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fastest);
    encoder.set_filter(png::Filter::Paeth);
    encoder.set_color(png::ColorType::Rgba);
    let mut pixels = vec![0; payload.len()];
    for (rgba, bgra) in pixels.chunks_exact_mut(4).zip(payload.chunks_exact(4)) {
        rgba.copy_from_slice(&[bgra[2], bgra[1], bgra[0], bgra[3]]);
    }
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
