//! The input of an event camera: five images of one firing, as plain bytes.

/// An image's rows in memory, padded or not.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    bytes: &'a [u8],
    row_bytes: usize,
    stride_bytes: usize,
}

impl<'a> Rows<'a> {
    /// Rows of `row_bytes`, one every `stride_bytes`.
    pub fn new(bytes: &'a [u8], row_bytes: usize, stride_bytes: usize) -> Self {
        Rows {
            bytes,
            row_bytes,
            stride_bytes,
        }
    }

    /// Rows without padding.
    pub fn tight(bytes: &'a [u8], row_bytes: usize) -> Self {
        Rows {
            bytes,
            row_bytes,
            stride_bytes: row_bytes,
        }
    }

    /// Row `y`.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &'a [u8] {
        &self.bytes[y * self.stride_bytes..][..self.row_bytes]
    }
}

/// Images of one firing.
#[derive(Clone, Copy, Debug)]
pub struct EventImages<'a> {
    /// `f32`: luminance, 1 is white.
    pub luminance: Rows<'a>,
    /// `f32` × 2: motion since the previous firing, pixels.
    pub flow: Rows<'a>,
    /// `f32`: metres; +∞ is the sky.
    pub depth: Rows<'a>,
    /// `u32`: object id.
    pub instance: Rows<'a>,
    /// `u8`: class.
    pub class: Rows<'a>,
}

pub(super) fn float(bytes: &[u8]) -> f32 {
    f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

pub(super) fn word(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}
