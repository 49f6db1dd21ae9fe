// Bends the finished images of a pinhole camera as a lens does. Mirrors: lens.rs.

// Mirror of LensData.
struct Lens {
    // Width and height of the picture, and how far it lies inside the pinhole's image.
    out_px: vec2<f32>,
    margin_px: vec2<f32>,
    distortion_size: vec2<f32>,
    distortion_k: f32,
    distortion_k_cubed: f32,
}

@group(0) @binding(0) var<uniform> lens: Lens;
@group(0) @binding(1) var floats: texture_2d<f32>;
@group(0) @binding(2) var codes: texture_2d<u32>;

@vertex
fn vs_main(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    // One triangle over the whole image.
    return vec4(f32(corner & 1u) * 4.0 - 1.0, f32(corner >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

fn bend(p: vec2<f32>) -> vec2<f32> {
    let scaled = p * lens.distortion_size;
    let squared = dot(scaled, scaled);
    return p * (1.0 + squared * (lens.distortion_k + lens.distortion_k_cubed * sqrt(squared)));
}

// The inverse of bend(), by Newton's method along the ray from the middle.
fn unbend(q: vec2<f32>) -> vec2<f32> {
    let scaled = q * lens.distortion_size;
    let squared = dot(scaled, scaled);
    let a = lens.distortion_k * squared;
    let b = lens.distortion_k_cubed * squared * sqrt(squared);
    var share = 1.0;
    for (var i = 0; i < 12; i++) {
        let value = share * (1.0 + share * share * (a + b * share)) - 1.0;
        let slope = 1.0 + share * share * (3.0 * a + 4.0 * b * share);
        share = clamp(share - value / max(slope, 0.05), 0.0, 100.0);
    }
    return q * share;
}

// Place in the pinhole's image, pixels, of a place in the picture.
fn source_of(at: vec2<f32>) -> vec2<f32> {
    return (bend(at / lens.out_px - 0.5) + 0.5) * lens.out_px + lens.margin_px;
}

// The pixel that holds this place.
fn pixel_at(source: vec2<f32>, size: vec2<u32>) -> vec2<u32> {
    return vec2<u32>(clamp(source, vec2(0.0), vec2<f32>(size) - 1.0));
}

// Labels are never mixed, so they take the pixel that holds the place.
@fragment
fn fs_code(@builtin(position) at: vec4<f32>) -> @location(0) u32 {
    return textureLoad(codes, pixel_at(source_of(at.xy), textureDimensions(codes)), 0).r;
}

@fragment
fn fs_float(@builtin(position) at: vec4<f32>) -> @location(0) f32 {
    return textureLoad(floats, pixel_at(source_of(at.xy), textureDimensions(floats)), 0).r;
}

@fragment
fn fs_normal(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return textureLoad(floats, pixel_at(source_of(at.xy), textureDimensions(floats)), 0);
}

// Motion between two places of the picture.
@fragment
fn fs_flow(@builtin(position) at: vec4<f32>) -> @location(0) vec2<f32> {
    let source = source_of(at.xy);
    let flow = textureLoad(floats, pixel_at(source, textureDimensions(floats)), 0).rg;
    if all(flow == vec2(0.0)) {
        return flow;
    }
    let before = (source - flow - lens.margin_px) / lens.out_px - 0.5;
    return at.xy - (unbend(before) + 0.5) * lens.out_px;
}

// The four pixels around a place, and the weights of the right and the lower ones.
struct Around {
    low: vec2<u32>,
    high: vec2<u32>,
    weight: vec2<f32>,
}

fn around(source: vec2<f32>, size: vec2<u32>) -> Around {
    let most = vec2<f32>(size) - 1.0;
    let place = clamp(source - 0.5, vec2(0.0), most);
    let low = floor(place);
    return Around(vec2<u32>(low), vec2<u32>(min(low + 1.0, most)), place - low);
}

@fragment
fn fs_luminance(@builtin(position) at: vec4<f32>) -> @location(0) f32 {
    let a = around(source_of(at.xy), textureDimensions(floats));
    let upper = mix(textureLoad(floats, a.low, 0).r, textureLoad(floats, vec2(a.high.x, a.low.y), 0).r, a.weight.x);
    let lower = mix(textureLoad(floats, vec2(a.low.x, a.high.y), 0).r, textureLoad(floats, a.high, 0).r, a.weight.x);
    return mix(upper, lower, a.weight.y);
}

fn color_at(pixel: vec2<u32>) -> vec4<f32> {
    return unpack4x8unorm(textureLoad(codes, pixel, 0).r);
}

@fragment
fn fs_color(@builtin(position) at: vec4<f32>) -> @location(0) u32 {
    let a = around(source_of(at.xy), textureDimensions(codes));
    let upper = mix(color_at(a.low), color_at(vec2(a.high.x, a.low.y)), a.weight.x);
    let lower = mix(color_at(vec2(a.low.x, a.high.y)), color_at(a.high), a.weight.x);
    return pack4x8unorm(mix(upper, lower, a.weight.y));
}
