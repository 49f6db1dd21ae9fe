//! Truths and detections.

use super::regions::Region;

/// Class of a truth that belongs to every class and is ignored in each: a region that is left out.
pub const ANY_CLASS: u32 = u32::MAX;

/// An object, or a region that does not count.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth<R> {
    /// Its class, or [`ANY_CLASS`].
    pub class: u32,
    /// Where it is.
    pub region: R,
    /// Area by which it is small, medium or large, square pixels.
    pub area_px: f64,
    /// A region with many objects of its class that are not told apart; does not count.
    pub crowd: bool,
    /// Does not count; always so in [`ANY_CLASS`].
    pub ignore: bool,
}

impl<R: Region> Truth<R> {
    /// An object that counts, with the area of its region.
    pub fn new(class: u32, region: R) -> Self {
        let area_px = region.area();
        Truth {
            class,
            region,
            area_px,
            crowd: false,
            ignore: false,
        }
    }

    /// A region of which any part may be detected any number of times.
    pub fn crowd(class: u32, region: R) -> Self {
        Truth {
            crowd: true,
            ..Truth::new(class, region)
        }
    }

    /// An object that does not count.
    pub fn ignored(class: u32, region: R) -> Self {
        Truth {
            ignore: true,
            ..Truth::new(class, region)
        }
    }
}

/// Something that was detected.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection<R> {
    /// Its class.
    pub class: u32,
    /// Where it is.
    pub region: R,
    /// Confidence; only its order matters.
    pub score: f64,
    /// Does not count as false if it finds no truth.
    pub ignore_unmatched: bool,
}

impl<R> Detection<R> {
    /// A detection that counts as false if it finds no truth.
    pub fn new(class: u32, score: f64, region: R) -> Self {
        Detection {
            class,
            region,
            score,
            ignore_unmatched: false,
        }
    }
}
