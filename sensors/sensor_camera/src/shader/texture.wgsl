// Procedural surfaces: what a point of each material is like, before light falls on it.
//
// A software rasteriser runs every branch for every pixel, so there is one path for all materials, steered by a table
// (light.materials, from light.rs). Noise comes from a small texture; what has one value per window or wall, from a hash.

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

// Whether somebody switched lamps or windows of the scenery, and how, by object number: words as switched.rs makes them.
override WITH_SWITCHED: bool = false;
@group(0) @binding(6) var<storage, read> switched: array<vec2<u32>>;

// The light of lamps or windows: their colour, and how many of them shine.
fn as_switched(id: u32, rgb: vec3<f32>, share: f32) -> vec4<f32> {
    if !WITH_SWITCHED || (id >> 31u) == 0u {
        return vec4(rgb, share);
    }
    let words = switched[min(id & 0x7fffffffu, arrayLength(&switched) - 1u)];
    let state = (words.x >> 25u) & 3u;
    let color = select(rgb, linear_of(words.x), ((words.x >> 24u) & 1u) == 1u);
    return vec4(color * bitcast<f32>(words.y), select(share, f32(state == 1u), state != 0u));
}

const MATERIAL_ASPHALT: u32 = 1u;
const MATERIAL_CONCRETE: u32 = 2u;
const MATERIAL_PAINT: u32 = 3u;
const MATERIAL_FACADE: u32 = 4u;
const MATERIAL_SHOP_FRONT: u32 = 5u;

// What light meets at a point.
struct Finish {
    albedo: vec3<f32>,
    // Radiance of its own.
    emitted: vec3<f32>,
    // Share mirrored at normal incidence; 0: nothing is mirrored at any angle.
    mirror: f32,
    // Level of the sky map that it mirrors.
    rough: f32,
    // Share of light that goes through (leaves).
    through: f32,
    // How much of the point is under standing water.
    puddle: f32,
}

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

// The surface of a wall, a road, a leaf. pixel_m: width of a pixel at this depth; cosine: of the angle of views[which].
fn finish_at(world_m: vec3<f32>, normal: vec3<f32>, uv_m: vec2<f32>, labels: vec4<u32>, pixel_m: f32, cosine: f32) -> Finish {
    let id = labels.x;
    let material = (labels.y >> 8u) & 0xffu;
    let lit_lamp = vec2(f32((labels.y >> 16u) & 1u), f32((labels.y >> 17u) & 1u));
    let base = light.materials[min(material, 16u)];
    let gloss = light.mirrors[min(material, 16u)];
    var out: Finish;

    // Grain on the plane that the surface faces most.
    let steep = abs(normal);
    let ground = steep.z >= max(steep.x, steep.y);
    let plane_m = select(vec2(select(world_m.x, world_m.y, steep.x > steep.y), world_m.z), world_m.xy, ground);
    var rough_at: vec2<f32>;
    if SIMPLE {
        // One look at the finest level; grain goes where pixels are larger than it.
        let seen = noise(plane_m * base.x, 0.0).rg;
        rough_at = 0.5 + (seen - 0.5) * clamp(vec2(1.6, 6.0) - 0.5 * pixel_m * base.x * vec2(1.0, 0.25), vec2(0.0), vec2(1.0));
    } else {
        let pixel_on_plane_m = pixel_m * inverseSqrt(max(cosine, 0.04));
        rough_at.x = noise(plane_m * base.x, log2(pixel_on_plane_m * base.x)).r;
        rough_at.y = noise(plane_m * base.z + vec2(57.0, 91.0), log2(pixel_on_plane_m * base.z)).g;
    }
    var albedo = linear_of(labels.z) * max(1.0 + base.y * (rough_at.x - 0.5) + base.w * (rough_at.y - 0.5), 0.0);

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
    out.emitted = vec3(0.0);
    if WITH_LAMPS {
        let own = mix(vec3(1.0, 0.62, 0.30), vec3(0.85, 0.92, 1.0), f32(window.lot.a > 0.8));
        let warm = as_switched(id, own, light.air.w);
        let is_lit = f32(window.lot.b < warm.w * select(0.34, 0.8, is_shop));
        // Brighter below the ceiling lamp, and not two rooms alike.
        let floor_up = fract(uv_m.y / select(3.1, 3.6, is_shop));
        out.emitted = warm.rgb * (light.lamps.y * is_lit * pane * (0.12 + 0.88 * window.lot.a * window.lot.g) * (0.45 + 0.9 * floor_up));
    }

    // A lamp is on when told to, scenery's lamps also when it is dark.
    let shining = as_switched(id, albedo, light.air.x);
    let on = max(lit_lamp.x, shining.w * lit_lamp.y) * gloss.w;
    out.emitted += shining.rgb * (light.lamps.x * on);
    // Unlit, coloured glass is dark.
    let palest = min(albedo.r, min(albedo.g, albedo.b)) / max(max(albedo.r, max(albedo.g, albedo.b)), 0.01);
    albedo *= 1.0 - gloss.w * mix(0.88, 0.6, palest);

    out.mirror = max(gloss.x, 0.16 * pane);
    out.rough = mix(gloss.y, 2.0, pane);
    out.through = gloss.z;
    out.puddle = 0.0;
    if WITH_WET {
        // Rain darkens what soaks it up; roads shine when wet, and water stands where they are low.
        let soaks = light.air.z * (1.0 - gloss.w) * select(0.35, 1.0, ground);
        let paved = f32(ground && material >= MATERIAL_ASPHALT && material <= MATERIAL_PAINT);
        let low = noise(world_m.xy * 1.7 + vec2(11.0, 29.0), log2(pixel_m * 1.7)).g;
        out.puddle = smoothstep(0.0, 0.06, light.rain.w - low) * paved * smoothstep(0.985, 0.998, normal.z);
        albedo *= (1.0 - 0.45 * soaks) * (1.0 - 0.5 * out.puddle);
        let film = max(0.035 * light.air.z * paved, 0.02 * f32(out.puddle > 0.0));
        out.mirror = max(out.mirror, film);
        out.rough = mix(mix(out.rough, 2.6, 0.9 * light.air.z * paved), 0.0, out.puddle);
    }
    out.albedo = albedo;
    return out;
}
