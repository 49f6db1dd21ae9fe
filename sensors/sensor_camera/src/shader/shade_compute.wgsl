// Shading in a compute shader.

@group(2) @binding(3) var color_map: texture_storage_2d<r32uint, write>;
@group(2) @binding(4) var luminance_map: texture_storage_2d<r32float, write>;
@group(2) @binding(5) var radiance_map: texture_storage_2d<rgba16float, write>;

// Whether the target of this number (targets.rs) is wanted.
fn wants(number: u32) -> bool {
    return ((view.raster.w >> number) & 1u) != 0u;
}

@compute @workgroup_size(16, 8)
fn cs_main(@builtin(global_invocation_id) at: vec3<u32>) {
    if f32(at.x) >= view.frame.x || f32(at.y) >= view.frame.y {
        return;
    }
    let ray = ray_in_camera(vec2<f32>(at.xy) + 0.5);
    let depth_m = textureLoad(depth_map, at.xy, 0).r;
    var radiance: vec3<f32>;
    if depth_m < FAR_M {
        radiance = surface_radiance(at.xy, depth_m, ray);
    } else {
        radiance = sky_at(ray);
    }
    // Not overrides: one pipeline for all, so that no compiler rounds a target in another way because of who else reads.
    if wants(7u) {
        textureStore(luminance_map, at.xy, vec4(luminance_of(radiance), 0.0, 0.0, 0.0));
    }
    if wants(8u) {
        textureStore(radiance_map, at.xy, vec4(min(radiance, vec3(60000.0)), 1.0));
    }
    if wants(6u) && !wants(8u) {
        textureStore(color_map, at.xy, vec4(packed_color(radiance), 0u, 0u, 0u));
    }
}
