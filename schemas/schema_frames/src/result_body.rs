//! How the body of each type of result is read, and what its writer may leave out.

use crate::control::VehicleControlRecord;
use crate::result_records::{
    Box2d, Box3d, Keypoint, KeypointSet, MaskRecord, Odometry, PathPoint, PoseEstimate, Scalar,
    Track,
};
use crate::result_type::{PixelFormat, ResultType, Space};

/// How the body of a result is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Body {
    /// `height` rows of `width` pixels.
    Pixels,
    /// Elements of one type with a shape.
    Tensor,
    /// Records of this many bytes each, one after the other.
    Records(usize),
    /// Records of this many bytes each, and behind them elements of the second size.
    RecordsAndTail(usize, usize),
    /// Records whose size the header says: points with named fields.
    Points,
    /// Bytes.
    Bytes,
}

impl ResultType {
    /// How its body is read.
    pub const fn body(self) -> Body {
        match self {
            ResultType::Image
            | ResultType::Flow
            | ResultType::Depth
            | ResultType::Semantic
            | ResultType::Instance => Body::Pixels,
            ResultType::Tensor => Body::Tensor,
            ResultType::Boxes2d => Body::Records(size_of::<Box2d>()),
            ResultType::Boxes3d => Body::Records(size_of::<Box3d>()),
            ResultType::Tracks => Body::Records(size_of::<Track>()),
            ResultType::Masks => Body::RecordsAndTail(size_of::<MaskRecord>(), size_of::<u32>()),
            ResultType::Keypoints => {
                Body::RecordsAndTail(size_of::<KeypointSet>(), size_of::<Keypoint>())
            }
            ResultType::Points => Body::Points,
            ResultType::Pose => Body::Records(size_of::<PoseEstimate>()),
            ResultType::Odometry => Body::Records(size_of::<Odometry>()),
            ResultType::Path => Body::Records(size_of::<PathPoint>()),
            ResultType::Control => Body::Records(size_of::<VehicleControlRecord>()),
            ResultType::Scalars => Body::Records(size_of::<Scalar>()),
            ResultType::Text | ResultType::Json | ResultType::Bytes => Body::Bytes,
        }
    }

    /// The only pixel format that this type may have; `None` if any may be, or none.
    pub const fn pixel_format(self) -> Option<PixelFormat> {
        match self {
            ResultType::Flow => Some(PixelFormat::Flow),
            ResultType::Depth => Some(PixelFormat::Depth),
            ResultType::Semantic => Some(PixelFormat::Class),
            ResultType::Instance => Some(PixelFormat::Id),
            _ => None,
        }
    }

    /// The space that results of this type are in if their writer says nothing.
    pub const fn usual_space(self) -> Space {
        match self {
            ResultType::Image
            | ResultType::Boxes2d
            | ResultType::Masks
            | ResultType::Keypoints
            | ResultType::Flow
            | ResultType::Depth
            | ResultType::Semantic
            | ResultType::Instance
            | ResultType::Tracks => Space::Image,
            ResultType::Boxes3d | ResultType::Points => Space::Sensor,
            ResultType::Pose | ResultType::Odometry | ResultType::Path => Space::World,
            ResultType::Tensor
            | ResultType::Control
            | ResultType::Scalars
            | ResultType::Text
            | ResultType::Json
            | ResultType::Bytes => Space::None,
        }
    }

    /// Whether samples of this type are large as images are, so that a topic has fewer places.
    pub const fn is_large(self) -> bool {
        matches!(
            self.body(),
            Body::Pixels | Body::Tensor | Body::Points | Body::Bytes
        ) && !matches!(self, ResultType::Text | ResultType::Json)
    }

    /// Whether bodies can stay on a GPU: arrays whose shape the header tells.
    pub const fn can_stay_on_gpu(self) -> bool {
        matches!(self.body(), Body::Pixels | Body::Tensor)
    }
}
