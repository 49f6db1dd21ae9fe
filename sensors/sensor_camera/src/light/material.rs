//! Materials: a table of their looks for the shader, and the noise that roughens them.

use sensor_gpu::Gpu;

/// `LightData::materials` and `LightData::mirrors` of each [`sensor_core::Material`], by its
/// number.
///
/// Texels per metre are powers of two: patterns then repeat within 1024 m, over which the eye's
/// position is taken.
pub(crate) const LOOKS: [([f32; 4], [f32; 4]); 17] = [
    ([8.0, 0.10, 1.0, 0.10], [0.0, 5.0, 0.0, 0.0]), // matte
    ([32.0, 0.44, 2.0, 0.34], [0.02, 5.0, 0.0, 0.0]), // asphalt
    ([32.0, 0.25, 4.0, 0.30], [0.0, 5.0, 0.0, 0.0]), // concrete
    ([16.0, 0.30, 4.0, 0.60], [0.0, 5.0, 0.0, 0.0]), // paint on the road
    ([16.0, 0.14, 2.0, 0.35], [0.0, 5.0, 0.0, 0.0]), // facade
    ([16.0, 0.14, 2.0, 0.30], [0.0, 5.0, 0.0, 0.0]), // shop front
    ([16.0, 0.40, 2.0, 0.40], [0.0, 5.0, 0.0, 0.0]), // roof
    ([16.0, 1.50, 4.0, 1.20], [0.0, 5.0, 0.30, 0.0]), // foliage
    ([32.0, 0.90, 4.0, 0.60], [0.0, 5.0, 0.0, 0.0]), // bark
    ([32.0, 0.80, 1.0, 0.90], [0.0, 5.0, 0.10, 0.0]), // grass
    ([4.0, 0.0, 1.0, 0.0], [0.06, 3.0, 0.0, 0.0]),  // car paint
    ([4.0, 0.0, 1.0, 0.0], [0.09, 1.0, 0.0, 0.0]),  // glass
    ([16.0, 0.10, 1.0, 0.10], [0.22, 4.0, 0.0, 0.0]), // metal
    ([16.0, 0.15, 1.0, 0.10], [0.02, 5.0, 0.0, 0.0]), // rubber
    ([4.0, 0.0, 1.0, 0.0], [0.05, 3.0, 0.0, 1.0]),  // lamp
    ([32.0, 0.20, 4.0, 0.10], [0.0, 5.0, 0.0, 0.0]), // cloth
    ([4.0, 0.20, 1.0, 0.30], [0.05, 1.0, 0.0, 0.0]), // water
];

/// A row of [`LOOKS`] as `LightData::looks`.
pub(crate) fn in_bytes((material, mirror): ([f32; 4], [f32; 4])) -> [u32; 4] {
    let word = |values: [f32; 4], whole: [f32; 4]| {
        u32::from_le_bytes(std::array::from_fn(|i| {
            (values[i] / whole[i] * 255.0).round().clamp(0.0, 255.0) as u8
        }))
    };
    [
        word(material, [255.0, 2.0, 255.0, 2.0]),
        word(mirror, [1.0, 5.0, 1.0, 1.0]),
        0,
        0,
    ]
}

const SIDE_PX: u32 = 256;

/// The levels of the noise, each half as wide as the one before: R grain, G clouds of many sizes, B
/// and A white noise; repeats.
pub(crate) fn noise_levels() -> Vec<Vec<[u8; 4]>> {
    let mut texels = finest();
    let n_levels = SIDE_PX.ilog2() + 1;
    let level = |number| {
        let bytes = texels
            .iter()
            .map(|texel| texel.map(|x| (x * 255.0 + 0.5) as u8));
        let bytes = bytes.collect();
        texels = halve(&texels, (SIDE_PX >> number) as usize);
        bytes
    };
    (0..n_levels).map(level).collect()
}

/// The noise as a texture.
pub(crate) fn noise_texture(gpu: &Gpu) -> wgpu::TextureView {
    let levels = noise_levels();
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let texture = gpu.texture(
        "noise",
        [SIDE_PX, SIDE_PX],
        levels.len() as u32,
        wgpu::TextureFormat::Rgba8Unorm,
        usage,
    );
    for (mip_level, bytes) in (0..).zip(&levels) {
        let side_px = SIDE_PX >> mip_level;
        gpu.queue().write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: &texture,
                mip_level,
                origin: wgpu::Origin3d::ZERO,
                aspect: wgpu::TextureAspect::All,
            },
            bytemuck::cast_slice(bytes),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(4 * side_px),
                rows_per_image: None,
            },
            wgpu::Extent3d {
                width: side_px,
                height: side_px,
                depth_or_array_layers: 1,
            },
        );
    }
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// The finest level, shifted so that no channel brightens or darkens what it roughens.
fn finest() -> Vec<[f32; 4]> {
    let mut texels: Vec<[f32; 4]> = (0..SIDE_PX * SIDE_PX)
        .map(|i| texel(i % SIDE_PX, i / SIDE_PX))
        .collect();
    for channel in 0..4 {
        let mean = texels.iter().map(|texel| texel[channel]).sum::<f32>() / texels.len() as f32;
        texels
            .iter_mut()
            .for_each(|texel| texel[channel] = (texel[channel] + 0.5 - mean).clamp(0.0, 1.0));
    }
    texels
}

fn halve(texels: &[[f32; 4]], side_px: usize) -> Vec<[f32; 4]> {
    let half_px = side_px / 2;
    let mean = |x: usize, y: usize, c: usize| {
        0.25 * (texels[y * side_px + x][c]
            + texels[y * side_px + x + 1][c]
            + texels[(y + 1) * side_px + x][c]
            + texels[(y + 1) * side_px + x + 1][c])
    };
    (0..half_px * half_px)
        .map(|i| std::array::from_fn(|c| mean(i % half_px * 2, i / half_px * 2, c)))
        .collect()
}

fn white(x: u32, y: u32, channel: u64) -> f32 {
    let key = (x as u64) | (y as u64) << 20 | channel << 40;
    (schema_types::noise::mix(key) >> 40) as f32 / (1u64 << 24) as f32
}

fn texel(x: u32, y: u32) -> [f32; 4] {
    let grain = 0.6 * white(x, y, 0) + 0.4 * smooth(x, y, 4, 1);
    // Octaves of 64 to 2 texels; contrast is stretched, because a sum of octaves crowds around its
    // mean.
    let clouds: f32 = (1..7)
        .map(|octave| smooth(x, y, 1 << octave, 10 + octave as u64) * (1 << octave) as f32)
        .sum::<f32>()
        / 126.0;
    [
        grain,
        (0.5 + 1.8 * (clouds - 0.5)).clamp(0.0, 1.0),
        white(x, y, 2),
        white(x, y, 3),
    ]
}

/// Value noise on a lattice of `pitch` texels, periodic over the texture.
fn smooth(x: u32, y: u32, pitch: u32, channel: u64) -> f32 {
    let n = SIDE_PX / pitch;
    let (cx, cy) = (x / pitch, y / pitch);
    let fraction = |x: u32| {
        let t = (x % pitch) as f32 / pitch as f32;
        t * t * (3.0 - 2.0 * t)
    };
    let corner = |dx: u32, dy: u32| white((cx + dx) % n, (cy + dy) % n, channel);
    let (fx, fy) = (fraction(x), fraction(y));
    let low = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * fx;
    let high = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * fx;
    low + (high - low) * fy
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_in_bytes_are_those_of_the_table() {
        for (material, mirror) in LOOKS {
            let [first, second, ..] = in_bytes((material, mirror));
            let check = |word: u32, values: [f32; 4], whole: [f32; 4]| {
                for ((byte, value), whole) in word.to_le_bytes().into_iter().zip(values).zip(whole)
                {
                    assert!(
                        (byte as f32 / 255.0 * whole - value).abs() <= 0.51 / 255.0 * whole,
                        "{value}"
                    );
                }
            };
            check(first, material, [255.0, 2.0, 255.0, 2.0]);
            check(second, mirror, [1.0, 5.0, 1.0, 1.0]);
        }
    }

    #[test]
    fn noise_has_a_middle_mean_so_that_albedo_keeps_its_own() {
        let texels = finest();
        for channel in 0..4 {
            let mean = texels.iter().map(|texel| texel[channel]).sum::<f32>() / texels.len() as f32;
            assert!((mean - 0.5).abs() < 0.02, "channel {channel}: {mean}");
        }
    }
}
