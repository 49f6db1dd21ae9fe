// Depth of shadow casters as the sun sees them. Mirror of `shadow_from_mesh`: shadow.rs.

@group(0) @binding(0) var<storage, read> shadow_from_mesh: array<array<vec4<f32>, 3>>;

@vertex
fn vs_main(@location(0) position_m: vec3<f32>, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    let p = vec4(position_m, 1.0);
    let m = shadow_from_mesh[instance];
    // Rows give u, v in 0..1 and depth; v runs down, clip y up.
    return vec4(dot(m[0], p) * 2.0 - 1.0, 1.0 - dot(m[1], p) * 2.0, dot(m[2], p), 1.0);
}
