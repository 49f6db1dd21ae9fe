// Light and view as the corners of the triangle carry them: llvmpipe fetches a number of a uniform once for every pixel, with a check of
// its bounds, and a flat value of a triangle only once for eight.

@group(0) @binding(0) var<uniform> bound_light: LightUniform;
@group(1) @binding(0) var<uniform> bound_views: array<ViewUniform, 32>;

var<private> light: LightUniform;
var<private> views: array<ViewUniform, 1>;

struct Carried {
    @builtin(position) @invariant at: vec4<f32>,
    @location(0) @interpolate(flat) lens_px: vec4<f32>,
    @location(1) @interpolate(flat) frame: vec4<f32>,
    @location(2) @interpolate(flat) world_x: vec4<f32>,
    @location(3) @interpolate(flat) world_y: vec4<f32>,
    @location(4) @interpolate(flat) world_z: vec4<f32>,
    @location(5) @interpolate(flat) shadow_x: vec4<f32>,
    @location(6) @interpolate(flat) shadow_y: vec4<f32>,
    @location(7) @interpolate(flat) shadow_z: vec4<f32>,
    @location(8) @interpolate(flat) options: vec4<f32>,
    @location(9) @interpolate(flat) sun_towards: vec4<f32>,
    @location(10) @interpolate(flat) sun_rgb: vec4<f32>,
    @location(11) @interpolate(flat) ambient_rgb: vec4<f32>,
    @location(12) @interpolate(flat) slope_x: vec4<f32>,
    @location(13) @interpolate(flat) slope_y: vec4<f32>,
    @location(14) @interpolate(flat) slope_z: vec4<f32>,
    @location(15) @interpolate(flat) fog_rgb: vec4<f32>,
    @location(16) @interpolate(flat) air: vec4<f32>,
    @location(17) @interpolate(flat) lamps: vec4<f32>,
    @location(18) @interpolate(flat) fog: vec4<f32>,
    @location(19) @interpolate(flat) rain: vec4<f32>,
    @location(20) @interpolate(flat) first_lamps: vec4<u32>,
}

fn carry(at: vec4<f32>) -> Carried {
    let view = bound_views[0];
    var out: Carried;
    out.at = at;
    out.lens_px = view.lens_px;
    out.frame = view.frame;
    out.world_x = view.world_from_camera[0];
    out.world_y = view.world_from_camera[1];
    out.world_z = view.world_from_camera[2];
    out.shadow_x = view.shadow_from_camera[0];
    out.shadow_y = view.shadow_from_camera[1];
    out.shadow_z = view.shadow_from_camera[2];
    out.options = view.options;
    out.first_lamps = view.lamps;
    out.sun_towards = bound_light.sun_towards;
    out.sun_rgb = bound_light.sun_rgb;
    out.ambient_rgb = bound_light.ambient_rgb;
    out.slope_x = bound_light.ambient_slope_rgb[0];
    out.slope_y = bound_light.ambient_slope_rgb[1];
    out.slope_z = bound_light.ambient_slope_rgb[2];
    out.fog_rgb = bound_light.fog_rgb;
    out.air = bound_light.air;
    out.lamps = bound_light.lamps;
    out.fog = bound_light.fog;
    out.rain = bound_light.rain;
    return out;
}

fn unload(carried: Carried) {
    views[0].lens_px = carried.lens_px;
    views[0].frame = carried.frame;
    views[0].world_from_camera[0] = carried.world_x;
    views[0].world_from_camera[1] = carried.world_y;
    views[0].world_from_camera[2] = carried.world_z;
    views[0].shadow_from_camera[0] = carried.shadow_x;
    views[0].shadow_from_camera[1] = carried.shadow_y;
    views[0].shadow_from_camera[2] = carried.shadow_z;
    views[0].options = carried.options;
    views[0].lamps = carried.first_lamps;
    light.sun_towards = carried.sun_towards;
    light.sun_rgb = carried.sun_rgb;
    light.ambient_rgb = carried.ambient_rgb;
    light.ambient_slope_rgb[0] = carried.slope_x;
    light.ambient_slope_rgb[1] = carried.slope_y;
    light.ambient_slope_rgb[2] = carried.slope_z;
    light.fog_rgb = carried.fog_rgb;
    light.air = carried.air;
    light.lamps = carried.lamps;
    light.fog = carried.fog;
    light.rain = carried.rain;
}

// A material's rows of the tables.
fn look_of(material: u32) -> vec2<u32> {
    return bound_light.looks[min(material, 16u)].xy;
}

fn roughness_of(material: u32) -> vec4<f32> {
    return bound_light.materials[min(material, 16u)];
}

fn mirror_of(material: u32) -> vec4<f32> {
    return bound_light.mirrors[min(material, 16u)];
}
