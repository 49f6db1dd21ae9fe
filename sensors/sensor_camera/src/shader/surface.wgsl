// What each modality keeps of a surface or of the sky. Drawn geometry (geometry_attached.wgsl,
// geometry_listed.wgsl) and computed geometry (resolve.wgsl) share it.

// Attachments; locations are the numbers of Target in target/kind.rs.
struct Pixel {
    // For shade.wgsl; surface_wide.wgsl or surface_slim.wgsl defines it.
    @location(0) surface: Surface,
    @location(1) depth_m: f32,
    @location(2) class_code: u32,
    @location(3) instance: u32,
    @location(4) flow_px: vec2<f32>,
    @location(5) normal: vec4<f32>,
}

const MATERIAL_CAR_PAINT: u32 = 10u;
const MATERIAL_LAMP: u32 = 14u;

// From a corner's attributes and its instance: object id; class, material, lit; albedo R G B A.
fn labels_of(albedo: u32, labels: vec4<u32>, object_id: u32, marks: vec4<u32>) -> vec3<u32> {
    let id = select(object_id, marks.x, object_id == 0u);
    let rgb = select(albedo, marks.y, labels.y == MATERIAL_CAR_PAINT && (marks.y >> 24u) != 0u);
    // Bit 0: shines. Bit 1: a lamp of the scenery, which shines when it is dark or was switched on.
    let by_itself = select(0u, 2u, (id >> 31u) == 1u);
    let lit = select(0u, ((marks.z >> (labels.z & 31u)) & 1u) | by_itself, labels.y == MATERIAL_LAMP && labels.z < 31u);
    return vec3(id, labels.x | (labels.y << 8u) | (lit << 16u), rgb);
}

// A surface at a pixel, without flow. The normal is the interpolated one; shading normalises it.
// pixel_m is the width of a pixel at this depth.
fn surface_pixel(depth_m: f32, normal_in_world: vec3<f32>, uv_m: vec2<f32>, labels: vec3<u32>, pixel_m: f32) -> Pixel {
    var out: Pixel;
    out.depth_m = depth_m;
    out.class_code = labels.y & 0xffu;
    out.instance = labels.x;
    out.normal = vec4(normalize(normal_in_world), 0.0);
    out.surface = surface_of(normal_in_world, labels, uv_m, pixel_m);
    return out;
}

const CLASS_SKY: u32 = 11u;

// The sky at a pixel, without flow. far_m is infinite.
fn sky_pixel(far_m: f32) -> Pixel {
    var out: Pixel;
    out.surface = Surface(0u);
    out.depth_m = far_m;
    out.class_code = CLASS_SKY;
    out.instance = 0u;
    out.normal = vec4(0.0);
    return out;
}
