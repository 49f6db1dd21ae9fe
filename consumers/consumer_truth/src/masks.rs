//! Masks of segments: COCO's run lengths, and outlines along the pixels' edges.

/// A mask inside a rectangle of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Rectangle that holds all of its pixels: first column and row, column and row behind the last.
    pub bounds: [u32; 4],
    /// Its pixels within the rectangle, row after row.
    inside: Vec<bool>,
}

impl Mask {
    /// Pixels for which `shows(column, row)` is true, looked for within `bounds`.
    pub fn new(bounds: [u32; 4], mut shows: impl FnMut(u32, u32) -> bool) -> Mask {
        let [x0, y0, x1, y1] = bounds;
        let mut inside = Vec::with_capacity((x1 - x0) as usize * (y1 - y0) as usize);
        for row in y0..y1 {
            inside.extend((x0..x1).map(|column| shows(column, row)));
        }
        Mask { bounds, inside }
    }

    /// Whether a pixel of the image is in the mask.
    pub fn has(&self, column: i64, row: i64) -> bool {
        let [x0, y0, x1, y1] = self.bounds.map(i64::from);
        let within = (x0..x1).contains(&column) && (y0..y1).contains(&row);
        within && self.inside[((row - y0) * (x1 - x0) + column - x0) as usize]
    }

    /// Number of pixels.
    pub fn n_pixels(&self) -> u64 {
        self.inside.iter().filter(|inside| **inside).count() as u64
    }

    /// COCO's runs in an image of this size: column after column, beginning with pixels outside.
    pub fn runs(&self, width: u32, height: u32) -> Vec<u32> {
        let [x0, y0, x1, y1] = self.bounds;
        let mut runs = Vec::new();
        let (mut value, mut length) = (false, 0u32);
        let mut add = |pixel: bool, n: u32| {
            if pixel != value {
                runs.push(length);
                (value, length) = (pixel, 0);
            }
            length += n;
        };
        add(false, x0 * height);
        for column in x0..x1 {
            add(false, y0);
            for row in y0..y1 {
                add(self.has(i64::from(column), i64::from(row)), 1);
            }
            add(false, height - y1);
        }
        add(false, (width - x1) * height);
        runs.push(length);
        runs
    }

    /// Outer outlines of its connected parts (pixels that share an edge), largest first: corners of
    /// pixels, clockwise as seen in the image, without those on straight lines. Holes are left out.
    pub fn outlines(&self) -> Vec<Vec<[u32; 2]>> {
        let [x0, y0, x1, y1] = self.bounds.map(i64::from);
        let (width, height) = ((x1 - x0) as usize, (y1 - y0) as usize);
        let mut part = vec![0u32; width * height];
        let mut outlines: Vec<(usize, Vec<[u32; 2]>)> = Vec::new();
        for at in 0..width * height {
            if !self.inside[at] || part[at] != 0 {
                continue;
            }
            let number = outlines.len() as u32 + 1;
            let mut left = vec![at];
            let mut n_pixels = 0;
            part[at] = number;
            while let Some(at) = left.pop() {
                n_pixels += 1;
                let (x, y) = (at % width, at / width);
                let mut look = |next: usize| {
                    if self.inside[next] && part[next] == 0 {
                        part[next] = number;
                        left.push(next);
                    }
                };
                if x > 0 {
                    look(at - 1)
                }
                if x + 1 < width {
                    look(at + 1)
                }
                if y > 0 {
                    look(at - width)
                }
                if y + 1 < height {
                    look(at + width)
                }
            }
            let has = |x: i64, y: i64| {
                x >= 0
                    && y >= 0
                    && x < width as i64
                    && y < height as i64
                    && part[y as usize * width + x as usize] == number
            };
            let corners = follow((at % width) as i64, (at / width) as i64, has);
            let corners = corners
                .into_iter()
                .map(|[x, y]| [(x + x0) as u32, (y + y0) as u32]);
            outlines.push((n_pixels, corners.collect()));
        }
        outlines.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        outlines.into_iter().map(|(_, corners)| corners).collect()
    }
}

/// Follows the outer edge of a part of which (x, y) is the first pixel in reading order, with the
/// part on the right hand.
fn follow(x: i64, y: i64, has: impl Fn(i64, i64) -> bool) -> Vec<[i64; 2]> {
    // Directions: 0 right, 1 down, 2 left, 3 up. Of an edge from a corner in a direction the pixel
    // ahead to the right and the one ahead to the left:
    let ahead = |[x, y]: [i64; 2], direction: usize| match direction {
        0 => ((x, y), (x, y - 1)),
        1 => ((x - 1, y), (x, y)),
        2 => ((x - 1, y - 1), (x - 1, y)),
        _ => ((x, y - 1), (x - 1, y - 1)),
    };
    let step = [[1, 0], [0, 1], [-1, 0], [0, -1]];
    let (start, mut direction) = ([x, y], 0usize);
    let mut at = start;
    let mut corners = Vec::new();
    loop {
        corners.push(at);
        loop {
            at = [at[0] + step[direction][0], at[1] + step[direction][1]];
            let ((rx, ry), (lx, ly)) = ahead(at, direction);
            // Parts hang together over edges only, so at a corner where two pixels touch the path
            // turns towards its own one.
            let turn = if !has(rx, ry) {
                Some(1)
            } else if has(lx, ly) {
                Some(3)
            } else {
                None
            };
            if let Some(turn) = turn {
                direction = (direction + turn) % 4;
                break;
            }
        }
        if at == start && direction == 0 {
            return corners;
        }
    }
}

/// COCO's text form of runs: differences to the run but one before, six bits a character.
pub fn runs_text(runs: &[u32]) -> String {
    let mut text = String::with_capacity(runs.len() * 2);
    for (i, run) in runs.iter().enumerate() {
        let mut value = i64::from(*run);
        if i > 2 {
            value -= i64::from(runs[i - 2]);
        }
        loop {
            let low = value & 0x1f;
            value >>= 5;
            let more = if low & 0x10 != 0 {
                value != -1
            } else {
                value != 0
            };
            text.push((48 + low as u8 + if more { 0x20 } else { 0 }) as char);
            if !more {
                break;
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blob(seed: u64) -> Mask {
        let mut rng = fastrand::Rng::with_seed(seed);
        let dense = rng.f64();
        Mask::new([3, 2, 15, 13], |_, _| rng.f64() < dense)
    }

    #[test]
    fn runs_paint_the_mask_again() {
        for seed in 0..200 {
            let mask = blob(seed);
            let mut painted = Vec::new();
            for (i, run) in mask.runs(20, 16).iter().enumerate() {
                painted.extend(std::iter::repeat_n(i % 2 == 1, *run as usize));
            }
            assert_eq!(painted.len(), 320);
            for column in 0..20 {
                for row in 0..16 {
                    assert_eq!(
                        painted[(column * 16 + row) as usize],
                        mask.has(column, row),
                        "{seed}"
                    );
                }
            }
        }
    }

    #[test]
    fn outlines_with_even_odd_filling_hold_every_pixel_and_nothing_but_holes_beside() {
        for seed in 0..200 {
            let mask = blob(seed);
            let outlines = mask.outlines();
            // A pixel is inside an outline if a line to the left crosses it an odd number of times.
            let crossed = |outline: &[[u32; 2]], x: f64, y: f64| {
                (0..outline.len())
                    .filter(|&i| {
                        let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
                        let (ay, by) = (f64::from(a[1]), f64::from(b[1]));
                        (ay <= y) != (by <= y) && f64::from(a[0]) < x
                    })
                    .count()
                    % 2
                    == 1
            };
            let mut in_parts = 0;
            for column in 0..20 {
                for row in 0..16 {
                    let n = outlines
                        .iter()
                        .filter(|outline| crossed(outline, column as f64 + 0.5, row as f64 + 0.5))
                        .count();
                    assert!(n >= usize::from(mask.has(column, row)), "{seed}");
                    in_parts += u64::from(mask.has(column, row));
                }
            }
            assert_eq!(in_parts, mask.n_pixels());
        }
        let square = Mask::new([2, 1, 5, 3], |_, _| true);
        assert_eq!(square.outlines(), [vec![[2, 1], [5, 1], [5, 3], [2, 3]]]);
    }

    #[test]
    fn the_text_of_runs_is_the_one_that_coco_documents_for_small_numbers() {
        // 5 is one group of five bits without a successor: 48 + 5.
        assert_eq!(runs_text(&[5]), "5");
        // 16 has the sign bit of its group set, so another group follows.
        assert_eq!(runs_text(&[16]), "`0");
        // From the fourth on differences count: 7 − 2.
        assert_eq!(runs_text(&[1, 2, 3, 7]), "1235");
    }
}
