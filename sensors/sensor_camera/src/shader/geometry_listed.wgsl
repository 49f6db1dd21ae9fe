// Geometry for GPUs: every modality of a view from one drawing; instances lie in a list. Mirrors:
// geometry/pass.rs, target/kind.rs.

struct Corner {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) normal_in_world: vec3<f32>,
    @location(1) uv_m: vec2<f32>,
    // Object id; class, material, lit; albedo R G B A; instance.
    @location(2) @interpolate(flat) labels: vec4<u32>,
}

// Reversed z with the far plane at infinity: clip z is the near distance, clip w the depth.
fn clip_from_camera(p: vec3<f32>) -> vec4<f32> {
    let scale = 2.0 * views[which].lens_px.xy / views[which].size_px;
    let shift = 2.0 * views[which].lens_px.zw / views[which].size_px - 1.0;
    return vec4(scale.x * p.x + shift.x * p.z, -scale.y * p.y - shift.y * p.z, views[which].near_m, p.z);
}

@vertex
fn vs_main(
    @location(0) position_m: vec3<f32>,
    @location(1) normal: vec4<f32>,
    @location(2) albedo: vec4<f32>,
    @location(3) labels: vec4<u32>,
    @location(4) object_id: u32,
    @location(5) uv_m: vec2<f32>,
    @builtin(instance_index) instance: u32,
) -> Corner {
    var out: Corner;
    out.clip = clip_from_camera(point_in_camera(instance, position_m));
    out.normal_in_world = direction_in_world(instance, normal.xyz);
    out.uv_m = uv_m;
    let found = labels_of(pack4x8unorm(albedo), labels, object_id, marks_of(instance));
    out.labels = vec4(found.xy, stored_albedo(found.z), instance);
    return out;
}

@fragment
fn fs_main(in: Corner) -> Pixel {
    let depth_m = 1.0 / in.clip.w;
    var out = surface_pixel(depth_m, in.normal_in_world, in.uv_m, in.labels.xyz, depth_m / views[which].lens_px.x);
    if WITH_FLOW {
        out.flow_px = flow_of(in.clip.xy, depth_m, in.labels.w);
    }
    return out;
}
