// Geometry for a software rasteriser. It fetches each number of a uniform or a list for every
// corner and pixel, with a bounds check; therefore each draw call's instance comes as attributes,
// and values that a triangle's pixels share are flat.

override NEAR_M: f32 = 0.1;

struct Vertex {
    @location(0) position_m: vec3<f32>,
    @location(1) normal: vec4<f32>,
    // R, G, B, A bytes.
    @location(2) albedo: u32,
    @location(3) labels: vec4<u32>,
    @location(4) object_id: u32,
    @location(5) uv_m: vec2<f32>,
    // Mirror of InstanceAttributes: rows of clip space from mesh space.
    @location(6) clip_x: vec4<f32>,
    @location(7) clip_y: vec4<f32>,
    @location(8) clip_w: vec4<f32>,
    // Pixel times depth at the previous firing from pixel times depth now.
    @location(9) before_x: vec4<f32>,
    @location(10) before_y: vec4<f32>,
    @location(11) before_w: vec4<f32>,
    @location(12) world_from_mesh_xyzw: vec4<f32>,
    // Object id, tint, lamps, bits of the focal length in pixels.
    @location(13) marks: vec4<u32>,
}

struct Corner {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) normal_in_world: vec3<f32>,
    @location(1) uv_m: vec2<f32>,
    // Object id; class, material, lit; albedo; bits of the focal length.
    @location(2) @interpolate(flat) labels: vec4<u32>,
}

// The same with what flow needs.
struct FlowingCorner {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) normal_in_world: vec3<f32>,
    @location(1) uv_m: vec2<f32>,
    @location(2) @interpolate(flat) labels: vec4<u32>,
    @location(3) @interpolate(flat) before_x: vec4<f32>,
    @location(4) @interpolate(flat) before_y: vec4<f32>,
    @location(5) @interpolate(flat) before_w: vec4<f32>,
}

fn corner_of(in: Vertex) -> Corner {
    var out: Corner;
    let p = vec4(in.position_m, 1.0);
    // Reversed z with the far plane at infinity: clip z is the near distance, clip w the depth.
    out.clip = vec4(dot(in.clip_x, p), dot(in.clip_y, p), NEAR_M, dot(in.clip_w, p));
    out.normal_in_world = rotate(in.world_from_mesh_xyzw, in.normal.xyz);
    out.uv_m = in.uv_m;
    let found = labels_of(in.albedo, in.labels, in.object_id, in.marks);
    out.labels = vec4(found.xy, stored_albedo(found.z), in.marks.w);
    return out;
}

@vertex
fn vs_main(in: Vertex) -> Corner {
    return corner_of(in);
}

@vertex
fn vs_flowing(in: Vertex) -> FlowingCorner {
    let corner = corner_of(in);
    var out: FlowingCorner;
    out.clip = corner.clip;
    out.normal_in_world = corner.normal_in_world;
    out.uv_m = corner.uv_m;
    out.labels = corner.labels;
    out.before_x = in.before_x;
    out.before_y = in.before_y;
    out.before_w = in.before_w;
    return out;
}

fn pixel_of_surface(clip: vec4<f32>, normal_in_world: vec3<f32>, uv_m: vec2<f32>, labels: vec4<u32>) -> Pixel {
    let depth_m = 1.0 / clip.w;
    return surface_pixel(depth_m, normal_in_world, uv_m, labels.xyz, depth_m / bitcast<f32>(labels.w));
}

@fragment
fn fs_main(in: Corner) -> Pixel {
    return pixel_of_surface(in.clip, in.normal_in_world, in.uv_m, in.labels);
}

@fragment
fn fs_flowing(in: FlowingCorner) -> Pixel {
    var out = pixel_of_surface(in.clip, in.normal_in_world, in.uv_m, in.labels);
    let here = vec4(vec3(in.clip.xy, 1.0) * out.depth_m, 1.0);
    let before = vec3(dot(in.before_x, here), dot(in.before_y, here), dot(in.before_w, here));
    // No flow if the point was behind the near plane, and so not in the image. A surface that did
    // not move has a depth of -1 here.
    if before.z >= NEAR_M {
        out.flow_px = in.clip.xy - before.xy / before.z;
    }
    return out;
}
