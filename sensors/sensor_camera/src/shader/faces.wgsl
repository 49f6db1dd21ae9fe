// Takes each pixel of a picture from the face that shows its direction. What faces/plan.rs says of a
// table's entry holds here.

@group(0) @binding(0) var table: texture_2d<u32>;
@group(0) @binding(1) var floats: texture_2d<f32>;
@group(0) @binding(2) var codes: texture_2d<u32>;

struct Corner {
    @builtin(position) at: vec4<f32>,
    @location(0) @interpolate(flat) face: u32,
}

@vertex
fn vs_main(@builtin(vertex_index) corner: u32, @builtin(instance_index) face: u32) -> Corner {
    // One triangle over the whole image.
    return Corner(vec4(f32(corner & 1u) * 4.0 - 1.0, f32(corner >> 1u) * 4.0 - 1.0, 0.0, 1.0), face);
}

// The upper left of the four pixels around a place, and the weights of the right and the lower ones.
struct Around {
    low: vec2<u32>,
    weight: vec2<f32>,
}

fn around(entry: vec2<u32>) -> Around {
    let place = vec2(entry.x & 0x1fffffffu, entry.y);
    return Around(place >> vec2(16u), vec2<f32>(place & vec2(0xffffu)) / 65536.0);
}

fn color_at(pixel: vec2<u32>) -> vec4<f32> {
    return unpack4x8unorm(textureLoad(codes, pixel, 0).r);
}

@fragment
fn fs_color(corner: Corner) -> @location(0) u32 {
    let entry = textureLoad(table, vec2<u32>(corner.at.xy), 0).rg;
    if entry.x >> 29u != corner.face {
        discard;
    }
    let a = around(entry);
    let upper = mix(color_at(a.low), color_at(a.low + vec2(1u, 0u)), a.weight.x);
    let lower = mix(color_at(a.low + vec2(0u, 1u)), color_at(a.low + 1u), a.weight.x);
    return pack4x8unorm(mix(upper, lower, a.weight.y));
}

fn light_at(pixel: vec2<u32>) -> vec3<f32> {
    return textureLoad(floats, pixel, 0).rgb;
}

// An alpha of 1 says that the lens sees something there.
@fragment
fn fs_radiance(corner: Corner) -> @location(0) vec4<f32> {
    let entry = textureLoad(table, vec2<u32>(corner.at.xy), 0).rg;
    if entry.x >> 29u != corner.face {
        discard;
    }
    let a = around(entry);
    let upper = mix(light_at(a.low), light_at(a.low + vec2(1u, 0u)), a.weight.x);
    let lower = mix(light_at(a.low + vec2(0u, 1u)), light_at(a.low + 1u), a.weight.x);
    return vec4(mix(upper, lower, a.weight.y), 1.0);
}
