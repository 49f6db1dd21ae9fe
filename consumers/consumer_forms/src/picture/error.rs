//! Why a picture cannot be coded.

use openh264_sys2 as sys;

/// Why a picture cannot be coded.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The size is none, or beyond the payload.
    #[error("{n_bytes} bytes are not {} × {} distances", .size_px[0], .size_px[1])]
    Distances {
        /// Length of the payload.
        n_bytes: usize,
        /// Width and height that were named for it.
        size_px: [u32; 2],
    },
    /// So many colours.
    #[error("a palette has 1 to 256 colours, not {0}")]
    Palette(usize),
    /// A size that is none for JPEG.
    #[error("a JPEG has 1 to {most} pixels along each side, not {} × {}", .size_px[0], .size_px[1])]
    JpegSize {
        /// Width and height.
        size_px: [u32; 2],
        /// Largest side.
        most: u32,
    },
    /// A size that is none for OpenH264.
    #[error("H.264 takes images of 16 × 16 to 3840 × 2160 pixels, not {} × {}", .0[0], .0[1])]
    VideoSize([u32; 2]),
    /// A quantiser that OpenH264 does not take.
    #[error("a quantiser of H.264 is 1 to 51, not {0}")]
    Quantiser(u8),
    /// A picture of another size than its stream.
    #[error("the picture has not the size of its stream")]
    OtherSize,
    /// OpenH264's code for why it made no encoder.
    #[error("OpenH264 makes no encoder (code {0})")]
    NoEncoder(i32),
    /// The table of OpenH264's functions has a gap.
    #[error("OpenH264 lacks a function")]
    NoFunction,
    /// OpenH264's code for what it does not take.
    #[error("OpenH264 refuses {what} (code {code})")]
    Refused {
        /// What it was given.
        what: &'static str,
        /// Its code.
        code: i32,
    },
    /// A frame that is neither a key frame nor refers to the one before, or not the one asked for.
    #[error("OpenH264 made a frame of type {0}")]
    FrameType(sys::EVideoFrameType),
    /// The size is not that of the pixels.
    #[error(transparent)]
    Png(#[from] png::EncodingError),
    /// The size is not that of the pixels.
    #[error(transparent)]
    Jpeg(#[from] jpeg_encoder::EncodingError),
}
