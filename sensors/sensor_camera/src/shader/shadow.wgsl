// Depth of shadow casters as the sun sees them. Mirror of `shadow_from_mesh`: shadow.rs.

@group(0) @binding(0) var<storage, read> shadow_from_mesh: array<array<vec4<f32>, 3>>;

@vertex
fn vs_main(@location(0) position_m: vec3<f32>, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    let p = vec4(position_m, 1.0);
    let m = shadow_from_mesh[instance];
    // Rows give u, v in 0..1 and depth; v runs down, clip y up.
    return vec4(dot(m[0], p) * 2.0 - 1.0, 1.0 - dot(m[1], p) * 2.0, dot(m[2], p), 1.0);
}

@group(0) @binding(0) var still_map: texture_depth_2d;

@vertex
fn vs_full(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    let xy = vec2(f32((corner << 1u) & 2u), f32(corner & 2u)) * 2.0 - 1.0;
    return vec4(xy, 0.0, 1.0);
}

@fragment
fn fs_still(@builtin(position) at: vec4<f32>) -> @builtin(frag_depth) f32 {
    return textureLoad(still_map, vec2<u32>(at.xy), 0);
}
