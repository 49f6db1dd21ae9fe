// Computes from the triangle that a pixel shows what each modality keeps of it; the counterpart of
// drawing. GPUs do so in resolve_compute.wgsl; sensor_shade has the same for processors. Mirrors:
// raster/plan.rs.

// Mirror of RasterDraw, as in raster.wgsl.
struct Draw {
    first_triangle: u32,
    n_triangles: u32,
    first_idx: u32,
    base_vertex: u32,
    instance: u32,
    view: u32,
    rest: vec2<u32>,
}

@group(2) @binding(0) var<storage, read> draws: array<Draw>;
@group(2) @binding(1) var<storage, read> vertices: array<u32>;
@group(2) @binding(2) var<storage, read> indices: array<u32>;

// Whether the target of this number (target/kind.rs) is wanted. This is not an override: with a
// single pipeline, no compiler rounds a target differently depending on other readers.
fn wants(number: u32) -> bool {
    return ((views[which].wanted >> number) & 1u) != 0u;
}

fn wants_flow() -> bool {
    return wants(4u);
}

const VERTEX_WORDS: u32 = 9u;

// The draw call of the view that holds this triangle: the last one that begins at or before it.
fn draw_with(triangle: u32) -> u32 {
    var low = views[which].first_draw;
    var n = views[which].n_draws;
    while n > 1u {
        let half = n / 2u;
        let is_behind = draws[low + half].first_triangle <= triangle;
        low = select(low, low + half, is_behind);
        n = select(half, n - half, is_behind);
    }
    return low;
}

fn position_of(vertex: u32) -> vec3<f32> {
    let at = vertex * VERTEX_WORDS;
    return bitcast<vec3<f32>>(vec3(vertices[at], vertices[at + 1u], vertices[at + 2u]));
}

fn normal_of(vertex: u32) -> vec3<f32> {
    return unpack4x8snorm(vertices[vertex * VERTEX_WORDS + 3u]).xyz;
}

fn uv_of(vertex: u32) -> vec2<f32> {
    let at = vertex * VERTEX_WORDS + 7u;
    return bitcast<vec2<f32>>(vec2(vertices[at], vertices[at + 1u]));
}

fn seen_pixel(at: vec2<f32>, found: vec2<u32>) -> Pixel {
    let depth_m = 1.0 / bitcast<f32>(found.y);
    let draw = draws[draw_with(found.x)];
    let first = draw.first_idx + 3u * (found.x - draw.first_triangle);
    let corners = vec3(indices[first], indices[first + 1u], indices[first + 2u]) + draw.base_vertex;
    let a = point_in_camera(draw.instance, position_of(corners.x));
    let along = point_in_camera(draw.instance, position_of(corners.y)) - a;
    let aside = point_in_camera(draw.instance, position_of(corners.z)) - a;
    // Barycentric coordinates of this point of the plane, clamped so that rounding does not lead
    // outside.
    let offset = ray_in_camera(at) * depth_m - a;
    let normal = cross(along, aside);
    let per_area = 1.0 / max(dot(normal, normal), 1e-37);
    let second = clamp(dot(cross(offset, aside), normal) * per_area, 0.0, 1.0);
    let third = clamp(dot(cross(along, offset), normal) * per_area, 0.0, 1.0 - second);
    let shares = vec3(1.0 - second - third, second, third);
    let in_mesh = normal_of(corners.x) * shares.x + normal_of(corners.y) * shares.y + normal_of(corners.z) * shares.z;
    let uv_m = uv_of(corners.x) * shares.x + uv_of(corners.y) * shares.y + uv_of(corners.z) * shares.z;
    let words = corners.x * VERTEX_WORDS;
    let codes = vertices[words + 5u];
    let labels = vec4(codes & 0xffu, (codes >> 8u) & 0xffu, (codes >> 16u) & 0xffu, codes >> 24u);
    let marks = labels_of(vertices[words + 4u], labels, vertices[words + 6u], marks_of(draw.instance));
    let pixel_m = depth_m / views[which].lens_px.x;
    var out = surface_pixel(depth_m, direction_in_world(draw.instance, in_mesh), uv_m, marks, pixel_m);
    if wants_flow() {
        out.flow_px = flow_of(at, depth_m, draw.instance);
    }
    return out;
}

// What is kept of the sky at a pixel.
fn seen_sky(at: vec2<f32>) -> Pixel {
    var out = sky_pixel(views[which].sky_depth_m);
    if wants_flow() && views[which].turned != 0.0 {
        // Points at infinity move by the rotation alone.
        let before = rotate_rows(views[which].previous_from_camera, ray_in_camera(at));
        if before.z > 0.0 {
            out.flow_px = at - pixel_of(before);
        }
    }
    return out;
}

// What is kept of the pixel with its centre here, which shows a triangle of this number at these bits
// of 1 / depth (0: sky).
fn pixel_at(at: vec2<f32>, found: vec2<u32>) -> Pixel {
    if found.y == 0u {
        return seen_sky(at);
    }
    return seen_pixel(at, found);
}
