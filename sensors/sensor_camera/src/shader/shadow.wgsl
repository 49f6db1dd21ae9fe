// Depth of shadow casters from the sun. Mirror of `shadow_from_mesh`: shadow/draw.rs.

@group(0) @binding(0) var<storage, read> shadow_from_mesh: array<array<vec4<f32>, 3>>;

@vertex
fn vs_main(@location(0) position_m: vec3<f32>, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    let p = vec4(position_m, 1.0);
    let m = shadow_from_mesh[instance];
    // Rows give u, v in 0..1 and depth; v runs down, clip y up.
    return vec4(dot(m[0], p) * 2.0 - 1.0, 1.0 - dot(m[1], p) * 2.0, dot(m[2], p), 1.0);
}

@group(0) @binding(0) var still_map: texture_depth_2d;
// Parts of a layer in clip space: left, top, right, bottom.
@group(0) @binding(1) var<storage, read> parts: array<vec4<f32>>;

// A part as a strip of two triangles, at the largest depth.
@vertex
fn vs_part(@builtin(vertex_index) corner: u32, @builtin(instance_index) part: u32) -> @builtin(position) vec4<f32> {
    let sides = parts[part];
    return vec4(select(sides.x, sides.z, (corner & 1u) != 0u), select(sides.y, sides.w, (corner & 2u) != 0u), 1.0, 1.0);
}

@fragment
fn fs_still(@builtin(position) at: vec4<f32>) -> @builtin(frag_depth) f32 {
    return textureLoad(still_map, vec2<u32>(at.xy), 0);
}
