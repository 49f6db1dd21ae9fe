// Reads what surface_slim.wgsl wrote.

fn normal_of(packed: u32) -> vec3<f32> {
    let at = vec2<f32>(vec2(packed & 0x7ffu, (packed >> 11u) & 0x7ffu)) * (2.0 / 2046.0) - 1.0;
    let z = 1.0 - abs(at.x) - abs(at.y);
    let below = vec2(max(-z, 0.0));
    return normalize(vec3(at - select(-below, below, at >= vec2(0.0)), z));
}

fn albedo_of(root: u32) -> vec3<f32> {
    let s = unpack4x8unorm(root).rgb;
    return s * s;
}

fn wall_seen(albedo: vec3<f32>, uv_m: vec2<f32>, labels: vec4<u32>, pixel_m: f32, ground: bool) -> Wall {
    let level = f32((labels.w >> 25u) & 63u) * (1.0 / 63.0);
    return Wall(albedo, f32((labels.w >> 22u) & 7u) * (1.0 / 7.0), GLOW_MOST * level * level, f32(labels.w >> 31u));
}
