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
    // A uniform's offset can be a multiple of 256 only.
    rest: array<vec4<u32>, 9>,
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

var<private> which: u32;

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
        let at = (vec2(f32(i % 64u), f32(i / 64u)) + 0.5) / 64.0 * posts[which].size_px;
        let luminance = luminance_of(textureLoad(radiance_maps, vec2<u32>(at), posts[which].layer, 0).rgb);
        let bin = (log2(max(luminance, 1e-9)) - LOWEST) * BINS_PER_STOP;
        atomicAdd(&bins[u32(clamp(bin, 0.0, f32(N_BINS) - 1.0))], 1u);
    }
    workgroupBarrier();
    if thread != 0u {
        return;
    }
    var before = 0.0;
    var sum = 0.0;
    var weight = 0.0;
    for (var bin = 0u; bin < N_BINS; bin++) {
        let n = f32(atomicLoad(&bins[bin]));
        let counted = max(min(before + n, 3686.0) - max(before, 410.0), 0.0);
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
    return pow(clamp(display(rgb), vec3(0.0), vec3(1.0)), vec3(posts[which].gamma_exponent));
}

fn radiance_at(at: vec2<f32>, factor: f32) -> vec3<f32> {
    return textureSampleLevel(radiance_maps, smooth_sampler, at, posts[which].layer, 0.0).rgb * factor;
}

// Smooth edges: where neighbours differ, the mean along the edge (after Lottes, FXAA, 2009).
fn smoothed(at: vec2<f32>, factor: f32) -> vec3<f32> {
    let px = posts[which].per_px;
    let middle = developed(radiance_at(at, factor));
    if posts[which].smooths_edges == 0.0 {
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
    let from_middle = (vec2<f32>(at.xy) + 0.5) * posts[which].per_px - 0.5;
    let scaled = from_middle * posts[which].distortion_size;
    let squared = dot(scaled, scaled);
    let bent = from_middle * (1.0 + squared * (posts[which].distortion_k + posts[which].distortion_k_cubed * sqrt(squared)));
    let to_corner = length(from_middle) * 1.41421356;
    var factor = exposed();
    if posts[which].has_film != 0.0 {
        factor *= clamp(1.0 - posts[which].vignette_multiplier * pow(to_corner, posts[which].vignette_falloff), 0.0, 1.0);
    }
    var rgb: vec3<f32>;
    if posts[which].aberration == 0.0 && posts[which].bloom == 0.0 {
        rgb = smoothed(bent + 0.5, factor);
    } else {
        let drift = posts[which].aberration * 0.01 * max(to_corner - posts[which].aberration_start, 0.0);
        var radiance = vec3(
            radiance_at(bent * (1.0 + drift) + 0.5, factor).r,
            radiance_at(bent + 0.5, factor).g,
            radiance_at(bent * (1.0 - drift) + 0.5, factor).b,
        );
        radiance += textureSampleLevel(glow_map, smooth_sampler, bent + 0.5, 0.0).rgb * (factor * posts[which].bloom);
        rgb = developed(radiance);
    }
    textureStore(color_maps, at.xy, posts[which].layer, vec4(pack4x8unorm(vec4(rgb.bgr, 1.0)), 0u, 0u, 0u));
}
