//! Lamps and windows of the scenery that commands switched: for shaders by object number, and as
//! sources of light.

use nalgebra::Point3;
use schema_types::id::SCENERY_BIT;
use sensor_core::{LampSetting, SceneAssets};
use sensor_gpu::Gpu;

use super::emitter::Emitter;

/// A lamp of the scenery, in the world.
#[derive(Clone, Debug)]
pub(crate) struct StillLamp {
    pub place: Point3<f64>,
    pub emitter: Emitter,
    /// Shines by day too.
    pub is_on: bool,
}

/// All lamps of the scenery except those that are switched off. `emitters` has the lamps of each
/// mesh.
pub(crate) fn still_lamps(assets: &SceneAssets, emitters: &[Vec<Emitter>]) -> Vec<StillLamp> {
    let mut lamps = Vec::new();
    for instance in &assets.statics {
        for emitter in &emitters[instance.mesh.0 as usize] {
            let object = if emitter.object.0 == 0 {
                instance.object
            } else {
                emitter.object
            };
            let place = instance.world_from_mesh * Point3::from(emitter.place_m.map(f64::from));
            match assets.switched.get(&object) {
                None => lamps.push(StillLamp {
                    place,
                    emitter: emitter.clone(),
                    is_on: false,
                }),
                Some(LampSetting {
                    on: Some(false), ..
                }) => {}
                Some(LampSetting {
                    on,
                    rgb,
                    strength_ratio,
                }) => {
                    lamps.push(StillLamp {
                        place,
                        emitter: emitter.clone().set(*rgb, *strength_ratio),
                        is_on: *on == Some(true),
                    });
                }
            }
        }
    }
    lamps
}

/// The words of an object that was not switched.
const NEUTRAL: [u32; 2] = [0, 1.0f32.to_bits()];

/// The word pairs that `as_switched` in `texture.wgsl` reads: colour, a bit for "has a colour", 0
/// by itself, 1 on, 2 off; and the strength. Entries after the last switched object are neutral.
pub(crate) fn words(assets: &SceneAssets) -> Vec<[u32; 2]> {
    let n = assets
        .switched
        .last_key_value()
        .map_or(0, |(object, _)| (object.0 & !SCENERY_BIT) as usize + 1);
    let mut words = vec![NEUTRAL; n + 1];
    for (
        object,
        LampSetting {
            on,
            rgb,
            strength_ratio,
        },
    ) in &assets.switched
    {
        let [r, g, b] = rgb.unwrap_or_default().map(u32::from);
        let state = on.map_or(0, |on| if on { 1 } else { 2 });
        let color = r | g << 8 | b << 16 | u32::from(rgb.is_some()) << 24;
        words[(object.0 & !SCENERY_BIT) as usize] = [color | state << 25, strength_ratio.to_bits()];
    }
    words
}

pub(crate) fn upload(gpu: &Gpu, assets: &SceneAssets) -> wgpu::Buffer {
    gpu.buffer_with(
        "switched lamps",
        bytemuck::cast_slice(&words(assets)),
        wgpu::BufferUsages::STORAGE,
    )
}
