// What shading gets of a surface from a software rasteriser, which runs every branch for every
// pixel. Therefore walls get their windows here, where only walls are drawn, and half the bytes
// suffice: normal (octahedral, 2 x 11 bits), pane (3 bits), light behind it (6 bits and its
// colour); root of the albedo, material, lit. Read by seen_slim.wgsl.

alias Surface = vec2<u32>;

// Whether the drawn meshes may have walls.
override WITH_WALLS: bool = true;

// The square root of linear light, so that a multiplication makes it linear again.
fn stored_albedo(rgb: u32) -> u32 {
    return pack4x8unorm(vec4(sqrt(max(linear_of(rgb), vec3(0.0))), 0.0));
}

fn surface_of(normal_in_world: vec3<f32>, labels: vec3<u32>, uv_m: vec2<f32>, pixel_m: f32) -> Surface {
    let steep = abs(normal_in_world);
    let n = normal_in_world / max(steep.x + steep.y + steep.z, 1e-6);
    let folded = (1.0 - abs(n.yx)) * select(vec2(-1.0), vec2(1.0), n.xy >= vec2(0.0));
    let at = vec2<u32>(clamp(select(folded, n.xy, n.z >= 0.0) * 0.5 + 0.5, vec2(0.0), vec2(1.0)) * 2046.0 + 0.5);
    var first = at.x | (at.y << 11u);
    var root = labels.z;
    if WITH_WALLS {
        let material = (labels.y >> 8u) & 0x1fu;
        let is_shop = material == MATERIAL_SHOP_FRONT;
        let is_wall = f32(is_shop || material == MATERIAL_FACADE) * f32(steep.z < max(steep.x, steep.y));
        let wall = wall_at(albedo_of(root), uv_m, labels.x, pixel_m, is_shop, is_wall);
        root = pack4x8unorm(vec4(sqrt(wall.albedo), 0.0));
        let glow = u32(sqrt(wall.glow / GLOW_MOST) * 63.0 + 0.5);
        first |= (u32(wall.pane * 7.0 + 0.5) << 22u) | (min(glow, 63u) << 25u) | (u32(wall.cool) << 31u);
    }
    return vec2(first, (root & 0xffffffu) | ((labels.y & 0x1f00u) << 16u) | ((labels.y >> 16u) << 29u));
}

fn albedo_of(root: u32) -> vec3<f32> {
    let s = unpack4x8unorm(root).rgb;
    return s * s;
}
