// Splits draw calls into chunks, of which a workgroup of raster.wgsl takes one each. Mirrors:
// raster/chunks.rs, raster/plan.rs.

// Mirror of RasterDraw, as in raster.wgsl.
struct Draw {
    first_triangle: u32,
    n_triangles: u32,
    first_idx: u32,
    base_vertex: u32,
    instance: u32,
    view: u32,
    first_chunk: u32,
    rest: u32,
}

// Mirror of ChunkCounts.
struct Counts {
    n_draws: u32,
    // Workgroups per row of the dispatch.
    n_across: u32,
    // Unused.
    rest: vec2<u32>,
}

@group(0) @binding(0) var<storage, read> draws: array<Draw>;
// Draw, first triangle.
@group(0) @binding(1) var<storage, read_write> chunks: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> counts: Counts;

// Triangles of a chunk.
const CHUNK: u32 = 64u;

// One draw call each.
@compute @workgroup_size(64)
fn cs_main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let number = (group.y * counts.n_across + group.x) * 64u + lane;
    if number >= counts.n_draws {
        return;
    }
    let first = draws[number].first_chunk;
    let n = (draws[number].n_triangles + CHUNK - 1u) / CHUNK;
    for (var i = 0u; i < n; i++) {
        chunks[first + i] = vec2(number, i * CHUNK);
    }
}
