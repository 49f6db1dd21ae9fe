// The shading pass: light on what the geometry pass saw, once per pixel. Mirrors: shade.rs, targets.rs.

@group(2) @binding(0) var surface_map: texture_2d<u32>;
@group(2) @binding(1) var depth_map: texture_2d<f32>;
@group(2) @binding(2) var instance_map: texture_2d<u32>;
@group(2) @binding(3) var color_map: texture_storage_2d<r32uint, write>;
@group(2) @binding(4) var luminance_map: texture_storage_2d<r32float, write>;

override WITH_LUMINANCE: bool = true;

// Furthest depth, metres, at which there can be a surface: the sky's is infinite.
const FAR_M: f32 = 1e9;

@compute @workgroup_size(16, 8)
fn cs_main(@builtin(global_invocation_id) at: vec3<u32>) {
    if f32(at.x) >= view.frame.x || f32(at.y) >= view.frame.y {
        return;
    }
    let ray = ray_in_camera(vec2<f32>(at.xy) + 0.5);
    let depth_m = textureLoad(depth_map, at.xy, 0).r;
    var radiance: vec3<f32>;
    if depth_m < FAR_M {
        let packed = textureLoad(surface_map, at.xy, 0);
        let id = textureLoad(instance_map, at.xy, 0).r;
        let n = vec3<f32>(vec3(packed.x & 0x7ffu, (packed.x >> 11u) & 0x7ffu, packed.x >> 22u));
        let normal = normalize(n * vec3(2.0 / 2046.0, 2.0 / 2046.0, 2.0 / 1022.0) - 1.0);
        let labels = vec4(id, (packed.y >> 16u) & 0x1f00u | (packed.y >> 29u) << 16u, packed.y, 0u);
        radiance = shade(ray * depth_m, normal, bitcast<vec2<f32>>(packed.zw), labels, depth_m / view.lens_px.x);
    } else {
        radiance = sky_radiance(normalize(rotate_rows(view.world_from_camera, ray)));
    }
    if WITH_LUMINANCE {
        textureStore(luminance_map, at.xy, vec4(luminance_of(radiance), 0.0, 0.0, 0.0));
    }
    if WITH_COLOR {
        textureStore(color_map, at.xy, vec4(packed_color(radiance), 0u, 0u, 0u));
    }
}
