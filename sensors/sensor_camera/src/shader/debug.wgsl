// Debug strokes: corners come in clip space, colours as the words of the colour target.

@group(0) @binding(0) var depth_map: texture_2d<f32>;

struct Corner {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) bgra: u32,
}

// Strokes are moved nearer by this factor, so that they win over the surface that they lie on.
// Mirror of NEARER_RATIO in debug.rs.
const NEARER_RATIO: f32 = 1.002;

@vertex
fn vs_main(@location(0) clip: vec4<f32>, @location(1) bgra: u32) -> Corner {
    return Corner(clip, bgra);
}

@fragment
fn fs_main(in: Corner) -> @location(0) u32 {
    if 1.0 / in.clip.w > textureLoad(depth_map, vec2<u32>(in.clip.xy), 0).r * NEARER_RATIO {
        discard;
    }
    return in.bgra;
}
