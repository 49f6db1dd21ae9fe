// Reads what surface_wide.wgsl wrote.

fn normal_of(packed: u32) -> vec3<f32> {
    let n = vec3<f32>(vec3(packed & 0x7ffu, (packed >> 11u) & 0x7ffu, packed >> 22u));
    return normalize(n * vec3(2.0 / 2046.0, 2.0 / 2046.0, 2.0 / 1022.0) - 1.0);
}

fn albedo_of(rgb: u32) -> vec3<f32> {
    return linear_of(rgb);
}

fn wall_seen(albedo: vec3<f32>, uv_m: vec2<f32>, labels: vec4<u32>, pixel_m: f32, ground: bool) -> Wall {
    let material = (labels.y >> 8u) & 0xffu;
    let is_shop = material == MATERIAL_SHOP_FRONT;
    return wall_at(albedo, uv_m, labels.x, pixel_m, is_shop, f32(is_shop || material == MATERIAL_FACADE) * f32(!ground));
}
