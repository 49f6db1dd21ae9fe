//! Ray casts and debug shapes: what commands ask of the world's geometry and draw into its images.

use serde::{Deserialize, Serialize};

use crate::document::PoseText;

/// Most rays in one `cast_rays`.
pub const MAX_RAYS: usize = 100_000;
/// Most hits along one ray.
pub const MAX_HITS: usize = 1000;
/// Most debug shapes that are kept; beyond that the oldest are dropped.
pub const MAX_DEBUG_SHAPES: usize = 50_000;
/// Longest text of a debug shape, bytes.
pub const MAX_DEBUG_TEXT_BYTES: usize = 4096;

/// A ray with an end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RaySegment {
    /// Start, world, metres.
    pub from_m: [f64; 3],
    /// End, world, metres; at most 10 km from the start.
    pub to_m: [f64; 3],
}

/// A surface that a ray meets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RayHit {
    /// Where the ray meets it, world, metres.
    pub point_m: [f64; 3],
    /// Metres from the ray's start.
    pub distance_m: f64,
    /// Unit normal of the surface on the side that is met, world.
    pub normal: [f64; 3],
    /// Semantic class.
    pub class: u8,
    /// Actor, or scenery object with bit 31 set.
    pub object_id: u32,
}

/// A box with a pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PosedBox {
    /// Pose of its centre, world.
    pub pose: PoseText,
    /// Half extents along its own axes, metres.
    pub half_m: [f64; 3],
}

/// A shape that is drawn into colour images; depth, labels and ray casts do not show it. Texts, and
/// shapes with `on_screen`, are drawn into the spectator's image only.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DebugShape {
    /// The shape.
    pub draw: DebugDraw,
    /// Colour, sRGB.
    pub color_rgb: [u8; 3],
    /// Simulated time for which it is drawn: 0 is the next tick only, `None` until `clear_debug`.
    #[serde(default)]
    pub life_nanos: Option<u64>,
    /// Whether it is drawn over the finished image of the spectator alone: nothing hides it, and
    /// its thickness and the side of its points are pixels.
    #[serde(default)]
    pub on_screen: bool,
}

/// What `clear_debug` removes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DebugKind {
    /// Shapes and texts.
    #[default]
    All,
    /// Points, lines, arrows and boxes.
    Shapes,
    /// Texts.
    Texts,
}

/// Kinds of debug shapes; all positions are in the world, all lengths in metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum DebugDraw {
    /// A square that faces the camera.
    Point {
        /// Its middle.
        at_m: [f64; 3],
        /// Length of its sides.
        size_m: f64,
    },
    /// A line.
    Line {
        /// One end.
        from_m: [f64; 3],
        /// The other end.
        to_m: [f64; 3],
        /// Its thickness.
        width_m: f64,
    },
    /// A line with a head of four strokes at its end.
    Arrow {
        /// Where it begins.
        from_m: [f64; 3],
        /// Where it points.
        to_m: [f64; 3],
        /// Its thickness.
        width_m: f64,
        /// Length of the head.
        head_m: f64,
    },
    /// A text whose upper left corner is at a place of the world; line feeds begin new lines.
    /// Nothing hides it. Only the spectator's image shows it.
    Text {
        /// Its place.
        at_m: [f64; 3],
        /// The text, at most [`MAX_DEBUG_TEXT_BYTES`]; letters without a glyph are boxes.
        text: String,
        /// Whether it has a dark shadow, which keeps it legible before a bright sky.
        #[serde(default)]
        shadow: bool,
    },
    /// Twelve edges.
    Box {
        /// The box.
        edges_of: PosedBox,
        /// Their thickness.
        width_m: f64,
    },
}
