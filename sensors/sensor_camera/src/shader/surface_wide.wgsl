// What shading gets of a surface, before textures: normal; albedo, material, lit; texture
// coordinates. Read by seen_wide.wgsl.

alias Surface = vec4<u32>;

fn stored_albedo(rgb: u32) -> u32 {
    return rgb;
}

fn surface_of(normal_in_world: vec3<f32>, labels: vec3<u32>, uv_m: vec2<f32>, pixel_m: f32) -> Surface {
    let n = vec3<u32>(clamp(normal_in_world * 0.5 + 0.5, vec3(0.0), vec3(1.0)) * vec3(2046.0, 2046.0, 1022.0) + 0.5);
    let look = (labels.z & 0xffffffu) | ((labels.y & 0x1f00u) << 16u) | ((labels.y >> 16u) << 29u);
    return vec4(n.x | (n.y << 11u) | (n.z << 22u), look, bitcast<vec2<u32>>(uv_m));
}
