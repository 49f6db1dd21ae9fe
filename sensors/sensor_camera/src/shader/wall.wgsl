// Walls: their windows, casings and blinds, and the light behind them.

// sRGB bytes to linear, without a power: a cubic, good to 0.5 % of white.
fn linear_of(packed: u32) -> vec3<f32> {
    let s = unpack4x8unorm(packed).rgb;
    return s * (s * (s * 0.305306011 + 0.682171111) + 0.012522878);
}

// A hash: four values in 0..=1 for a number (a step of the PCG generator, O'Neill 2014).
fn lot_of(number: u32) -> vec4<f32> {
    let state = number * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return unpack4x8unorm((word >> 22u) ^ word);
}

const MATERIAL_ASPHALT: u32 = 1u;
const MATERIAL_CONCRETE: u32 = 2u;
const MATERIAL_PAINT: u32 = 3u;
const MATERIAL_FACADE: u32 = 4u;
const MATERIAL_SHOP_FRONT: u32 = 5u;

// A wall's grid of windows at a point: shares of pane and casing, and the window's hash.
struct Window {
    pane: f32,
    casing: f32,
    lot: vec4<f32>,
}

fn window_at(uv_m: vec2<f32>, style: vec4<f32>, pixel_m: f32, shop: bool, id: u32) -> Window {
    let pitch_m = select(vec2(2.6 + 1.4 * style.x, 3.1), vec2(4.2, 3.6), shop);
    let share = select(vec2(0.42 + 0.3 * style.y, 0.52), vec2(0.86, 0.72), shop);
    let grid = uv_m / pitch_m;
    let cell = floor(grid);
    let centred = abs(grid - cell - vec2(0.5, select(0.52, 0.44, shop))) - 0.5 * share;
    let soft = 0.7 * pixel_m / pitch_m + 0.002;
    // 1 inside, 0 outside, with a transition of one pixel; sills and casings reach a little
    // further.
    var pane = clamp(0.5 - centred / soft, vec2(0.0), vec2(1.0));
    // Two sashes, a post between them.
    pane.x *= clamp(0.5 + (centred.x + 0.5 * share.x - 0.035 / pitch_m.x) / soft.x, 0.0, 1.0);
    let casing = clamp(0.5 - (centred - 0.03) / soft, vec2(0.0), vec2(1.0));
    let fine = clamp(0.5 / pixel_m - 0.5, 0.0, 1.0);
    var out: Window;
    out.pane = mix(share.x * share.y, pane.x * pane.y, fine);
    out.casing = max(casing.x * casing.y - out.pane, 0.0) * fine;
    let column_row = vec2<u32>(vec2<i32>(cell));
    out.lot = lot_of(id * 64u + column_row.x + column_row.y * 1597u);
    return out;
}

// A wall at a point.
struct Wall {
    albedo: vec3<f32>,
    // Share of it that is a window's pane.
    pane: f32,
    // Light behind the pane relative to a lit window; 1 if its colour is cool.
    glow: f32,
    cool: f32,
}

// Brightest that `glow` can be.
const GLOW_MOST: f32 = 1.35;

// is_wall is 1, or 0 where the surface is no wall.
fn wall_at(albedo: vec3<f32>, uv_m: vec2<f32>, id: u32, pixel_m: f32, is_shop: bool, is_wall: f32) -> Wall {
    let style = lot_of(id);
    let window = window_at(uv_m, style.barg, pixel_m, is_shop, id);
    var out: Wall;
    out.pane = window.pane * is_wall;
    // Less sky reaches the foot.
    out.albedo = albedo * mix(1.0, 0.72 + 0.28 * clamp(uv_m.y * 0.4, 0.0, 1.0), is_wall);
    out.albedo = mix(out.albedo, vec3(0.62, 0.6, 0.56) * (0.35 + 0.65 * style.b), window.casing * is_wall);
    let has_blind = f32(window.lot.b > 0.72 && !is_shop);
    let room = select(vec3(0.02, 0.024, 0.03), vec3(0.11, 0.095, 0.075) * (0.3 + window.lot.r), is_shop);
    out.albedo = mix(out.albedo, mix(room, vec3(0.32, 0.3, 0.26) * (0.5 + 0.5 * window.lot.r), has_blind), out.pane);
    out.cool = f32(window.lot.a > 0.8);
    let share = as_switched(id, vec3(1.0), light.lamps.windows_on_ratio).w * select(0.34, 0.8, is_shop);
    // Brighter below the ceiling lamp, and different in every room.
    let floor_up = fract(uv_m.y / select(3.1, 3.6, is_shop));
    out.glow = out.pane * f32(window.lot.b < share) * (0.12 + 0.88 * window.lot.a * window.lot.g) * (0.45 + 0.9 * floor_up);
    return out;
}

// Radiance of a window.
fn window_light(wall: Wall, id: u32) -> vec3<f32> {
    let own = mix(vec3(1.0, 0.62, 0.30), vec3(0.85, 0.92, 1.0), wall.cool);
    return as_switched(id, own, light.lamps.windows_on_ratio).rgb * (light.lamps.window_radiance * wall.glow);
}
