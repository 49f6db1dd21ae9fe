// Shading in a compute shader.

@group(2) @binding(0) var surface_maps: texture_2d_array<u32>;
@group(2) @binding(1) var depth_maps: texture_2d_array<f32>;
@group(2) @binding(2) var instance_maps: texture_2d_array<u32>;
@group(2) @binding(3) var color_maps: texture_storage_2d_array<r32uint, write>;
@group(2) @binding(4) var luminance_maps: texture_storage_2d_array<r32float, write>;
@group(2) @binding(5) var radiance_maps: texture_storage_2d_array<rgba16float, write>;

fn surface_at(pixel: vec2<u32>) -> vec4<u32> {
    return textureLoad(surface_maps, pixel, views[which].layer, 0);
}

fn depth_at(pixel: vec2<u32>) -> f32 {
    return textureLoad(depth_maps, pixel, views[which].layer, 0).r;
}

fn id_at(pixel: vec2<u32>) -> u32 {
    return textureLoad(instance_maps, pixel, views[which].layer, 0).r;
}

// Whether the target of this number (target/kind.rs) is wanted.
fn wants(number: u32) -> bool {
    return ((views[which].wanted >> number) & 1u) != 0u;
}

@compute @workgroup_size(16, 8)
fn cs_main(@builtin(global_invocation_id) at: vec3<u32>) {
    which = at.z;
    if f32(at.x) >= views[which].size_px.x || f32(at.y) >= views[which].size_px.y {
        return;
    }
    let ray = ray_in_camera(vec2<f32>(at.xy) + 0.5);
    let depth_m = depth_at(at.xy);
    var radiance: vec3<f32>;
    if depth_m < FAR_M {
        radiance = surface_radiance(at.xy, depth_m, ray);
    } else {
        radiance = sky_at(ray);
    }
    let layer = views[which].layer;
    // These are not overrides: with a single pipeline, no compiler rounds a target differently
    // depending on other readers.
    if wants(7u) {
        textureStore(luminance_maps, at.xy, layer, vec4(luminance_of(radiance), 0.0, 0.0, 0.0));
    }
    if wants(8u) {
        textureStore(radiance_maps, at.xy, layer, vec4(min(radiance, vec3(60000.0)), 1.0));
    }
    if wants(6u) && !wants(8u) {
        textureStore(color_maps, at.xy, layer, vec4(packed_color(radiance), 0u, 0u, 0u));
    }
}
