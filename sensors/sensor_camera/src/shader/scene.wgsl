// Mirrors of the structs in uniform.rs, and bindings that all passes share.

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

// Where a shadow map lies in its layer.
struct MapPlace {
    // x, y in sides of the map.
    tile: vec2<f32>,
    // Side of the map in sides of the layer.
    side: f32,
    layer: u32,
}

// Mirror of ViewData.
struct ViewUniform {
    // Focal length x, y, principal point x, y.
    lens_px: vec4<f32>,
    size_px: vec2<f32>,
    near_m: f32,
    // Infinite.
    sky_depth_m: f32,
    world_from_camera: array<vec4<f32>, 3>,
    previous_from_camera: array<vec4<f32>, 3>,
    shadow_from_camera: array<vec4<f32>, 3>,
    far_shadow_from_camera: array<vec4<f32>, 3>,
    // 1 if the camera turned.
    turned: f32,
    // 1 if there are shadow maps.
    has_shadows: f32,
    // A texel of each shadow map in units of its depth.
    shadow_texel_depth: f32,
    far_shadow_texel_depth: f32,
    first_lamp: u32,
    first_lamp_tile: u32,
    // Where compute shaders find its targets.
    layer: u32,
    // Bits of the targets that are wanted.
    wanted: u32,
    // First draw call, their number, and first pixel in the list of what was seen (resolve.wgsl).
    first_draw: u32,
    n_draws: u32,
    first_pixel: u32,
    n_blockers: u32,
    // Where compute shaders find its shadow maps.
    near_map: MapPlace,
    far_map: MapPlace,
    // Boxes of what moves, two each: light.wgsl.
    blockers: array<vec4<f32>, 12>,
    // A uniform's offset can be a multiple of 256 only.
    rest: vec4<u32>,
}

// Mirror of SunData.
struct Sun {
    // In the world; the moon's by night.
    towards: vec3<f32>,
    // Cosine of the disc's radius.
    disc_cosine: f32,
    // Irradiance of a surface that faces it.
    rgb: vec3<f32>,
    // Radiance of the disc over `rgb`.
    disc_gain: f32,
}

// Mirror of AmbientData.
struct Ambient {
    // Irradiance from sky and ground, constant term.
    rgb: vec3<f32>,
    // The zenith's radiance over what falls on level ground.
    zenith_ratio: f32,
    // Change of `rgb` along world x, y, z.
    slope_rgb: array<vec4<f32>, 3>,
}

// Mirror of FogData.
struct Fog {
    // Colour of the air far away.
    rgb: vec3<f32>,
    begin_m: f32,
    // Extinction at height 0, and its fall per metre of height.
    per_m: f32,
    falloff_per_m: f32,
    // Metres of fog above the eye towards the zenith.
    above_m: f32,
    // How much of the sun's light it throws forward.
    forward_ratio: f32,
    // Extinction of clear air.
    clear_air_per_m: f32,
    unused_x: u32,
    unused_y: u32,
    unused_z: u32,
}

// Mirror of WaterData.
struct Water {
    rain_ratio: f32,
    // Lean of the rain's streaks.
    lean: f32,
    // Wraps around.
    time_secs: f32,
    // Roads are under puddles where the cloud noise is below this.
    puddle_level: f32,
    wet_ratio: f32,
    unused_x: u32,
    unused_y: u32,
    unused_z: u32,
}

// Mirror of SceneryLampsData.
struct SceneryLamps {
    // Share of lamps that shine, and of windows that are lit.
    on_ratio: f32,
    windows_on_ratio: f32,
    radiance: f32,
    window_radiance: f32,
}

// Mirror of LightData.
struct LightUniform {
    sun: Sun,
    ambient: Ambient,
    fog: Fog,
    water: Water,
    lamps: SceneryLamps,
    // Tables by material: roughness_of(), mirror_of(), look_of().
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
