//! What each modality keeps of a view that is rasterised in tiles: every pixel is resolved by the
//! functions that `sensor_shade` has from `resolve.wgsl`. Colour is not among it.

use sensor_core::vector_lanes::{LaneWork, Lanes, WordLanes, in_lanes};
use sensor_shade::resolving::{self, Bound, Maps, Overrides, Pixel};

use super::plan::RasterView;
use super::tiles::{TILE_PX, Tile, TileInput, TileLists};
use crate::target::Target;
use crate::uniform::ViewData;

/// Images of a view, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExactImages {
    /// Width, height.
    pub size_px: [usize; 2],
    /// Depth along the optical axis; infinite where there is sky.
    pub depth_m: Vec<f32>,
    /// Numbers of classes.
    pub class_code: Vec<u8>,
    /// Numbers of objects; 0 where there is sky.
    pub instance: Vec<u32>,
    /// Where the pixel is minus where it was.
    pub flow_px: Vec<[f32; 2]>,
    /// Unit normals in the world; zero where there is sky.
    pub normal: Vec<[f32; 3]>,
}

/// Resolving reads no image.
struct NoMaps;

impl<L: Lanes> Maps<L> for NoMaps {}

impl ExactImages {
    /// Draws a view. Where its draw calls begin, and which targets are wanted, is not taken from
    /// `view`: all of `input` is drawn, and everything is made.
    ///
    /// # Panics
    /// If a draw call names vertices, indices or instances that are not there.
    pub fn draw(view: &ViewData, input: &TileInput<'_>) -> ExactImages {
        let size_px = view.size_px.map(|size| size as usize);
        let raster_view = RasterView {
            lens_px: view.lens_px,
            size_px: view.size_px.map(|size| size as u32),
            first_pixel: 0,
            near_m: view.near_m,
        };
        let view = ViewData {
            first_draw: 0,
            n_draws: input.draws.len() as u32,
            wanted: Target::Flow.bit().0 as u32,
            ..*view
        };
        let bound = Bound {
            overrides: Overrides {},
            views: bytemuck::cast_ref(&view),
            instances: bytemuck::cast_slice(input.instances),
            draws: bytemuck::cast_slice(input.draws),
            vertices: bytemuck::cast_slice(input.vertices),
            indices: input.indices,
            maps: &NoMaps,
        };
        let n_pixels = size_px[0] * size_px[1];
        let mut out = ExactImages {
            size_px,
            depth_m: vec![0.0; n_pixels],
            class_code: vec![0; n_pixels],
            instance: vec![0; n_pixels],
            flow_px: vec![[0.0; 2]; n_pixels],
            normal: vec![[0.0; 3]; n_pixels],
        };
        let mut lists = TileLists::default();
        lists.sort(&raster_view, input);
        let [across, down] = lists.n_tiles();
        let mut tile = Tile::default();
        for number in 0..across * down {
            lists.fill(number, &mut tile);
            in_lanes(Resolve {
                bound: &bound,
                tile: &tile,
                origin_px: [number % across, number / across].map(|at| at * TILE_PX),
                out: &mut out,
            });
        }
        out
    }
}

/// Resolves the pixels of a tile.
struct Resolve<'r> {
    bound: &'r Bound<'r, NoMaps>,
    tile: &'r Tile,
    origin_px: [usize; 2],
    out: &'r mut ExactImages,
}

impl LaneWork for Resolve<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let [left, top] = self.origin_px;
        let [width, height] = self.out.size_px;
        let ramp = L::load(&[0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5]);
        let rows = self.tile.number.iter().zip(self.tile.inverse_depth.iter());
        for (y, (numbers, inverses)) in (top..height).zip(rows) {
            let eights = numbers.as_chunks::<8>().0.iter();
            let eights = eights.zip(inverses.as_chunks::<8>().0);
            for (x, (numbers, inverses)) in (left..width).step_by(8).zip(eights) {
                let at = [L::splat(x as f32).add(ramp), L::splat(y as f32 + 0.5)];
                let found = [<L::Words>::load(numbers), L::load(inverses).to_words()];
                let pixel = resolving::pixel_at::<L, NoMaps>(self.bound, L::mask(true), at, found);
                let n = (width - x).min(8);
                keep(self.out, y * width + x, n, &pixel);
            }
        }
    }
}

/// Writes the first `n` of eight pixels from this place on.
#[inline(always)]
fn keep<L: Lanes>(out: &mut ExactImages, first: usize, n: usize, pixel: &Pixel<L>) {
    let to = first..first + n;
    out.depth_m[to.clone()].copy_from_slice(&pixel.depth_m.store()[..n]);
    out.instance[to.clone()].copy_from_slice(&pixel.instance.store()[..n]);
    let classes = pixel.class_code.store().map(|code| code as u8);
    out.class_code[to.clone()].copy_from_slice(&classes[..n]);
    let [x, y] = pixel.flow_px.map(L::store);
    let flow: [[f32; 2]; 8] = std::array::from_fn(|i| [x[i], y[i]]);
    out.flow_px[to.clone()].copy_from_slice(&flow[..n]);
    let [x, y, z, _] = pixel.normal.map(L::store);
    let normals: [[f32; 3]; 8] = std::array::from_fn(|i| [x[i], y[i], z[i]]);
    out.normal[to].copy_from_slice(&normals[..n]);
}
