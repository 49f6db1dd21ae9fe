//! What detections and truths cover of an image: boxes, and masks as COCO's run lengths.

/// A part of an image.
pub trait Region {
    /// Its area, square pixels.
    fn area(&self) -> f64;

    /// Area of what both cover, square pixels.
    fn intersection(&self, other: &Self) -> f64;

    /// Whether it is a region at all.
    fn is_valid(&self) -> bool;

    /// Overlap of a detection with a truth, 0..=1: intersection over union, or over the detection's
    /// own area if the truth is a crowd.
    fn overlap(&self, truth: &Self, crowd: bool) -> f64 {
        let both = self.intersection(truth);
        if both <= 0.0 {
            return 0.0;
        }
        let own = self.area();
        both / if crowd {
            own
        } else {
            own + truth.area() - both
        }
    }
}

/// A box along the axes of an image, pixels from the outer corner of the top-left pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxPx {
    /// Corner with the smallest coordinates `[x, y]`.
    pub min_px: [f64; 2],
    /// Corner with the largest coordinates `[x, y]`.
    pub max_px: [f64; 2],
}

impl BoxPx {
    /// A box by two of its corners.
    pub fn new(min_px: [f64; 2], max_px: [f64; 2]) -> BoxPx {
        BoxPx { min_px, max_px }
    }

    /// Left, top, width and height, as COCO writes boxes.
    pub fn xywh(&self) -> [f64; 4] {
        let ([x0, y0], [x1, y1]) = (self.min_px, self.max_px);
        [x0, y0, x1 - x0, y1 - y0]
    }
}

impl Region for BoxPx {
    fn area(&self) -> f64 {
        let [_, _, width, height] = self.xywh();
        width * height
    }

    fn intersection(&self, other: &Self) -> f64 {
        let [width, height] = [0, 1].map(|axis| {
            self.max_px[axis].min(other.max_px[axis]) - self.min_px[axis].max(other.min_px[axis])
        });
        width.max(0.0) * height.max(0.0)
    }

    fn is_valid(&self) -> bool {
        self.area().is_finite()
            && (0..2)
                .all(|axis| self.min_px[axis].is_finite() && self.max_px[axis] >= self.min_px[axis])
    }
}

/// Pixels of an image, as intervals of its columns laid end to end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunMask {
    width: u32,
    height: u32,
    /// First pixel and pixel behind the last, rising, apart.
    intervals: Vec<[u32; 2]>,
    n_pixels: u64,
    /// Rectangle round all pixels; empty if there are none.
    bounds: [u32; 4],
}

/// Runs that make no mask.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MaskError {
    /// The image has more pixels than a mask can number.
    #[error("a mask of {width} x {height} pixels is too large: at most 4294967295 pixels")]
    TooLarge {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The runs are longer or shorter than the image.
    #[error(
        "the runs of a mask cover {covered} pixels, but its image has {width} x {height} = {expected}: \
         runs count every pixel, column by column, background first"
    )]
    Length {
        /// Sum of the runs.
        covered: u64,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Pixels of the image.
        expected: u64,
    },
}

impl RunMask {
    /// A mask by COCO's runs: lengths of background and object in turn, beginning with background,
    /// column by column over the whole image.
    ///
    /// # Errors
    /// If the runs do not cover the image exactly, or it has more than `u32::MAX` pixels.
    pub fn from_runs(width: u32, height: u32, runs: &[u32]) -> Result<RunMask, MaskError> {
        let expected = u64::from(width) * u64::from(height);
        if expected > u64::from(u32::MAX) {
            return Err(MaskError::TooLarge { width, height });
        }
        let covered = runs.iter().map(|run| u64::from(*run)).sum();
        if covered != expected {
            return Err(MaskError::Length {
                covered,
                width,
                height,
                expected,
            });
        }
        let mut intervals: Vec<[u32; 2]> = Vec::with_capacity(runs.len() / 2);
        let mut at = 0;
        for (i, run) in runs.iter().enumerate() {
            let end = at + run;
            if i % 2 == 1 && *run > 0 {
                match intervals.last_mut() {
                    Some(last) if last[1] == at => last[1] = end,
                    _ => intervals.push([at, end]),
                }
            }
            at = end;
        }
        Ok(RunMask::of_intervals(width, height, intervals))
    }

    /// A mask of the pixels for which `has(column, row)` is true.
    ///
    /// # Errors
    /// If the image has more than `u32::MAX` pixels.
    pub fn from_pixels(
        width: u32,
        height: u32,
        has: impl FnMut(u32, u32) -> bool,
    ) -> Result<RunMask, MaskError> {
        RunMask::from_part(width, height, [0, 0, width, height], has)
    }

    /// The same for a mask that lies inside a rectangle (first column and row, column and row behind
    /// the last), which alone is asked about; what of it lies outside of the image is left out.
    ///
    /// # Errors
    /// If the image has more than `u32::MAX` pixels.
    pub fn from_part(
        width: u32,
        height: u32,
        [x0, y0, x1, y1]: [u32; 4],
        mut has: impl FnMut(u32, u32) -> bool,
    ) -> Result<RunMask, MaskError> {
        if u64::from(width) * u64::from(height) > u64::from(u32::MAX) {
            return Err(MaskError::TooLarge { width, height });
        }
        let mut intervals: Vec<[u32; 2]> = Vec::new();
        for column in x0..x1.min(width) {
            for row in (y0..y1.min(height)).filter(|row| has(column, *row)) {
                let at = column * height + row;
                match intervals.last_mut() {
                    Some(last) if last[1] == at => last[1] = at + 1,
                    _ => intervals.push([at, at + 1]),
                }
            }
        }
        Ok(RunMask::of_intervals(width, height, intervals))
    }

    fn of_intervals(width: u32, height: u32, intervals: Vec<[u32; 2]>) -> RunMask {
        let n_pixels = intervals
            .iter()
            .map(|[from, to]| u64::from(to - from))
            .sum();
        let mut bounds = [u32::MAX, u32::MAX, 0, 0];
        for [from, to] in &intervals {
            let (first, last) = (from / height, (to - 1) / height);
            // An interval over several columns reaches the bottom of one and the top of the next.
            let (top, bottom) = if first == last {
                (from % height, (to - 1) % height)
            } else {
                (0, height - 1)
            };
            bounds[0] = bounds[0].min(first);
            bounds[1] = bounds[1].min(top);
            bounds[2] = bounds[2].max(last + 1);
            bounds[3] = bounds[3].max(bottom + 1);
        }
        if intervals.is_empty() {
            bounds = [0; 4];
        }
        RunMask {
            width,
            height,
            intervals,
            n_pixels,
            bounds,
        }
    }

    /// COCO's runs, as [`RunMask::from_runs`] takes them.
    pub fn runs(&self) -> Vec<u32> {
        let mut runs = Vec::with_capacity(self.intervals.len() * 2 + 1);
        let mut at = 0;
        for [from, to] in &self.intervals {
            runs.extend([from - at, to - from]);
            at = *to;
        }
        let end = self.width * self.height;
        if end > at || runs.is_empty() {
            runs.push(end - at);
        }
        runs
    }

    /// Width and height of the image, pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Number of pixels in the mask.
    pub fn n_pixels(&self) -> u64 {
        self.n_pixels
    }

    /// Rectangle round its pixels: first column and row, column and row behind the last; `None` if
    /// it has no pixel.
    pub fn bounds(&self) -> Option<[u32; 4]> {
        (self.n_pixels > 0).then_some(self.bounds)
    }
}

impl Region for RunMask {
    fn area(&self) -> f64 {
        self.n_pixels as f64
    }

    /// 0 for masks of images of different sizes.
    fn intersection(&self, other: &Self) -> f64 {
        let ([ax0, ay0, ax1, ay1], [bx0, by0, bx1, by1]) = (self.bounds, other.bounds);
        let apart = ax1 <= bx0 || bx1 <= ax0 || ay1 <= by0 || by1 <= ay0;
        if apart || self.size() != other.size() {
            return 0.0;
        }
        let (mut a, mut b) = (self.intervals.iter(), other.intervals.iter());
        let (mut own, mut others) = (a.next(), b.next());
        let mut both = 0u64;
        while let (Some([from, to]), Some([other_from, other_to])) = (own, others) {
            both += u64::from(to.min(other_to).saturating_sub(*from.max(other_from)));
            if to < other_to {
                own = a.next();
            } else {
                others = b.next();
            }
        }
        both as f64
    }

    fn is_valid(&self) -> bool {
        true
    }
}
