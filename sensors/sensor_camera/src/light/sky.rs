//! The sky: Hosek-Wilkie radiance with clouds, painted into an octahedral map of the upper
//! hemisphere.
//!
//! Made on the CPU when the weather changes, because a software rasteriser samples a texture far
//! faster than it evaluates the model. Values are luminous (kilolux per steradian) until
//! [`SkyMap::scaled`].

#[cfg(test)]
mod published;

use std::f32::consts::PI;

use hw_skymodel::rgb::{Channel, SkyParams, SkyState};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Octahedral map, row-major, `side_px` squared.
#[derive(Clone, Debug)]
pub(crate) struct SkyMap {
    pub side_px: usize,
    pub rgb: Vec<[f32; 3]>,
}

/// What the sky depends on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SkyLook {
    pub sun_towards: Vector3<f32>,
    /// 0 clear to 1 overcast.
    pub clouds_ratio: f32,
    /// Horizontal illuminance from the clear sky, kilolux.
    pub clear_klx: f32,
    /// Illuminance on a surface facing the unclouded sun, R G B, kilolux.
    pub sun_klx: [f32; 3],
    /// Colour and strength of the glow that remains at night, kilolux.
    pub night_klx: [f32; 3],
    /// Air molecules and haze relative to an ordinary clear day.
    pub rayleigh_ratio: f32,
    pub mie_ratio: f32,
}

/// Direction of a map position in 0..=1: inverse of `sky_sample` in `sky.wgsl`.
pub(crate) fn direction_of(u: f32, v: f32) -> Vector3<f32> {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let (x, y) = (0.5 * (a + b), 0.5 * (a - b));
    Vector3::new(x, y, (1.0 - x.abs() - y.abs()).max(0.0)).normalize()
}

/// Luminance of linear sRGB.
pub(crate) fn luminance(rgb: [f32; 3]) -> f32 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

impl SkyMap {
    /// Paints the sky.
    pub fn paint(look: &SkyLook, side_px: usize) -> SkyMap {
        let clear = ClearSky::new(look);
        let row = |y: usize| {
            let clear = &clear;
            (0..side_px).map(move |x| {
                let at = |i: usize| (i as f32 + 0.5) / side_px as f32;
                radiance(look, clear, direction_of(at(x), at(y)))
            })
        };
        let rgb: Vec<Vec<[f32; 3]>> = (0..side_px)
            .into_par_iter()
            .map(|y| row(y).collect())
            .collect();
        SkyMap {
            side_px,
            rgb: rgb.concat(),
        }
    }

    /// The same times a factor.
    pub fn scaled(mut self, factor: f32) -> SkyMap {
        for texel in &mut self.rgb {
            *texel = texel.map(|x| x * factor);
        }
        self
    }

    /// Half the resolution.
    pub fn halved(&self) -> SkyMap {
        let side_px = self.side_px / 2;
        let at = |x: usize, y: usize, c: usize| self.rgb[y * self.side_px + x][c];
        let mean = |x: usize, y: usize, c: usize| {
            0.25 * (at(x, y, c) + at(x + 1, y, c) + at(x, y + 1, c) + at(x + 1, y + 1, c))
        };
        let rgb = (0..side_px * side_px)
            .map(|i| std::array::from_fn(|c| mean(i % side_px * 2, i / side_px * 2, c)))
            .collect();
        SkyMap { side_px, rgb }
    }

    /// Irradiance of a surface with this normal from the sky above the horizon (a numerical
    /// integral over a grid of directions).
    pub fn irradiance(&self, normal: Vector3<f32>) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for i in 0..self.rgb.len() {
            let at = |i: usize| (i as f32 + 0.5) / self.side_px as f32;
            let (u, v) = (at(i % self.side_px), at(i / self.side_px));
            let direction = direction_of(u, v);
            let weight = direction.dot(&normal).max(0.0) * solid_angle(u, v, self.side_px);
            for (sum, texel) in sum.iter_mut().zip(self.rgb[i]) {
                *sum += texel * weight;
            }
        }
        sum
    }

    /// Mean radiance just above the horizon.
    pub fn horizon(&self) -> [f32; 3] {
        let n = self.side_px;
        let rim: Vec<[f32; 3]> = (0..n)
            .flat_map(|i| {
                [
                    self.rgb[i],
                    self.rgb[(n - 1) * n + i],
                    self.rgb[i * n],
                    self.rgb[i * n + n - 1],
                ]
            })
            .collect();
        std::array::from_fn(|c| rim.iter().map(|texel| texel[c]).sum::<f32>() / rim.len() as f32)
    }

    /// Half-float R G B A texels.
    pub fn texels(&self) -> Vec<[u16; 4]> {
        self.rgb
            .iter()
            .map(|[r, g, b]| [half(*r), half(*g), half(*b), half(1.0)])
            .collect()
    }
}

/// Solid angle of a texel: its area on the octahedron (√3/2 · area of the projection, doubled by
/// the rotation) over distance cubed.
fn solid_angle(u: f32, v: f32, side_px: usize) -> f32 {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let (x, y) = (0.5 * (a + b), 0.5 * (a - b));
    let z = (1.0 - x.abs() - y.abs()).max(0.0);
    // The face |x|+|y|+z = 1 lies 1/√3 from the origin: dω = (1/√3) dA / r³ with dA = √3 dx dy, so
    // dω = dx dy / r³; dx dy = da db / 2.
    let texel = 2.0 / side_px as f32;
    0.5 * texel * texel / (x * x + y * y + z * z).powf(1.5)
}

/// Hosek and Wilkie's clear sky, scaled to the illuminance wanted.
struct ClearSky {
    state: SkyState,
    scale: f32,
}

impl ClearSky {
    fn new(look: &SkyLook) -> Self {
        let elevation = look.sun_towards.z.clamp(0.0, 1.0).asin();
        let params = SkyParams {
            elevation,
            turbidity: 2.5 + 3.0 * look.clouds_ratio,
            albedo: [0.2; 3],
        };
        let state =
            SkyState::new(&params).expect("elevation is 0..=π/2, turbidity 2.5..=5.5, albedo 0.2");
        let mut sky = ClearSky { state, scale: 1.0 };
        const COARSE_PX: usize = 32;
        let at = |i: usize| (i as f32 + 0.5) / COARSE_PX as f32;
        let texel = |i: usize| {
            let (u, v) = (at(i % COARSE_PX), at(i / COARSE_PX));
            let direction = direction_of(u, v);
            luminance(sky.radiance(look.sun_towards, direction))
                * direction.z
                * solid_angle(u, v, COARSE_PX)
        };
        let raw: f32 = (0..COARSE_PX * COARSE_PX).map(texel).sum();
        sky.scale = look.clear_klx / raw.max(1e-9);
        sky
    }

    fn radiance(&self, sun: Vector3<f32>, direction: Vector3<f32>) -> [f32; 3] {
        let theta = direction.z.clamp(0.0, 1.0).acos().min(0.5 * PI - 0.01);
        let gamma = direction.dot(&sun).clamp(-1.0, 1.0).acos();
        [Channel::R, Channel::G, Channel::B]
            .map(|channel| self.state.radiance(theta, gamma, channel).max(0.0) * self.scale)
    }
}

fn radiance(look: &SkyLook, clear: &ClearSky, direction: Vector3<f32>) -> [f32; 3] {
    let blue = clear.radiance(look.sun_towards, direction);
    let cover = cloud_cover(direction, look.clouds_ratio);
    let day_klx = look.clear_klx + luminance(look.sun_klx) * look.sun_towards.z.max(0.0);
    // Base of a cloud is darker where it is thick; its rim glows towards the sun. Overcast
    // brightens towards the zenith (CIE).
    let towards = direction.dot(&look.sun_towards).max(0.0);
    let rim = towards.powi(6) * (1.0 - cover) * 1.2;
    let overcast = (1.0 + 2.0 * direction.z) / 3.0;
    let body = 0.55 - 0.3 * cover * cover * look.clouds_ratio.max(0.45) + rim * 0.4;
    let tint: [f32; 3] =
        std::array::from_fn(|c| 0.75 + 0.25 * look.sun_klx[c] / luminance(look.sun_klx).max(1e-6));
    let starlight = if look.night_klx[0] > 0.0 {
        star(direction) * (1.0 - cover) * smoothstep(0.02, 0.25, direction.z)
    } else {
        0.0
    };
    let (moon, haze) = (
        moon(look, direction) * (1.0 - 0.97 * cover),
        aureole(look, direction),
    );
    std::array::from_fn(|c| {
        let white = day_klx * body / PI * tint[c] * (1.0 + (overcast - 1.0) * look.clouds_ratio);
        let air = blue[c] * molecules(c, look.rayleigh_ratio) + haze * look.sun_klx[c];
        air + (white - air) * cover
            + look.night_klx[c] / PI * (1.3 - direction.z)
            + starlight * look.night_klx[c]
            + moon
    })
}

/// Optical depth of the air's molecules towards the zenith at 650, 550 and 450 nm (Bucholtz 1995).
pub(crate) const RAYLEIGH_DEPTH: [f32; 3] = [0.048, 0.096, 0.219];

/// The same of usual haze.
pub(crate) const MIE_DEPTH: f32 = 0.03;

/// Light scattered by `ratio` times the usual number of molecules, relative to the usual number.
pub(crate) fn molecules(channel: usize, ratio: f32) -> f32 {
    let scattered = |ratio: f32| 1.0 - (-RAYLEIGH_DEPTH[channel] * ratio).exp();
    scattered(ratio) / scattered(1.0)
}

/// Radiance of haze beyond the usual amount, per irradiance of the sun: Henyey and Greenstein's
/// phase function, scattered once.
fn aureole(look: &SkyLook, direction: Vector3<f32>) -> f32 {
    const G: f32 = 0.76;
    let phase = (1.0 - G * G)
        / (4.0 * PI * (1.0 + G * G - 2.0 * G * direction.dot(&look.sun_towards)).powf(1.5));
    let depth = MIE_DEPTH * (look.mie_ratio - 1.0).max(0.0) / (direction.z.max(0.0) + 0.08);
    (1.0 - (-depth).exp()) * phase
}

/// Radiance of a full moon opposite the sun, kilolux per steradian. It is twice as wide as the true
/// one, so that the map's texels show it, and far dimmer: white in pictures of streets under lamps.
fn moon(look: &SkyLook, direction: Vector3<f32>) -> f32 {
    if look.sun_towards.z >= 0.0 {
        return 0.0;
    }
    let away_deg = direction.angle(&-look.sun_towards).to_degrees();
    let rise = smoothstep(0.0, 0.1, -look.sun_towards.z);
    (0.105 * smoothstep(0.62, 0.42, away_deg) + 0.0006 * (-away_deg * away_deg / 8.0).exp()) * rise
}

/// Brightness of the stars in a direction, in units of the night sky: points in a fixed grid of
/// cells, few of them bright.
fn star(direction: Vector3<f32>) -> f32 {
    const CELLS: f32 = 70.0;
    let at = direction * CELLS;
    let cell = at.map(|x| x.floor());
    let key = (cell.x as i64 & 0xff) as u64
        | ((cell.y as i64 & 0xff) as u64) << 8
        | ((cell.z as i64 & 0xff) as u64) << 16;
    let draw = |channel: u64| {
        (schema_types::noise::mix(key | channel << 32) >> 40) as f32 / (1u64 << 24) as f32
    };
    if draw(0) > 0.09 {
        return 0.0;
    }
    let place = Vector3::new(draw(1), draw(2), draw(3)).map(|x| 0.2 + 0.6 * x);
    let away = (at - cell - place).norm();
    smoothstep(0.12, 0.0, away) * (0.2 + 3.0 * draw(4).powi(4)) * 9.0
}

/// How much clouds hide of the sky in a direction, 0..=1.
fn cloud_cover(direction: Vector3<f32>, clouds_ratio: f32) -> f32 {
    // A flat layer, bent down at the horizon so that it does not run to infinity.
    let reach = 1.6 / (direction.z + 0.14);
    let (x, y) = (direction.x * reach, direction.y * reach);
    let warp = fbm(x * 0.6 + 19.0, y * 0.6 + 7.0, 2) - 0.5;
    let field = fbm(x + 1.3 * warp + 31.0, y - 0.9 * warp + 57.0, 5);
    let threshold = 0.63 - 0.5 * clouds_ratio;
    let cover = smoothstep(threshold, threshold + 0.2, field);
    let overcast = smoothstep(0.7, 1.0, clouds_ratio);
    let horizon = smoothstep(0.0, 0.10, direction.z);
    (cover * (0.25 + 0.75 * horizon)).max(overcast * 0.96)
}

fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn fbm(x: f32, y: f32, n_octaves: u32) -> f32 {
    let (mut sum, mut weight, mut total, mut scale) = (0.0, 0.5, 0.0, 1.0);
    for octave in 0..n_octaves {
        sum += weight * value_noise(x * scale + 17.0 * octave as f32, y * scale);
        total += weight;
        weight *= 0.5;
        scale *= 2.03;
    }
    sum / total
}

fn value_noise(x: f32, y: f32) -> f32 {
    let (cell_x, cell_y) = (x.floor(), y.floor());
    let (fx, fy) = (x - cell_x, y - cell_y);
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let corner = |dx: i64, dy: i64| {
        let key = (cell_x as i64 + dx) as u64 ^ ((cell_y as i64 + dy) as u64).rotate_left(32);
        (schema_types::noise::mix(key) >> 40) as f32 / (1u64 << 24) as f32
    };
    let low = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * smooth(fx);
    let high = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * smooth(fx);
    low + (high - low) * smooth(fy)
}

/// IEEE half of a non-negative number; too small numbers become 0, too large ones the largest half.
fn half(x: f32) -> u16 {
    const LARGEST: f32 = 65504.0;
    let bits = x.clamp(0.0, LARGEST).to_bits();
    // Rebias the exponent from 127 to 15 and round off 13 mantissa bits; numbers below the smallest
    // normal half become 0.
    if bits < 0x3880_0000 {
        0
    } else {
        ((bits - 0x3800_0000 + 0x1000) >> 13).min(0x7bff) as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solid_angles_of_the_map_add_up_to_a_hemisphere() {
        let n = 64;
        let at = |i: usize| (i as f32 + 0.5) / n as f32;
        let sum: f32 = (0..n * n)
            .map(|i| solid_angle(at(i % n), at(i / n), n))
            .sum();
        assert!((sum - 2.0 * PI).abs() < 0.01, "{sum}");
    }

    #[test]
    fn clear_sky_gives_the_illuminance_asked_for() {
        let sun_towards = Vector3::new(0.6, 0.0, 0.8);
        let look = SkyLook {
            sun_towards,
            clouds_ratio: 0.0,
            clear_klx: 12.0,
            sun_klx: [90.0; 3],
            night_klx: [0.0; 3],
            rayleigh_ratio: 1.0,
            mie_ratio: 1.0,
        };
        let up = SkyMap::paint(&look, 64).irradiance(Vector3::z());
        assert!((luminance(up) - 12.0).abs() < 1.5, "{up:?}");
    }

    #[test]
    fn air_scatters_blue_most_and_a_moon_stands_opposite_the_sun() {
        assert!(molecules(0, 1.0) == 1.0 && molecules(2, 0.0) == 0.0);
        // Thin air scatters in proportion; ten times the air is past that, in blue more than in
        // red.
        assert!(
            (molecules(0, 0.1) - 0.1).abs() < 0.01
                && molecules(0, 10.0) / 10.0 > 0.75
                && molecules(2, 10.0) / 10.0 < 0.5
        );
        let sun_towards = Vector3::new(0.6, 0.0, -0.8);
        let look = SkyLook {
            sun_towards,
            clouds_ratio: 0.0,
            clear_klx: 0.0,
            sun_klx: [0.0; 3],
            night_klx: [0.0; 3],
            rayleigh_ratio: 1.0,
            mie_ratio: 1.0,
        };
        assert!(moon(&look, -sun_towards) > 0.08 && moon(&look, Vector3::z()) < 1e-4);
    }

    #[test]
    fn halves_round_trip_simple_values() {
        for (x, bits) in [
            (0.0, 0),
            (1.0, 0x3c00),
            (0.5, 0x3800),
            (65504.0, 0x7bff),
            (1e9, 0x7bff),
        ] {
            assert_eq!(half(x), bits, "{x}");
        }
    }
}
