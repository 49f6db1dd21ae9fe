// Post-processing of colour: exposure, lens, bloom, white balance, film, smooth edges. Mirrors:
// post.rs.

// Mirror of PostData.
struct Post {
    // Width and height, and one over each.
    size_px: vec2<f32>,
    per_px: vec2<f32>,
    // Factor of the light; 1: multiplied by the meter's exposure.
    factor: f32,
    is_metered: f32,
    // 2.2 / gamma.
    gamma_exponent: f32,
    // 1: film curve.
    has_film: f32,
    min_ev100: f32,
    max_ev100: f32,
    // Shares of the way to the light and to the dark that the meter goes in this firing.
    up_share: f32,
    down_share: f32,
    // Luminance of white as shaded.
    white_cd_per_m2: f32,
    // The meter's constant.
    calibration: f32,
    // 1: smooth edges.
    smooths_edges: f32,
    // Strength of bloom.
    bloom: f32,
    distortion_k: f32,
    distortion_k_cubed: f32,
    distortion_size: vec2<f32>,
    vignette_multiplier: f32,
    vignette_falloff: f32,
    // Chromatic aberration, and where it begins.
    aberration: f32,
    aberration_start: f32,
    // Gains of red, green, blue.
    white_rgb: vec3<f32>,
    // Layer of its image.
    layer: u32,
    // Size of the picture, which lies in the middle of the image.
    out_px: vec2<f32>,
    // Strength of ghosts.
    flare: f32,
    // 1: the film's curve is a shaped one, with the numbers below.
    is_shaped: f32,
    slope: f32,
    // Where the toe ends and the shoulder begins, log10 of light.
    toe_at: f32,
    shoulder_at: f32,
    straight_offset: f32,
    toe_height: f32,
    shoulder_height: f32,
    black_clip: f32,
    white_clip: f32,
    // A uniform's offset can be a multiple of 256 only.
    rest: array<vec4<u32>, 6>,
}

struct Meter {
    ev100: f32,
    // 0 before the first frame.
    known: f32,
}

// The binding begins at the first view of the dispatch, which handles one view per z.
@group(0) @binding(0) var<uniform> posts: array<Post, 32>;
@group(0) @binding(1) var radiance_maps: texture_2d_array<f32>;
@group(0) @binding(2) var smooth_sampler: sampler;
@group(0) @binding(3) var<storage, read_write> meter: Meter;
@group(0) @binding(4) var color_maps: texture_storage_2d_array<r32uint, write>;
@group(0) @binding(5) var glow_map: texture_2d<f32>;
@group(0) @binding(6) var glow_out: texture_storage_2d<rgba16float, write>;
@group(0) @binding(7) var ghost_map: texture_2d<f32>;

var<private> which: u32;

// What there may be. A program is made for every combination that cameras ask for, because software
// adapters spend the time of what a branch leaves out.
override HAS_SHAPED_FILM: bool = true;
override HAS_GHOSTS: bool = true;
override HAS_LENS: bool = true;
override SMOOTHS_EDGES: bool = true;
// Whether what has an alpha of 0 lies beyond a lens's field.
override HAS_FIELD: bool = false;

const N_BINS: u32 = 128u;
// Luminance of the lowest bin: 2^-18 of white; 5 bins a stop.
const LOWEST: f32 = -18.0;
const BINS_PER_STOP: f32 = 5.0;

var<workgroup> bins: array<atomic<u32>, 128>;

// The meter: a histogram over a grid of 64 × 64 points; the result is the mean without the darkest
// and the brightest tenth.
@compute @workgroup_size(256)
fn cs_meter(@builtin(local_invocation_index) thread: u32) {
    if thread < N_BINS {
        atomicStore(&bins[thread], 0u);
    }
    workgroupBarrier();
    for (var i = thread; i < 4096u; i += 256u) {
        let share = (vec2(f32(i % 64u), f32(i / 64u)) + 0.5) / 64.0;
        let at = share * posts[which].out_px + 0.5 * (posts[which].size_px - posts[which].out_px);
        let texel = textureLoad(radiance_maps, vec2<u32>(at), posts[which].layer, 0);
        if HAS_FIELD && texel.a == 0.0 {
            continue;
        }
        let luminance = luminance_of(texel.rgb);
        let bin = (log2(max(luminance, 1e-9)) - LOWEST) * BINS_PER_STOP;
        atomicAdd(&bins[u32(clamp(bin, 0.0, f32(N_BINS) - 1.0))], 1u);
    }
    workgroupBarrier();
    if thread != 0u {
        return;
    }
    // A tenth of what was counted; of the whole grid these are 410 and 3686 points.
    var total = 4096.0;
    if HAS_FIELD {
        total = 0.0;
        for (var bin = 0u; bin < N_BINS; bin++) {
            total += f32(atomicLoad(&bins[bin]));
        }
    }
    let low = total * (410.0 / 4096.0);
    let high = total * (3686.0 / 4096.0);
    var before = 0.0;
    var sum = 0.0;
    var weight = 0.0;
    for (var bin = 0u; bin < N_BINS; bin++) {
        let n = f32(atomicLoad(&bins[bin]));
        let counted = max(min(before + n, high) - max(before, low), 0.0);
        sum += counted * (f32(bin) + 0.5);
        weight += counted;
        before += n;
    }
    let log_mean = sum / max(weight, 1.0) / BINS_PER_STOP + LOWEST + log2(posts[which].white_cd_per_m2);
    let asked = clamp(log_mean + log2(100.0 / posts[which].calibration), posts[which].min_ev100, posts[which].max_ev100);
    if meter.known == 0.0 {
        meter.ev100 = asked;
    } else {
        meter.ev100 += (asked - meter.ev100) * select(posts[which].down_share, posts[which].up_share, asked > meter.ev100);
    }
    meter.known = 1.0;
}

// Half the size: the mean of sixteen neighbours.
@compute @workgroup_size(16, 8)
fn cs_shrink(@builtin(global_invocation_id) at: vec3<u32>) {
    let size = textureDimensions(glow_out);
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let middle = (vec2<f32>(at.xy) + 0.5) / vec2<f32>(size);
    let step = 1.0 / vec2<f32>(textureDimensions(radiance_maps));
    var sum = vec3(0.0);
    for (var i = 0; i < 4; i++) {
        let away = vec2(f32(i & 1) * 2.0 - 1.0, f32(i >> 1u) * 2.0 - 1.0);
        sum += min(textureSampleLevel(radiance_maps, smooth_sampler, middle + away * step, posts[which].layer, 0.0).rgb, vec3(200.0));
    }
    textureStore(glow_out, at.xy, vec4(sum * 0.25, 1.0));
}

// The same of light so far above white that the lens shows ghosts of it.
@compute @workgroup_size(16, 8)
fn cs_shrink_bright(@builtin(global_invocation_id) at: vec3<u32>) {
    let size = textureDimensions(glow_out);
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let middle = (vec2<f32>(at.xy) + 0.5) / vec2<f32>(size);
    let step = 1.0 / vec2<f32>(textureDimensions(radiance_maps));
    let factor = exposed();
    var sum = vec3(0.0);
    for (var i = 0; i < 4; i++) {
        let away = vec2(f32(i & 1) * 2.0 - 1.0, f32(i >> 1u) * 2.0 - 1.0);
        let light = textureSampleLevel(radiance_maps, smooth_sampler, middle + away * step, posts[which].layer, 0.0).rgb * factor;
        sum += clamp(light - GHOSTS_FROM, vec3(0.0), vec3(200.0));
    }
    textureStore(glow_out, at.xy, vec4(sum * 0.25, 1.0));
}

// Ghosts of light at p lie at -p times these sizes, in these colours.
const GHOSTS_FROM: f32 = 8.0;
const N_GHOSTS: i32 = 6;
const GHOST_SIZES = array<f32, 6>(0.35, 0.6, -0.45, 1.0, 1.5, -1.7);
const GHOST_RGB = array<vec3<f32>, 6>(
    vec3(1.0, 0.8, 0.4), vec3(0.5, 0.9, 0.6), vec3(0.4, 0.5, 1.0),
    vec3(0.9, 0.5, 0.3), vec3(0.3, 0.6, 0.6), vec3(0.5, 0.3, 0.7));

// Light of all ghosts at a place in the image, from its middle.
fn ghosts_at(q: vec2<f32>) -> vec3<f32> {
    let texel = 1.0 / vec2<f32>(textureDimensions(ghost_map));
    var sizes = GHOST_SIZES;
    var colors = GHOST_RGB;
    var sum = vec3(0.0);
    for (var ghost = 0; ghost < N_GHOSTS; ghost++) {
        let source = 0.5 - q / sizes[ghost];
        if any(abs(source - 0.5) > vec2(0.5)) {
            continue;
        }
        var light = vec3(0.0);
        for (var i = 0; i < 9; i++) {
            let away = vec2(f32(i % 3) - 1.0, f32(i / 3) - 1.0);
            let weight = (2.0 - abs(away.x)) * (2.0 - abs(away.y)) / 16.0;
            light += textureSampleLevel(ghost_map, smooth_sampler, source + away * texel, 0.0).rgb * weight;
        }
        // A larger ghost spreads the same light.
        sum += light * colors[ghost] / max(sizes[ghost] * sizes[ghost], 0.25);
    }
    return sum * posts[which].flare;
}

fn exposed() -> f32 {
    if posts[which].is_metered == 0.0 {
        return posts[which].factor;
    }
    return posts[which].factor * posts[which].white_cd_per_m2 / (1.2 * exp2(meter.ev100));
}

// Radiance as display values, 0 to 1.
fn developed(radiance: vec3<f32>) -> vec3<f32> {
    let rgb = max(radiance * posts[which].white_rgb, vec3(0.0));
    if posts[which].has_film == 0.0 {
        return pow(min(rgb, vec3(1.0)), vec3(posts[which].gamma_exponent / 2.2));
    }
    if HAS_SHAPED_FILM && posts[which].is_shaped != 0.0 {
        let tones = vec3(shaped(rgb.r), shaped(rgb.g), shaped(rgb.b));
        return pow(clamp(tones, vec3(0.0), vec3(1.0)), vec3(posts[which].gamma_exponent / 2.2));
    }
    return pow(clamp(display(rgb), vec3(0.0), vec3(1.0)), vec3(posts[which].gamma_exponent));
}

// A film curve of a straight part, a toe and a shoulder over the logarithm of light.
fn shaped(light: f32) -> f32 {
    let slope = posts[which].slope;
    let toe_at = posts[which].toe_at;
    let shoulder_at = posts[which].shoulder_at;
    let toe_height = posts[which].toe_height;
    let shoulder_height = posts[which].shoulder_height;
    let x = log2(max(light, 1e-6)) * 0.30103;
    let straight = slope * (x + posts[which].straight_offset);
    var toe = straight;
    if x < toe_at {
        toe = 2.0 * toe_height / (1.0 + exp(-2.0 * slope / toe_height * (x - toe_at))) - posts[which].black_clip;
    }
    var shoulder = straight;
    if x > shoulder_at {
        let steps = 2.0 * slope / max(shoulder_height, 1e-4) * (x - shoulder_at);
        shoulder = 1.0 + posts[which].white_clip - 2.0 * shoulder_height / (1.0 + exp(min(steps, 60.0)));
    }
    let between = shoulder_at - toe_at;
    var share = clamp((x - toe_at) / select(between, 1e-4, abs(between) < 1e-4), 0.0, 1.0);
    // A long toe and a long shoulder overlap.
    share = select(share, 1.0 - share, between < 0.0);
    return mix(toe, shoulder, share * share * (3.0 - 2.0 * share));
}

// Where the lens shows what the image has at q, both from the middle: the inverse of the bend.
fn unbent(q: vec2<f32>) -> vec2<f32> {
    if !HAS_LENS {
        return q;
    }
    let scaled = q * posts[which].distortion_size;
    let squared = dot(scaled, scaled);
    let a = posts[which].distortion_k * squared;
    let b = posts[which].distortion_k_cubed * squared * sqrt(squared);
    if a == 0.0 && b == 0.0 {
        return q;
    }
    var share = 1.0;
    for (var i = 0; i < 12; i++) {
        let value = share * (1.0 + share * share * (a + b * share)) - 1.0;
        let slope = 1.0 + share * share * (3.0 * a + 4.0 * b * share);
        share = clamp(share - value / max(slope, 0.05), 0.0, 100.0);
    }
    return q * share;
}

fn radiance_at(at: vec2<f32>, factor: f32) -> vec3<f32> {
    return textureSampleLevel(radiance_maps, smooth_sampler, at, posts[which].layer, 0.0).rgb * factor;
}

// Smooth edges: where neighbours differ, the mean along the edge (after Lottes, FXAA, 2009).
fn smoothed(at: vec2<f32>, factor: f32) -> vec3<f32> {
    let px = posts[which].per_px;
    let middle = developed(radiance_at(at, factor));
    if !SMOOTHS_EDGES || posts[which].smooths_edges == 0.0 {
        return middle;
    }
    let weights = vec3(0.299, 0.587, 0.114);
    let nw = dot(developed(radiance_at(at + vec2(-0.5, -0.5) * px, factor)), weights);
    let ne = dot(developed(radiance_at(at + vec2(0.5, -0.5) * px, factor)), weights);
    let sw = dot(developed(radiance_at(at + vec2(-0.5, 0.5) * px, factor)), weights);
    let se = dot(developed(radiance_at(at + vec2(0.5, 0.5) * px, factor)), weights);
    let m = dot(middle, weights);
    let low = min(m, min(min(nw, ne), min(sw, se)));
    let high = max(m, max(max(nw, ne), max(sw, se)));
    if high - low < max(0.03, 0.10 * high) {
        return middle;
    }
    var along = vec2((sw + se) - (nw + ne), (nw + sw) - (ne + se));
    let shortest = min(abs(along.x), abs(along.y)) + max((nw + ne + sw + se) * 0.03, 0.008);
    along = clamp(along / shortest, vec2(-8.0), vec2(8.0)) * px;
    let near = 0.5 * (developed(radiance_at(at - along / 6.0, factor)) + developed(radiance_at(at + along / 6.0, factor)));
    let wide = 0.5 * near + 0.25 * (developed(radiance_at(at - along * 0.5, factor)) + developed(radiance_at(at + along * 0.5, factor)));
    let found = dot(wide, weights);
    return select(wide, near, found < low || found > high);
}

@compute @workgroup_size(16, 8)
fn cs_main(@builtin(global_invocation_id) at: vec3<u32>) {
    which = at.z;
    if f32(at.x) >= posts[which].size_px.x || f32(at.y) >= posts[which].size_px.y {
        return;
    }
    if HAS_FIELD && textureLoad(radiance_maps, at.xy, posts[which].layer, 0).a == 0.0 {
        textureStore(color_maps, at.xy, posts[which].layer, vec4(0xff000000u, 0u, 0u, 0u));
        return;
    }
    // The image is a pinhole's, with margins around the picture if the lens will bend it.
    let in_image = (vec2<f32>(at.xy) + 0.5) * posts[which].per_px - 0.5;
    let sides = posts[which].size_px / posts[which].out_px;
    let to_corner = length(unbent(in_image * sides)) * 1.41421356;
    var factor = exposed();
    if posts[which].has_film != 0.0 {
        factor *= clamp(1.0 - posts[which].vignette_multiplier * pow(to_corner, posts[which].vignette_falloff), 0.0, 1.0);
    }
    var rgb: vec3<f32>;
    if posts[which].aberration == 0.0 && posts[which].bloom == 0.0 && posts[which].flare == 0.0 {
        rgb = smoothed(in_image + 0.5, factor);
    } else {
        let drift = posts[which].aberration * 0.01 * max(to_corner - posts[which].aberration_start, 0.0);
        var radiance = vec3(
            radiance_at(in_image * (1.0 + drift) + 0.5, factor).r,
            radiance_at(in_image + 0.5, factor).g,
            radiance_at(in_image * (1.0 - drift) + 0.5, factor).b,
        );
        radiance += textureSampleLevel(glow_map, smooth_sampler, in_image + 0.5, 0.0).rgb * (factor * posts[which].bloom);
        if HAS_GHOSTS && posts[which].flare != 0.0 {
            radiance += ghosts_at(in_image);
        }
        rgb = developed(radiance);
    }
    textureStore(color_maps, at.xy, posts[which].layer, vec4(pack4x8unorm(vec4(rgb.bgr, 1.0)), 0u, 0u, 0u));
}
