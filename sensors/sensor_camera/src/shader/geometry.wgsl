// The geometry pass: every modality of a view from one drawing. Mirrors: pass.rs, targets.rs.

struct Corner {
    @builtin(position) clip: vec4<f32>,
    @location(0) normal_in_world: vec3<f32>,
    @location(1) uv_m: vec2<f32>,
    // Object id; class, material, lit; albedo R G B A; instance.
    @location(2) @interpolate(flat) labels: vec4<u32>,
}

// Attachments; locations are the numbers of Target in targets.rs.
struct Pixel {
    // For shade.wgsl: normal; albedo, material, lit; texture coordinates.
    @location(0) surface: vec4<u32>,
    @location(1) depth_m: f32,
    @location(2) class_code: u32,
    @location(3) instance: u32,
    @location(4) flow_px: vec2<f32>,
    @location(5) normal: vec4<f32>,
}

const MATERIAL_CAR_PAINT: u32 = 10u;
const MATERIAL_LAMP: u32 = 14u;

// Reversed z with the far plane at infinity: clip z is the near distance, clip w the depth.
fn clip_from_camera(p: vec3<f32>) -> vec4<f32> {
    let scale = 2.0 * view.lens_px.xy / view.frame.xy;
    let shift = 2.0 * view.lens_px.zw / view.frame.xy - 1.0;
    return vec4(scale.x * p.x + shift.x * p.z, -scale.y * p.y - shift.y * p.z, view.frame.z, p.z);
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
    let marks = marks_of(instance);
    out.clip = clip_from_camera(point_in_camera(instance, position_m));
    out.normal_in_world = direction_in_world(instance, normal.xyz);
    out.uv_m = uv_m;
    let id = select(object_id, marks.x, object_id == 0u);
    var rgb = pack4x8unorm(albedo);
    if labels.y == MATERIAL_CAR_PAINT && (marks.y >> 24u) != 0u {
        rgb = marks.y;
    }
    // Bit 0: shines; bit 1: scenery's lamp, which shines when it is dark or when somebody switched it.
    let by_itself = select(0u, 2u, (id >> 31u) == 1u);
    let lit = select(0u, ((marks.z >> labels.z) & 1u) | by_itself, labels.y == MATERIAL_LAMP && labels.z < 31u);
    out.labels = vec4(id, labels.x | (labels.y << 8u) | (lit << 16u), rgb, instance);
    return out;
}

@fragment
fn fs_main(in: Corner) -> Pixel {
    var out: Pixel;
    let depth_m = 1.0 / in.clip.w;
    let point = ray_in_camera(in.clip.xy) * depth_m;
    let normal = normalize(in.normal_in_world);
    out.depth_m = depth_m;
    out.class_code = in.labels.y & 0xffu;
    out.instance = in.labels.x;
    out.normal = vec4(normal, 0.0);
    if WITH_FLOW && marks_of(in.labels.w).w != 0u {
        let before = point_before(in.labels.w, point);
        // A point that was behind the near plane was nowhere in the image: no flow.
        if before.z >= view.frame.z {
            out.flow_px = in.clip.xy - pixel_of(before);
        }
    }
    // The normal as interpolated, not of unit length: shading makes it so.
    let n = vec3<u32>(clamp(in.normal_in_world * 0.5 + 0.5, vec3(0.0), vec3(1.0)) * vec3(2046.0, 2046.0, 1022.0) + 0.5);
    let look = (in.labels.z & 0xffffffu) | ((in.labels.y & 0x1f00u) << 16u) | ((in.labels.y >> 16u) << 29u);
    out.surface = vec4(n.x | (n.y << 11u) | (n.z << 22u), look, bitcast<vec2<u32>>(in.uv_m));
    return out;
}

// One triangle over the whole image at infinity.
@vertex
fn vs_sky(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    let xy = vec2(f32((corner << 1u) & 2u), f32(corner & 2u)) * 2.0 - 1.0;
    return vec4(xy, 0.0, 1.0);
}

const CLASS_SKY: u32 = 11u;

@fragment
fn fs_sky(@builtin(position) at: vec4<f32>) -> Pixel {
    var out: Pixel;
    let ray = ray_in_camera(at.xy);
    out.surface = vec4(0u);
    out.depth_m = view.frame.w;
    out.class_code = CLASS_SKY;
    out.instance = 0u;
    out.normal = vec4(0.0);
    if WITH_FLOW && view.options.x != 0.0 {
        // Points at infinity move by the rotation alone.
        let before = rotate_rows(view.previous_from_camera, ray);
        if before.z > 0.0 {
            out.flow_px = at.xy - pixel_of(before);
        }
    }
    return out;
}
