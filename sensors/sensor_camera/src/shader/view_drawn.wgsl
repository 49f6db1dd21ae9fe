// A pass that draws handles one view.

const which: u32 = 0u;

@group(1) @binding(1) var shadow_map: texture_depth_2d;
@group(1) @binding(5) var far_shadow_map: texture_depth_2d;

// Share of the light that passes at a place of the shadow map, each 0 to 1.
fn near_shadow(at: vec2<f32>, depth: f32) -> f32 {
    return textureSampleCompareLevel(shadow_map, shadow_sampler, at, depth);
}

fn far_shadow(at: vec2<f32>, depth: f32) -> f32 {
    return textureSampleCompareLevel(far_shadow_map, shadow_sampler, at, depth);
}
