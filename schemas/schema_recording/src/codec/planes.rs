//! Images of words. Each word is expected to be left + above − above left, which is exact where the
//! words grow evenly; what remains is folded to an unsigned number and split into planes of bytes,
//! lowest first, component after component.
//!
//! Flow is first brought to the place that its pixel came from, pixel centre − flow. The simulator
//! computes flow as the difference of these two, so this place has fewer bits that vary.

use schema_frames::FrameHeader;

use super::bytes::{fold16, fold32, join, split, unfold16, unfold32, unpack, word};
use super::error::CodecError;

/// Rows that the filter needs; kept for the next image.
#[derive(Debug, Default)]
pub(super) struct Rows {
    above: Vec<u32>,
    now: Vec<u32>,
    folded: Vec<u32>,
}

/// Shape of an image whose rows follow each other without a gap.
#[derive(Clone, Copy, Debug)]
struct Shape {
    width: usize,
    height: usize,
    n_components: usize,
    word_bytes: usize,
}

impl Shape {
    fn new(header: &FrameHeader, payload_bytes: usize, word_bytes: usize) -> Option<Shape> {
        let shape = Shape {
            width: header.width as usize,
            height: header.height as usize,
            n_components: header.element_bytes as usize / word_bytes,
            word_bytes,
        };
        let row_bytes = shape.width.checked_mul(header.element_bytes as usize)?;
        let fits = row_bytes > 0
            && header.element_bytes as usize == shape.n_components * word_bytes
            && row_bytes == header.row_stride as usize
            && row_bytes.checked_mul(shape.height)? == payload_bytes
            && payload_bytes > 0;
        fits.then_some(shape)
    }

    fn element_bytes(self) -> usize {
        self.n_components * self.word_bytes
    }

    fn row_bytes(self) -> usize {
        self.width * self.element_bytes()
    }

    /// Bytes of a plane.
    fn plane_bytes(self) -> usize {
        self.width * self.height
    }

    /// Bytes of the planes of a component.
    fn component_bytes(self) -> usize {
        self.plane_bytes() * self.word_bytes
    }
}

/// Middle of a pixel, pixels.
#[inline]
fn centre(at: usize) -> f32 {
    at as f32 + 0.5
}

/// Replaces flow by the place that the pixel came from; not 0 if the flow does not come back exactly
/// from it.
#[inline]
fn origin(word: &mut u32, centre: f32) -> u32 {
    let origin = centre - f32::from_bits(*word);
    let lost = (centre - origin).to_bits() ^ *word;
    *word = origin.to_bits();
    lost
}

impl Rows {
    /// Filters an image of 32-bit words; `false` if it is none.
    pub(super) fn words32(
        &mut self,
        header: &FrameHeader,
        payload: &[u8],
        out: &mut Vec<u8>,
    ) -> bool {
        Shape::new(header, payload.len(), 4).is_some_and(|shape| {
            self.image(shape, payload, out, |now, row, k, _| {
                match (shape.n_components, k) {
                    (1, _) => load32::<1, 0>(now, row),
                    (2, 0) => load32::<2, 0>(now, row),
                    (2, _) => load32::<2, 1>(now, row),
                    (n, k) => {
                        for (now, bytes) in now.iter_mut().zip(row.chunks_exact(4 * n)) {
                            *now = word(&bytes[4 * k..]);
                        }
                    }
                }
                true
            })
        })
    }

    /// Filters an image of 16-bit words; `false` if it is none.
    pub(super) fn words16(
        &mut self,
        header: &FrameHeader,
        payload: &[u8],
        out: &mut Vec<u8>,
    ) -> bool {
        Shape::new(header, payload.len(), 2).is_some_and(|shape| {
            self.image(shape, payload, out, |now, row, k, _| {
                let pixels = row.chunks_exact(shape.element_bytes());
                for (now, bytes) in now.iter_mut().zip(pixels) {
                    *now = u16::from_le_bytes([bytes[2 * k], bytes[2 * k + 1]]) as u32;
                }
                true
            })
        })
    }

    /// Filters flow; `false` if it is no flow, or some of it does not come back exactly.
    pub(super) fn flow(&mut self, header: &FrameHeader, payload: &[u8], out: &mut Vec<u8>) -> bool {
        let shape = Shape::new(header, payload.len(), 4).filter(|shape| shape.n_components == 2);
        let Some(shape) = shape else {
            return false;
        };
        let columns: Vec<f32> = (0..shape.width).map(centre).collect();
        self.image(shape, payload, out, |now, row, k, y| {
            let mut lost = 0;
            if k == 0 {
                load32::<2, 0>(now, row);
                for (now, column) in now.iter_mut().zip(&columns) {
                    lost |= origin(now, *column);
                }
            } else {
                load32::<2, 1>(now, row);
                now.iter_mut()
                    .for_each(|now| lost |= origin(now, centre(y)));
            }
            lost == 0
        })
    }

    /// Filters every component; `load(now, row, component, y)` reads a row's words, and says `false`
    /// to give up.
    fn image(
        &mut self,
        shape: Shape,
        payload: &[u8],
        out: &mut Vec<u8>,
        load: impl Fn(&mut [u32], &[u8], usize, usize) -> bool,
    ) -> bool {
        out.resize(payload.len(), 0);
        for k in 0..shape.n_components {
            for row in [&mut self.above, &mut self.now, &mut self.folded] {
                row.clear();
                row.resize(shape.width, 0);
            }
            let planes = &mut out[k * shape.component_bytes()..][..shape.component_bytes()];
            for (y, row) in payload.chunks_exact(shape.row_bytes()).enumerate() {
                if !load(&mut self.now, row, k, y) {
                    out.clear();
                    return false;
                }
                self.fold(shape.word_bytes);
                split(&self.folded, planes, shape.plane_bytes(), y * shape.width);
                std::mem::swap(&mut self.above, &mut self.now);
            }
        }
        true
    }

    /// Makes `folded` of `now` and `above`; `above` is lost.
    fn fold(&mut self, word_bytes: usize) {
        for (above, now) in self.above.iter_mut().zip(&self.now) {
            *above = now.wrapping_sub(*above);
        }
        let rise = &self.above;
        if word_bytes == 2 {
            self.folded[0] = fold16(rise[0]);
            let steps = self.folded[1..].iter_mut().zip(rise[1..].iter().zip(rise));
            steps.for_each(|(folded, (here, left))| *folded = fold16(here.wrapping_sub(*left)));
        } else {
            self.folded[0] = fold32(rise[0]);
            let steps = self.folded[1..].iter_mut().zip(rise[1..].iter().zip(rise));
            steps.for_each(|(folded, (here, left))| *folded = fold32(here.wrapping_sub(*left)));
        }
    }
}

/// Reads word `K` of each of a row's pixels of `N` words.
#[inline]
fn load32<const N: usize, const K: usize>(now: &mut [u32], row: &[u8]) {
    let (pixels, _) = row.as_chunks::<4>();
    for (now, pixel) in now.iter_mut().zip(pixels.chunks_exact(N)) {
        *now = u32::from_le_bytes(pixel[K]);
    }
}

/// Decodes an image of 16-bit words.
pub(super) fn decode16(
    header: &FrameHeader,
    coded: &[u8],
    out: &mut [u8],
) -> Result<(), CodecError> {
    decode(header, coded, out, 2, |row, element_bytes, k, _, now| {
        for (bytes, now) in row.chunks_exact_mut(element_bytes).zip(now) {
            bytes[2 * k..2 * k + 2].copy_from_slice(&(*now as u16).to_le_bytes());
        }
    })
}

/// Decodes an image of 32-bit words.
pub(super) fn decode32(
    header: &FrameHeader,
    coded: &[u8],
    out: &mut [u8],
) -> Result<(), CodecError> {
    decode(header, coded, out, 4, |row, element_bytes, k, _, now| {
        for (bytes, now) in row.chunks_exact_mut(element_bytes).zip(now) {
            bytes[4 * k..4 * k + 4].copy_from_slice(&now.to_le_bytes());
        }
    })
}

/// Decodes flow.
pub(super) fn decode_flow(
    header: &FrameHeader,
    coded: &[u8],
    out: &mut [u8],
) -> Result<(), CodecError> {
    if header.element_bytes != 8 {
        return Err("the codec flow belongs to pixels of two numbers".into());
    }
    decode(header, coded, out, 4, |row, element_bytes, k, y, now| {
        for (x, (bytes, now)) in row.chunks_exact_mut(element_bytes).zip(now).enumerate() {
            let centre = centre(if k == 0 { x } else { y });
            let flow = centre - f32::from_bits(*now);
            bytes[4 * k..4 * k + 4].copy_from_slice(&flow.to_bits().to_le_bytes());
        }
    })
}

/// Undoes [`Rows::image`]; `store(row, element_bytes, component, y, now)` writes a row's words.
fn decode(
    header: &FrameHeader,
    coded: &[u8],
    out: &mut [u8],
    word_bytes: usize,
    store: impl Fn(&mut [u8], usize, usize, usize, &[u32]),
) -> Result<(), CodecError> {
    let shape = Shape::new(header, out.len(), word_bytes)
        .ok_or("the header describes no image of whole words without gaps")?;
    let planes = unpack(coded, out.len())?;
    if planes.len() != out.len() {
        return Err(CodecError(format!(
            "coded bytes unpack to {} bytes, the image has {}",
            planes.len(),
            out.len()
        )));
    }
    let mut now = vec![0u32; shape.width];
    let mut folded = vec![0u32; shape.width];
    for k in 0..shape.n_components {
        now.fill(0);
        let planes = &planes[k * shape.component_bytes()..][..shape.component_bytes()];
        for (y, row) in out.chunks_exact_mut(shape.row_bytes()).enumerate() {
            join(&mut folded, planes, shape.plane_bytes(), y * shape.width);
            // The sum of a row's differences is how much it rises above the row before.
            let mut rise = 0u32;
            for (now, folded) in now.iter_mut().zip(&folded) {
                let difference = if word_bytes == 2 {
                    unfold16(*folded)
                } else {
                    unfold32(*folded)
                };
                rise = rise.wrapping_add(difference);
                *now = now.wrapping_add(rise);
            }
            store(row, shape.element_bytes(), k, y, &now);
        }
    }
    Ok(())
}
