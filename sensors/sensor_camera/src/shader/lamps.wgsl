// Lamps: street lamps, headlights, tail lights. Each tile of 32 × 32 pixels has a set of the lamps
// that can reach it (lamps.rs).

struct Lamp {
    // Camera space, metres; w: reach, metres.
    place: vec4<f32>,
    // Direction of its light, camera space; w: cosine of the outermost ray.
    axis: vec4<f32>,
    // Illuminance at one metre on its axis, exposed like the sun's. w is one over the difference of
    // the cosine of the full beam and the w of `axis`.
    rgb: vec4<f32>,
}

@group(1) @binding(3) var<storage, read> lamps: array<Lamp>;
@group(1) @binding(4) var<storage, read> lamp_tiles: array<vec2<u32>>;

const LAMP_TILE_PX: u32 = 32u;

// Light of lamps on a surface: diffuse irradiance, and the reflection of the lamps themselves.
struct LampLight {
    diffuse: vec3<f32>,
    glint: vec3<f32>,
}

fn lamps_at(pixel: vec2<u32>, point: vec3<f32>, normal: vec3<f32>, mirrored: vec3<f32>, through: f32, gloss_power: f32) -> LampLight {
    var out: LampLight;
    let tile = pixel / LAMP_TILE_PX;
    let n_across = (u32(views[which].size_px.x) + LAMP_TILE_PX - 1u) / LAMP_TILE_PX;
    var words = lamp_tiles[views[which].first_lamp_tile + tile.y * n_across + tile.x];
    while (words.x | words.y) != 0u {
        let in_first = words.x != 0u;
        let bit = firstTrailingBit(select(words.y, words.x, in_first));
        if in_first {
            words.x &= words.x - 1u;
        } else {
            words.y &= words.y - 1u;
        }
        let lamp = lamps[views[which].first_lamp + bit + select(32u, 0u, in_first)];
        let away = lamp.place.xyz - point;
        let squared = dot(away, away);
        let towards = away * inverseSqrt(max(squared, 1e-4));
        let reach = squared / (lamp.place.w * lamp.place.w);
        let window = clamp(1.0 - reach * reach, 0.0, 1.0);
        let beam = clamp((-dot(towards, lamp.axis.xyz) - lamp.axis.w) * lamp.rgb.w, 0.0, 1.0);
        // A lamp has a size, so distances below 30 cm do not count.
        let strength = window * window * beam * beam / max(squared, 0.09);
        let facing = dot(normal, towards);
        let lit = max(facing, 0.0) * (1.0 - through) + through * abs(facing);
        out.diffuse += lamp.rgb.rgb * (strength * lit);
        if !SIMPLE {
            let along = clamp(dot(mirrored, towards), 0.0, 1.0);
            out.glint += lamp.rgb.rgb * (strength * pow(along, gloss_power) * gloss_power * 0.16);
        }
    }
    return out;
}
