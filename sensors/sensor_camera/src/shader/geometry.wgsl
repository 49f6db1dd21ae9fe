// The geometry pass: every modality of a view from one drawing. Mirrors: pass.rs, targets.rs.

// Targets are attached only if somebody reads them; this switches off the work behind flow.
override WITH_FLOW: bool = true;

fn wants_flow() -> bool {
    return WITH_FLOW;
}

struct Corner {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) normal_in_world: vec3<f32>,
    @location(1) uv_m: vec2<f32>,
    // Object id; class, material, lit; albedo R G B A; instance.
    @location(2) @interpolate(flat) labels: vec4<u32>,
}

// Reversed z with the far plane at infinity: clip z is the near distance, clip w the depth.
fn clip_from_camera(p: vec3<f32>) -> vec4<f32> {
    let scale = 2.0 * views[which].lens_px.xy / views[which].frame.xy;
    let shift = 2.0 * views[which].lens_px.zw / views[which].frame.xy - 1.0;
    return vec4(scale.x * p.x + shift.x * p.z, -scale.y * p.y - shift.y * p.z, views[which].frame.z, p.z);
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
    return surface_pixel(in.clip.xy, 1.0 / in.clip.w, in.normal_in_world, in.uv_m, in.labels.xyz, in.labels.w);
}

// One triangle over the whole image at infinity.
@vertex
fn vs_sky(@builtin(vertex_index) corner: u32) -> @builtin(position) @invariant vec4<f32> {
    let xy = vec2(f32((corner << 1u) & 2u), f32(corner & 2u)) * 2.0 - 1.0;
    return vec4(xy, 0.0, 1.0);
}

@fragment
fn fs_sky(@builtin(position) at: vec4<f32>) -> Pixel {
    return sky_pixel(at.xy);
}
