// The event camera on the GPU, one thread per pixel. The modules of dvs/ explain the model.
// Mirrors: dvs/gpu/job.rs.
//
// A first run counts events by slices of time, and a second run writes them slice after slice. Once
// each slice is sorted, the result does not depend on the order of the work.

// Mirror of EventJob.
struct Job {
    size_px: vec2<u32>,
    n_tiles: vec2<u32>,
    threshold_up: f32,
    threshold_down: f32,
    // What is added before the logarithm.
    log_eps: f32,
    // Longest path between two samples.
    substep_px: f32,
    // How much references sink in the window; length of the window over that of the one before.
    leak: f32,
    ratio: f32,
    nanos: u32,
    refractory_nanos: u32,
    // The slice of a time is (time * slices) >> 32; low and high word.
    slices: vec2<u32>,
    capacity: u32,
    // What a level is: 0 logarithm, 1 linear, 2 and 3 the same of encoded colour.
    level: u32,
    // Whether images are warped along their motion; whether thresholds vary from pixel to pixel.
    moves: u32,
    differs: u32,
    // Whether this run writes events and pixel states, or only counts; which half of `levels` is
    // the end of the window.
    writes: u32,
    now: u32,
}

struct Slices {
    // Bits of the square of the fastest motion.
    fastest2: atomic<u32>,
    rest: vec3<u32>,
    // Events per slice, and where the next event of each slice goes.
    counts: array<atomic<u32>, 1024>,
    ends: array<atomic<u32>, 1024>,
}

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var luminance_map: texture_2d<f32>;
@group(0) @binding(2) var flow_map: texture_2d<f32>;
@group(0) @binding(3) var depth_map: texture_2d<f32>;
@group(0) @binding(4) var instance_map: texture_2d<u32>;
@group(0) @binding(5) var class_map: texture_2d<u32>;
// Levels of two images, one after the other; `job.now` is the index of the one that ends the
// window.
@group(0) @binding(6) var<storage, read_write> levels: array<f32>;
@group(0) @binding(7) var<storage, read_write> flow_before: array<vec2<f32>>;
@group(0) @binding(8) var<storage, read_write> flow_now: array<vec2<f32>>;
// Motion of the surface that was at a pixel when the window began.
@group(0) @binding(9) var<storage, read_write> motion_before: array<vec2<f32>>;
// Per tile: least and greatest motion at the end and at the beginning.
@group(0) @binding(10) var<storage, read_write> range_now: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> range_before: array<vec4<f32>>;
// Per tile: its fastest motion, if there is a discontinuity.
@group(0) @binding(12) var<storage, read_write> jump: array<vec2<f32>>;
@group(0) @binding(13) var<storage, read_write> references: array<f32>;
@group(0) @binding(14) var<storage, read_write> silent_nanos: array<u32>;
@group(0) @binding(15) var<storage, read_write> mismatch: array<f32>;
@group(0) @binding(16) var<storage, read_write> slices: Slices;
// Ends of the slices, four to an element, then events.
@group(0) @binding(17) var<storage, read_write> list: array<vec4<u32>>;
// Per pixel of the first image: inverted depth (high word) and the pixel that came from there (low
// word). Per tile: square of the fastest motion that passes (high word) and the inverted number of
// the tile it comes from (low word).
@group(1) @binding(0) var<storage, read_write> source: array<atomic<u64>>;
@group(1) @binding(1) var<storage, read_write> passing: array<atomic<u64>>;
// The same tables for reading.
@group(1) @binding(0) var<storage, read> source_words: array<vec2<u32>>;
@group(1) @binding(1) var<storage, read> passing_words: array<vec2<u32>>;

const SMOOTH: u32 = 1u;
const STRAIGHT: u32 = 3u;
const SEVERAL: u32 = 4u;
const TILE_PX: u32 = 8u;
const MAX_STEPS: u32 = 256u;
const LIST_HEAD: u32 = 256u;
const HUGE: f32 = 3.4e38;

var<workgroup> low: array<vec2<f32>, 64>;
var<workgroup> high: array<vec2<f32>, 64>;
var<workgroup> near: array<vec2<f32>, 81>;
var<workgroup> speeds: array<f32, 64>;

// Natural logarithm, term by term as on the CPU.
fn ln(x: f32) -> f32 {
    let bits = bitcast<i32>(x);
    let exponent = (bits - 0x3f3504f3) >> 23u;
    let m = bitcast<f32>(bits - (exponent << 23u));
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    let series = 1.0 + s2 * (1.0 / 3.0 + s2 * (1.0 / 5.0 + s2 * (1.0 / 7.0 + s2 * (1.0 / 9.0))));
    return f32(exponent) * 0.6931472 + 2.0 * s * series;
}

fn encoded(linear: f32) -> f32 {
    let x = clamp(linear, 0.0, 1.0);
    return select(1.055 * pow(x, 1.0 / 2.4) - 0.055, 12.92 * x, x <= 0.0031308);
}

fn level_of(luminance: f32) -> f32 {
    let light = select(luminance, encoded(luminance), job.level >= 2u);
    return select(255.0 * light, ln(light + job.log_eps), (job.level & 1u) == 0u);
}

fn index_of(at: vec2<u32>) -> u32 {
    return at.y * job.size_px.x + at.x;
}

// Index of the first level of the image that begins the window, or of the one that ends it.
fn first_before() -> u32 {
    return (1u - job.now) * job.size_px.x * job.size_px.y;
}

fn first_now() -> u32 {
    return job.now * job.size_px.x * job.size_px.y;
}

// Index of the pixel at a position, or -1 outside.
fn index_at(at: vec2<f32>) -> i32 {
    if (any(at < vec2(0.0)) || any(at >= vec2<f32>(job.size_px))) {
        return -1;
    }
    return i32(index_of(vec2<u32>(at)));
}

fn is_inside(at: vec2<f32>) -> bool {
    return all(at >= vec2(0.0)) && all(at <= vec2<f32>(job.size_px));
}

fn norm2(m: vec2<f32>) -> f32 {
    return m.x * m.x + m.y * m.y;
}

fn may_be_one_surface(a: vec2<f32>, b: vec2<f32>) -> bool {
    let tolerance = 0.5 + 0.35 * sqrt(max(norm2(a), norm2(b)));
    return norm2(a - b) <= tolerance * tolerance;
}

fn alike(a: vec2<f32>, b: vec2<f32>) -> bool {
    let tolerance = 0.5 + 0.1 * sqrt(norm2(b));
    return norm2(a - b) <= tolerance * tolerance;
}

fn with_range(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    return vec4(min(a.xy, b.xy), max(a.zw, b.zw));
}

fn fastest2_of(range: vec4<f32>) -> f32 {
    return norm2(max(-range.xy, range.zw));
}

fn slowest_of(range: vec4<f32>) -> f32 {
    return sqrt(norm2(max(max(range.xy, -range.zw), vec2(0.0))));
}

fn is_spread(range: vec4<f32>) -> bool {
    return sqrt(norm2(range.zw - range.xy)) > 0.5 + 0.35 * slowest_of(range);
}

// Bounding box of the motions of a workgroup's lanes; valid in lane 0.
fn range_of_tile(lane: u32, motion: vec2<f32>, counts: bool) -> vec4<f32> {
    low[lane] = select(vec2(HUGE), motion, counts);
    high[lane] = select(vec2(-HUGE), motion, counts);
    workgroupBarrier();
    for (var step = 32u; step > 0u; step /= 2u) {
        if (lane < step) {
            low[lane] = min(low[lane], low[lane + step]);
            high[lane] = max(high[lane], high[lane + step]);
        }
        workgroupBarrier();
    }
    return vec4(low[0], high[0]);
}

// Levels and motion of the new image.
@compute @workgroup_size(8, 8)
fn cs_levels(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) tile: vec3<u32>,
) {
    let inside = all(id.xy < job.size_px);
    var flow = vec2(0.0);
    if (inside) {
        levels[first_now() + index_of(id.xy)] = level_of(textureLoad(luminance_map, vec2<i32>(id.xy), 0).x);
        flow = textureLoad(flow_map, vec2<i32>(id.xy), 0).xy;
        flow_now[index_of(id.xy)] = flow;
    }
    let range = range_of_tile(lane, flow, inside);
    if (lane == 0u) {
        range_now[tile.y * job.n_tiles.x + tile.x] = range;
        atomicMax(&slices.fastest2, bitcast<u32>(fastest2_of(range)));
    }
}

// The first image initialises the references, which hold how far each pixel has leaked.
@compute @workgroup_size(8, 8)
fn cs_begin(@builtin(global_invocation_id) id: vec3<u32>) {
    if (all(id.xy < job.size_px)) {
        let i = index_of(id.xy);
        references[i] = levels[first_now() + i] - references[i];
        silent_nanos[i] = 0u;
    }
}

// Rounds half away from zero.
fn rounded(x: f32) -> f32 {
    return trunc(x + select(-0.5, 0.5, x >= 0.0));
}

// Tells each tile that this motion passed on its way here.
fn send_back(tile: vec2<u32>, motion: vec2<f32>) {
    let number = tile.y * job.n_tiles.x + tile.x;
    jump[number] = motion;
    let key = (u64(bitcast<u32>(norm2(motion))) << 32u) | u64(0xffffffffu - number);
    let back = clamp(motion / f32(TILE_PX), vec2(-1e4), vec2(1e4));
    let n_steps = i32(ceil(max(abs(back.x), abs(back.y)))) + 1;
    for (var step = 0; step <= n_steps; step++) {
        let share = f32(step) / f32(n_steps);
        let x = rounded(f32(tile.x) - back.x * share);
        let y = rounded(f32(tile.y) - back.y * share);
        if (x >= 0.0 && y >= 0.0 && x < f32(job.n_tiles.x) && y < f32(job.n_tiles.y)) {
            atomicMax(&passing[u32(y) * job.n_tiles.x + u32(x)], key);
        }
    }
}

// Finds where each pixel came from, nearest surface first, and which motions pass which tiles.
@compute @workgroup_size(8, 8)
fn cs_scatter(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) tile: vec3<u32>,
) {
    if (all(id.xy < job.size_px) && bitcast<f32>(atomicLoad(&slices.fastest2)) >= 0.25) {
        let i = index_of(id.xy);
        let origin = index_at(vec2<f32>(id.xy) + 0.5 - flow_now[i]);
        if (origin >= 0) {
            let depth_m = textureLoad(depth_map, vec2<i32>(id.xy), 0).x;
            atomicMax(&source[origin], (u64(~bitcast<u32>(depth_m)) << 32u) | u64(i));
        }
    }
    // One pixel more to the left and above, because a discontinuity may lie between two tiles.
    let corner = TILE_PX * tile.xy;
    for (var k = lane; k < 81u; k += 64u) {
        let at = clamp(vec2<i32>(corner) + vec2(i32(k % 9u), i32(k / 9u)) - 1, vec2(0), vec2<i32>(job.size_px) - 1);
        near[k] = flow_now[index_of(vec2<u32>(at))];
    }
    workgroupBarrier();
    if (lane != 0u) {
        return;
    }
    let left = select(0u, 1u, tile.x > 0u);
    let above = select(0u, job.n_tiles.x, tile.y > 0u);
    let number = tile.y * job.n_tiles.x + tile.x;
    var about = with_range(range_now[number], range_now[number - left]);
    about = with_range(about, with_range(range_now[number - above], range_now[number - left - above]));
    if (!is_spread(about)) {
        return;
    }
    // Pixels beyond the edge repeat it, which changes neither the fastest nor the slowest.
    var fastest = vec2(0.0);
    var slowest = vec2(HUGE);
    var slowest2 = HUGE;
    for (var k = 0u; k < 81u; k++) {
        let speed2 = norm2(near[k]);
        if (speed2 > norm2(fastest)) {
            fastest = near[k];
        }
        if (speed2 < slowest2) {
            slowest = near[k];
            slowest2 = speed2;
        }
    }
    if (!may_be_one_surface(fastest, slowest) && norm2(fastest) > 0.0) {
        send_back(tile.xy, fastest);
    }
}

// Gives each pixel of the first image the motion of the surface that left it.
@compute @workgroup_size(8, 8)
fn cs_before(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) tile: vec3<u32>,
) {
    let inside = all(id.xy < job.size_px);
    var motion = vec2(0.0);
    if (inside) {
        let i = index_of(id.xy);
        let came = source_words[i];
        if (bitcast<f32>(atomicLoad(&slices.fastest2)) < 0.25) {
            // Nothing leaves its pixel.
            motion = flow_now[i];
        } else if (came.y != 0u) {
            motion = flow_now[came.x];
        } else {
            motion = flow_before[i] * job.ratio;
        }
        motion_before[i] = motion;
    }
    let range = range_of_tile(lane, motion, inside);
    if (lane == 0u) {
        range_before[tile.y * job.n_tiles.x + tile.x] = range;
    }
}

// The pixel of a thread and its state.
struct Pixel {
    at: vec2<u32>,
    i: u32,
    reference: f32,
    silent_nanos: u32,
    up: f32,
    down: f32,
}

fn put_event(pixel: Pixel, nanos: u32, polarity: u32) {
    let scale = (u64(job.slices.y) << 32u) | u64(job.slices.x);
    let slice = min(u32((u64(nanos) * scale) >> 32u), 1023u);
    if (job.writes == 0u) {
        atomicAdd(&slices.counts[slice], 1u);
        return;
    }
    let place = atomicAdd(&slices.ends[slice], 1u);
    if (place < job.capacity) {
        let at = vec2<i32>(pixel.at);
        let id = textureLoad(instance_map, at, 0).x;
        let label = textureLoad(class_map, at, 0).x;
        list[LIST_HEAD + place] = vec4(nanos, (pixel.at.y << 16u) | pixel.at.x, id, (label << 8u) | polarity);
    }
}

fn nanos_of(step: u32, n_steps: u32) -> u32 {
    return u32(u64(job.nanos) * u64(step) / u64(n_steps));
}

// Makes the events of a level that goes linearly from `before` to `after` in one step of the
// window.
fn cross(pixel: ptr<function, Pixel>, before: f32, after: f32, step: u32, n_steps: u32) {
    let rises = after > before;
    let change = select(-(*pixel).down, (*pixel).up, rises);
    let sign = select(-1.0, 1.0, rises);
    var aim = (*pixel).reference + change;
    if (sign * after < sign * aim) {
        return;
    }
    let begin_nanos = nanos_of(step - 1u, n_steps);
    let length_nanos = nanos_of(step, n_steps) - begin_nanos;
    var per_level = HUGE;
    if (after != before) {
        per_level = 1.0 / (after - before);
    }
    while (sign * after >= sign * aim) {
        let share = clamp((aim - before) * per_level, 0.0, 1.0);
        let nanos = begin_nanos + min(u32(share * f32(length_nanos)), length_nanos);
        (*pixel).reference = aim;
        aim += change;
        if (job.refractory_nanos == 0u) {
            put_event(*pixel, nanos, u32(rises));
        } else if (nanos >= (*pixel).silent_nanos) {
            put_event(*pixel, nanos, u32(rises));
            let until = nanos + job.refractory_nanos;
            (*pixel).silent_nanos = select(until, 0xffffffffu, until < nanos);
        }
    }
}

// Bilinear level in the image whose first level this is.
fn sample(first: u32, at: vec2<f32>) -> f32 {
    let most = job.size_px - 1u;
    let q = clamp(at - 0.5, vec2(0.0), vec2<f32>(most));
    let a = vec2<u32>(q);
    let b = min(a + 1u, most);
    let w = q - floor(q);
    let upper = mix_of(levels[first + index_of(a)], levels[first + index_of(vec2(b.x, a.y))], w.x);
    return mix_of(upper, mix_of(levels[first + index_of(vec2(a.x, b.y))], levels[first + index_of(b)], w.x), w.y);
}

fn mix_of(a: f32, b: f32, share: f32) -> f32 {
    return a + (b - a) * share;
}

// Level of a pixel that one surface passes, when `share` of the window has passed.
fn level_of_one(i: u32, at: vec2<f32>, begin: vec2<f32>, end: vec2<f32>, share: f32) -> f32 {
    let motion = begin + (end - begin) * share;
    let ahead = at + motion * (1.0 - share);
    let behind = at - motion * share;
    let was_inside = is_inside(behind);
    let will_be = is_inside(ahead);
    if (!was_inside && !will_be) {
        return mix_of(levels[first_before() + i], levels[first_now() + i] + job.leak, share);
    }
    let before = sample(first_before(), behind);
    let after = sample(first_now(), ahead);
    // If one image does not show the point, the other one's level is used for both.
    return mix_of(select(after, before, was_inside), select(before, after, will_be), share) + job.leak * share;
}

// Level of a pixel that several surfaces pass: the nearest that has its motion and is here at this
// time hides the others.
fn level_of_several(i: u32, at: vec2<f32>, motions: array<vec2<f32>, 3>, n: u32, share: f32) -> f32 {
    var all_motions = motions;
    var chosen = vec2(0.0);
    var is_chosen = false;
    var nearest_m = HUGE;
    for (var k = 0u; k < n; k++) {
        let m = all_motions[k];
        let there = index_at(at + m * (1.0 - share));
        if (there >= 0) {
            let pixel = vec2(u32(there) % job.size_px.x, u32(there) / job.size_px.x);
            // The sky is infinitely far, and so are depths beyond this number.
            let depth_m = min(textureLoad(depth_map, vec2<i32>(pixel), 0).x, HUGE);
            if (depth_m <= nearest_m && alike(flow_now[there], m)) {
                nearest_m = depth_m;
                chosen = m;
                is_chosen = true;
            }
        }
    }
    var behind = at - motion_before[i] * share;
    if (!is_chosen) {
        // The surface is hidden at the end: take the one that was here at the beginning, moving on
        // as before.
        if (is_inside(behind)) {
            return sample(first_before(), behind);
        }
        return mix_of(levels[first_before() + i], levels[first_now() + i], share);
    }
    behind = at - chosen * share;
    let ahead = at + chosen * (1.0 - share);
    let origin = index_at(behind);
    var was_seen = false;
    if (origin >= 0) {
        was_seen = alike(motion_before[origin], chosen);
    }
    let will_be = is_inside(ahead);
    if (was_seen && will_be) {
        return mix_of(sample(first_before(), behind), sample(first_now(), ahead), share);
    }
    if (was_seen) {
        return sample(first_before(), behind);
    }
    if (will_be) {
        return sample(first_now(), ahead);
    }
    return mix_of(levels[first_before() + i], levels[first_now() + i], share);
}

fn n_steps_of(fastest_px: f32) -> u32 {
    return clamp(u32(min(fastest_px / job.substep_px, f32(MAX_STEPS) - 1.0)) + 1u, 1u, MAX_STEPS);
}

// Follows each pixel through the window: counts its events, or writes them and the pixel's state.
@compute @workgroup_size(8, 8)
fn cs_follow(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) tile: vec3<u32>,
) {
    let inside = all(id.xy < job.size_px);
    let i = index_of(min(id.xy, job.size_px - 1u));
    let at = vec2<f32>(id.xy) + 0.5;
    let number = tile.y * job.n_tiles.x + tile.x;
    var path = STRAIGHT;
    var begin = vec2(0.0);
    var end = vec2(0.0);
    var motions: array<vec2<f32>, 3>;
    var n_motions = 0u;
    if (inside && job.moves != 0u) {
        var range = with_range(range_now[number], range_before[number]);
        let sent = passing_words[number];
        var passes = vec2(0.0);
        if (sent.y != 0u) {
            passes = jump[0xffffffffu - sent.x];
            range = with_range(range, vec4(passes, passes));
        }
        begin = motion_before[i];
        end = flow_now[i];
        if (fastest2_of(range) >= job.substep_px * job.substep_px) {
            path = SMOOTH;
            if (is_spread(range)) {
                let fits = sent.y == 0u || may_be_one_surface(passes, begin) || may_be_one_surface(passes, end);
                if (!(may_be_one_surface(begin, end) && fits)) {
                    path = SEVERAL;
                    motions[0] = end;
                    n_motions = 1u;
                    if (!alike(begin, end)) {
                        motions[1] = begin;
                        n_motions = 2u;
                    }
                    // Zero motion counts as a motion, as on the CPU.
                    if (!alike(passes, end) && !(n_motions == 2u && alike(passes, begin))) {
                        motions[n_motions] = passes;
                        n_motions += 1u;
                    }
                } else if (all(begin == vec2(0.0)) && all(end == vec2(0.0))) {
                    path = STRAIGHT;
                }
            }
        }
    }
    // Eight pixels of a row that one surface passes use the steps of the fastest.
    speeds[lane] = select(0.0, max(norm2(begin), norm2(begin + (end - begin))), path == SMOOTH);
    workgroupBarrier();
    var fastest2 = 0.0;
    for (var k = 0u; k < 8u; k++) {
        fastest2 = max(fastest2, speeds[(lane & 56u) + k]);
    }
    if (!inside) {
        return;
    }
    var pixel = Pixel(id.xy, i, references[i], silent_nanos[i], job.threshold_up, job.threshold_down);
    if (job.differs != 0u) {
        pixel.up *= mismatch[i];
        pixel.down *= mismatch[i];
    }
    if (path == STRAIGHT) {
        cross(&pixel, levels[first_before() + i], levels[first_now() + i] + job.leak, 1u, 1u);
    } else {
        if (path == SEVERAL) {
            for (var k = 0u; k < n_motions; k++) {
                fastest2 = select(fastest2, norm2(motions[k]), k == 0u || norm2(motions[k]) > fastest2);
            }
        }
        let n_steps = n_steps_of(sqrt(fastest2));
        var before = levels[first_before() + i];
        for (var step = 1u; step <= n_steps; step++) {
            let share = f32(step) / f32(n_steps);
            var level = levels[first_now() + i] + job.leak;
            if (step < n_steps) {
                if (path == SMOOTH) {
                    level = level_of_one(i, at, begin, end, share);
                } else {
                    level = level_of_several(i, at, motions, n_motions, share) + job.leak * share;
                }
            }
            cross(&pixel, before, level, step, n_steps);
            before = level;
        }
    }
    if (job.writes != 0u) {
        references[i] = pixel.reference - job.leak;
        silent_nanos[i] = pixel.silent_nanos - min(pixel.silent_nanos, job.nanos);
    }
}

// Computes where each slice begins, and for the host where it ends.
@compute @workgroup_size(256)
fn cs_place(@builtin(local_invocation_index) lane: u32) {
    var own = vec4<u32>();
    var sum = 0u;
    for (var k = 0u; k < 4u; k++) {
        own[k] = sum;
        sum += atomicLoad(&slices.counts[4u * lane + k]);
    }
    let first = sum_up_to(lane, sum) - sum;
    for (var k = 0u; k < 4u; k++) {
        atomicStore(&slices.ends[4u * lane + k], first + own[k]);
    }
    list[lane] = vec4(first + own.y, first + own.z, first + own.w, first + sum);
}
