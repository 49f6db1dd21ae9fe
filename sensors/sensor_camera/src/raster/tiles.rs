//! Rasterises on processors by the rules of `raster.wgsl`: corners in 256ths of a pixel, edges in
//! integers, the top-left rule, and in each pixel the greatest of (1 / depth, number).
//!
//! [`TileLists::sort`] puts the triangles of a view into tiles of 64 × 64 pixels, [`TileLists::fill`]
//! finds what each pixel of a tile shows, eight pixels at a time. Tiles share nothing, so threads
//! can fill them in any order, and all processors give the same bits.

use sensor_core::Vertex;
use sensor_core::vector_lanes::{LaneWork, Lanes, WordLanes, in_arrays, in_lanes};

use super::plan::{RasterDraw, RasterView};
use crate::uniform::InstanceData;

/// Side of a tile.
pub const TILE_PX: usize = 64;
/// Triangles are clipped to this distance from the image, as in `raster.wgsl`.
const GUARD_PX: f32 = 524_288.0;
/// Corners lie within this many 256ths of a pixel; clipped ones do anyway, with room to spare.
const MOST_SNAPPED: i32 = 1 << 29;
/// Edges this long, in 256ths of a pixel, overflow 32 bits within a tile.
const LONG_EDGE: i64 = 1 << 22;

/// Meshes of an episode, and the draw calls of a view, whose triangles are numbered in order.
#[derive(Clone, Copy)]
pub struct TileInput<'i> {
    /// Corners of all meshes.
    pub vertices: &'i [Vertex],
    /// Triangles of all meshes.
    pub indices: &'i [u32],
    /// What the draw calls show.
    pub instances: &'i [InstanceData],
    /// The draw calls, by rising number of their first triangle.
    pub draws: &'i [RasterDraw],
}

/// A number on a triangle's plane, 1 / depth or a map's height: a position, the value there, its
/// change per pixel, its bounds.
#[derive(Clone, Copy, Debug)]
struct Slope {
    at_px: [f32; 2],
    value: f32,
    change: [f32; 2],
    least: f32,
    most: f32,
}

#[derive(Clone, Copy, Debug)]
struct Triangle {
    number: u32,
    /// First corner in the list, and their number: three, or more if it was clipped.
    corners: [u32; 2],
    slope: Slope,
}

/// The triangles of a view in tiles.
#[derive(Clone, Debug, Default)]
pub struct TileLists {
    size_px: [usize; 2],
    triangles: Vec<Triangle>,
    /// 256ths of a pixel.
    corners: Vec<[i32; 2]>,
    /// Triangles of each tile, by rising number, row by row.
    tiles: Vec<Vec<u32>>,
}

/// What the pixels of a tile show.
#[derive(Clone, Debug)]
pub struct Tile {
    /// 1 / depth, or 0 where there is sky.
    pub inverse_depth: Box<[[f32; TILE_PX]; TILE_PX]>,
    /// Number of the triangle.
    pub number: Box<[[u32; TILE_PX]; TILE_PX]>,
}

impl Default for Tile {
    fn default() -> Self {
        Tile {
            inverse_depth: Box::new([[0.0; TILE_PX]; TILE_PX]),
            number: Box::new([[0; TILE_PX]; TILE_PX]),
        }
    }
}

type Point = [f32; 3];

fn cross(a: Point, b: Point) -> Point {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn difference(a: Point, b: Point) -> Point {
    std::array::from_fn(|i| a[i] - b[i])
}

fn transformed(m: &[[f32; 4]; 3], p: Point) -> Point {
    m.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3])
}

fn snapped(view: &RasterView, p: Point) -> [i32; 2] {
    std::array::from_fn(|axis| {
        snapped_axis(p[axis] / p[2] * view.lens_px[axis] + view.lens_px[axis + 2])
    })
}

fn snapped_axis(px: f32) -> i32 {
    let whole = (px * 256.0 + 0.5).floor() as i32;
    whole.clamp(-MOST_SNAPPED, MOST_SNAPPED)
}

/// Twice the area of a polygon; negative if it is counter-clockwise, as y runs down.
fn twice_area(corners: &[[i32; 2]]) -> i64 {
    let [x, y] = corners[0].map(i64::from);
    let away = |corner: &[i32; 2]| [corner[0] as i64 - x, corner[1] as i64 - y];
    let pairs = corners.windows(2).map(|two| [away(&two[0]), away(&two[1])]);
    pairs.map(|[a, b]| a[0] * b[1] - a[1] * b[0]).sum()
}

fn snapped_px(place_px: [f32; 2]) -> [i32; 2] {
    place_px.map(snapped_axis)
}

fn slope_of(view: &RasterView, [a, b, c]: [Point; 3]) -> Slope {
    // From the farthest corner, where 1 / depth and its error are smallest.
    let mut far = a;
    for corner in [b, c] {
        if corner[2] > far[2] {
            far = corner;
        }
    }
    let normal = cross(difference(b, a), difference(c, a));
    let ray = [far[0] / far[2], far[1] / far[2]];
    let facing = normal[0] * ray[0] + normal[1] * ray[1] + normal[2];
    let value = 1.0 / far[2];
    let change = |axis: usize| {
        let change = normal[axis] * value / (view.lens_px[axis] * facing);
        if facing.abs() > 1e-30 && change.is_finite() {
            change
        } else {
            0.0
        }
    };
    Slope {
        at_px: [0, 1].map(|axis| ray[axis] * view.lens_px[axis] + view.lens_px[axis + 2]),
        value,
        change: [change(0), change(1)],
        least: value,
        most: 1.0 / a[2].min(b[2]).min(c[2]).max(view.near_m),
    }
}

/// The same of heights from 0 to 1 over a map: corners have their places in pixels, and a height.
fn slope_of_heights([a, b, c]: [Point; 3]) -> Slope {
    let mut low = a;
    for corner in [b, c] {
        if corner[2] < low[2] {
            low = corner;
        }
    }
    let normal = cross(difference(b, a), difference(c, a));
    let change = |axis: usize| {
        let change = -normal[axis] / normal[2];
        if change.is_finite() { change } else { 0.0 }
    };
    Slope {
        at_px: [low[0], low[1]],
        value: low[2],
        change: [change(0), change(1)],
        least: low[2].max(0.0),
        most: a[2].max(b[2]).max(c[2]).min(1.0),
    }
}

/// Signed distance to one of the five clipping planes.
fn inside_of(view: &RasterView, plane: usize, p: Point) -> f32 {
    let reach = |axis: usize| GUARD_PX / view.lens_px[axis] * p[2];
    match plane {
        0 => p[2] - view.near_m,
        1 => reach(0) - p[0],
        2 => reach(0) + p[0],
        3 => reach(1) - p[1],
        _ => reach(1) + p[1],
    }
}

/// Clips plane by plane (Sutherland and Hodgman, 1974). An edge is always cut from its inner end on,
/// so that two triangles with a common edge get the same point.
fn clipped(view: &RasterView, corners: [Point; 3]) -> (Polygon, usize) {
    let (mut polygon, mut n) = begun(corners);
    for plane in 0..5 {
        let inside = |p| inside_of(view, plane, p);
        (polygon, n) = cut(&polygon[..n], inside, |mut point| {
            if plane == 0 {
                point[2] = view.near_m;
            }
            point
        });
    }
    (polygon, n)
}

/// The same for a map: to heights from 0 to 1, and to places near the map.
fn clipped_to_map(corners: [Point; 3]) -> (Polygon, usize) {
    let (mut polygon, mut n) = begun(corners);
    for plane in 0..6 {
        let inside = |p: Point| match plane {
            0 => p[2],
            1 => 1.0 - p[2],
            2 => GUARD_PX - p[0],
            3 => GUARD_PX + p[0],
            4 => GUARD_PX - p[1],
            _ => GUARD_PX + p[1],
        };
        (polygon, n) = cut(&polygon[..n], inside, |point| point);
    }
    (polygon, n)
}

/// Each of at most six planes adds a corner to the three.
type Polygon = [Point; 9];

fn begun(corners: [Point; 3]) -> (Polygon, usize) {
    let mut polygon = [[0.0; 3]; 9];
    polygon[..3].copy_from_slice(&corners);
    (polygon, 3)
}

/// Clips by one plane, which `placed` puts new corners on.
fn cut(
    begin: &[Point],
    inside_of: impl Fn(Point) -> f32,
    placed: impl Fn(Point) -> Point,
) -> (Polygon, usize) {
    let n = begin.len();
    let mut kept = [[0.0; 3]; 9];
    let mut n_kept = 0;
    let mut keep = |p: Point| {
        if n_kept < kept.len() {
            kept[n_kept] = p;
            n_kept += 1;
        }
    };
    for i in 0..n {
        let (here, next) = (begin[i], begin[(i + 1) % n]);
        let (inside, next_inside) = (inside_of(here), inside_of(next));
        if inside >= 0.0 {
            keep(here);
        }
        if (inside >= 0.0) != (next_inside >= 0.0) {
            let cut = |from: Point, to: Point, inside: f32, outside: f32| -> Point {
                let share = inside / (inside - outside);
                std::array::from_fn(|i| from[i] + (to[i] - from[i]) * share)
            };
            keep(placed(if inside >= 0.0 {
                cut(here, next, inside, next_inside)
            } else {
                cut(next, here, next_inside, inside)
            }));
        }
    }
    (kept, n_kept)
}

impl TileLists {
    /// Sorts the triangles of a view into tiles. Triangles with a corner that is not finite are left
    /// out.
    ///
    /// # Panics
    /// If a draw call names vertices, indices or instances that are not there.
    pub fn sort(&mut self, view: &RasterView, input: &TileInput<'_>) {
        self.begin(view.size_px.map(|size| size as usize));
        for draw in input.draws {
            let rows = &input.instances[draw.instance as usize].camera_from_mesh;
            let first = draw.first_idx as usize;
            let indices = &input.indices[first..first + 3 * draw.n_triangles as usize];
            let vertices = &input.vertices[draw.base_vertex as usize..];
            for (number, triangle) in (draw.first_triangle..).zip(indices.as_chunks::<3>().0) {
                let corners = triangle.map(|i| transformed(rows, vertices[i as usize].position_m));
                self.add(view, number, corners);
            }
        }
    }

    /// Begins without triangles.
    pub(crate) fn begin(&mut self, size_px: [usize; 2]) {
        self.size_px = size_px;
        self.triangles.clear();
        self.corners.clear();
        let [across, down] = self.n_tiles();
        self.tiles.resize_with(across * down, Vec::new);
        self.tiles.iter_mut().for_each(Vec::clear);
    }

    /// Adds a triangle of a map, both of whose sides are seen: of each corner the place in pixels,
    /// and its height from 0 to 1. The highest is what tiles show, as they do of 1 / depth; what
    /// lies below or above is cut off. A corner that is not finite leaves it out.
    pub(crate) fn add_to_map(&mut self, points: [Point; 3]) {
        if !points.iter().flatten().all(|x| x.is_finite()) {
            return;
        }
        let is_beside = |axis: usize| {
            let all = points.map(|p| p[axis]);
            let size = self.size_px[axis] as f32;
            all.iter().all(|at| *at < 0.0) || all.iter().all(|at| *at > size)
        };
        if is_beside(0) || is_beside(1) {
            return;
        }
        let is_within = |p: &Point| {
            (0.0..=1.0).contains(&p[2]) && p[0].abs() <= GUARD_PX && p[1].abs() <= GUARD_PX
        };
        let (polygon, n) = if points.iter().all(is_within) {
            begun(points)
        } else {
            clipped_to_map(points)
        };
        if n < 3 {
            return;
        }
        let first = self.corners.len();
        self.corners
            .extend(polygon[..n].iter().map(|p| snapped_px([p[0], p[1]])));
        // Front faces are counter-clockwise.
        match twice_area(&self.corners[first..]) {
            0 => return self.corners.truncate(first),
            area if area > 0 => self.corners[first..].reverse(),
            _ => {}
        }
        self.put(first, 0, slope_of_heights(points));
    }

    fn add(&mut self, view: &RasterView, number: u32, points: [Point; 3]) {
        let [a, b, c] = points;
        let are_finite = points.iter().flatten().all(|x| x.is_finite());
        if !are_finite || a[2].max(b[2]).max(c[2]) < view.near_m {
            return;
        }
        // The triangle lies completely beside the image.
        let is_beside = |axis: usize| {
            let (scale, shift) = (view.lens_px[axis], view.lens_px[axis + 2]);
            let size = view.size_px[axis] as f32;
            let from = points.map(|p| p[axis] * scale + shift * p[2]);
            let to = points.map(|p| p[axis] * scale + (shift - size) * p[2]);
            from.into_iter().fold(f32::NEG_INFINITY, f32::max) < 0.0
                || to.into_iter().fold(f32::INFINITY, f32::min) > 0.0
        };
        if is_beside(0) || is_beside(1) {
            return;
        }
        let reach = |axis: usize| GUARD_PX / view.lens_px[axis];
        let is_outside = |p: &Point| p[0].abs() > reach(0) * p[2] || p[1].abs() > reach(1) * p[2];
        let first = self.corners.len();
        if a[2].min(b[2]).min(c[2]) < view.near_m || points.iter().any(is_outside) {
            // The visible face has its normal towards the eye.
            let normal = cross(difference(b, a), difference(c, a));
            // Not a number where numbers are too large; then nothing is seen either.
            let facing = normal[0] * a[0] + normal[1] * a[1] + normal[2] * a[2];
            if facing.is_nan() || facing >= 0.0 {
                return;
            }
            let (polygon, n) = clipped(view, points);
            if n < 3 {
                return;
            }
            self.corners
                .extend(polygon[..n].iter().map(|p| snapped(view, *p)));
        } else {
            let corners = points.map(|p| snapped(view, p));
            let side = |k: usize, axis: usize| (corners[k][axis] - corners[0][axis]) as i64;
            // Front faces are counter-clockwise.
            if side(1, 0) * side(2, 1) - side(1, 1) * side(2, 0) >= 0 {
                return;
            }
            self.corners.extend(corners);
        }
        self.put(first, number, slope_of(view, points));
    }

    /// Puts the triangle whose corners begin at `first` into its tiles.
    fn put(&mut self, first: usize, number: u32, slope: Slope) {
        // Pixels of the image whose centres can lie in it.
        let corners = &self.corners[first..];
        let range = |axis: usize| {
            let of = corners.iter().map(|corner| corner[axis]);
            let (least, most) = (of.clone().min(), of.max());
            let low = (least.unwrap_or(0) + 127) >> 8;
            let high = (most.unwrap_or(0) - 128) >> 8;
            (low.max(0), high.min(self.size_px[axis] as i32 - 1))
        };
        let ((left, right), (top, bottom)) = (range(0), range(1));
        if left > right || top > bottom {
            self.corners.truncate(first);
            return;
        }
        let place = self.triangles.len() as u32;
        self.triangles.push(Triangle {
            number,
            corners: [first as u32, (self.corners.len() - first) as u32],
            slope,
        });
        let across = self.n_tiles()[0];
        let tiles = |low: i32, high: i32| low as usize / TILE_PX..=high as usize / TILE_PX;
        for row in tiles(top, bottom) {
            for column in tiles(left, right) {
                self.tiles[row * across + column].push(place);
            }
        }
    }

    /// Tiles across and down; their numbers go row by row.
    pub fn n_tiles(&self) -> [usize; 2] {
        self.size_px.map(|size| size.div_ceil(TILE_PX))
    }

    /// Whether no triangle reaches into a tile.
    pub(crate) fn is_empty(&self, tile_idx: usize) -> bool {
        self.tiles[tile_idx].is_empty()
    }

    /// Finds what the pixels of a tile show, with the widest vectors that there are. Pixels of the
    /// tile outside of the image may show anything.
    ///
    /// # Panics
    /// If there is no tile of this number.
    pub fn fill(&self, tile_idx: usize, out: &mut Tile) {
        in_lanes(Fill {
            lists: self,
            tile_idx,
            out,
        });
    }

    /// The same with plain arrays: the reference in tests.
    pub fn fill_in_arrays(&self, tile_idx: usize, out: &mut Tile) {
        in_arrays(Fill {
            lists: self,
            tile_idx,
            out,
        });
    }
}

/// An edge function relative to a tile: at the centre of its first pixel, and its steps to the right
/// and down, over 256. Whole pixels change it by multiples of 256, so that rounding down keeps its
/// sign at all of them.
#[derive(Clone, Copy)]
struct Edge {
    begin: i64,
    right: i64,
    down: i64,
}

impl Edge {
    fn of(from: [i32; 2], to: [i32; 2], origin_px: [i32; 2]) -> Edge {
        let [dx, dy] = [0, 1].map(|axis| to[axis] as i64 - from[axis] as i64);
        let away = |axis: usize| (origin_px[axis] * 256 + 128) as i64 - from[axis] as i64;
        // Points on this edge belong to the triangle on its right.
        let rim = if dy < 0 || (dy == 0 && dx > 0) { 0 } else { -1 };
        Edge {
            begin: (dx * away(1) - dy * away(0) + rim) >> 8,
            right: -dy,
            down: dx,
        }
    }
}

struct Fill<'f> {
    lists: &'f TileLists,
    tile_idx: usize,
    out: &'f mut Tile,
}

impl LaneWork for Fill<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let lists = self.lists;
        let across = lists.n_tiles()[0];
        let origin_px = [self.tile_idx % across, self.tile_idx / across]
            .map(|number| (number * TILE_PX) as i32);
        let last_px: [i32; 2] = std::array::from_fn(|axis| {
            let rest = lists.size_px[axis] as i32 - origin_px[axis];
            rest.min(TILE_PX as i32) - 1
        });
        self.out.inverse_depth.as_flattened_mut().fill(0.0);
        self.out.number.as_flattened_mut().fill(0);
        for place in &lists.tiles[self.tile_idx] {
            let triangle = &lists.triangles[*place as usize];
            let [first, n] = triangle.corners.map(|x| x as usize);
            let corners = &lists.corners[first..first + n];
            let within = |axis: usize| {
                let of = corners.iter().map(|corner| corner[axis]);
                let (least, most) = (of.clone().min(), of.max());
                let low = ((least.unwrap_or(0) + 127) >> 8) - origin_px[axis];
                let high = ((most.unwrap_or(0) - 128) >> 8) - origin_px[axis];
                (low.max(0), high.min(last_px[axis]))
            };
            let (columns, rows) = (within(0), within(1));
            if columns.0 > columns.1 || rows.0 > rows.1 {
                continue;
            }
            let edge = |from: usize, to: usize| Edge::of(corners[from], corners[to], origin_px);
            if let [_, _, _] = corners {
                let edges = [edge(0, 2), edge(2, 1), edge(1, 0)];
                let longest = edges.iter().map(|e| e.right.abs().max(e.down.abs())).max();
                if longest.unwrap_or(0) < LONG_EDGE {
                    by_edges::<L>(triangle, edges, origin_px, columns, rows, self.out);
                    continue;
                }
            }
            let edges = (0..n).map(|k| edge((k + 1) % n, k));
            by_rows::<L>(triangle, edges, origin_px, columns, rows, self.out);
        }
    }
}

/// What the lanes of a triangle share.
struct Shown<L: Lanes> {
    at_x_px: L,
    at_y_px: L,
    value: L,
    change_x: L,
    change_y: L,
    least: L,
    most: L,
    number: L::Words,
}

impl<L: Lanes> Shown<L> {
    #[inline(always)]
    fn new(triangle: &Triangle) -> Self {
        let slope = &triangle.slope;
        Shown {
            at_x_px: L::splat(slope.at_px[0]),
            at_y_px: L::splat(slope.at_px[1]),
            value: L::splat(slope.value),
            change_x: L::splat(slope.change[0]),
            change_y: L::splat(slope.change[1]),
            least: L::splat(slope.least),
            most: L::splat(slope.most),
            number: <L::Words>::splat(triangle.number),
        }
    }

    /// Change of 1 / depth from the slope's place to this row of pixels.
    #[inline(always)]
    fn along_y(&self, y_px: i32) -> L {
        let middle = L::splat(y_px as f32).add(L::splat(0.5));
        self.change_y.mul(middle.sub(self.at_y_px))
    }

    /// Shows it at eight pixels of a row, from this column of the tile on, in the lanes that lie
    /// inside.
    #[inline(always)]
    fn show(&self, out: &mut Tile, [x, y]: [i32; 2], x_px: i32, along_y: L, inside: L::Mask) {
        let inverses = eight_of(&mut out.inverse_depth[y as usize], x);
        let numbers = eight_of(&mut out.number[y as usize], x);
        let ramp = L::load(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let middle = L::splat(x_px as f32).add(ramp).add(L::splat(0.5));
        let along_x = self.change_x.mul(middle.sub(self.at_x_px));
        let here = self.value.add(along_x.add(along_y));
        let here = here.max(self.least).min(self.most);
        let before = L::load(inverses);
        // Numbers rise, so that the greater one wins where depths are the same.
        let is_seen = L::and(inside, before.le(here));
        *inverses = L::select(is_seen, here, before).store();
        let before = <L::Words>::load(numbers);
        *numbers = <L::Words>::select(is_seen, self.number, before).store();
    }
}

/// Fills a triangle whose edges are short enough for 32 bits.
#[inline(always)]
fn by_edges<L: Lanes>(
    triangle: &Triangle,
    edges: [Edge; 3],
    origin_px: [i32; 2],
    (left, right): (i32, i32),
    (top, bottom): (i32, i32),
    out: &mut Tile,
) {
    let shown = Shown::<L>::new(triangle);
    let word = |x: i32| <L::Words>::splat(x as u32);
    let ramp = <L::Words>::load(&[0, 1, 2, 3, 4, 5, 6, 7]);
    let zero = word(0);
    let first = left & !7;
    // Far values keep their sign over a tile, which changes them by less than 2³⁰.
    let begin = edges.map(|e| e.begin.clamp(-(1 << 30) - 1, 1 << 30) as i32);
    let steps = edges.map(|e| word(e.right as i32));
    let lanes = steps.map(|step| step.mul(ramp.add(word(first))));
    for y in top..=bottom {
        let along_y = shown.along_y(origin_px[1] + y);
        let row_of = |k: usize| lanes[k].add(word(begin[k] + edges[k].down as i32 * y));
        let mut at = [row_of(0), row_of(1), row_of(2)];
        for x in (first..=right).step_by(8) {
            let outside = at[0].or(at[1]).or(at[2]).lt_signed(zero);
            if L::bits(outside) != 255 {
                shown.show(out, [x, y], origin_px[0] + x, along_y, L::not(outside));
            }
            for k in 0..3 {
                at[k] = at[k].add(steps[k].shl(word(3)));
            }
        }
    }
}

/// The eight values of a row from this column on.
#[inline(always)]
fn eight_of<T>(row: &mut [T; TILE_PX], x: i32) -> &mut [T; 8] {
    let rest = &mut row[x as usize..];
    rest.first_chunk_mut()
        .expect("columns are multiples of 8 below the side of a tile")
}

/// Fills any convex polygon: from each row's first pixel between all edges to its last, in 64 bits.
#[inline(always)]
fn by_rows<L: Lanes>(
    triangle: &Triangle,
    edges: impl Iterator<Item = Edge> + Clone,
    origin_px: [i32; 2],
    (left, right): (i32, i32),
    (top, bottom): (i32, i32),
    out: &mut Tile,
) {
    let shown = Shown::<L>::new(triangle);
    let ramp = <L::Words>::load(&[0, 1, 2, 3, 4, 5, 6, 7]);
    for y in top..=bottom {
        let (mut first, mut last) = (left as i64, right as i64);
        for edge in edges.clone() {
            let begin = edge.begin + edge.down * y as i64;
            match edge.right {
                0 if begin < 0 => last = -1,
                0 => {}
                right if right > 0 => first = first.max(-begin.div_euclid(right)),
                right => last = last.min(begin.div_euclid(-right)),
            }
        }
        if first > last {
            continue;
        }
        let along_y = shown.along_y(origin_px[1] + y);
        let [low, high] = [first, last].map(|x| <L::Words>::splat(x as u32));
        for x in ((first as i32 & !7)..=last as i32).step_by(8) {
            let column = <L::Words>::splat(x as u32).add(ramp);
            let outside = L::or(column.lt_signed(low), high.lt_signed(column));
            shown.show(out, [x, y], origin_px[0] + x, along_y, L::not(outside));
        }
    }
}
