// Debug strokes: corners come in clip space, colours as the words of the colour target.

struct Corner {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) bgra: u32,
}

@vertex
fn vs_main(@location(0) clip: vec4<f32>, @location(1) bgra: u32) -> Corner {
    return Corner(clip, bgra);
}

@fragment
fn fs_main(in: Corner) -> @location(0) u32 {
    return in.bgra;
}
