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

// How a house was built, from its hash.
struct Style {
    // Size of the grid of windows, and the share of a cell that an opening takes.
    pitch_m: vec2<f32>,
    share: vec2<f32>,
    // Posts and bars that part an opening.
    n_parts: vec2<f32>,
    // Whether the wall is of bricks, of panels; has courses between its storeys, and downpipes.
    brick: f32,
    panels: f32,
    courses: f32,
    pipes: f32,
    // Paleness of frames and sills.
    pale: f32,
    // Paint of a shop's board.
    board: vec3<f32>,
}

fn style_of(id: u32, shop: bool) -> Style {
    let lot = lot_of(id);
    // Digits that come after those of `lot`.
    let more = fract(lot * 21.25);
    let house = f32(!shop);
    var out: Style;
    out.pitch_m = select(vec2(2.6 + 1.4 * lot.b, 3.1), vec2(4.2, 3.6), shop);
    out.share = select(vec2(0.36 + 0.3 * lot.a, 0.46 + 0.14 * more.b), vec2(0.88, 0.74), shop);
    out.n_parts = select(vec2(1.0 + floor(more.r * 2.99), 1.0 + floor(more.g * 2.4)), vec2(3.0, 1.0), shop);
    out.brick = f32(lot.r < 0.5) * house;
    out.panels = f32(lot.r > 0.82) * house;
    out.courses = f32(more.a < 0.6) * house;
    out.pipes = f32(more.b > 0.4) * house;
    out.pale = 0.3 + 0.6 * lot.g * lot.g;
    out.board = 0.04 + 0.3 * more.rgb;
    return out;
}

// Pixels a metre; and how sharp edges are drawn, so that none is narrower than a pixel. Divisions are
// dear for a software rasteriser: there is one for all that follows.
struct Grain {
    px_per_m: f32,
    sharp_per_m: f32,
}

fn grain_of(pixel_m: f32) -> Grain {
    let px_per_m = 1.0 / (pixel_m + 0.004);
    return Grain(px_per_m, 1.4 * px_per_m);
}

// 1 inside a band, 0 outside, with a transition of a pixel.
fn band(at_m: f32, low_m: f32, high_m: f32, sharp_per_m: f32) -> f32 {
    let half_m = 0.5 * (high_m - low_m);
    return clamp((half_m - abs(at_m - low_m - half_m)) * sharp_per_m + 0.5, 0.0, 1.0);
}

// A wall's grid of windows at a point.
struct Window {
    // Shares of glass, and of frame and sill.
    pane: f32,
    frame: f32,
    // Shade of reveal and sill on what lies there.
    shade: f32,
    // Place in the opening, 0 to 1 inside; place in the cell.
    place: vec2<f32>,
    in_cell: vec2<f32>,
    lot: vec4<f32>,
}

fn window_at(uv_m: vec2<f32>, style: Style, grain: Grain, shop: bool, id: u32) -> Window {
    let sharp = grain.sharp_per_m;
    let fine = clamp(0.5 * grain.px_per_m - 0.5, 0.0, 1.0);
    let size_m = style.share * style.pitch_m;
    let grid = uv_m / style.pitch_m;
    let cell = floor(grid);
    var out: Window;
    out.in_cell = grid - cell;
    // Metres from the opening's middle, and inside its edges.
    let off_m = (out.in_cell - vec2(0.5, select(0.52, 0.45, shop))) * style.pitch_m;
    let within_m = 0.5 * size_m - abs(off_m);
    out.place = off_m / size_m + 0.5;
    let opened = clamp(within_m * sharp + 0.5, vec2(0.0), vec2(1.0));
    let open = opened.x * opened.y;
    // Metres to the nearest post or bar; the opening's edges are such, too.
    let parts = (0.5 - abs(fract(out.place * style.n_parts) - 0.5)) * (size_m / style.n_parts);
    let glass = clamp((parts - vec2(0.04, 0.035)) * sharp + 0.5, vec2(0.0), vec2(1.0));
    let below_m = -0.5 * size_m.y - off_m.y;
    let beside = clamp((within_m.x + 0.07) * sharp + 0.5, 0.0, 1.0);
    let pane = open * glass.x * glass.y;
    out.pane = mix(0.8 * style.share.x * style.share.y, pane, fine);
    out.frame = max(open - pane, band(below_m, 0.0, 0.08, sharp) * beside) * fine;
    // The lintel's shade at the top of the recess, the reveal's at one side, the sill's below it,
    // and what the rain has washed down there.
    let recess = (1.0 - 0.6 * clamp(1.4 - (0.5 * size_m.y - off_m.y) * 6.25, 0.0, 1.0))
        * (1.0 - 0.45 * clamp(1.3 - (0.5 * size_m.x + off_m.x) * 11.0, 0.0, 1.0));
    let under = 1.0 - (0.36 * band(below_m, 0.08, 0.17, sharp) + 0.1 * band(below_m, 0.08, 0.75, sharp)) * beside;
    out.shade = mix(1.0, mix(under, recess, open), fine);
    let column_row = vec2<u32>(vec2<i32>(cell));
    out.lot = lot_of(id * 64u + column_row.x + column_row.y * 1597u);
    return out;
}

// What a wall is made of: its albedo against that of its house.
fn masonry(uv_m: vec2<f32>, style: Style, window: Window, grain: Grain, shop: bool) -> f32 {
    let sharp = grain.sharp_per_m;
    let coarse = clamp(0.4 * grain.px_per_m - 0.5, 0.0, 1.0);
    // Bricks of 225 by 75 mm with their joints, each of its own shade.
    let course = uv_m.y * 13.333333;
    let row = floor(course);
    let along = uv_m.x * 4.4444444 + row * 0.5;
    let brick = fract(vec2(along, course));
    let brick_m = (0.5 - abs(brick - 0.5)) * vec2(0.225, 0.075);
    let joint = 1.0 - clamp((min(brick_m.x, brick_m.y) - 0.006) * sharp + 0.5, 0.0, 1.0);
    let shade = fract((along - brick.x) * 0.7548777 + row * 0.5698403 + 0.37 * fract(row * 0.1371));
    let near = style.brick * clamp(0.05 * grain.px_per_m - 0.5, 0.0, 1.0);
    var out = 1.0 + near * (0.5 * (shade - 0.5) + joint * 0.35);
    // Joints of panels.
    let rim_m = (0.5 - abs(window.in_cell - 0.5)) * style.pitch_m;
    out *= 1.0 - 0.5 * style.panels * coarse * (1.0 - clamp((min(rim_m.x, rim_m.y) - 0.012) * sharp + 0.5, 0.0, 1.0));
    // A course of stones between two storeys, and its shade.
    let storey_m = window.in_cell.y * style.pitch_m.y;
    out *= 1.0 + style.courses * coarse * (0.16 * band(storey_m, 0.07, 0.24, sharp) - 0.45 * band(storey_m, 0.0, 0.07, sharp));
    // A plinth at the foot, with a ledge.
    out *= 1.0 - select(0.3, 0.0, shop) * clamp((0.55 - uv_m.y) * sharp + 0.5, 0.0, 1.0) - 0.3 * coarse * band(uv_m.y, 0.55, 0.6, sharp);
    // Downpipes at every fourth column, lit from one side, with their shade on the other.
    let pipe_m = fract(uv_m.x * 0.083 + style.pale) * 12.05;
    let pipe = style.pipes * coarse;
    out = mix(out, 0.5 + 5.0 * pipe_m, pipe * band(pipe_m, 0.02, 0.13, sharp)) * (1.0 - 0.35 * pipe * band(pipe_m, 0.13, 0.19, sharp));
    return max(out, 0.0);
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
    let style = style_of(id, is_shop);
    let grain = grain_of(pixel_m);
    let window = window_at(uv_m, style, grain, is_shop, id);
    var out: Wall;
    out.pane = window.pane * is_wall;
    // Less sky reaches the foot.
    let foot = 0.72 + 0.28 * clamp(uv_m.y * 0.4, 0.0, 1.0);
    var seen = albedo * (foot * masonry(uv_m, style, window, grain, is_shop));
    // The board above a shop's windows.
    let shop = f32(is_shop);
    seen = mix(seen, style.board, shop * band(uv_m.y, 2.98, 3.5, grain.sharp_per_m));
    seen = mix(seen, vec3(0.62, 0.6, 0.56) * style.pale, window.frame);
    // Behind the glass: a dark room, curtains at its sides, a blind from above. In shops a lit
    // ceiling and a wall at the back, goods of many heights on a plinth in front of them, and on every
    // third pane a poster.
    let lot = window.lot;
    let curtain = (1.0 - shop) * f32(lot.r > 0.4 && abs(window.place.x - 0.5) > 0.2 + 0.25 * lot.g);
    let blind = (1.0 - shop) * f32(lot.b > 0.72 && window.place.y > lot.g);
    let fine = clamp(0.25 * grain.px_per_m - 0.5, 0.0, 1.0);
    let pane_at = window.place.x * style.n_parts.x;
    let in_pane = fract(pane_at);
    let own = fract((pane_at - in_pane) * 0.3819660 + lot.rgb);
    let good = uv_m.x * (1.6 + 2.2 * lot.g);
    let in_good = fract(good);
    let look = fract((good - in_good) * vec3(0.7548777, 0.5698403, 0.3819660) + lot.gbr);
    // Wide below, narrower above, as bottles, boxes and busts are.
    let up_m = uv_m.y - 0.62;
    let goods = f32(abs(in_good - 0.5) < 0.46 - 0.26 * clamp(up_m - 0.3 * look.y, 0.0, 1.0)) * f32(up_m < 0.12 + 1.1 * look.x * look.x) * f32(up_m > 0.0);
    let back = mix(0.035, 0.075, lot.r) * (0.35 + 0.9 * clamp(window.place.y, 0.0, 1.0));
    let tubes = f32(window.place.y > 0.86) * f32(abs(fract(uv_m.x * 0.9 + lot.b) - 0.5) < 0.3);
    let poster_at = abs(vec2(in_pane - 0.5, window.place.y - 0.42)) * vec2(1.0, 0.9);
    let poster = f32(own.x > 0.66 && poster_at.x < 0.3 && poster_at.y < 0.24);
    var shown = vec3(back) * vec3(1.05, 1.0, 0.9);
    shown = mix(shown, mix(vec3(look.z), look, 0.5) * (0.03 + 0.2 * look.y), goods * fine);
    shown = mix(shown, vec3(0.11, 0.1, 0.09), f32(up_m < 0.0 && up_m > -0.3));
    shown = mix(shown, vec3(0.42, 0.41, 0.38), tubes * (0.25 + 0.5 * lot.a));
    let headline = f32(abs(poster_at.y - 0.12) < 0.05);
    shown = mix(shown, mix(vec3(0.36, 0.35, 0.33), 0.3 * own * own, max(headline, f32(poster_at.x < 0.16 && poster_at.y < 0.04))), poster * fine);
    var room = select(vec3(0.018, 0.02, 0.024), shown, is_shop);
    room = mix(room, vec3(0.34, 0.32, 0.28) * (0.4 + 0.6 * lot.g), max(0.7 * curtain, blind));
    seen = mix(seen, room, window.pane);
    out.albedo = mix(albedo, seen * window.shade, is_wall);
    out.cool = f32(lot.a > 0.8);
    let share = as_switched(id, vec3(1.0), light.lamps.windows_on_ratio).w * select(0.34, 0.8, is_shop);
    // Brighter below the ceiling lamp, and different in every room.
    let floor_up = fract(uv_m.y / select(3.1, 3.6, is_shop));
    out.glow = out.pane * f32(lot.b < share) * (0.12 + 0.88 * lot.a * lot.g) * (0.45 + 0.9 * floor_up);
    return out;
}

// Radiance of a window.
fn window_light(wall: Wall, id: u32) -> vec3<f32> {
    let own = mix(vec3(1.0, 0.62, 0.30), vec3(0.85, 0.92, 1.0), wall.cool);
    return as_switched(id, own, light.lamps.windows_on_ratio).rgb * (light.lamps.window_radiance * wall.glow);
}
