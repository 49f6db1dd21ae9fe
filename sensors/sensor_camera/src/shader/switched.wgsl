// Lamps and windows of the scenery that were switched, by object number; assets/switched.rs makes
// the words.
override WITH_SWITCHED: bool = false;
@group(0) @binding(6) var<storage, read> switched: array<vec2<u32>>;

// The light of lamps or windows: their colour, and the share of them that shines.
fn as_switched(id: u32, rgb: vec3<f32>, share: f32) -> vec4<f32> {
    if !WITH_SWITCHED || (id >> 31u) == 0u {
        return vec4(rgb, share);
    }
    let words = switched[min(id & 0x7fffffffu, arrayLength(&switched) - 1u)];
    let state = (words.x >> 25u) & 3u;
    let color = select(rgb, linear_of(words.x), ((words.x >> 24u) & 1u) == 1u);
    return vec4(color * bitcast<f32>(words.y), select(share, f32(state == 1u), state != 0u));
}
