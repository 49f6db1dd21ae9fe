// Colour: procedural surfaces, sun, sky, shadow, air, film; for the geometry pass or the shading pass. Nothing here touches labels, depth or flow.
//
// A software rasteriser runs every branch for every pixel, so there is one path for all materials, steered by a table
// (light.materials, from light.rs). Noise comes from a small texture; what has one value per window or wall, from a hash.

// Low quality: one fetch of noise instead of two, and mirrors show a plain gradient of the sky.
override SIMPLE: bool = false;

fn luminance_of(rgb: vec3<f32>) -> f32 {
    return dot(rgb, vec3(0.2126, 0.7152, 0.0722));
}

// Filmic curve with the display's gamma in it (Hejl and Burgess-Dawson 2010).
fn display(radiance: vec3<f32>) -> vec3<f32> {
    let x = max(radiance - 0.004, vec3(0.0));
    return (x * (6.2 * x + 0.5)) / (x * (6.2 * x + 1.7) + 0.06);
}

// B, G, R, A bytes.
fn packed_color(radiance: vec3<f32>) -> u32 {
    return pack4x8unorm(vec4(display(radiance).bgr, 1.0));
}

// sRGB bytes to linear, without a power: a cubic, good to 0.5 % of white.
fn linear_of(packed: u32) -> vec3<f32> {
    let s = unpack4x8unorm(packed).rgb;
    return s * (s * (s * 0.305306011 + 0.682171111) + 0.012522878);
}

const NOISE_SIDE: i32 = 256;

// R: grain, G: clouds of many sizes, B and A: white noise. `at` in texels.
fn noise(at: vec2<f32>, level: f32) -> vec4<f32> {
    return textureSampleLevel(noise_map, noise_sampler, at * (1.0 / f32(NOISE_SIDE)), level);
}

// Four values in 0..=1 that belong to a number (a step of the PCG generator, O'Neill 2014).
fn lot_of(number: u32) -> vec4<f32> {
    let state = number * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return unpack4x8unorm((word >> 22u) ^ word);
}

// Octahedral map of the upper hemisphere: sky.rs writes what this reads.
fn sky_sample(direction: vec3<f32>, level: f32) -> vec3<f32> {
    let d = vec3(direction.xy, max(direction.z, 0.0));
    let p = d.xy / (abs(d.x) + abs(d.y) + d.z);
    let uv = vec2(p.x + p.y, p.x - p.y) * 0.5 + 0.5;
    return textureSampleLevel(sky_map, sky_sampler, uv, level).rgb;
}

fn sky_radiance(direction: vec3<f32>) -> vec3<f32> {
    var rgb = sky_sample(direction, 0.0);
    let towards = dot(direction, light.sun_towards.xyz);
    let disc = smoothstep(light.sun_towards.w, light.sun_towards.w + 0.00001, towards);
    var glow = max((towards - 0.995) * 200.0, 0.0);
    glow = glow * glow;
    glow = glow * glow * 0.02;
    rgb += light.sun_rgb.rgb * (light.sun_rgb.w * disc + glow * glow);
    // Below the horizon: ground far away, as the air shows it.
    rgb = mix(rgb, light.fog_rgb.rgb * 0.75, clamp(-direction.z * 12.0, 0.0, 1.0));
    // Fog lies some 150 m thick: nearly all of it before the horizon, little before the zenith.
    let fog = 1.0 - exp(-light.lamps.z * 150.0 / (max(direction.z, 0.0) + 0.05));
    return mix(rgb, light.fog_rgb.rgb, fog);
}

fn shadow_at(point_in_camera: vec3<f32>, facing: f32) -> f32 {
    let at = transform(view.shadow_from_camera, point_in_camera);
    let edge = max(abs(at.x - 0.5), abs(at.y - 0.5));
    // Slope-scaled: a texel seen at a grazing angle spans a range of depths.
    let biased = at.z - view.options.w * (0.6 + 3.0 * (1.0 - abs(facing)));
    let lit = textureSampleCompareLevel(shadow_map, shadow_sampler, at.xy, biased);
    // No map, or beyond it: no shadow.
    return mix(1.0, lit, view.options.y * (1.0 - smoothstep(0.42, 0.49, edge)));
}

const MATERIAL_CONCRETE: u32 = 2u;
const MATERIAL_FACADE: u32 = 4u;
const MATERIAL_SHOP_FRONT: u32 = 5u;

// A wall's grid of windows at this place: what is pane, what is frame, and the window's lot.
struct Window {
    pane: f32,
    frame: f32,
    lot: vec4<f32>,
}

fn window_at(uv_m: vec2<f32>, style: vec4<f32>, pixel_m: f32, shop: bool, id: u32) -> Window {
    let pitch_m = select(vec2(2.6 + 1.4 * style.x, 3.1), vec2(4.2, 3.6), shop);
    let share = select(vec2(0.42 + 0.3 * style.y, 0.52), vec2(0.86, 0.72), shop);
    let grid = uv_m / pitch_m;
    let cell = floor(grid);
    let centred = abs(grid - cell - vec2(0.5, select(0.52, 0.44, shop))) - 0.5 * share;
    let soft = 0.7 * pixel_m / pitch_m + 0.002;
    // 1 inside, 0 outside, a pixel wide in between; sills and frames reach a little further.
    let pane = clamp(0.5 - centred / soft, vec2(0.0), vec2(1.0));
    let frame = clamp(0.5 - (centred - 0.03) / soft, vec2(0.0), vec2(1.0));
    let fine = clamp(0.5 / pixel_m - 0.5, 0.0, 1.0);
    var out: Window;
    out.pane = mix(share.x * share.y, pane.x * pane.y, fine);
    out.frame = max(frame.x * frame.y - out.pane, 0.0) * fine;
    let column_row = vec2<u32>(vec2<i32>(cell));
    out.lot = lot_of(id * 64u + column_row.x + column_row.y * 1597u);
    return out;
}

// Radiance towards the eye, with the air in between. pixel_m: width of a pixel at this depth.
fn shade(point_in_camera: vec3<f32>, normal: vec3<f32>, uv_m: vec2<f32>, labels: vec4<u32>, pixel_m: f32) -> vec3<f32> {
    let offset = rotate_rows(view.world_from_camera, point_in_camera);
    let world_m = offset + vec3(view.world_from_camera[0].w, view.world_from_camera[1].w, view.world_from_camera[2].w);
    let distance_m = length(offset);
    let towards_point = offset / distance_m;
    let cosine = clamp(-dot(towards_point, normal), 0.0, 1.0);
    let id = labels.x;
    let material = (labels.y >> 8u) & 0xffu;
    let lit_lamp = f32(labels.y >> 16u);
    let base = light.materials[min(material, 16u)];
    let gloss = light.mirrors[min(material, 16u)];

    // Grain on the plane that the surface faces most.
    let steep = abs(normal);
    let ground = steep.z >= max(steep.x, steep.y);
    let plane_m = select(vec2(select(world_m.x, world_m.y, steep.x > steep.y), world_m.z), world_m.xy, ground);
    let pixel_on_plane_m = pixel_m * inverseSqrt(max(cosine, 0.04));
    let fine = noise(plane_m * base.x, log2(pixel_on_plane_m * base.x));
    var clouds = fine.g;
    if !SIMPLE {
        clouds = noise(plane_m * base.z + vec2(57.0, 91.0), log2(pixel_on_plane_m * base.z)).g;
    }
    var albedo = linear_of(labels.z) * max(1.0 + base.y * (fine.r - 0.5) + base.w * (clouds - 0.5), 0.0);

    // Slabs of one metre with dark joints.
    let joint_m = 0.5 - abs(fract(world_m.xy) - 0.5);
    let joint = clamp((0.012 - min(joint_m.x, joint_m.y)) / (0.6 * pixel_m + 0.004) + 0.5, 0.0, 1.0) * clamp(0.1 / pixel_m - 0.5, 0.0, 1.0);
    albedo *= 1.0 - select(0.0, 0.35 * joint, material == MATERIAL_CONCRETE && ground);

    // Walls: windows with their own glass, blind and lamp; less sky reaches the foot.
    let is_shop = material == MATERIAL_SHOP_FRONT;
    let is_wall = f32(is_shop || material == MATERIAL_FACADE) * f32(!ground);
    let style = lot_of(id);
    let window = window_at(uv_m, style.barg, pixel_m, is_shop, id);
    let pane = window.pane * is_wall;
    albedo *= mix(1.0, 0.72 + 0.28 * clamp(uv_m.y * 0.4, 0.0, 1.0), is_wall);
    albedo = mix(albedo, vec3(0.62, 0.6, 0.56) * (0.35 + 0.65 * style.b), window.frame * is_wall);
    let has_blind = f32(window.lot.b > 0.72 && !is_shop);
    let room = select(vec3(0.02, 0.024, 0.03), vec3(0.11, 0.095, 0.075) * (0.3 + window.lot.r), is_shop);
    albedo = mix(albedo, mix(room, vec3(0.32, 0.3, 0.26) * (0.5 + 0.5 * window.lot.r), has_blind), pane);
    let is_lit = f32(window.lot.b < light.air.w * select(0.42, 0.85, is_shop));
    let warm = mix(vec3(1.0, 0.66, 0.34), vec3(0.85, 0.92, 1.0), f32(window.lot.a > 0.8));
    var emitted = warm * (light.lamps.y * is_lit * pane * (0.25 + 0.75 * window.lot.a));

    // A lamp is on when told to, scenery's lamps also when it is dark.
    let on = max(lit_lamp, light.air.x * f32(id >> 31u)) * gloss.w;
    emitted += albedo * (light.lamps.x * on);
    albedo *= 1.0 - 0.6 * gloss.w;
    albedo *= 1.0 - light.air.z * select(0.0, 0.45, ground);

    let sun = light.sun_towards.xyz;
    let facing = dot(normal, sun);
    let through = gloss.z;
    let direct = max(facing, 0.0) * (1.0 - through) + through * (0.35 + 0.65 * abs(facing));
    let lit = shadow_at(point_in_camera, facing);
    let sky = light.ambient_rgb.rgb + normal.x * light.ambient_slope_rgb[0].rgb + normal.y * light.ambient_slope_rgb[1].rgb
        + normal.z * light.ambient_slope_rgb[2].rgb;
    var radiance = albedo * (light.sun_rgb.rgb * (direct * lit) + max(sky, vec3(0.0))) * 0.318309886 + emitted;

    // Schlick's Fresnel, weaker at grazing angles where the surface is rough; panes mirror like glass, wet ground a little.
    let mirror = max(gloss.x, max(0.16 * pane, 0.10 * light.air.z * f32(ground)));
    let rough = mix(gloss.y, 2.0, max(pane, 0.8 * light.air.z * f32(ground)));
    let sharp = clamp((5.5 - rough) * 0.25, 0.1, 1.0);
    let away = 1.0 - cosine;
    let away2 = away * away;
    let fresnel = (mirror + max(0.75 - mirror, 0.0) * sharp * away2 * away2 * away) * f32(mirror > 0.0);
    let mirrored = reflect(towards_point, normal);
    // Streets mirror houses below some 20 degrees; what lies there is as bright as a wall in the shade.
    var above: vec3<f32>;
    if SIMPLE {
        above = mix(light.fog_rgb.rgb, (light.ambient_rgb.rgb + light.ambient_slope_rgb[2].rgb) * 0.22, sqrt(clamp(mirrored.z, 0.0, 1.0)));
    } else {
        above = sky_sample(mirrored, rough);
    }
    let seen = mix(light.ambient_rgb.rgb * 0.09, above, smoothstep(-0.05, 0.35, mirrored.z));
    var glint = max(dot(mirrored, sun), 0.0);
    glint = glint * glint;
    glint = glint * glint;
    glint = glint * glint;
    glint = glint * glint;
    glint = glint * glint; // 32nd power
    var keen = glint * glint;
    keen = keen * keen;
    keen = keen * keen; // 256th
    let shine = mix(0.5 * glint, 5.0 * keen, sharp) * lit;
    radiance = mix(radiance, seen + light.sun_rgb.rgb * shine, fresnel);

    let haze = 1.0 - exp(-light.fog_rgb.w * max(distance_m - light.air.y, 0.0));
    return mix(radiance, light.fog_rgb.rgb, haze);
}
