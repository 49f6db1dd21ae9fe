//! How far one can see at most, in blocks of 8 × 8 pixels of an image.

use sensor_spec::Intrinsics;

use super::occluder::Occluder;
use crate::camera_motion::NEAR_M;

/// Side of a block, pixels.
const SIDE_PX: usize = 8;
/// Depths behind an occluder within this part of its own count as before it.
const DEPTH_MARGIN: f64 = 2e-3;
/// Boxes are widened by this, more than rasterisers may move an edge, pixels.
const MARGIN_PX: f64 = 2.0;
/// Corners of a polygon after clipping, at most.
const MAX_CORNERS: usize = 10;

/// One block.
#[derive(Clone, Copy, Debug)]
struct Block {
    /// Nothing behind this is seen: one over metres; 0 is infinity.
    inverse_depth: f32,
    /// Pixels that something covers which does not cover the whole block.
    covered: u64,
    /// One over the depth of its farthest point.
    covered_inverse_depth: f32,
}

/// The image of a pinhole camera in blocks.
#[derive(Clone, Debug, Default)]
pub(crate) struct Blocks {
    n: [usize; 2],
    size_px: [f64; 2],
    /// Focal lengths and centre, pixels.
    lens: [f64; 4],
    blocks: Vec<Block>,
}

impl Blocks {
    /// Nothing is hidden in the image of this lens.
    pub fn clear(&mut self, lens: &Intrinsics) {
        let size = [lens.width_px as usize, lens.height_px as usize];
        self.n = size.map(|side| side.div_ceil(SIDE_PX));
        self.size_px = size.map(|side| side as f64);
        self.lens = lens.as_array();
        self.blocks.clear();
        for by in 0..self.n[1] {
            for bx in 0..self.n[0] {
                self.blocks.push(Block {
                    inverse_depth: 0.0,
                    covered: outside(size, [bx, by]),
                    covered_inverse_depth: f32::INFINITY,
                });
            }
        }
    }

    /// Draws a polygon whose mesh has this pose, rows of `[rotation | translation]` in the camera's
    /// axes (x to the right, y down, z forward); says whether it faces the camera.
    pub fn draw(&mut self, occluder: &Occluder, camera_from_mesh: &[[f64; 4]; 3]) -> bool {
        let mut polygon = Polygon::default();
        let corner = |p: [f32; 3]| {
            let p = p.map(f64::from);
            camera_from_mesh.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3])
        };
        let n = occluder.corners_m.len();
        let mut before = corner(occluder.corners_m[n - 1]);
        for m in &occluder.corners_m {
            let here = corner(*m);
            // Clipped at the near plane.
            if (here[2] >= NEAR_M) != (before[2] >= NEAR_M) {
                let share = (NEAR_M - before[2]) / (here[2] - before[2]);
                let at = |axis: usize| before[axis] + (here[axis] - before[axis]) * share;
                polygon.push(self.projected([at(0), at(1), NEAR_M]));
            }
            if here[2] >= NEAR_M {
                polygon.push(self.projected(here));
            }
            before = here;
        }
        let plane = polygon.plane();
        if let Some(plane) = plane {
            self.fill(&polygon, plane);
        }
        plane.is_some()
    }

    /// Image position and one over the depth.
    fn projected(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [fx, fy, cx, cy] = self.lens;
        [cx + fx * x / z, cy + fy * y / z, 1.0 / z]
    }

    fn fill(&mut self, polygon: &Polygon, plane: [f64; 3]) {
        let corners = polygon.corners();
        let bound = |axis: usize, pick: fn(f64, f64) -> f64| {
            corners
                .iter()
                .map(|corner| corner[axis])
                .reduce(pick)
                .unwrap_or(0.0)
        };
        let (top, bottom) = (
            bound(1, f64::min).max(0.0),
            bound(1, f64::max).min(self.size_px[1]),
        );
        let farthest = bound(2, f64::min);
        if bottom <= top {
            return;
        }
        let (first, last) = (
            top as usize / SIDE_PX,
            (bottom as usize / SIDE_PX).min(self.n[1] - 1),
        );
        for by in first..=last {
            let mut spans = [[0_i32; 2]; SIDE_PX];
            let mut all = [i32::MAX, 0];
            for (row, span) in spans.iter_mut().enumerate() {
                let y = (by * SIDE_PX + row) as f64 + 0.5;
                *span = self.span(corners, y);
                if span[0] < span[1] {
                    all = [all[0].min(span[0]), all[1].max(span[1])];
                }
            }
            if all[0] >= all[1] {
                continue;
            }
            let columns = all[0] as usize / SIDE_PX..(all[1] as usize).div_ceil(SIDE_PX);
            for bx in columns {
                let corner = [bx, by].map(|i| (i * SIDE_PX) as f64);
                // The farthest corner of the block, or the polygon's farthest one.
                let far = |axis: usize| {
                    corner[axis]
                        + if plane[axis] > 0.0 {
                            0.0
                        } else {
                            SIDE_PX as f64
                        }
                };
                let inverse = (plane[0] * far(0) + plane[1] * far(1) + plane[2]).max(farthest);
                let inverse = (inverse * (1.0 - DEPTH_MARGIN)) as f32;
                let mut covered = 0_u64;
                for (row, span) in spans.iter().enumerate() {
                    let begin = (bx * SIDE_PX) as i32;
                    let [from, to] = span.map(|x| (x - begin).clamp(0, SIDE_PX as i32) as u32);
                    let bits = ((1_u64 << to) - 1) & !((1_u64 << from) - 1);
                    covered |= bits << (SIDE_PX * row);
                }
                self.blocks[by * self.n[0] + bx].cover(covered, inverse);
            }
        }
    }

    /// First pixel, and the one behind the last, whose centres at this height the polygon covers.
    fn span(&self, corners: &[[f64; 3]], y: f64) -> [i32; 2] {
        let (mut from, mut to) = (0.0_f64, self.size_px[0]);
        let mut before = corners[corners.len() - 1];
        for here in corners {
            // Where y is downwards, the inside has dx · (y − y0) ≤ dy · (x − x0) at each edge.
            let (dx, dy) = (here[0] - before[0], here[1] - before[1]);
            let rest = dx * (y - before[1]) + dy * before[0];
            if dy > 0.0 {
                from = from.max(rest / dy);
            } else if dy < 0.0 {
                to = to.min(rest / dy);
            } else if rest > 0.0 {
                return [0, 0];
            }
            before = *here;
        }
        // Slivers may have no pixel at all, or lines that meet far away.
        let (from, to) = (from.min(self.size_px[0]), to.max(0.0));
        // Centres lie at halves.
        [(from - 0.5).ceil() as i32, (to - 0.5).floor() as i32 + 1]
    }

    /// Whether nothing of a box can be seen, given by its corners in the camera's axes, metres.
    pub fn hide(&self, corners: &[[f64; 3]; 8]) -> bool {
        let (mut least, mut greatest) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut nearest = 0.0_f64;
        for corner in corners {
            if corner[2] < NEAR_M {
                return false;
            }
            let [x, y, inverse] = self.projected(*corner);
            least = [least[0].min(x), least[1].min(y)];
            greatest = [greatest[0].max(x), greatest[1].max(y)];
            nearest = nearest.max(inverse);
        }
        let block = |position: f64, axis: usize| {
            (position.clamp(0.0, self.size_px[axis]) as usize / SIDE_PX).min(self.n[axis] - 1)
        };
        let [x0, y0] = [0, 1].map(|axis: usize| block(least[axis] - MARGIN_PX, axis));
        let [x1, y1] = [0, 1].map(|axis: usize| block(greatest[axis] + MARGIN_PX, axis));
        (y0..=y1).all(|y| {
            self.blocks[y * self.n[0] + x0..=y * self.n[0] + x1]
                .iter()
                .all(|block| f64::from(block.inverse_depth) > nearest)
        })
    }
}

impl Block {
    /// Some pixels are covered by something that is nowhere farther than this.
    fn cover(&mut self, covered: u64, inverse_depth: f32) {
        if inverse_depth <= self.inverse_depth {
            return;
        }
        if covered == u64::MAX {
            self.inverse_depth = inverse_depth;
            return;
        }
        self.covered |= covered;
        self.covered_inverse_depth = self.covered_inverse_depth.min(inverse_depth);
        if self.covered == u64::MAX {
            self.inverse_depth = self.inverse_depth.max(self.covered_inverse_depth);
            (self.covered, self.covered_inverse_depth) = (0, f32::INFINITY);
        }
    }
}

/// The pixels of a block that lie outside the image.
fn outside(size_px: [usize; 2], [bx, by]: [usize; 2]) -> u64 {
    if (bx + 1) * SIDE_PX <= size_px[0] && (by + 1) * SIDE_PX <= size_px[1] {
        return 0;
    }
    let mut bits = 0;
    for y in 0..SIDE_PX {
        for x in 0..SIDE_PX {
            if bx * SIDE_PX + x >= size_px[0] || by * SIDE_PX + y >= size_px[1] {
                bits |= 1 << (SIDE_PX * y + x);
            }
        }
    }
    bits
}

/// A polygon on the screen: image position and one over the depth of each corner.
#[derive(Default)]
struct Polygon {
    corners: [[f64; 3]; MAX_CORNERS],
    n: usize,
}

impl Polygon {
    fn push(&mut self, corner: [f64; 3]) {
        if self.n < MAX_CORNERS {
            self.corners[self.n] = corner;
            self.n += 1;
        }
    }

    fn corners(&self) -> &[[f64; 3]] {
        &self.corners[..self.n]
    }

    /// One over the depth as a·x + b·y + c; `None` if it is seen from behind or from the edge.
    fn plane(&self) -> Option<[f64; 3]> {
        let corners = self.corners();
        let mut best: Option<(f64, [f64; 3])> = None;
        for i in 2..corners.len() {
            let [p, q, r] = [corners[0], corners[i - 1], corners[i]];
            let (u, v) = (
                [0, 1, 2].map(|k| q[k] - p[k]),
                [0, 1, 2].map(|k| r[k] - p[k]),
            );
            // Fronts are counter-clockwise seen, which is a negative turn where y is downwards.
            let turn = u[0] * v[1] - u[1] * v[0];
            if -turn > best.map_or(MIN_TURN_PX2, |(area, _)| area) {
                let a = (u[2] * v[1] - u[1] * v[2]) / turn;
                let b = (u[0] * v[2] - u[2] * v[0]) / turn;
                best = Some((-turn, [a, b, p[2] - a * p[0] - b * p[1]]));
            }
        }
        best.map(|(_, plane)| plane)
    }
}

/// Polygons whose largest triangle is smaller hide nothing, square pixels times two.
const MIN_TURN_PX2: f64 = 64.0;

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: what is called hidden is hidden. Method: rays through all pixel centres, against random
    /// walls, find no box before them.
    #[test]
    fn hidden_boxes_are_behind_a_wall_at_every_pixel() {
        let lens = Intrinsics::from_fov(123, 77, 1.4);
        let [fx, fy, cx, cy] = lens.as_array();
        let mut rng = fastrand::Rng::with_seed(4);
        let still = [0, 1, 2].map(|axis| std::array::from_fn(|k| (k == axis) as u8 as f64));
        let (mut blocks, mut n_hidden, mut n_seen) = (Blocks::default(), 0, 0);
        for _ in 0..300 {
            blocks.clear(&lens);
            let mut number = |low: f64, high: f64| low + (high - low) * rng.f64();
            // Upright walls with a front towards the camera, some beside it.
            let walls: Vec<[[f64; 3]; 4]> = (0..6)
                .map(|i| {
                    let (x, z) = (number(-8.0, 6.0), number(-1.0, 9.0));
                    let (dx, dz) = (number(2.0, 14.0), number(-3.0, 3.0));
                    // Some nearly touch the camera, are endless, or are seen from the edge.
                    let (x, z) = [(x, z), (1e5 * x, z), (x, 0.1 + 1e-9 * z)][i % 3];
                    let (dx, dz) = [(dx, dz), (1e5 * dx, 1e-5 * dz), (dx, 1e6 * dz)][i / 2];
                    let (top, bottom) = (number(-9.0, -1.0), number(0.5, 4.0));
                    let corners = [
                        [x, bottom, z],
                        [x + dx, bottom, z + dz],
                        [x + dx, top, z + dz],
                        [x, top, z],
                    ];
                    // As meshes hold them.
                    corners.map(|corner| corner.map(|x: f64| f64::from(x as f32)))
                })
                .collect();
            for wall in &walls {
                let corners_m = wall.map(|corner| corner.map(|x| x as f32)).to_vec();
                blocks.draw(&Occluder { corners_m }, &still);
            }
            for _ in 0..20 {
                let (low, side) = (
                    [number(-9.0, 8.0), number(-4.0, 2.0), number(0.2, 14.0)],
                    [number(0.2, 3.0), number(0.2, 3.0), number(0.2, 3.0)],
                );
                let corners = std::array::from_fn(|i| {
                    [0, 1, 2].map(|axis| low[axis] + side[axis] * ((i >> axis) & 1) as f64)
                });
                if !blocks.hide(&corners) {
                    n_seen += 1;
                    continue;
                }
                n_hidden += 1;
                for y in 0..lens.height_px {
                    for x in 0..lens.width_px {
                        let ray = [(x as f64 + 0.5 - cx) / fx, (y as f64 + 0.5 - cy) / fy, 1.0];
                        let Some(box_m) = box_depth(ray, low, side) else {
                            continue;
                        };
                        let wall_m = walls.iter().filter_map(|wall| wall_depth(ray, wall));
                        assert!(
                            wall_m.fold(f64::INFINITY, f64::min) < box_m,
                            "{low:?} {side:?} is seen at {x}, {y}"
                        );
                    }
                }
            }
        }
        assert!(
            n_hidden > 300 && n_seen > 300,
            "{n_hidden} hidden, {n_seen} seen"
        );
    }

    /// Depth at which a ray enters a box.
    fn box_depth(ray: [f64; 3], low: [f64; 3], side: [f64; 3]) -> Option<f64> {
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let at = [low[axis] / ray[axis], (low[axis] + side[axis]) / ray[axis]];
            enter = enter.max(at[0].min(at[1]));
            leave = leave.min(at[0].max(at[1]));
        }
        (enter < leave).then_some(enter)
    }

    /// Depth at which a ray meets the front of an upright wall beyond the near plane.
    fn wall_depth(ray: [f64; 3], wall: &[[f64; 3]; 4]) -> Option<f64> {
        let (begin, end) = (wall[0], wall[1]);
        let (dx, dz) = (end[0] - begin[0], end[2] - begin[2]);
        // begin + share · (end − begin) = depth · ray, seen from above.
        let det = ray[0] * dz - ray[2] * dx;
        let depth = (begin[0] * dz - begin[2] * dx) / det;
        let share = (ray[2] * begin[0] - ray[0] * begin[2]) / det;
        let height = depth * ray[1];
        (det < 0.0
            && depth >= NEAR_M
            && (0.0..=1.0).contains(&share)
            && (wall[2][1]..=wall[0][1]).contains(&height))
        .then_some(depth)
    }
}
