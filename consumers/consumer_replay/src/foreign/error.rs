//! Why a message of another program does not become a frame.

use consumer_forms::ros2::cdr::ReadError;

/// Why a message, or all messages of a topic, do not become frames.
#[derive(Debug, thiserror::Error)]
pub enum ForeignError {
    /// The topic is empty.
    #[error("it has no message")]
    NoMessage,
    /// There is no frame for such messages.
    #[error(
        "there is no frame for {schema} in {encoding:?}; known are Foxglove's RawImage, CompressedImage, PointCloud and LocationFix in protobuf and ROS 2's Image, CompressedImage, PointCloud2, NavSatFix and Imu in CDR"
    )]
    Unknown {
        /// Name of the schema.
        schema: String,
        /// Encoding of the messages.
        encoding: String,
    },
    /// It cannot be read as protobuf.
    #[error("it is no message of its schema: {0}")]
    Protobuf(String),
    /// It cannot be read as CDR.
    #[error(transparent)]
    Cdr(#[from] ReadError),
    /// An encoding of pixels that has no frame.
    #[error(
        "its pixels are {0:?}, known are rgb8, bgr8, rgba8, bgra8, mono8, mono16, 16UC1 and 32FC1"
    )]
    Pixels(String),
    /// Pixels of another kind than those of the first image.
    #[error("its pixels have become {0:?}")]
    PixelsChanged(String),
    /// Too few bytes, or too many pixels.
    #[error("{n_bytes} bytes are no image of {width} × {height} pixels")]
    Size {
        /// Bytes of the pixels.
        n_bytes: usize,
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// Neither of the two kinds of files that images come in.
    #[error("it is coded as neither PNG nor JPEG")]
    Coding,
    /// A broken JPEG file.
    #[error("its JPEG cannot be decoded: {0}")]
    Jpeg(image::ImageError),
    /// A broken PNG file.
    #[error("its PNG cannot be decoded: {0}")]
    Png(png::DecodingError),
    /// A PNG file that would be too large.
    #[error("its PNG unpacks to {0} bytes")]
    PngSize(usize),
    /// A cloud without places.
    #[error("its points have no x, y and z")]
    NoAxes,
    /// A cloud whose points have no length.
    #[error("its points have 0 bytes")]
    EmptyPoints,
    /// A cloud whose points are shorter than their fields.
    #[error("a field lies beyond its point")]
    FieldBeyond,
}
