//! What each modality keeps of a tile: every pixel is resolved by the functions that `sensor_shade`
//! has from `resolve.wgsl`.

use sensor_core::vector_lanes::{LaneWork, Lanes, WordLanes};
use sensor_shade::resolving::{self, Bound, Maps, Overrides, Pixel};

use super::plan::RasterDraw;
use super::tile_images::Band;
use super::tile_surfaces::SurfaceRows;
use super::tiles::{Tile, TileInput};
use crate::uniform::ViewData;

/// Resolving reads no image.
struct NoMaps;

impl<L: Lanes> Maps<L> for NoMaps {}

/// Resolves the pixels of a tile.
pub(super) struct Resolve<'r, 'b, 's> {
    pub view: &'r ViewData,
    pub input: &'r TileInput<'r>,
    pub tile: &'r Tile,
    /// Its first pixel in the image.
    pub origin_px: [usize; 2],
    pub out: &'r mut Band<'b>,
    /// Where surfaces go, and the tile's first column there.
    pub surfaces: Option<(&'r mut SurfaceRows<'s>, usize)>,
}

/// The draw call in which neighbouring pixels mostly lie: functions of shaders search all for it, pixel
/// by pixel.
#[derive(Clone, Copy, Default)]
struct Call {
    number: u32,
    /// Its triangles: the first, and the one behind the last.
    triangles: [u32; 2],
}

impl Call {
    /// That of a triangle.
    fn with(draws: &[RasterDraw], triangle: u32) -> Call {
        let behind = draws.partition_point(|draw| draw.first_triangle <= triangle);
        let number = behind.saturating_sub(1);
        draws.get(number).map_or(Call::default(), |draw| Call {
            number: number as u32,
            triangles: [draw.first_triangle, draw.first_triangle + draw.n_triangles],
        })
    }

    /// Whether the triangles that these pixels show are its own.
    #[inline(always)]
    fn has<L: Lanes>(self, numbers: L::Words, is_seen: L::Mask) -> bool {
        let [first, behind] = self.triangles;
        // Numbers before the first become large.
        let place = numbers.sub(<L::Words>::splat(first));
        let inside = place.lt_unsigned(<L::Words>::splat(behind - first));
        !L::any(L::and(is_seen, L::not(inside)))
    }
}

impl LaneWork for Resolve<'_, '_, '_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let [left, top] = self.origin_px;
        let width = self.out.width;
        let n_rows = n_rows(self.out);
        let ramp = L::load(&[0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5]);
        let rows = self.tile.number.iter().zip(self.tile.inverse_depth.iter());
        let mut view = *self.view;
        let mut call = Call::default();
        for (y, (numbers, inverses)) in (0..n_rows).zip(rows) {
            let eights = numbers.as_chunks::<8>().0.iter();
            let eights = eights.zip(inverses.as_chunks::<8>().0);
            for (x, (numbers, inverses)) in (left..width).step_by(8).zip(eights) {
                let at = [
                    L::splat(x as f32).add(ramp),
                    L::splat((top + y) as f32 + 0.5),
                ];
                let found = [<L::Words>::load(numbers), L::load(inverses).to_words()];
                let is_seen = L::splat(0.0).lt(L::load(inverses));
                if !call.has::<L>(found[0], is_seen) {
                    let lane = L::bits(is_seen).trailing_zeros() as usize;
                    call = Call::with(self.input.draws, numbers[lane]);
                }
                (view.first_draw, view.n_draws) = if call.has::<L>(found[0], is_seen) {
                    (call.number, 1)
                } else {
                    (0, self.input.draws.len() as u32)
                };
                let bound = Bound {
                    overrides: Overrides {},
                    views: bytemuck::cast_ref(&view),
                    instances: bytemuck::cast_slice(self.input.instances),
                    draws: bytemuck::cast_slice(self.input.draws),
                    vertices: bytemuck::cast_slice(self.input.vertices),
                    indices: self.input.indices,
                    maps: &NoMaps,
                };
                let pixel = resolving::pixel_at::<L, NoMaps>(&bound, L::mask(true), at, found);
                if let Some((rows, column)) = &mut self.surfaces {
                    put(rows, y * rows.stride + *column + (x - left), &pixel);
                }
                keep(self.out, y * width + x, (width - x).min(8), &pixel);
            }
        }
    }
}

/// Rows of pixels in a band.
fn n_rows(band: &Band<'_>) -> usize {
    let lengths = [
        band.color.len(),
        band.depth_m.len(),
        band.class_code.len(),
        band.instance.len(),
        band.flow_px.len(),
        band.normal.len(),
    ];
    lengths.iter().max().map_or(0, |n| n / band.width)
}

/// Writes eight surfaces from this place on.
#[inline(always)]
fn put<L: Lanes>(rows: &mut SurfaceRows<'_>, first: usize, pixel: &Pixel<L>) {
    let to = first..first + 8;
    rows.words[0][to.clone()].copy_from_slice(&pixel.surface[0].store());
    rows.words[1][to.clone()].copy_from_slice(&pixel.surface[1].store());
    rows.words[2][to.clone()].copy_from_slice(&pixel.surface[2].store());
    rows.words[3][to.clone()].copy_from_slice(&pixel.surface[3].store());
    rows.depth[to.clone()].copy_from_slice(&pixel.depth_m.to_words().store());
    rows.id[to].copy_from_slice(&pixel.instance.store());
}

/// Writes the first `n` of eight pixels from this place on.
#[inline(always)]
fn keep<L: Lanes>(out: &mut Band<'_>, first: usize, n: usize, pixel: &Pixel<L>) {
    let to = first..first + n;
    if !out.depth_m.is_empty() {
        out.depth_m[to.clone()].copy_from_slice(&pixel.depth_m.store()[..n]);
    }
    if !out.instance.is_empty() {
        out.instance[to.clone()].copy_from_slice(&pixel.instance.store()[..n]);
    }
    if !out.class_code.is_empty() {
        let classes = pixel.class_code.store().map(|code| code as u8);
        out.class_code[to.clone()].copy_from_slice(&classes[..n]);
    }
    if !out.flow_px.is_empty() {
        let [x, y] = [pixel.flow_px[0].store(), pixel.flow_px[1].store()];
        let flow: [[f32; 2]; 8] = std::array::from_fn(|i| [x[i], y[i]]);
        out.flow_px[to.clone()].copy_from_slice(&flow[..n]);
    }
    if !out.normal.is_empty() {
        let [x, y, z, _] = pixel.normal;
        let [x, y, z] = [x.store(), y.store(), z.store()];
        let normals: [[f32; 3]; 8] = std::array::from_fn(|i| [x[i], y[i], z[i]]);
        out.normal[to].copy_from_slice(&normals[..n]);
    }
}
