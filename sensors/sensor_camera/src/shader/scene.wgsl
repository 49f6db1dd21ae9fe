// What every view knows: mirrors of the structs in uniform.rs, and the bindings.

// Mirror of InstanceData.
struct Instance {
    camera_from_mesh: array<vec4<f32>, 3>,
    previous_from_camera: array<vec4<f32>, 3>,
    world_from_mesh_xyzw: vec4<f32>,
    object_id: u32,
    tint: u32,
    lamps: u32,
    moved: u32,
}

// Mirror of ViewData.
struct ViewUniform {
    lens_px: vec4<f32>,
    frame: vec4<f32>,
    world_from_camera: array<vec4<f32>, 3>,
    previous_from_camera: array<vec4<f32>, 3>,
    shadow_from_camera: array<vec4<f32>, 3>,
    far_shadow_from_camera: array<vec4<f32>, 3>,
    options: vec4<f32>,
    // First lamp, first tile of lamps, a texel of the far shadow map in its depth.
    lamps: vec4<u32>,
    // First draw call, their number, first pixel in the list of what was seen (resolve.wgsl); bits of the targets that are wanted.
    raster: vec4<u32>,
    // Where compute shaders find its images and shadow maps: layer of its targets, of the near map, of the far map.
    layers: vec4<u32>,
    // Where in those layers: x, y of the near map in sides of itself, its side in sides of the layer.
    tile: vec4<f32>,
    // The same of the far map.
    far_tile: vec4<f32>,
    // A uniform's offset can be a multiple of 256 only.
    rest: array<vec4<u32>, 12>,
}

// Mirror of LightData.
struct LightUniform {
    sun_towards: vec4<f32>,
    sun_rgb: vec4<f32>,
    ambient_rgb: vec4<f32>,
    ambient_slope_rgb: array<vec4<f32>, 3>,
    fog_rgb: vec4<f32>,
    air: vec4<f32>,
    lamps: vec4<f32>,
    fog: vec4<f32>,
    rain: vec4<f32>,
    materials: array<vec4<f32>, 17>,
    mirrors: array<vec4<f32>, 17>,
    looks: array<vec4<u32>, 17>,
}

@group(0) @binding(2) var sky_map: texture_2d<f32>;
@group(0) @binding(3) var sky_sampler: sampler;
@group(0) @binding(4) var noise_map: texture_2d<f32>;
@group(0) @binding(5) var noise_sampler: sampler;
@group(1) @binding(2) var shadow_sampler: sampler_comparison;

// Rows of [rotation | translation] applied to a point.
fn transform(m: array<vec4<f32>, 3>, point: vec3<f32>) -> vec3<f32> {
    let p = vec4(point, 1.0);
    return vec3(dot(m[0], p), dot(m[1], p), dot(m[2], p));
}

fn rotate_rows(m: array<vec4<f32>, 3>, v: vec3<f32>) -> vec3<f32> {
    return vec3(dot(m[0].xyz, v), dot(m[1].xyz, v), dot(m[2].xyz, v));
}

// Rotates by a unit quaternion xyzw.
fn rotate(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}

// Direction through a pixel with camera z = 1: times the depth it is the point.
fn ray_in_camera(pixel: vec2<f32>) -> vec3<f32> {
    return vec3((pixel - views[which].lens_px.zw) / views[which].lens_px.xy, 1.0);
}

fn pixel_of(point_in_camera: vec3<f32>) -> vec2<f32> {
    return point_in_camera.xy / point_in_camera.z * views[which].lens_px.xy + views[which].lens_px.zw;
}
