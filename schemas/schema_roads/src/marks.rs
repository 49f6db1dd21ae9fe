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
    /// The kind that OpenDRIVE's word names.
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

impl MarkColour {
    /// The paint's colour, sRGB.
    pub fn rgb(self) -> [u8; 3] {
        match self {
            MarkColour::White => [226, 226, 220],
            MarkColour::Yellow => [222, 172, 52],
            MarkColour::Blue => [56, 98, 176],
            MarkColour::Green => [58, 140, 84],
            MarkColour::Red => [184, 52, 46],
            MarkColour::Orange => [218, 122, 40],
            MarkColour::Violet => [128, 80, 160],
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

/// Dash and gap of a broken line that states none, metres.
const DASH_M: (f64, f64) = (3.0, 6.0);

impl MarkRecord {
    /// The lines that the mark consists of: those of the file, or else those that its kind implies.
    pub fn stripes(&self) -> Vec<MarkStripe> {
        if !self.lines.is_empty() {
            return self.lines.clone();
        }
        let width_m = if self.width_m > 0.0 {
            self.width_m
        } else {
            0.12
        };
        let line = |t_offset_m: f64, broken: bool| MarkStripe {
            length_m: if broken { DASH_M.0 } else { 0.0 },
            space_m: if broken { DASH_M.1 } else { 0.0 },
            s_offset_m: 0.0,
            t_offset_m,
            width_m,
            colour: self.colour,
        };
        // "solid broken" is read from the inside outwards. The two lines lie a line's width apart.
        let pair = |inner: bool, outer: bool| vec![line(-width_m, inner), line(width_m, outer)];
        match self.kind {
            MarkKind::None | MarkKind::Grass | MarkKind::Kerb => Vec::new(),
            MarkKind::Solid | MarkKind::Other => vec![line(0.0, false)],
            MarkKind::Broken => vec![line(0.0, true)],
            MarkKind::SolidSolid => pair(false, false),
            MarkKind::SolidBroken => pair(false, true),
            MarkKind::BrokenSolid => pair(true, false),
            MarkKind::BrokenBroken => pair(true, true),
            MarkKind::BottsDots => vec![MarkStripe {
                length_m: 0.1,
                space_m: 1.2,
                ..line(0.0, true)
            }],
        }
    }
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
