// Lidar rays through a two-level hierarchy of quantised eight-wide nodes, and the packing of their
// points.
//
// Rays walk in f32; the distance to what they hit is then computed in f64. Numbers that need more
// than f32 come as pairs (high, low) whose sum they are.
//
// Sources: Ylitie, Karras and Laine, Efficient Incoherent Ray Traversal on GPUs Through Compressed
// Wide BVHs (HPG 2017), for the nodes and the order of children; Steele, Lea and Flood, Fast
// splittable pseudorandom number generators (2014), for the noise.

struct Instance {
    // Rows of mesh_from_world with its translation in w: high and low parts.
    high: array<vec4<f32>, 3>,
    low: array<vec4<f32>, 3>,
    root: u32,
    first_triangle: u32,
    object: u32,
    // Where its legs begin among the instances; 0 if it stands still.
    first_leg: u32,
}

// One lidar. submission.rs explains the fields.
struct Lidar {
    n_channels: u32,
    n_columns: u32,
    first_elevation: u32,
    first_azimuth: u32,
    first_pose: u32,
    n_poses: u32,
    first_word: u32,
    first_chunk: u32,
    is_semantic: u32,
    ignored: u32,
    misfires_low: u32,
    misfires_high: u32,
    noise_low: u32,
    noise_high: u32,
    n_chunks: u32,
    point_words: u32,
    range_high_m: f32,
    range_low_m: f32,
    attenuation_per_m: f32,
    noise_range_stddev_m: f32,
    keep_limit: f32,
    dropoff_intensity_limit: f32,
    dropoff_zero_intensity_ratio: f32,
    root: u32,
    output: u32,
    first_out: u32,
    first_cleared: u32,
    first_moment: u32,
}

// Which lidars a dispatch traces and packs; blocks and chunks are those of the lidar that has most.
struct Dispatch {
    first_traced: u32,
    n_traced: u32,
    first_packed: u32,
    n_packed: u32,
    n_blocks: u32,
    n_chunks: u32,
}

@group(0) @binding(0) var<storage, read> nodes: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read> triangles: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> instances: array<Instance>;
@group(0) @binding(3) var<storage, read> lidars: array<Lidar>;
@group(0) @binding(4) var<storage, read> tables: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> points: array<u32>;
@group(0) @binding(6) var<storage, read_write> kept: array<atomic<u32>>;
// Returns per lidar, and up to eight outputs that points go to: scratch memory, or that of readers.
@group(1) @binding(0) var<storage, read_write> totals: array<u32>;
@group(1) @binding(1) var<storage, read_write> out0: array<u32>;
@group(1) @binding(2) var<storage, read_write> out1: array<u32>;
@group(1) @binding(3) var<storage, read_write> out2: array<u32>;
@group(1) @binding(4) var<storage, read_write> out3: array<u32>;
@group(1) @binding(5) var<storage, read_write> out4: array<u32>;
@group(1) @binding(6) var<storage, read_write> out5: array<u32>;
@group(1) @binding(7) var<storage, read_write> out6: array<u32>;
@group(1) @binding(8) var<storage, read_write> out7: array<u32>;

var<immediate> dispatch: Dispatch;

// Width of a workgroup's block of 64 rays.
override block_columns: u32 = 8u;

const chunk_rays: u32 = 256u;
const lost: u32 = 0xffffu;
const nothing: u32 = 0xffffffffu;
const is_instances: u32 = 0x80000000u;

fn wide(high: f32, low: f32) -> f64 {
    return f64(high) + f64(low);
}

struct Vec3d {
    x: f64,
    y: f64,
    z: f64,
}

fn dot3(a: Vec3d, b: Vec3d) -> f64 {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

fn minus(a: Vec3d, b: Vec3d) -> Vec3d {
    return Vec3d(a.x - b.x, a.y - b.y, a.z - b.z);
}

fn cross3(a: Vec3d, b: Vec3d) -> Vec3d {
    return Vec3d(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

fn widened(v: vec3<f32>) -> Vec3d {
    return Vec3d(f64(v.x), f64(v.y), f64(v.z));
}

fn narrowed(v: Vec3d) -> vec3<f32> {
    return vec3<f32>(f32(v.x), f32(v.y), f32(v.z));
}

fn row(high: vec4<f32>, low: vec4<f32>) -> Vec3d {
    return Vec3d(wide(high.x, low.x), wide(high.y, low.y), wide(high.z, low.z));
}

fn mix64(seed: u64) -> u64 {
    var z = seed + 0x9e3779b97f4a7c15lu;
    z = (z ^ (z >> 30u)) * 0xbf58476d1ce4e5b9lu;
    z = (z ^ (z >> 27u)) * 0x94d049bb133111eblu;
    return z ^ (z >> 31u);
}

// 53 random bits of a sample.
fn sample53(key: u64, sample: u64) -> u64 {
    return mix64(key ^ mix64(sample)) >> 11u;
}

fn uniform01(bits: u64) -> f32 {
    return f32(f64(bits) * 1.1102230246251565e-16lf);
}

fn gaussian(key: u64, sample: u64) -> f32 {
    let own = key ^ 0x6a09e667f3bcc908lu;
    // 1 - u, subtracted as integers: where it is small, and the logarithm steep, f32 keeps all
    // bits.
    let rest = f32(f64(0x20000000000000lu - sample53(own, 2lu * sample)) * 1.1102230246251565e-16lf);
    let angle = 6.283185307179586 * uniform01(sample53(own, 2lu * sample + 1lu));
    return sqrt(-2.0 * log(rest)) * cos(angle);
}

struct Found {
    distance: f32,
    triangle: u32,
    instance: u32,
}

fn finite_inverse(x: f32) -> f32 {
    return select(select(-1e20, 1e20, x >= 0.0), 1.0 / x, abs(x) > 1e-20);
}

fn inverse3(v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(finite_inverse(v.x), finite_inverse(v.y), finite_inverse(v.z));
}

// Octant of a direction: slots XOR this number are visited from the highest to the lowest bit,
// which is from near to far.
fn order_of(direction: vec3<f32>) -> u32 {
    return select(4u, 0u, direction.x < 0.0) | select(2u, 0u, direction.y < 0.0) | select(1u, 0u, direction.z < 0.0);
}

// A group that has a root node as its only child.
fn root(node: u32, order: u32) -> vec2<u32> {
    return vec2<u32>(node, ((1u << (7u ^ order)) << 8u) | 0x80u);
}

fn edge_normal(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return cross(a + b, b - a);
}

// Distance to a triangle, or -1. An edge that two triangles share gives numbers of opposite sign
// for the two, so that no ray slips between them.
fn triangle_distance(at: u32, origin: vec3<f32>, direction: vec3<f32>) -> f32 {
    let a = bitcast<vec3<f32>>(triangles[3u * at].xyz) - origin;
    let b = bitcast<vec3<f32>>(triangles[3u * at + 1u].xyz) - origin;
    let c = bitcast<vec3<f32>>(triangles[3u * at + 2u].xyz) - origin;
    let u = dot(edge_normal(b, c), direction);
    let v = dot(edge_normal(c, a), direction);
    let w = dot(edge_normal(a, b), direction);
    let low = min(min(u, v), w);
    let high = max(max(u, v), w);
    let sum = u + v + w;
    if ((low < 0.0 && high > 0.0) || sum == 0.0) {
        return -1.0;
    }
    return dot((u * a + v * b + w * c) / sum, direction);
}

// A ray in the space of an instance.
struct LocalRay {
    origin: Vec3d,
    direction: Vec3d,
}

// When a ray is fired: the leg of the way from tick to tick, counted from the newest, and the share
// of the way back to its earlier end. The leg `nothing` is the tick itself.
struct Moment {
    leg: u32,
    share: f64,
}

fn scaled(a: Vec3d, factor: f64) -> Vec3d {
    return Vec3d(a.x * factor, a.y * factor, a.z * factor);
}

fn plus(a: Vec3d, b: Vec3d) -> Vec3d {
    return Vec3d(a.x + b.x, a.y + b.y, a.z + b.z);
}

// Turns a vector by the inverse of a unit quaternion.
fn turned_back(w: f64, axis: Vec3d, v: Vec3d) -> Vec3d {
    let across = cross3(axis, v);
    return plus(v, scaled(minus(cross3(axis, across), scaled(across, w)), 2.0lf));
}

// The ray in the space of an instance where it is on a leg of its way; motion.rs has the same on the
// CPU.
fn local_ray_on(leg: u32, share: f64, origin: Vec3d, direction: Vec3d) -> LocalRay {
    let high = instances[leg].high;
    let low = instances[leg].low;
    let place = plus(row(high[0], low[0]), scaled(row(high[1], low[1]), share));
    let half_turn = Vec3d(
        wide(high[0].w, low[0].w),
        wide(high[1].w, low[1].w),
        wide(bitcast<f32>(instances[leg].root), bitcast<f32>(instances[leg].first_triangle)),
    );
    // Cosine of the half angle, and its sine over it.
    let square = dot3(half_turn, half_turn) * share * share;
    var cosine = 1.0lf;
    var ratio = 1.0lf;
    for (var n = 20u; n > 0u; n -= 2u) {
        let even = f64(n);
        cosine = 1.0lf - cosine * square / ((even - 1.0lf) * even);
        ratio = 1.0lf - ratio * square / (even * (even + 1.0lf));
    }
    let later = row(high[2], low[2]);
    let later_w = wide(high[2].w, low[2].w);
    let axis = scaled(half_turn, ratio * share);
    let w = later_w * cosine - dot3(later, axis);
    let turn = plus(plus(scaled(axis, later_w), scaled(later, cosine)), cross3(later, axis));
    return LocalRay(turned_back(w, turn, minus(origin, place)), turned_back(w, turn, direction));
}

fn local_ray(instance: u32, moment: Moment, origin: Vec3d, direction: Vec3d) -> LocalRay {
    let first_leg = instances[instance].first_leg;
    if (first_leg != 0u && moment.leg != nothing) {
        return local_ray_on(first_leg + moment.leg, moment.share, origin, direction);
    }
    let high = instances[instance].high;
    let low = instances[instance].low;
    let x = row(high[0], low[0]);
    let y = row(high[1], low[1]);
    let z = row(high[2], low[2]);
    let local_origin = Vec3d(
        dot3(x, origin) + wide(high[0].w, low[0].w),
        dot3(y, origin) + wide(high[1].w, low[1].w),
        dot3(z, origin) + wide(high[2].w, low[2].w),
    );
    return LocalRay(local_origin, Vec3d(dot3(x, direction), dot3(y, direction), dot3(z, direction)));
}

fn cast_ray(origin_in_world: Vec3d, direction_in_world: Vec3d, moment: Moment, limit: f32, ignored: u32, upper_root: u32) -> Found {
    var found = Found(limit, nothing, nothing);
    let world_origin = narrowed(origin_in_world);
    let world_direction = narrowed(direction_in_world);
    var origin = world_origin;
    var direction = world_direction;
    var inverse = inverse3(direction);
    var order = order_of(direction);
    var instance = nothing;
    var first_triangle = 0u;
    // What is still to be visited. For nodes: first child, and hits << 8 | inner slots. For
    // instances: the first one, and the top bit with a bit for each. The stack is private memory:
    // in workgroup memory it would leave room for fewer rays at a time.
    var stack: array<vec2<u32>, 32>;
    var depth = 0u;
    // Depth of the stack at which the walk of the current instance ends.
    var instance_depth = 0u;
    var group = root(upper_root, order);
    loop {
        if ((group.y & is_instances) != 0u) {
            let next = group.x + firstTrailingBit(group.y);
            let rest = group.y & (group.y - 1u);
            if (rest != is_instances) {
                stack[depth] = vec2<u32>(group.x, rest);
                depth += 1u;
            }
            group.y = 0u;
            if (ignored == 0u || instances[next].object != ignored) {
                instance = next;
                instance_depth = depth;
                first_triangle = instances[next].first_triangle;
                let local = local_ray(next, moment, origin_in_world, direction_in_world);
                origin = narrowed(local.origin);
                direction = narrowed(local.direction);
                inverse = inverse3(direction);
                order = order_of(direction);
                group = root(instances[next].root, order);
            }
        } else {
            let bit = firstLeadingBit(group.y >> 8u);
            let slot = bit ^ order;
            let child = group.x + countOneBits((group.y & 0xffu) & ((1u << slot) - 1u));
            group.y = group.y & ~(0x100u << bit);
            if ((group.y >> 8u) != 0u) {
                stack[depth] = group;
                depth += 1u;
            }
            // A node: origin, exponents and inner slots; first child, first item, meta; lower
            // sides; upper sides.
            let n0 = nodes[5u * child];
            let n1 = nodes[5u * child + 1u];
            let n2 = nodes[5u * child + 2u];
            let n3 = nodes[5u * child + 3u];
            let n4 = nodes[5u * child + 4u];
            let scale = vec3<f32>(
                bitcast<f32>((n0.w & 0xffu) << 23u),
                bitcast<f32>(((n0.w >> 8u) & 0xffu) << 23u),
                bitcast<f32>(((n0.w >> 16u) & 0xffu) << 23u),
            ) * inverse;
            let start = (bitcast<vec3<f32>>(n0.xyz) - origin) * inverse;
            // Near and far sides of four children at a time.
            let low_x = n2.xy;
            let low_y = n2.zw;
            let low_z = n3.xy;
            let high_x = n3.zw;
            let high_y = n4.xy;
            let high_z = n4.zw;
            let near_x = select(low_x, high_x, direction.x < 0.0);
            let far_x = select(high_x, low_x, direction.x < 0.0);
            let near_y = select(low_y, high_y, direction.y < 0.0);
            let far_y = select(high_y, low_y, direction.y < 0.0);
            let near_z = select(low_z, high_z, direction.z < 0.0);
            let far_z = select(high_z, low_z, direction.z < 0.0);
            var hits_out = 0u;
            var items = 0u;
            let inner = n0.w >> 24u;
            for (var part = 0u; part < 2u; part++) {
                let enter_x = vec4<f32>(unpack4xU8(near_x[part])) * scale.x + start.x;
                let enter_y = vec4<f32>(unpack4xU8(near_y[part])) * scale.y + start.y;
                let enter_z = vec4<f32>(unpack4xU8(near_z[part])) * scale.z + start.z;
                let leave_x = vec4<f32>(unpack4xU8(far_x[part])) * scale.x + start.x;
                let leave_y = vec4<f32>(unpack4xU8(far_y[part])) * scale.y + start.y;
                let leave_z = vec4<f32>(unpack4xU8(far_z[part])) * scale.z + start.z;
                let enter = max(max(enter_x, enter_y), max(enter_z, vec4<f32>(0.0)));
                let leave = min(min(leave_x, leave_y) * 1.0000005, min(leave_z * 1.0000005, vec4<f32>(found.distance)));
                let meta4 = unpack4xU8(n1[2u + part]);
                let is_hit = enter <= leave;
                for (var k = 0u; k < 4u; k++) {
                    let slot_here = 4u * part + k;
                    if (is_hit[k]) {
                        if (((inner >> slot_here) & 1u) != 0u) {
                            hits_out |= 1u << (slot_here ^ order);
                        } else if (meta4[k] != 0xffu) {
                            let n_items = (meta4[k] >> 5u) + 1u;
                            items |= ((1u << n_items) - 1u) << (meta4[k] & 31u);
                        }
                    }
                }
            }
            group = vec2<u32>(n1.x, (hits_out << 8u) | inner);
            if (instance == nothing) {
                // Visit the instances first and keep the inner nodes for later.
                if (items != 0u) {
                    if (hits_out != 0u) {
                        stack[depth] = group;
                        depth += 1u;
                    }
                    group = vec2<u32>(n1.y, is_instances | items);
                }
            } else {
                while (items != 0u) {
                    let at = first_triangle + n1.y + firstTrailingBit(items);
                    items = items & (items - 1u);
                    let distance = triangle_distance(at, origin, direction);
                    if (distance >= 0.0 && distance < found.distance) {
                        found = Found(distance, at, instance);
                    }
                }
            }
        }
        if ((group.y >> 8u) == 0u) {
            if (instance != nothing && depth == instance_depth) {
                instance = nothing;
                origin = world_origin;
                direction = world_direction;
                inverse = inverse3(direction);
                order = order_of(direction);
            }
            if (depth == 0u) {
                break;
            }
            depth -= 1u;
            group = stack[depth];
        }
    }
    return found;
}

fn put_lost(lidar: u32, ray: u32) {
    let words = lidars[lidar].point_words;
    points[lidars[lidar].first_word + words * ray + words - 1u] = lost << 16u;
}

fn trace_block(lidar: u32, block: u32, lane: u32) {
    let n_channels = lidars[lidar].n_channels;
    let n_columns = lidars[lidar].n_columns;
    let block_channels = 64u / block_columns;
    let across = (n_columns + block_columns - 1u) / block_columns;
    let column = (block % across) * block_columns + lane % block_columns;
    let channel = (block / across) * block_channels + lane / block_columns;
    if (channel >= n_channels || column >= n_columns) {
        return;
    }
    let ray = channel * n_columns + column;
    let key = (u64(lidars[lidar].noise_high) << 32u) | u64(lidars[lidar].noise_low);
    let misfires = (u64(lidars[lidar].misfires_high) << 32u) | u64(lidars[lidar].misfires_low);
    if (misfires != 0lu && sample53(key, 2lu * u64(ray)) < misfires) {
        put_lost(lidar, ray);
        return;
    }
    let elevation = tables[lidars[lidar].first_elevation + channel];
    let azimuth = tables[lidars[lidar].first_azimuth + column];
    let level = wide(elevation.x, elevation.y);
    let beam = Vec3d(level * wide(azimuth.x, azimuth.y), level * wide(azimuth.z, azimuth.w), wide(elevation.z, elevation.w));
    let pose = lidars[lidar].first_pose + 6u * select(0u, column, lidars[lidar].n_poses > 1u);
    let origin = Vec3d(
        wide(tables[pose].w, tables[pose + 3u].w),
        wide(tables[pose + 1u].w, tables[pose + 4u].w),
        wide(tables[pose + 2u].w, tables[pose + 5u].w),
    );
    let direction = Vec3d(
        dot3(row(tables[pose], tables[pose + 3u]), beam),
        dot3(row(tables[pose + 1u], tables[pose + 4u]), beam),
        dot3(row(tables[pose + 2u], tables[pose + 5u]), beam),
    );
    let range_high_m = lidars[lidar].range_high_m;
    // A little more than the range: the exact distance decides.
    var moment = Moment(nothing, 0.0lf);
    if (lidars[lidar].first_moment != nothing) {
        let of_column = tables[lidars[lidar].first_moment + column];
        if (of_column.x >= 0.0) {
            moment = Moment(u32(of_column.x), wide(of_column.y, of_column.z));
        }
    }
    let found = cast_ray(origin, direction, moment, range_high_m * 1.000001 + 1e-3, lidars[lidar].ignored, lidars[lidar].root);
    if (found.triangle == nothing) {
        put_lost(lidar, ray);
        return;
    }
    let a4 = triangles[3u * found.triangle];
    let b4 = triangles[3u * found.triangle + 1u];
    let a = widened(bitcast<vec3<f32>>(a4.xyz));
    let normal = cross3(minus(widened(bitcast<vec3<f32>>(b4.xyz)), a), minus(widened(bitcast<vec3<f32>>(triangles[3u * found.triangle + 2u].xyz)), a));
    let local = local_ray(found.instance, moment, origin, direction);
    let slope = dot3(normal, local.direction);
    var distance = f64(found.distance);
    if (slope != 0.0lf) {
        let plane = dot3(normal, minus(a, local.origin)) / slope;
        // A sliver has no well-defined plane: its f32 distance counts.
        if (abs(f32(plane) - found.distance) <= 0.01 + 0.01 * found.distance) {
            distance = max(plane, 0.0lf);
        }
    }
    if (distance > wide(range_high_m, lidars[lidar].range_low_m)) {
        put_lost(lidar, ray);
        return;
    }
    let word = lidars[lidar].first_word + lidars[lidar].point_words * ray;
    if (lidars[lidar].is_semantic == 1u) {
        let steep = f32(abs(slope));
        let length = sqrt(f32(dot3(normal, normal)));
        let own = a4.w;
        points[word] = bitcast<u32>(f32(beam.x * distance));
        points[word + 1u] = bitcast<u32>(f32(beam.y * distance));
        points[word + 2u] = bitcast<u32>(f32(beam.z * distance));
        points[word + 3u] = bitcast<u32>(select(1.0, min(steep / length, 1.0), length > 0.0));
        points[word + 4u] = select(own, instances[found.instance].object, own == 0u);
        points[word + 5u] = (channel << 16u) | b4.w;
    } else {
        let stddev_m = lidars[lidar].noise_range_stddev_m;
        if (stddev_m > 0.0) {
            distance = max(distance + f64(stddev_m * gaussian(key, u64(ray))), 0.0lf);
        }
        let intensity = exp(-lidars[lidar].attenuation_per_m * f32(distance));
        if (intensity < lidars[lidar].keep_limit) {
            let share = intensity / lidars[lidar].dropoff_intensity_limit;
            let kept_ratio = 1.0 - lidars[lidar].dropoff_zero_intensity_ratio * (1.0 - share);
            if (uniform01(sample53(key, 2lu * u64(ray) + 1lu)) >= kept_ratio) {
                put_lost(lidar, ray);
                return;
            }
        }
        points[word] = bitcast<u32>(f32(beam.x * distance));
        points[word + 1u] = bitcast<u32>(f32(beam.y * distance));
        points[word + 2u] = bitcast<u32>(f32(beam.z * distance));
        points[word + 3u] = (channel << 16u) | u32(intensity * 65535.0 + 0.5);
    }
    atomicAdd(&kept[lidars[lidar].first_chunk + ray / chunk_rays], 1u);
}

// Rays of a chunk that have a return.
var<workgroup> returned: array<u32, 256>;

fn put(output: u32, at: u32, word: u32) {
    switch (output) {
        case 0u: { out0[at] = word; }
        case 1u: { out1[at] = word; }
        case 2u: { out2[at] = word; }
        case 3u: { out3[at] = word; }
        case 4u: { out4[at] = word; }
        case 5u: { out5[at] = word; }
        case 6u: { out6[at] = word; }
        default: { out7[at] = word; }
    }
}

// Writes the returns of a chunk of 256 rays after those of all chunks before it.
fn pack_chunk(lidar: u32, chunk: u32, lane: u32) {
    let n_rays = lidars[lidar].n_channels * lidars[lidar].n_columns;
    let n_chunks = lidars[lidar].n_chunks;
    let words = lidars[lidar].point_words;
    let first_word = lidars[lidar].first_word;
    let first_chunk = lidars[lidar].first_chunk;
    let output = lidars[lidar].output;
    let is_used = chunk < n_chunks;
    var before = 0u;
    for (var other = lane; other < min(chunk, n_chunks); other += 64u) {
        before += atomicLoad(&kept[first_chunk + other]);
    }
    sum_up_to(lane, before);
    let base = sums[63];
    workgroupBarrier();
    let first_ray = chunk * chunk_rays + 4u * lane;
    var flags = 0u;
    for (var i = 0u; i < 4u; i++) {
        let ray = first_ray + i;
        if (is_used && ray < n_rays && (points[first_word + words * ray + words - 1u] >> 16u) != lost) {
            flags |= 1u << i;
        }
    }
    let n_own = countOneBits(flags);
    var at = sum_up_to(lane, n_own) - n_own;
    while (flags != 0u) {
        returned[at] = first_ray + firstTrailingBit(flags);
        flags = flags & (flags - 1u);
        at += 1u;
    }
    workgroupBarrier();
    let n_returned = sums[63];
    if (is_used && lane == 0u) {
        atomicStore(&kept[lidars[lidar].first_cleared + chunk], 0u);
        if (chunk + 1u == n_chunks) {
            totals[lidar] = base + n_returned;
        }
    }
    // Lanes write consecutive words, aligned to 128 bytes: the host's memory is reached over a bus
    // that transfers whole lines.
    let first_out = lidars[lidar].first_out + words * base;
    let skipped = first_out & 31u;
    let n_words = n_returned * words;
    for (var i = lane; i < n_words + skipped; i += 64u) {
        if (i >= skipped) {
            let word = i - skipped;
            let ray = returned[word / words];
            put(output, first_out + word, points[first_word + words * ray + word % words]);
        }
    }
}

@compute @workgroup_size(64)
fn trace(@builtin(workgroup_id) block: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    trace_block(dispatch.first_traced + block.y, block.x, lane);
}

@compute @workgroup_size(64)
fn pack(@builtin(workgroup_id) block: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    pack_chunk(dispatch.first_packed + block.y, block.x, lane);
}

// Packs some lidars while it traces the next ones, which keeps the bus busy: one of five workgroups
// packs. If all packing workgroups came first, they would fill the GPU and wait for the bus
// together.
@compute @workgroup_size(64)
fn both(@builtin(workgroup_id) block: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = block.z * 65535u + block.y;
    if (block.x == 0u) {
        let packed = place / dispatch.n_chunks;
        if (packed < dispatch.n_packed) {
            pack_chunk(dispatch.first_packed + packed, place % dispatch.n_chunks, lane);
        }
    } else {
        let own = 4u * place + block.x - 1u;
        let traced = own / dispatch.n_blocks;
        if (traced < dispatch.n_traced) {
            trace_block(dispatch.first_traced + traced, own % dispatch.n_blocks, lane);
        }
    }
}
