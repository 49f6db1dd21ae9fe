// Lidar rays through a two-level hierarchy of quantised eight-wide nodes, and the packing of their
// points.
//
// Rays walk in f32; what they hit is then made exact in f64. Numbers that need more than f32 come
// as pairs (high, low).
// Sources: Ylitie, Karras and Laine, Efficient Incoherent Ray Traversal on GPUs Through Compressed
// Wide BVHs (HPG 2017), for the nodes and the order of children; Steele, Lea and Flood, Fast
// splittable pseudorandom number generators (2014), for the noise.

struct Instance {
    // Rows of mesh_from_world with its translation in w: high and low parts.
    high: array<vec4<f32>, 3>,
    low: array<vec4<f32>, 3>,
    // Root node, first triangle, object id.
    what: vec4<u32>,
}

struct Lidar {
    // Channels, columns, first elevation and first azimuth in `tables`.
    shape: vec4<u32>,
    // First pose in `tables`, number of poses, first word of its points, first chunk.
    place: vec4<u32>,
    // 1 if semantic, object that rays pass through or 0, numerator over 2^53 of the general
    // drop-off (low, high).
    what: vec4<u32>,
    // Noise key (low, high), number of chunks, words of a point.
    noise: vec4<u32>,
    // Range (high, low), attenuation per metre, standard deviation of the range.
    range: vec4<f32>,
    // Intensity from which on every return is kept, the same for the ratio, share lost at intensity
    // 0.
    loss: vec4<f32>,
    // Output of its points, first word there, first of the counts that are cleared for the next
    // submission.
    target_of: vec4<u32>,
}

// What a dispatch does: first lidar to be traced, how many, first lidar to be packed, how many;
// blocks and chunks of the longest.
struct Turn {
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
// Counts of returns, and up to eight places where points go: scratch memory, or that of readers.
@group(1) @binding(0) var<storage, read_write> totals: array<u32>;
@group(1) @binding(1) var<storage, read_write> out0: array<u32>;
@group(1) @binding(2) var<storage, read_write> out1: array<u32>;
@group(1) @binding(3) var<storage, read_write> out2: array<u32>;
@group(1) @binding(4) var<storage, read_write> out3: array<u32>;
@group(1) @binding(5) var<storage, read_write> out4: array<u32>;
@group(1) @binding(6) var<storage, read_write> out5: array<u32>;
@group(1) @binding(7) var<storage, read_write> out6: array<u32>;
@group(1) @binding(8) var<storage, read_write> out7: array<u32>;

var<immediate> turn: Turn;

// Columns of a workgroup's block of 64 rays.
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
    // One less the number, which has the last bits where the logarithm needs them.
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

// Bit of a direction's octant that puts the nearest child highest.
fn order_of(direction: vec3<f32>) -> u32 {
    return select(4u, 0u, direction.x < 0.0) | select(2u, 0u, direction.y < 0.0) | select(1u, 0u, direction.z < 0.0);
}

// A root as the only child of a node above it.
fn root(node: u32, order: u32) -> vec2<u32> {
    return vec2<u32>(node, ((1u << (7u ^ order)) << 8u) | 0x80u);
}

fn edge_normal(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return cross(a + b, b - a);
}

// Distance to a triangle, or -1. An edge that two triangles share gives the same number with the
// other sign for the other one.
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

fn local_origin(instance: u32, origin: Vec3d) -> Vec3d {
    let high = instances[instance].high;
    let low = instances[instance].low;
    return Vec3d(
        dot3(row(high[0], low[0]), origin) + wide(high[0].w, low[0].w),
        dot3(row(high[1], low[1]), origin) + wide(high[1].w, low[1].w),
        dot3(row(high[2], low[2]), origin) + wide(high[2].w, low[2].w),
    );
}

fn local_direction(instance: u32, direction: Vec3d) -> Vec3d {
    let high = instances[instance].high;
    let low = instances[instance].low;
    return Vec3d(dot3(row(high[0], low[0]), direction), dot3(row(high[1], low[1]), direction), dot3(row(high[2], low[2]), direction));
}

fn cast_ray(origin_in_world: Vec3d, direction_in_world: Vec3d, limit: f32, ignored: u32) -> Found {
    var found = Found(limit, nothing, nothing);
    let world_origin = narrowed(origin_in_world);
    let world_direction = narrowed(direction_in_world);
    var origin = world_origin;
    var direction = world_direction;
    var inverse = inverse3(direction);
    var order = order_of(direction);
    var instance = nothing;
    var first_triangle = 0u;
    // What is still to be visited: first child and hits << 8 | inner slots, or first instance, the
    // top bit and a bit for each. In the workgroup's memory it leaves room for fewer rays at a
    // time.
    var stack: array<vec2<u32>, 32>;
    var depth = 0u;
    // The walk of an instance ends where it began.
    var instance_depth = 0u;
    var group = root(0u, order);
    loop {
        if ((group.y & is_instances) != 0u) {
            let next = group.x + firstTrailingBit(group.y);
            let rest = group.y & (group.y - 1u);
            if (rest != is_instances) {
                stack[depth] = vec2<u32>(group.x, rest);
                depth += 1u;
            }
            group.y = 0u;
            if (ignored == 0u || instances[next].what.z != ignored) {
                instance = next;
                instance_depth = depth;
                first_triangle = instances[next].what.y;
                origin = narrowed(local_origin(next, origin_in_world));
                direction = narrowed(local_direction(next, direction_in_world));
                inverse = inverse3(direction);
                order = order_of(direction);
                group = root(instances[next].what.x, order);
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
                // Instances before the nodes below.
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
    let words = lidars[lidar].noise.w;
    points[lidars[lidar].place.z + words * ray + words - 1u] = lost << 16u;
}

fn trace_block(lidar: u32, block: u32, lane: u32) {
    let shape = lidars[lidar].shape;
    let place = lidars[lidar].place;
    let what = lidars[lidar].what;
    let block_channels = 64u / block_columns;
    let across = (shape.y + block_columns - 1u) / block_columns;
    let column = (block % across) * block_columns + lane % block_columns;
    let channel = (block / across) * block_channels + lane / block_columns;
    if (channel >= shape.x || column >= shape.y) {
        return;
    }
    let ray = channel * shape.y + column;
    let key = (u64(lidars[lidar].noise.y) << 32u) | u64(lidars[lidar].noise.x);
    let misfires = (u64(what.w) << 32u) | u64(what.z);
    if (misfires != 0lu && sample53(key, 2lu * u64(ray)) < misfires) {
        put_lost(lidar, ray);
        return;
    }
    let elevation = tables[shape.z + channel];
    let azimuth = tables[shape.w + column];
    let level = wide(elevation.x, elevation.y);
    let beam = Vec3d(level * wide(azimuth.x, azimuth.y), level * wide(azimuth.z, azimuth.w), wide(elevation.z, elevation.w));
    let pose = place.x + 6u * select(0u, column, place.y > 1u);
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
    let range = lidars[lidar].range;
    // A little beyond the limit: the exact distance decides.
    let found = cast_ray(origin, direction, range.x * 1.000001 + 1e-3, what.y);
    if (found.triangle == nothing) {
        put_lost(lidar, ray);
        return;
    }
    let a4 = triangles[3u * found.triangle];
    let b4 = triangles[3u * found.triangle + 1u];
    let a = widened(bitcast<vec3<f32>>(a4.xyz));
    let normal = cross3(minus(widened(bitcast<vec3<f32>>(b4.xyz)), a), minus(widened(bitcast<vec3<f32>>(triangles[3u * found.triangle + 2u].xyz)), a));
    let local = local_direction(found.instance, direction);
    let slope = dot3(normal, local);
    var distance = f64(found.distance);
    if (slope != 0.0lf) {
        let plane = dot3(normal, minus(a, local_origin(found.instance, origin))) / slope;
        // A sliver has no plane worth the name.
        if (abs(f32(plane) - found.distance) <= 0.01 + 0.01 * found.distance) {
            distance = max(plane, 0.0lf);
        }
    }
    if (distance > wide(range.x, range.y)) {
        put_lost(lidar, ray);
        return;
    }
    let word = place.z + lidars[lidar].noise.w * ray;
    if (what.x == 1u) {
        let steep = f32(abs(slope));
        let length = sqrt(f32(dot3(normal, normal)));
        let own = a4.w;
        points[word] = bitcast<u32>(f32(beam.x * distance));
        points[word + 1u] = bitcast<u32>(f32(beam.y * distance));
        points[word + 2u] = bitcast<u32>(f32(beam.z * distance));
        points[word + 3u] = bitcast<u32>(select(1.0, min(steep / length, 1.0), length > 0.0));
        points[word + 4u] = select(own, instances[found.instance].what.z, own == 0u);
        points[word + 5u] = (channel << 16u) | b4.w;
    } else {
        if (range.w > 0.0) {
            distance = max(distance + f64(range.w * gaussian(key, u64(ray))), 0.0lf);
        }
        let loss = lidars[lidar].loss;
        let intensity = exp(-range.z * f32(distance));
        if (intensity < loss.x && uniform01(sample53(key, 2lu * u64(ray) + 1lu)) >= 1.0 - loss.z * (1.0 - intensity / loss.y)) {
            put_lost(lidar, ray);
            return;
        }
        points[word] = bitcast<u32>(f32(beam.x * distance));
        points[word + 1u] = bitcast<u32>(f32(beam.y * distance));
        points[word + 2u] = bitcast<u32>(f32(beam.z * distance));
        points[word + 3u] = (channel << 16u) | u32(intensity * 65535.0 + 0.5);
    }
    atomicAdd(&kept[place.w + ray / chunk_rays], 1u);
}

// Rays of a chunk that return.
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

// Writes the returns of a chunk of 256 rays behind those of all chunks before it.
fn pack_chunk(lidar: u32, chunk: u32, lane: u32) {
    let n_rays = lidars[lidar].shape.x * lidars[lidar].shape.y;
    let n_chunks = lidars[lidar].noise.z;
    let words = lidars[lidar].noise.w;
    let first_word = lidars[lidar].place.z;
    let first_chunk = lidars[lidar].place.w;
    let home = lidars[lidar].target_of;
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
        atomicStore(&kept[home.z + chunk], 0u);
        if (chunk + 1u == n_chunks) {
            totals[lidar] = base + n_returned;
        }
    }
    // Word by word from a multiple of 128 bytes on: memory of the host is reached over a bus that
    // wants whole lines.
    let first_out = home.y + words * base;
    let skipped = first_out & 31u;
    let n_words = n_returned * words;
    for (var i = lane; i < n_words + skipped; i += 64u) {
        if (i >= skipped) {
            let word = i - skipped;
            let ray = returned[word / words];
            put(home.x, first_out + word, points[first_word + words * ray + word % words]);
        }
    }
}

@compute @workgroup_size(64)
fn trace(@builtin(workgroup_id) block: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    trace_block(turn.first_traced + block.y, block.x, lane);
}

@compute @workgroup_size(64)
fn pack(@builtin(workgroup_id) block: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    pack_chunk(turn.first_packed + block.y, block.x, lane);
}

// Some lidars are packed while the next ones are traced, so that the bus has work all the time: of
// five workgroups one packs. If all that pack came first, they would fill the GPU and wait for the
// bus together.
@compute @workgroup_size(64)
fn both(@builtin(workgroup_id) block: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = block.z * 65535u + block.y;
    if (block.x == 0u) {
        let packed = place / turn.n_chunks;
        if (packed < turn.n_packed) {
            pack_chunk(turn.first_packed + packed, place % turn.n_chunks, lane);
        }
    } else {
        let own = 4u * place + block.x - 1u;
        let traced = own / turn.n_blocks;
        if (traced < turn.n_traced) {
            trace_block(turn.first_traced + traced, own % turn.n_blocks, lane);
        }
    }
}
