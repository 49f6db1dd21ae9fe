// Resolving in a compute shader: one pixel each, into the targets that are wanted.

// Per pixel: the triangle's number, bits of 1 / depth (0: sky).
@group(2) @binding(3) var<storage, read> seen: array<vec2<u32>>;
@group(3) @binding(0) var surface_out: texture_storage_2d_array<rgba32uint, write>;
@group(3) @binding(1) var depth_out: texture_storage_2d_array<r32float, write>;
@group(3) @binding(2) var class_out: texture_storage_2d_array<r8uint, write>;
@group(3) @binding(3) var instance_out: texture_storage_2d_array<r32uint, write>;
@group(3) @binding(4) var flow_out: texture_storage_2d_array<rg32float, write>;
@group(3) @binding(5) var normal_out: texture_storage_2d_array<rgba16float, write>;

@compute @workgroup_size(16, 8)
fn cs_resolve(@builtin(global_invocation_id) at: vec3<u32>) {
    which = at.z;
    let size = vec2<u32>(views[which].size_px);
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let found = seen[views[which].first_pixel + at.y * size.x + at.x];
    let pixel = pixel_at(vec2<f32>(at.xy) + 0.5, found);
    let layer = views[which].layer;
    if wants(0u) {
        textureStore(surface_out, at.xy, layer, pixel.surface);
    }
    if wants(1u) {
        textureStore(depth_out, at.xy, layer, vec4(pixel.depth_m, 0.0, 0.0, 0.0));
    }
    if wants(2u) {
        textureStore(class_out, at.xy, layer, vec4(pixel.class_code, 0u, 0u, 0u));
    }
    if wants(3u) {
        textureStore(instance_out, at.xy, layer, vec4(pixel.instance, 0u, 0u, 0u));
    }
    if wants(4u) {
        textureStore(flow_out, at.xy, layer, vec4(pixel.flow_px, 0.0, 0.0));
    }
    if wants(5u) {
        textureStore(normal_out, at.xy, layer, pixel.normal);
    }
}
