//! Colour of a tile: every pixel is lit by the functions that `sensor_shade` has from `shade.wgsl`.

use sensor_core::vector_lanes::{LaneWork, Lanes, WordLanes};
use sensor_shade::images::{ByteImage, DepthImage, NumberImage};
use sensor_shade::memory::{numbers_at, words_at};
use sensor_shade::shading::{self, Bound, Maps, Overrides};

use super::tile_surfaces::{SurfaceBand, Surfaces};
use super::tiles::TILE_PX;
use crate::uniform::{LampData, LightData, ViewData};

/// The light that a view is seen in, as its shaders get it.
#[derive(Clone, Copy)]
pub(crate) struct TileLight<'l> {
    pub light: &'l LightData,
    pub overrides: Overrides,
    pub lamps: &'l [LampData],
    pub lamp_tiles: &'l [[u32; 2]],
    pub switched: &'l [[u32; 2]],
    pub noise: &'l ByteImage,
    pub sky: &'l NumberImage,
    pub shadows: &'l DepthImage,
}

impl TileLight<'_> {
    /// Whether pixels show others in reflections, which must be there before.
    pub fn mirrors_pixels(&self) -> bool {
        self.overrides.with_wet
    }
}

/// Images for eight pixels.
struct Eight<'e, L: Lanes> {
    light: &'e TileLight<'e>,
    /// Their own surfaces and ids.
    surface: [L::Words; 4],
    id: L::Words,
    /// Everybody's, if pixels show others.
    whole: Option<&'e Surfaces>,
}

impl<L: Lanes> Eight<'_, L> {
    /// Where the surfaces of these pixels lie.
    #[inline(always)]
    fn places(surfaces: &Surfaces, at: [L::Words; 2]) -> L::Words {
        let stride = <L::Words>::splat(surfaces.stride as u32);
        at[1].mul(stride).add(at[0])
    }
}

impl<L: Lanes> Maps<L> for Eight<'_, L> {
    #[inline(always)]
    fn depth_map_loaded(&self, at: [L::Words; 2]) -> [L; 4] {
        let Some(whole) = self.whole else {
            return [L::splat(0.0); 4];
        };
        [numbers_at::<L>(&whole.depth, Self::places(whole, at), 0); 4]
    }

    #[inline(always)]
    fn surface_map_loaded(&self, at: [L::Words; 2]) -> [L::Words; 4] {
        let Some(whole) = self.whole else {
            return self.surface;
        };
        let places = Self::places(whole, at);
        [
            words_at::<L>(&whole.words[0], places, 0),
            words_at::<L>(&whole.words[1], places, 0),
            words_at::<L>(&whole.words[2], places, 0),
            words_at::<L>(&whole.words[3], places, 0),
        ]
    }

    #[inline(always)]
    fn instance_map_loaded(&self, at: [L::Words; 2]) -> [L::Words; 4] {
        let Some(whole) = self.whole else {
            return [self.id; 4];
        };
        [words_at::<L>(&whole.id, Self::places(whole, at), 0); 4]
    }

    #[inline(always)]
    fn noise_map_sampled(&self, at: [L; 2], level: L) -> [L; 4] {
        self.light.noise.sampled(at, level)
    }

    #[inline(always)]
    fn sky_map_sampled(&self, at: [L; 2], level: L) -> [L; 4] {
        self.light.sky.sampled(at, level)
    }

    #[inline(always)]
    fn shadow_map_compared(&self, at: [L; 2], depth: L) -> L {
        self.light.shadows.compared(at, depth)
    }

    /// Low quality has no second map.
    #[inline(always)]
    fn far_shadow_map_compared(&self, _at: [L; 2], _depth: L) -> L {
        L::splat(1.0)
    }
}

/// Lights the pixels of a tile.
pub(super) struct Shade<'s> {
    pub light: &'s TileLight<'s>,
    pub view: &'s ViewData,
    /// The rows of its surfaces, and its first column there.
    pub own: &'s SurfaceBand<'s>,
    pub column: usize,
    pub whole: Option<&'s Surfaces>,
    /// Its first pixel in the image.
    pub origin_px: [usize; 2],
    /// Rows of the image, and their width.
    pub color: &'s mut [u32],
    pub width: usize,
}

/// Beyond this there is only sky, metres: `FAR_M` of `shade.wgsl`.
const FAR_M: f32 = 1e9;

/// The eight words of a list from this place on.
#[inline(always)]
fn eight<L: Lanes>(list: &[u32], first: usize) -> L::Words {
    let words = list[first..].first_chunk();
    <L::Words>::load(words.expect("rows are multiples of 8 pixels"))
}

impl LaneWork for Shade<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let [left, top] = self.origin_px;
        let ramp = <L::Words>::load(&[0, 1, 2, 3, 4, 5, 6, 7]);
        let right = self.width.min(left + TILE_PX);
        let half = L::splat(0.5);
        for (y, row) in self.color.chunks_exact_mut(self.width).enumerate() {
            for x in (left..right).step_by(8) {
                let first = y * self.own.stride + self.column + (x - left);
                let maps = Eight::<L> {
                    light: self.light,
                    surface: [
                        eight::<L>(self.own.words[0], first),
                        eight::<L>(self.own.words[1], first),
                        eight::<L>(self.own.words[2], first),
                        eight::<L>(self.own.words[3], first),
                    ],
                    id: eight::<L>(self.own.id, first),
                    whole: self.whole,
                };
                let bound = Bound {
                    overrides: self.light.overrides,
                    views: bytemuck::cast_ref(self.view),
                    light: bytemuck::cast_ref(self.light.light),
                    switched: self.light.switched.as_flattened(),
                    lamps: bytemuck::cast_slice(self.light.lamps),
                    lamp_tiles: self.light.lamp_tiles.as_flattened(),
                    maps: &maps,
                };
                let at = [
                    <L::Words>::splat(x as u32).add(ramp),
                    <L::Words>::splat((top + y) as u32),
                ];
                let middle = [
                    at[0].from_unsigned().add(half),
                    at[1].from_unsigned().add(half),
                ];
                let ray = shading::ray_in_camera::<L, _>(&bound, middle);
                let depth_m = eight::<L>(self.own.depth, first).to_numbers();
                let near = depth_m.lt(L::splat(FAR_M));
                let far = L::not(near);
                let mut radiance = [L::splat(0.0); 3];
                if L::any(near) {
                    radiance = shading::surface_radiance::<L, _>(&bound, near, at, depth_m, ray);
                }
                if L::any(far) {
                    let sky = shading::sky_at::<L, _>(&bound, far, ray);
                    radiance = [
                        L::select(far, sky[0], radiance[0]),
                        L::select(far, sky[1], radiance[1]),
                        L::select(far, sky[2], radiance[2]),
                    ];
                }
                let color = shading::packed_color::<L>(radiance).store();
                let n = (right - x).min(8);
                row[x..x + n].copy_from_slice(&color[..n]);
            }
        }
    }
}
