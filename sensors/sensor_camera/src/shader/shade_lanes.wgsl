// Shading on processors, eight pixels at a time: sensor_shade is generated from this shader, and
// calls the functions themselves in place of an entry point.

@group(2) @binding(0) var surface_map: texture_2d<u32>;
@group(2) @binding(1) var depth_map: texture_2d<f32>;
@group(2) @binding(2) var instance_map: texture_2d<u32>;

fn surface_at(pixel: vec2<u32>) -> vec4<u32> {
    return textureLoad(surface_map, pixel, 0);
}

fn depth_at(pixel: vec2<u32>) -> f32 {
    return textureLoad(depth_map, pixel, 0).r;
}

fn id_at(pixel: vec2<u32>) -> u32 {
    return textureLoad(instance_map, pixel, 0).r;
}
