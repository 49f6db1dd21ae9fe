// Sky where nothing was drawn: one triangle over the whole image at infinity.

// Without a reader of flow this switches its computation off.
override WITH_FLOW: bool = true;

struct SkyCorner {
    @builtin(position) @invariant clip: vec4<f32>,
    // Pixel at the previous firing from the current pixel, homogeneous. Last column: depth of the
    // sky; 1 if the camera turned; 0.
    @location(0) @interpolate(flat) before_x: vec4<f32>,
    @location(1) @interpolate(flat) before_y: vec4<f32>,
    @location(2) @interpolate(flat) before_w: vec4<f32>,
}

// Converts a matrix row for directions in camera space to one for pixels.
fn taking_pixels(row: vec3<f32>) -> vec3<f32> {
    let lens = views[which].lens_px;
    let along = row.xy / lens.xy;
    return vec3(along, row.z - dot(along, lens.zw));
}

@vertex
fn vs_sky(@builtin(vertex_index) corner: u32) -> SkyCorner {
    let xy = vec2(f32((corner << 1u) & 2u), f32(corner & 2u)) * 2.0 - 1.0;
    var out: SkyCorner;
    out.clip = vec4(xy, 0.0, 1.0);
    let view = views[which];
    let last = view.previous_from_camera[2].xyz;
    out.before_x = vec4(taking_pixels(view.lens_px.x * view.previous_from_camera[0].xyz + view.lens_px.z * last), view.sky_depth_m);
    out.before_y = vec4(taking_pixels(view.lens_px.y * view.previous_from_camera[1].xyz + view.lens_px.w * last), view.turned);
    out.before_w = vec4(taking_pixels(last), 0.0);
    return out;
}

@fragment
fn fs_sky(in: SkyCorner) -> Pixel {
    var out = sky_pixel(in.before_x.w);
    if WITH_FLOW {
        // Points at infinity move by the rotation alone.
        let here = vec3(in.clip.xy, 1.0);
        let before = vec3(dot(in.before_x.xyz, here), dot(in.before_y.xyz, here), dot(in.before_w.xyz, here));
        if in.before_y.w != 0.0 && before.z > 0.0 {
            out.flow_px = in.clip.xy - before.xy / before.z;
        }
    }
    return out;
}
