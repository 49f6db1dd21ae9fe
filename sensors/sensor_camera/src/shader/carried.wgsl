// Light and view as flat values of the triangle's corners: llvmpipe fetches each number of a
// uniform for every pixel, with a bounds check, but a flat value only once for eight pixels.

@group(0) @binding(0) var<uniform> bound_light: LightUniform;
@group(1) @binding(0) var<uniform> bound_views: array<ViewUniform, 32>;

var<private> light: LightUniform;
var<private> views: array<ViewUniform, 1>;

struct Carried {
    @builtin(position) @invariant at: vec4<f32>,
    @location(0) @interpolate(flat) lens_px: vec4<f32>,
    // Size in pixels, near plane, depth of the sky.
    @location(1) @interpolate(flat) size: vec4<f32>,
    @location(2) @interpolate(flat) world_x: vec4<f32>,
    @location(3) @interpolate(flat) world_y: vec4<f32>,
    @location(4) @interpolate(flat) world_z: vec4<f32>,
    @location(5) @interpolate(flat) shadow_x: vec4<f32>,
    @location(6) @interpolate(flat) shadow_y: vec4<f32>,
    @location(7) @interpolate(flat) shadow_z: vec4<f32>,
    // Whether it turned, whether there are shadow maps, a texel of each map in units of its depth.
    @location(8) @interpolate(flat) shadows: vec4<f32>,
    // Direction, cosine of the disc; irradiance, gain of the disc.
    @location(9) @interpolate(flat) sun_towards: vec4<f32>,
    @location(10) @interpolate(flat) sun_rgb: vec4<f32>,
    // Irradiance, the zenith's share; its slopes.
    @location(11) @interpolate(flat) ambient_rgb: vec4<f32>,
    @location(12) @interpolate(flat) slope_x: vec4<f32>,
    @location(13) @interpolate(flat) slope_y: vec4<f32>,
    @location(14) @interpolate(flat) slope_z: vec4<f32>,
    // Colour, where fog begins; extinction, its fall, metres above, light thrown forward.
    @location(15) @interpolate(flat) fog_rgb: vec4<f32>,
    @location(16) @interpolate(flat) fog: vec4<f32>,
    // Rain, its lean, time, puddles.
    @location(17) @interpolate(flat) water: vec4<f32>,
    // Shares of lamps and windows that shine, and their radiances.
    @location(18) @interpolate(flat) lamps: vec4<f32>,
    // Extinction of clear air, wetness.
    @location(19) @interpolate(flat) air: vec2<f32>,
    // First lamp, first tile of lamps, number of boxes.
    @location(20) @interpolate(flat) firsts: vec3<u32>,
}

fn carry(at: vec4<f32>) -> Carried {
    let view = bound_views[0];
    var out: Carried;
    out.at = at;
    out.lens_px = view.lens_px;
    out.size = vec4(view.size_px, view.near_m, view.sky_depth_m);
    out.world_x = view.world_from_camera[0];
    out.world_y = view.world_from_camera[1];
    out.world_z = view.world_from_camera[2];
    out.shadow_x = view.shadow_from_camera[0];
    out.shadow_y = view.shadow_from_camera[1];
    out.shadow_z = view.shadow_from_camera[2];
    out.shadows = vec4(view.turned, view.has_shadows, view.shadow_texel_depth, view.far_shadow_texel_depth);
    out.firsts = vec3(view.first_lamp, view.first_lamp_tile, view.n_blockers);
    let sun = bound_light.sun;
    out.sun_towards = vec4(sun.towards, sun.disc_cosine);
    out.sun_rgb = vec4(sun.rgb, sun.disc_gain);
    out.ambient_rgb = vec4(bound_light.ambient.rgb, bound_light.ambient.zenith_ratio);
    out.slope_x = bound_light.ambient.slope_rgb[0];
    out.slope_y = bound_light.ambient.slope_rgb[1];
    out.slope_z = bound_light.ambient.slope_rgb[2];
    let fog = bound_light.fog;
    out.fog_rgb = vec4(fog.rgb, fog.begin_m);
    out.fog = vec4(fog.per_m, fog.falloff_per_m, fog.above_m, fog.forward_ratio);
    let water = bound_light.water;
    out.water = vec4(water.rain_ratio, water.lean, water.time_secs, water.puddle_level);
    let lamps = bound_light.lamps;
    out.lamps = vec4(lamps.on_ratio, lamps.windows_on_ratio, lamps.radiance, lamps.window_radiance);
    out.air = vec2(fog.clear_air_per_m, water.wet_ratio);
    return out;
}

fn unload(carried: Carried) {
    views[0].lens_px = carried.lens_px;
    views[0].size_px = carried.size.xy;
    views[0].near_m = carried.size.z;
    views[0].sky_depth_m = carried.size.w;
    views[0].world_from_camera[0] = carried.world_x;
    views[0].world_from_camera[1] = carried.world_y;
    views[0].world_from_camera[2] = carried.world_z;
    views[0].shadow_from_camera[0] = carried.shadow_x;
    views[0].shadow_from_camera[1] = carried.shadow_y;
    views[0].shadow_from_camera[2] = carried.shadow_z;
    views[0].turned = carried.shadows.x;
    views[0].has_shadows = carried.shadows.y;
    views[0].shadow_texel_depth = carried.shadows.z;
    views[0].far_shadow_texel_depth = carried.shadows.w;
    views[0].first_lamp = carried.firsts.x;
    views[0].first_lamp_tile = carried.firsts.y;
    views[0].n_blockers = carried.firsts.z;
    light.sun.towards = carried.sun_towards.xyz;
    light.sun.disc_cosine = carried.sun_towards.w;
    light.sun.rgb = carried.sun_rgb.rgb;
    light.sun.disc_gain = carried.sun_rgb.w;
    light.ambient.rgb = carried.ambient_rgb.rgb;
    light.ambient.zenith_ratio = carried.ambient_rgb.w;
    light.ambient.slope_rgb[0] = carried.slope_x;
    light.ambient.slope_rgb[1] = carried.slope_y;
    light.ambient.slope_rgb[2] = carried.slope_z;
    light.fog.rgb = carried.fog_rgb.rgb;
    light.fog.begin_m = carried.fog_rgb.w;
    light.fog.per_m = carried.fog.x;
    light.fog.falloff_per_m = carried.fog.y;
    light.fog.above_m = carried.fog.z;
    light.fog.forward_ratio = carried.fog.w;
    light.fog.clear_air_per_m = carried.air.x;
    light.water.rain_ratio = carried.water.x;
    light.water.lean = carried.water.y;
    light.water.time_secs = carried.water.z;
    light.water.puddle_level = carried.water.w;
    light.water.wet_ratio = carried.air.y;
    light.lamps.on_ratio = carried.lamps.x;
    light.lamps.windows_on_ratio = carried.lamps.y;
    light.lamps.radiance = carried.lamps.z;
    light.lamps.window_radiance = carried.lamps.w;
}

// Half of a box (light.wgsl).
fn blocker_of(half: u32) -> vec4<f32> {
    return bound_views[0].blockers[min(half, 11u)];
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
