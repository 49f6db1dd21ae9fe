//! Road marks: kinds, colours, and what they allow.

/// How a mark is painted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum MarkKind {
    /// No mark.
    #[default]
    None,
    /// One continuous line.
    Solid,
    /// One broken line.
    Broken,
    /// Two continuous lines.
    SolidSolid,
    /// Continuous, and broken on the outer side.
    SolidBroken,
    /// Broken, and continuous on the outer side.
    BrokenSolid,
    /// Two broken lines.
    BrokenBroken,
    /// Raised dots.
    BottsDots,
    /// Grass edge.
    Grass,
    /// Kerb.
    Kerb,
    /// Anything else.
    Other,
}

impl MarkKind {
    /// From OpenDRIVE's word.
    pub(crate) fn from_text(text: &str) -> MarkKind {
        match text {
            "none" | "" => MarkKind::None,
            "solid" => MarkKind::Solid,
            "broken" => MarkKind::Broken,
            "solid solid" => MarkKind::SolidSolid,
            "solid broken" => MarkKind::SolidBroken,
            "broken solid" => MarkKind::BrokenSolid,
            "broken broken" => MarkKind::BrokenBroken,
            "botts dots" => MarkKind::BottsDots,
            "grass" => MarkKind::Grass,
            "curb" => MarkKind::Kerb,
            _ => MarkKind::Other,
        }
    }
}

/// A mark's colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum MarkColour {
    /// `standard` and `white`.
    #[default]
    White,
    /// Yellow.
    Yellow,
    /// Blue.
    Blue,
    /// Green.
    Green,
    /// Red.
    Red,
    /// Orange.
    Orange,
    /// Violet.
    Violet,
}

impl MarkColour {
    pub(crate) fn from_text(text: &str) -> MarkColour {
        match text {
            "yellow" => MarkColour::Yellow,
            "blue" => MarkColour::Blue,
            "green" => MarkColour::Green,
            "red" => MarkColour::Red,
            "orange" => MarkColour::Orange,
            "violet" => MarkColour::Violet,
            _ => MarkColour::White,
        }
    }
}

/// One painted line of a mark.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MarkStripe {
    /// Length of a dash, metres; 0 for a continuous line.
    pub length_m: f64,
    /// Gap between dashes, metres.
    pub space_m: f64,
    /// Where the first dash begins after the mark's start, metres.
    pub s_offset_m: f64,
    /// Distance of the line's middle from the lane's edge, metres, positive to the left.
    pub t_offset_m: f64,
    /// Width, metres.
    pub width_m: f64,
    /// Colour.
    pub colour: MarkColour,
}

/// A mark on a lane's outer edge from `s_offset_m` after the section's start.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct MarkRecord {
    pub s_offset_m: f64,
    pub kind: MarkKind,
    pub colour: MarkColour,
    pub width_m: f64,
    /// Lines that the file describes one by one.
    pub lines: Vec<MarkStripe>,
    /// Whether a change to the lane with the greater id is allowed.
    pub to_greater: bool,
    /// Whether a change to the lane with the smaller id is allowed.
    pub to_smaller: bool,
}

/// The record in force at `ds_m`.
pub(crate) fn mark_at(records: &[MarkRecord], ds_m: f64) -> Option<&MarkRecord> {
    let after = records.partition_point(|r| r.s_offset_m <= ds_m + 1e-9);
    records.get(after.checked_sub(1)?)
}

/// A stretch of one mark as a polyline in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkLine {
    /// How it is painted.
    pub kind: MarkKind,
    /// Its colour.
    pub colour: MarkColour,
    /// Width of the line, metres.
    pub width_m: f64,
    /// Number of its road, as in [`crate::LaneKey`].
    pub road: u32,
    /// OpenDRIVE's id of the lane whose outer edge it marks; 0 is the centre line.
    pub lane: i8,
    /// Whether a change to the lane with the greater id is allowed.
    pub to_greater: bool,
    /// Whether a change to the lane with the smaller id is allowed.
    pub to_smaller: bool,
    /// Points by rising s of the road, world, metres.
    pub points: Vec<[f64; 3]>,
}
