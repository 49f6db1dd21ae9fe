//! Small images of random texels: as textures, and as what lanes read, one by one.

use sensor_core::vector_lanes::{Lanes, WordLanes};
use sensor_gpu::Gpu;
use sensor_shade::shading::Maps;

/// Size of the view, and so of the images that have a texel per pixel.
pub const VIEW_PX: [u32; 2] = [64, 48];
/// Focal length of the view; its principal point is the middle.
pub const FOCAL_PX: f32 = 50.0;
/// Side of the images that are filtered.
const SIDE: u32 = 16;

/// What a texel outside of an image is.
#[derive(Clone, Copy, PartialEq)]
enum Outside {
    Repeated,
    Clamped,
}

pub struct Images {
    noise: Vec<[f32; 4]>,
    sky: Vec<[f32; 4]>,
    /// Depths as 16 bits.
    shadows: [Vec<u16>; 2],
    surfaces: Vec<[u32; 4]>,
    depths: Vec<f32>,
    instances: Vec<u32>,
}

fn texel_of<T: Copy>(texels: &[T], at: [i64; 2], outside: Outside) -> T {
    let side = SIDE as i64;
    let [x, y] = at.map(|i| match outside {
        Outside::Repeated => i.rem_euclid(side),
        Outside::Clamped => i.clamp(0, side - 1),
    });
    texels[(y * side + x) as usize]
}

/// The linear filter between the four texels around a place.
fn filtered<T: Copy, const N: usize>(
    texels: &[T],
    at: [f32; 2],
    outside: Outside,
    value: impl Fn(T) -> [f32; N],
) -> [f32; N] {
    let place = at.map(|at| at * SIDE as f32 - 0.5);
    // Lanes that do not run may ask for anything.
    let first = place.map(|at| if at.abs() < 1e9 { at.floor() as i64 } else { 0 });
    let share: [f32; 2] = std::array::from_fn(|i| place[i] - first[i] as f32);
    let of = |dx, dy| value(texel_of(texels, [first[0] + dx, first[1] + dy], outside));
    let (a, b, c, d) = (of(0, 0), of(1, 0), of(0, 1), of(1, 1));
    std::array::from_fn(|i| {
        let above = a[i] + (b[i] - a[i]) * share[0];
        let below = c[i] + (d[i] - c[i]) * share[0];
        above + (below - above) * share[1]
    })
}

/// A number that a 16-bit float holds exactly.
fn half_exact(rng: &mut fastrand::Rng) -> f32 {
    rng.u32(0..=1024) as f32 / 1024.0
}

impl Images {
    pub fn random(rng: &mut fastrand::Rng) -> Images {
        let n_pixels = (VIEW_PX[0] * VIEW_PX[1]) as usize;
        let n_texels = (SIDE * SIDE) as usize;
        let mut colors = || {
            (0..n_texels)
                .map(|_| std::array::from_fn(|_| half_exact(rng)))
                .collect::<Vec<[f32; 4]>>()
        };
        let (noise, sky) = (colors(), colors());
        // Far from the depths that functions compare, so that rounding decides nothing.
        let mut depths_of_map = || {
            (0..n_texels)
                .map(|_| [0, u16::MAX][rng.usize(0..2)])
                .collect()
        };
        let shadows = [depths_of_map(), depths_of_map()];
        let surface = |rng: &mut fastrand::Rng| {
            let [albedo, normal] = [rng.u32(..), rng.u32(..)];
            let look = albedo & 0xe0ff_ffff | rng.u32(0..17) << 24;
            let uv = [rng.f32() * 40.0, rng.f32() * 20.0].map(f32::to_bits);
            [normal, look, uv[0], uv[1]]
        };
        Images {
            noise,
            sky,
            shadows,
            surfaces: (0..n_pixels).map(|_| surface(rng)).collect(),
            // A rough wall, so that points have neighbours.
            depths: (0..n_pixels)
                .map(|i| 3.0 + 0.03 * (i % VIEW_PX[0] as usize) as f32 + 0.4 * rng.f32())
                .collect(),
            instances: (0..n_pixels).map(|_| rng.u32(..)).collect(),
        }
    }

    fn pixel<T: Copy>(texels: &[T], [x, y]: [u32; 2]) -> T {
        let [width, height] = VIEW_PX;
        texels[(y.min(height - 1) * width + x.min(width - 1)) as usize]
    }

    /// The texture of a global variable of the shader.
    pub fn texture(&self, gpu: &Gpu, name: &str) -> wgpu::Texture {
        use wgpu::TextureFormat as Format;
        let halves = |texels: &[[f32; 4]]| -> Vec<u8> {
            let numbers = texels.iter().flatten();
            numbers.flat_map(|x| half_bits(*x).to_le_bytes()).collect()
        };
        let (format, size, bytes) = match name {
            "noise_map" => (Format::Rgba16Float, [SIDE; 2], halves(&self.noise)),
            "sky_map" => (Format::Rgba16Float, [SIDE; 2], halves(&self.sky)),
            "shadow_map" | "far_shadow_map" => {
                let map = &self.shadows[usize::from(name == "far_shadow_map")];
                (
                    Format::Depth16Unorm,
                    [SIDE; 2],
                    bytemuck::cast_slice(map).to_vec(),
                )
            }
            "surface_map" => (
                Format::Rgba32Uint,
                VIEW_PX,
                bytemuck::cast_slice(&self.surfaces).to_vec(),
            ),
            "depth_map" => (
                Format::R32Float,
                VIEW_PX,
                bytemuck::cast_slice(&self.depths).to_vec(),
            ),
            "instance_map" => (
                Format::R32Uint,
                VIEW_PX,
                bytemuck::cast_slice(&self.instances).to_vec(),
            ),
            _ => panic!("there is no image {name}"),
        };
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let texture = gpu.texture(name, size, 1, format, usage);
        let n_rows = size[1];
        gpu.queue().write_texture(
            texture.as_image_copy(),
            &bytes,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(bytes.len() as u32 / n_rows),
                rows_per_image: None,
            },
            texture.size(),
        );
        texture
    }
}

/// Bits of a number from 0 to 1, of which a 16-bit float holds every multiple of 1 / 1024 exactly.
fn half_bits(x: f32) -> u16 {
    if x == 0.0 {
        return 0;
    }
    let bits = x.to_bits();
    let exponent = (bits >> 23) as i32 - 127 + 15;
    (exponent as u16) << 10 | (bits >> 13 & 0x3ff) as u16
}

/// A value for each lane from two numbers of each.
fn each<L: Lanes, const N: usize>(at: [L; 2], f: impl Fn([f32; 2], usize) -> [f32; N]) -> [L; N] {
    let [x, y] = at.map(L::store);
    let found: [[f32; N]; 8] = std::array::from_fn(|i| f([x[i], y[i]], i));
    std::array::from_fn(|k| L::load(&found.map(|value| value[k])))
}

/// The same from two words, with words.
fn each_pixel<L: Lanes, const N: usize>(
    at: [L::Words; 2],
    f: impl Fn([u32; 2]) -> [u32; N],
) -> [L::Words; N] {
    let [x, y] = at.map(WordLanes::store);
    let found: [[u32; N]; 8] = std::array::from_fn(|i| f([x[i], y[i]]));
    std::array::from_fn(|k| <L::Words>::load(&found.map(|value| value[k])))
}

impl Images {
    fn compared<L: Lanes>(&self, map: usize, at: [L; 2], depth: L) -> L {
        let depth = depth.store();
        let [passed] = each(at, |at, lane| {
            let depth = depth[lane].clamp(0.0, 1.0);
            filtered(&self.shadows[map], at, Outside::Clamped, |texel| {
                [(depth <= texel as f32 / 65535.0) as u32 as f32]
            })
        });
        passed
    }
}

impl<L: Lanes> Maps<L> for Images {
    fn noise_map_sampled(&self, at: [L; 2], _level: L) -> [L; 4] {
        each(at, |at, _| {
            filtered(&self.noise, at, Outside::Repeated, |t| t)
        })
    }

    fn sky_map_sampled(&self, at: [L; 2], _level: L) -> [L; 4] {
        each(at, |at, _| filtered(&self.sky, at, Outside::Clamped, |t| t))
    }

    fn shadow_map_compared(&self, at: [L; 2], depth: L) -> L {
        self.compared(0, at, depth)
    }

    fn far_shadow_map_compared(&self, at: [L; 2], depth: L) -> L {
        self.compared(1, at, depth)
    }

    fn surface_map_loaded(&self, at: [L::Words; 2]) -> [L::Words; 4] {
        each_pixel::<L, 4>(at, |at| Self::pixel(&self.surfaces, at))
    }

    fn depth_map_loaded(&self, at: [L::Words; 2]) -> [L; 4] {
        let depth = each_pixel::<L, 1>(at, |at| [Self::pixel(&self.depths, at).to_bits()]);
        let zero = L::splat(0.0);
        [depth[0].to_numbers(), zero, zero, L::splat(1.0)]
    }

    fn instance_map_loaded(&self, at: [L::Words; 2]) -> [L::Words; 4] {
        each_pixel::<L, 4>(at, |at| [Self::pixel(&self.instances, at), 0, 0, 1])
    }
}
