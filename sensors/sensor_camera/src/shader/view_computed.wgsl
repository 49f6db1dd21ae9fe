// A dispatch handles many views, one per z.

var<private> which: u32;

@group(1) @binding(1) var shadow_maps: texture_depth_2d_array;
@group(1) @binding(5) var far_shadow_maps: texture_depth_2d_array;

// Share of the light that passes at a place of the shadow map, each 0 to 1. Texels beyond belong to
// a neighbouring map and must not count.
fn near_shadow(at: vec2<f32>, depth: f32) -> f32 {
    let in_layer = (at + views[which].near_map.tile) * views[which].near_map.side;
    return textureSampleCompareLevel(shadow_maps, shadow_sampler, in_layer, views[which].near_map.layer, depth);
}

fn far_shadow(at: vec2<f32>, depth: f32) -> f32 {
    let in_layer = (at + views[which].far_map.tile) * views[which].far_map.side;
    return textureSampleCompareLevel(far_shadow_maps, shadow_sampler, in_layer, views[which].far_map.layer, depth);
}
