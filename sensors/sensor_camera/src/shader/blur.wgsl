// Focus and motion blur of radiance. Both gather: light of a neighbour counts where that
// neighbour's own blur reaches this pixel. Nearer surfaces lie over it with the share that they
// cover; what lies behind shows through only as far as this pixel's own blur lets it. Mirrors:
// blur.rs.

// Mirror of BlurData.
struct Blur {
    size_px: vec2<f32>,
    // Radius of blur at infinity, and the distance that is sharp.
    far_radius_px: f32,
    focus_m: f32,
    // Radius of haze at infinity, and one over the distance at which it has half of it.
    haze_px: f32,
    haze_per_m: f32,
    // Longest radius and longest half streak.
    longest_px: f32,
    // Half of the exposure over the time that flow covers.
    half_exposure_ratio: f32,
    // Corners of the diaphragm, 0 for a circle; curvature radius of its blades over that of its
    // corners, 0 for straight ones.
    n_blades: f32,
    blade_radius: f32,
    // Area of the diaphragm whose corners lie at 1.
    blades_area: f32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> blur: Blur;
@group(0) @binding(1) var color_map: texture_2d<f32>;
@group(0) @binding(2) var depth_map: texture_2d<f32>;
@group(0) @binding(3) var flow_map: texture_2d<f32>;
@group(0) @binding(4) var tile_map: texture_2d<f32>;
@group(0) @binding(5) var smooth_sampler: sampler;
@group(0) @binding(6) var image_out: texture_storage_2d<rgba16float, write>;

const TILE_PX: u32 = 16u;
const PI: f32 = 3.14159265;

fn depth_at(pixel: vec2<i32>) -> f32 {
    return textureLoad(depth_map, pixel, 0).r;
}

fn color_at(at: vec2<f32>) -> vec3<f32> {
    return textureSampleLevel(color_map, smooth_sampler, at / blur.size_px, 0.0).rgb;
}

// Whether a surface at this depth lies in front of another.
fn is_before(depth_m: f32, other_m: f32) -> bool {
    return depth_m < other_m * 0.998 - 0.01;
}

// Radius of the circle of confusion, pixels; below 0 nearer than the focus.
fn confusion_px(depth_m: f32) -> f32 {
    var radius = 0.0;
    if blur.far_radius_px > 0.0 {
        radius = blur.far_radius_px * (1.0 - blur.focus_m / max(depth_m, 1e-3));
    }
    let haze = blur.haze_px * (1.0 - exp2(-depth_m * blur.haze_per_m));
    return clamp(select(radius, haze, haze > abs(radius)), -blur.longest_px, blur.longest_px);
}

// Half of the streak of a pixel, centred on it.
fn half_streak_px(pixel: vec2<i32>) -> vec2<f32> {
    let half = textureLoad(flow_map, pixel, 0).rg * blur.half_exposure_ratio;
    return half * min(1.0, blur.longest_px / max(length(half), 1e-6));
}

// The largest radius of a tile.
@compute @workgroup_size(8, 8)
fn cs_radius_tiles(@builtin(global_invocation_id) at: vec3<u32>) {
    if any(at.xy >= textureDimensions(image_out)) {
        return;
    }
    let end = min((at.xy + 1u) * TILE_PX, vec2<u32>(blur.size_px));
    var most = 0.0;
    for (var y = at.y * TILE_PX; y < end.y; y++) {
        for (var x = at.x * TILE_PX; x < end.x; x++) {
            most = max(most, abs(confusion_px(depth_at(vec2<i32>(vec2(x, y))))));
        }
    }
    textureStore(image_out, at.xy, vec4(most, 0.0, 0.0, 0.0));
}

// The longest streak of a tile.
@compute @workgroup_size(8, 8)
fn cs_streak_tiles(@builtin(global_invocation_id) at: vec3<u32>) {
    if any(at.xy >= textureDimensions(image_out)) {
        return;
    }
    let end = min((at.xy + 1u) * TILE_PX, vec2<u32>(blur.size_px));
    var most = vec2(0.0);
    for (var y = at.y * TILE_PX; y < end.y; y++) {
        for (var x = at.x * TILE_PX; x < end.x; x++) {
            let half = half_streak_px(vec2<i32>(vec2(x, y)));
            most = select(most, half, dot(half, half) > dot(most, most));
        }
    }
    textureStore(image_out, at.xy, vec4(most, 0.0, 0.0));
}

// Most of what tiles hold that could reach this pixel.
fn most_around(pixel: vec2<u32>) -> vec2<f32> {
    let reach = i32(ceil(blur.longest_px / f32(TILE_PX)));
    let tile = vec2<i32>(pixel / TILE_PX);
    let last = vec2<i32>(textureDimensions(tile_map)) - 1;
    var most = vec2(0.0);
    for (var y = max(tile.y - reach, 0); y <= min(tile.y + reach, last.y); y++) {
        for (var x = max(tile.x - reach, 0); x <= min(tile.x + reach, last.x); x++) {
            let found = textureLoad(tile_map, vec2(x, y), 0).rg;
            // A tile counts if its blur is long enough to come here.
            let away = f32((max(max(abs(x - tile.x), abs(y - tile.y)), 1) - 1) * i32(TILE_PX));
            if length(found) >= away && dot(found, found) > dot(most, most) {
                most = found;
            }
        }
    }
    return most;
}

// Distance of the diaphragm's rim in a direction; its corners lie at 1, one of them upwards.
fn rim(away: vec2<f32>) -> f32 {
    if blur.n_blades == 0.0 {
        return 1.0;
    }
    let step = 2.0 * PI / blur.n_blades;
    // Angle from the nearest corner upwards, then from the middle of a blade.
    let angle = atan2(away.x, -away.y);
    let turned = (angle / step - floor(angle / step) - 0.5) * step;
    let apothem = cos(0.5 * step);
    if blur.blade_radius == 0.0 {
        return apothem / cos(turned);
    }
    let half_chord = sin(0.5 * step);
    let middle = apothem - sqrt(max(blur.blade_radius * blur.blade_radius - half_chord * half_chord, 0.0));
    let aside = middle * sin(turned);
    return middle * cos(turned) + sqrt(max(blur.blade_radius * blur.blade_radius - aside * aside, 0.0));
}

@compute @workgroup_size(16, 8)
fn cs_focus(@builtin(global_invocation_id) at: vec3<u32>) {
    if any(vec2<f32>(at.xy) >= blur.size_px) {
        return;
    }
    let here = vec2<i32>(at.xy);
    let own = textureLoad(color_map, here, 0).rgb;
    let own_m = depth_at(here);
    let own_px = abs(confusion_px(own_m));
    let most_px = most_around(at.xy).x;
    if most_px <= 0.5 {
        textureStore(image_out, at.xy, vec4(own, 1.0));
        return;
    }
    // At most 25 × 25 samples.
    let stride = max(1.0, most_px / 12.0);
    let n = i32(ceil(most_px / stride));
    var sum = vec3(0.0);
    var weight = 0.0;
    var front = vec3(0.0);
    var covered = 0.0;
    for (var y = -n; y <= n; y++) {
        for (var x = -n; x <= n; x++) {
            let away = vec2(f32(x), f32(y)) * stride;
            let place = vec2<f32>(here) + 0.5 + away;
            if any(place < vec2(0.0)) || any(place >= blur.size_px) {
                continue;
            }
            let depth_m = depth_at(vec2<i32>(place));
            let radius = confusion_px(depth_m);
            let reach = max(select(abs(radius), own_px, is_before(own_m, depth_m)), 0.5);
            // The image of a point behind the focus is the diaphragm with a corner upwards, of one
            // before it with a corner downwards; it must reach back from the neighbour to here.
            let direction = select(away, -away, radius > 0.0);
            let inside = clamp((reach * rim(direction) - length(away)) / stride + 0.5, 0.0, 1.0);
            if inside <= 0.0 {
                continue;
            }
            let share = inside * stride * stride / (blur.blades_area * reach * reach);
            let color = color_at(place);
            if is_before(depth_m, own_m) {
                front += color * share;
                covered += share;
            } else {
                sum += color * share;
                weight += share;
            }
        }
    }
    var color = sum / max(weight, 1e-6);
    if covered > 0.0 {
        color = mix(color, front / covered, min(covered, 1.0));
    }
    textureStore(image_out, at.xy, vec4(color, 1.0));
}

@compute @workgroup_size(16, 8)
fn cs_streaks(@builtin(global_invocation_id) at: vec3<u32>) {
    if any(vec2<f32>(at.xy) >= blur.size_px) {
        return;
    }
    let here = vec2<i32>(at.xy);
    let own = textureLoad(color_map, here, 0).rgb;
    let most = most_around(at.xy);
    let most_px = length(most);
    if most_px <= 0.25 {
        textureStore(image_out, at.xy, vec4(own, 1.0));
        return;
    }
    let own_m = depth_at(here);
    let half = half_streak_px(here);
    let own_px = length(half);
    // Along its own motion: its own surface, and what it uncovers.
    var sum = own;
    var weight = 1.0;
    if own_px > 0.25 {
        let along = half / own_px;
        let stride = max(1.0, own_px / 24.0);
        let n = i32(ceil((max(own_px, 0.5) + 0.5) / stride));
        sum = vec3(0.0);
        weight = 0.0;
        for (var i = -n; i <= n; i++) {
            let away = f32(i) * stride;
            let place = vec2<f32>(here) + 0.5 + along * away;
            if any(place < vec2(0.0)) || any(place >= blur.size_px) {
                continue;
            }
            let there = vec2<i32>(place);
            let depth_m = depth_at(there);
            if is_before(depth_m, own_m) {
                continue;
            }
            let its_px = abs(dot(half_streak_px(there), along));
            let reach = max(select(its_px, own_px, is_before(own_m, depth_m)), 0.5);
            let share = clamp((reach - abs(away)) / stride + 0.5, 0.0, 1.0) / reach;
            sum += color_at(place) * share;
            weight += share;
        }
    }
    // Along the longest motion nearby: nearer surfaces that pass over it.
    let along = most / most_px;
    let stride = max(1.0, most_px / 24.0);
    let n = i32(ceil((most_px + 0.5) / stride));
    var front = vec3(0.0);
    var covered = 0.0;
    for (var i = -n; i <= n; i++) {
        let away = f32(i) * stride;
        let place = vec2<f32>(here) + 0.5 + along * away;
        if any(place < vec2(0.0)) || any(place >= blur.size_px) {
            continue;
        }
        let there = vec2<i32>(place);
        if !is_before(depth_at(there), own_m) {
            continue;
        }
        let streak = half_streak_px(there);
        let reach = max(length(streak), 0.5);
        // How far its motion passes beside this pixel.
        let beside = abs(streak.x * along.y - streak.y * along.x) / reach * abs(away);
        let inside = clamp((reach - abs(away)) / stride + 0.5, 0.0, 1.0) * clamp(1.5 - beside, 0.0, 1.0);
        let share = inside * stride / (2.0 * reach);
        front += color_at(place) * share;
        covered += share;
    }
    var color = sum / max(weight, 1e-6);
    if covered > 0.0 {
        color = mix(color, front / covered, min(covered, 1.0));
    }
    textureStore(image_out, at.xy, vec4(color, 1.0));
}
