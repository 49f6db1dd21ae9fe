// Rasterises triangles in a compute shader, for GPUs that have far more arithmetic there than
// behind their rasteriser.
//
// Corners are rounded to 1/256 pixel and edges are tested in integers, so that triangles with a
// common edge share no pixel and leave no gap (top-left rule). A pixel keeps the greatest of (1 /
// depth, number of the triangle), so the result does not depend on the order of the work. Mirrors:
// raster/plan.rs.

struct Instance {
    camera_from_mesh: array<vec4<f32>, 3>,
    previous_from_camera: array<vec4<f32>, 3>,
    world_from_mesh_xyzw: vec4<f32>,
    marks: vec4<u32>,
}

// Mirror of RasterView.
struct RasterView {
    // Focal length x, y, principal point x, y.
    lens_px: vec4<f32>,
    size_px: vec2<u32>,
    // Where its pixels begin in `seen`.
    first_pixel: u32,
    near_m: f32,
}

// Mirror of RasterDraw.
struct Draw {
    // Number of its first triangle among those of the view.
    first_triangle: u32,
    n_triangles: u32,
    first_idx: u32,
    base_vertex: u32,
    instance: u32,
    view: u32,
    // Where its chunks begin in their list.
    first_chunk: u32,
    // Unused.
    rest: u32,
}

// Mirror of RasterBatch.
struct Batch {
    first_chunk: u32,
    n_chunks: u32,
    // Workgroups per row of the dispatch.
    n_across: u32,
    // Room for tiles in the queue; after it there is room for whole triangles.
    max_tiles: u32,
}

struct Queue {
    n_tiles: atomic<u32>,
    n_whole: atomic<u32>,
    // Unused.
    rest: vec2<u32>,
    // Draw, triangle, tile.
    items: array<vec4<u32>>,
}

@group(0) @binding(0) var<storage, read> views: array<RasterView>;
@group(0) @binding(1) var<storage, read> instances: array<Instance>;
@group(0) @binding(2) var<storage, read> draws: array<Draw>;
// Draw, first triangle.
@group(0) @binding(3) var<storage, read> chunks: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> vertices: array<u32>;
@group(0) @binding(5) var<storage, read> indices: array<u32>;
// Per pixel: bits of 1 / depth (high word) and the triangle's number (low word).
@group(0) @binding(6) var<storage, read_write> seen: array<atomic<u64>>;
@group(0) @binding(7) var<storage, read_write> queue: Queue;
@group(0) @binding(8) var<uniform> batch: Batch;
@group(1) @binding(0) var<storage, read_write> arguments: array<u32, 3>;

const VERTEX_WORDS: u32 = 9u;
const TILE_PX: i32 = 64;
// Whole triangles: tile numbers end below.
const WHOLE: u32 = 0xffffffffu;
// An entry in the queue that stays empty.
const NOTHING: u32 = 0xffffffffu;
// Limits of a triangle that one thread fills: side of its box, and pixels.
const SMALL_SIDE_PX: i32 = 48;
const SMALL_PX: i32 = 64;
// Triangles are clipped to this distance from the image.
const GUARD_PX: f32 = 524288.0;

fn corner_of(draw: Draw, triangle: u32, corner: u32) -> vec3<f32> {
    let at = (draw.base_vertex + indices[draw.first_idx + 3u * triangle + corner]) * VERTEX_WORDS;
    let p = vec4(bitcast<f32>(vertices[at]), bitcast<f32>(vertices[at + 1u]), bitcast<f32>(vertices[at + 2u]), 1.0);
    let m = instances[draw.instance].camera_from_mesh;
    return vec3(dot(m[0], p), dot(m[1], p), dot(m[2], p));
}

fn pixel_of(view: RasterView, p: vec3<f32>) -> vec2<f32> {
    return p.xy / p.z * view.lens_px.xy + view.lens_px.zw;
}

// Rounds a position to 256ths of a pixel.
fn snapped(at: vec2<f32>) -> vec2<i32> {
    return vec2<i32>(floor(at * 256.0 + 0.5));
}

// 1 / depth of a triangle's plane as a function of the pixel: a position, the value there, its
// change per pixel, and its bounds.
struct Slope {
    at_px: vec2<f32>,
    value: f32,
    change: vec2<f32>,
    least: f32,
    most: f32,
}

fn slope_of(view: RasterView, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> Slope {
    // Start at the farthest corner, where 1 / depth and its error are smallest.
    var far = a;
    if b.z > far.z {
        far = b;
    }
    if c.z > far.z {
        far = c;
    }
    let normal = cross(b - a, c - a);
    let ray = far.xy / far.z;
    let facing = dot(normal, vec3(ray, 1.0));
    var out: Slope;
    out.at_px = ray * view.lens_px.xy + view.lens_px.zw;
    out.value = 1.0 / far.z;
    out.change = select(vec2(0.0), normal.xy * out.value / (view.lens_px.xy * facing), abs(facing) > 1e-30);
    out.least = out.value;
    out.most = 1.0 / max(min(a.z, min(b.z, c.z)), view.near_m);
    return out;
}

fn key_at(slope: Slope, x: i32, y: i32, number: u32) -> u64 {
    let away = vec2(f32(x), f32(y)) + 0.5 - slope.at_px;
    let value = clamp(slope.value + dot(slope.change, away), slope.least, slope.most);
    return (u64(bitcast<u32>(value)) << 32u) | u64(number);
}

// Twice the area of a, b, c: positive clockwise as seen, y down.
fn area_of(a: vec2<i32>, b: vec2<i32>, c: vec2<i32>) -> i32 {
    return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

// 0 if points on this edge belong to the triangle on its right, else -1.
fn rim(d: vec2<i32>) -> i32 {
    return select(-1, 0, d.y < 0 || (d.y == 0 && d.x > 0));
}

// Pixels of the image whose centres can lie in the box.
struct Box {
    low: vec2<i32>,
    high: vec2<i32>,
}

fn box_of(view: RasterView, least: vec2<i32>, most: vec2<i32>) -> Box {
    return Box(max((least + 127) >> vec2(8u), vec2(0)), min((most - 128) >> vec2(8u), vec2<i32>(view.size_px) - 1));
}

@compute @workgroup_size(64)
fn cs_small(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let number = group.y * batch.n_across + group.x;
    if number >= batch.n_chunks {
        return;
    }
    let chunk = chunks[batch.first_chunk + number];
    let draw = draws[chunk.x];
    let triangle = chunk.y + lane;
    if triangle >= draw.n_triangles {
        return;
    }
    let view = views[draw.view];
    let a = corner_of(draw, triangle, 0u);
    let b = corner_of(draw, triangle, 1u);
    let c = corner_of(draw, triangle, 2u);
    if max(a.z, max(b.z, c.z)) < view.near_m {
        return;
    }
    // The triangle lies completely beside the image.
    let size = vec2<f32>(view.size_px);
    let scale = view.lens_px.xy;
    let shift = view.lens_px.zw;
    let from_left = max(a.xy * scale + shift * a.z, max(b.xy * scale + shift * b.z, c.xy * scale + shift * c.z));
    let from_right = min(a.xy * scale + (shift - size) * a.z, min(b.xy * scale + (shift - size) * b.z, c.xy * scale + (shift - size) * c.z));
    if any(from_left < vec2(0.0)) || any(from_right > vec2(0.0)) {
        return;
    }
    var within: Box;
    if is_cut(view, a, b, c) {
        let cut = polygon_of(view, a, b, c);
        if cut.n < 3u {
            return;
        }
        var least = cut.corners[0];
        var most = cut.corners[0];
        for (var i = 1u; i < cut.n; i++) {
            least = min(least, cut.corners[i]);
            most = max(most, cut.corners[i]);
        }
        within = box_of(view, least, most);
    } else {
        let first = snapped(pixel_of(view, a));
        let second = snapped(pixel_of(view, b));
        let third = snapped(pixel_of(view, c));
        let least = min(first, min(second, third));
        let most = max(first, max(second, third));
        within = box_of(view, least, most);
        let sides = most - least;
        let n = within.high - within.low + 1;
        if all(n > vec2(0)) && all(sides < vec2(SMALL_SIDE_PX * 256)) && n.x * n.y <= SMALL_PX {
            let origin = within.low * 256 + 128;
            fill_small(view, draw, triangle, slope_of(view, a, b, c), within, first - origin, second - origin, third - origin);
            return;
        }
    }
    if any(within.high < within.low) {
        return;
    }
    let first_tile = within.low / TILE_PX;
    let n_tiles = within.high / TILE_PX - first_tile + 1;
    let n = u32(n_tiles.x * n_tiles.y);
    let place = atomicAdd(&queue.n_tiles, n);
    if place + n > batch.max_tiles {
        for (var i = place; i < batch.max_tiles; i++) {
            queue.items[i] = vec4(NOTHING);
        }
        let behind = atomicAdd(&queue.n_whole, 1u);
        queue.items[batch.max_tiles + behind] = vec4(chunk.x, triangle, WHOLE, 0u);
        return;
    }
    for (var i = 0u; i < n; i++) {
        let tile = vec2<u32>(first_tile) + vec2(i % u32(n_tiles.x), i / u32(n_tiles.x));
        queue.items[place + i] = vec4(chunk.x, triangle, tile.x | (tile.y << 16u), 0u);
    }
}

// Corners relative to the centre of the box's first pixel; the box is small enough for 32 bits.
fn fill_small(view: RasterView, draw: Draw, triangle: u32, slope: Slope, within: Box, a: vec2<i32>, b: vec2<i32>, c: vec2<i32>) {
    // Front faces are counter-clockwise.
    if area_of(a, b, c) >= 0 {
        return;
    }
    let ac = c - a;
    let cb = b - c;
    let ba = a - b;
    var row = vec3(ac.y * a.x - ac.x * a.y + rim(ac), cb.y * c.x - cb.x * c.y + rim(cb), ba.y * b.x - ba.x * b.y + rim(ba));
    let right = vec3(ac.y, cb.y, ba.y) * -256;
    let down = vec3(ac.x, cb.x, ba.x) * 256;
    for (var y = within.low.y; y <= within.high.y; y++) {
        var edges = row;
        for (var x = within.low.x; x <= within.high.x; x++) {
            if (edges.x | edges.y | edges.z) >= 0 {
                let pixel = view.first_pixel + u32(y) * view.size_px.x + u32(x);
                atomicMax(&seen[pixel], key_at(slope, x, y, draw.first_triangle + triangle));
            }
            edges += right;
        }
        row += down;
    }
}

// Whether a corner lies in front of the near plane or too far outside for integers.
fn is_cut(view: RasterView, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> bool {
    let behind = min(a.z, min(b.z, c.z)) < view.near_m;
    let reach = GUARD_PX / view.lens_px.xy;
    let outside = any(abs(a.xy) > reach * a.z) || any(abs(b.xy) > reach * b.z) || any(abs(c.xy) > reach * c.z);
    return behind || outside;
}

// A triangle clipped to the near plane and to the guard band; corners in 256ths of a pixel.
struct Polygon {
    n: u32,
    corners: array<vec2<i32>, 8>,
}

// Signed distance to one of the five clipping planes.
fn inside_of(view: RasterView, plane: u32, p: vec3<f32>) -> f32 {
    let reach = GUARD_PX / view.lens_px.xy * p.z;
    switch plane {
        case 0u: { return p.z - view.near_m; }
        case 1u: { return reach.x - p.x; }
        case 2u: { return reach.x + p.x; }
        case 3u: { return reach.y - p.y; }
        default: { return reach.y + p.y; }
    }
}

// Clips plane by plane (Sutherland and Hodgman, 1974). An edge is always cut starting from its
// inner end, so that two triangles with a common edge get the same point.
fn polygon_of(view: RasterView, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> Polygon {
    var begin: array<vec3<f32>, 8>;
    var kept: array<vec3<f32>, 8>;
    begin[0] = a;
    begin[1] = b;
    begin[2] = c;
    var n = 3u;
    for (var plane = 0u; plane < 5u; plane++) {
        var n_kept = 0u;
        for (var i = 0u; i < n; i++) {
            let here = begin[i];
            let next = begin[select(i + 1u, 0u, i + 1u == n)];
            let inside = inside_of(view, plane, here);
            let next_inside = inside_of(view, plane, next);
            if inside >= 0.0 && n_kept < 8u {
                kept[n_kept] = here;
                n_kept++;
            }
            if (inside >= 0.0) != (next_inside >= 0.0) && n_kept < 8u {
                var cut: vec3<f32>;
                if inside >= 0.0 {
                    cut = here + (next - here) * (inside / (inside - next_inside));
                } else {
                    cut = next + (here - next) * (next_inside / (next_inside - inside));
                }
                if plane == 0u {
                    cut.z = view.near_m;
                }
                kept[n_kept] = cut;
                n_kept++;
            }
        }
        begin = kept;
        n = n_kept;
    }
    var out: Polygon;
    out.n = n;
    for (var i = 0u; i < n; i++) {
        out.corners[i] = snapped(pixel_of(view, begin[i]));
    }
    return out;
}

// One workgroup per item, up to the limit of workgroups.
@compute @workgroup_size(1)
fn cs_arguments() {
    let n = min(atomicLoad(&queue.n_tiles), batch.max_tiles) + atomicLoad(&queue.n_whole);
    let down = max((n + 32767u) / 32768u, 1u);
    arguments[0] = (n + down - 1u) / down;
    arguments[1] = down;
    arguments[2] = 1u;
}

@compute @workgroup_size(64)
fn cs_tiles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let n_tiles = min(atomicLoad(&queue.n_tiles), batch.max_tiles);
    let number = group.y * groups.x + group.x;
    if number >= n_tiles + atomicLoad(&queue.n_whole) {
        return;
    }
    let item = queue.items[select(batch.max_tiles + number - n_tiles, number, number < n_tiles)];
    if item.x == NOTHING {
        return;
    }
    let draw = draws[item.x];
    let view = views[draw.view];
    let a = corner_of(draw, item.y, 0u);
    let b = corner_of(draw, item.y, 1u);
    let c = corner_of(draw, item.y, 2u);
    var tile = Box(vec2(0), vec2<i32>(view.size_px) - 1);
    if item.z != WHOLE {
        tile.low = vec2<i32>(vec2(item.z & 0xffffu, item.z >> 16u)) * TILE_PX;
        tile.high = tile.low + TILE_PX - 1;
    }
    if is_cut(view, a, b, c) {
        fill_polygon(view, draw, item.y, tile, lane, a, b, c);
    } else {
        fill_triangle(view, draw, item.y, tile, lane, a, b, c);
    }
}

// Edge function of an edge that begins here and runs along d, in integers: it grows to the right,
// and is negative outside the triangle.
fn right_of(begin: vec2<i32>, d: vec2<i32>, at: vec2<i32>) -> i64 {
    return i64(d.x) * i64(at.y - begin.y) - i64(d.y) * i64(at.x - begin.x) + i64(rim(d));
}

fn fill_triangle(view: RasterView, draw: Draw, triangle: u32, tile: Box, lane: u32, pa: vec3<f32>, pb: vec3<f32>, pc: vec3<f32>) {
    let a = snapped(pixel_of(view, pa));
    let b = snapped(pixel_of(view, pb));
    let c = snapped(pixel_of(view, pc));
    let ac = c - a;
    let cb = b - c;
    let ba = a - b;
    // Front faces are counter-clockwise.
    if i64(-ba.x) * i64(ac.y) - i64(-ba.y) * i64(ac.x) >= 0li {
        return;
    }
    let own = box_of(view, min(a, min(b, c)), max(a, max(b, c)));
    let low = max(tile.low, own.low);
    let n = min(tile.high, own.high) - low + 1;
    if any(n <= vec2(0)) {
        return;
    }
    let slope = slope_of(view, pa, pb, pc);
    for (var i = i32(lane); i < n.x * n.y; i += 64) {
        let at = low + vec2(i % n.x, i / n.x);
        let middle = at * 256 + 128;
        if (right_of(a, ac, middle) | right_of(c, cb, middle) | right_of(b, ba, middle)) >= 0li {
            let pixel = view.first_pixel + u32(at.y) * view.size_px.x + u32(at.x);
            atomicMax(&seen[pixel], key_at(slope, at.x, at.y, draw.first_triangle + triangle));
        }
    }
}

fn fill_polygon(view: RasterView, draw: Draw, triangle: u32, tile: Box, lane: u32, pa: vec3<f32>, pb: vec3<f32>, pc: vec3<f32>) {
    // The visible face has its normal towards the eye.
    if dot(cross(pb - pa, pc - pa), pa) >= 0.0 {
        return;
    }
    var cut = polygon_of(view, pa, pb, pc);
    if cut.n < 3u {
        return;
    }
    var least = cut.corners[0];
    var most = cut.corners[0];
    for (var i = 1u; i < cut.n; i++) {
        least = min(least, cut.corners[i]);
        most = max(most, cut.corners[i]);
    }
    let own = box_of(view, least, most);
    let low = max(tile.low, own.low);
    let n = min(tile.high, own.high) - low + 1;
    if any(n <= vec2(0)) {
        return;
    }
    let slope = slope_of(view, pa, pb, pc);
    for (var i = i32(lane); i < n.x * n.y; i += 64) {
        let at = low + vec2(i % n.x, i / n.x);
        let middle = at * 256 + 128;
        var inside = 0li;
        for (var k = 0u; k < cut.n; k++) {
            let end = cut.corners[k];
            let begin = cut.corners[select(k + 1u, 0u, k + 1u == cut.n)];
            inside = inside | right_of(begin, end - begin, middle);
        }
        if inside >= 0li {
            let pixel = view.first_pixel + u32(at.y) * view.size_px.x + u32(at.x);
            atomicMax(&seen[pixel], key_at(slope, at.x, at.y, draw.first_triangle + triangle));
        }
    }
}
