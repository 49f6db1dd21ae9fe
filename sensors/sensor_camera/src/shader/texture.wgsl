// Procedural surfaces: the properties of a point of each material.
//
// A software rasteriser runs every branch for every pixel, so there is one path for all materials,
// controlled by a table (light.materials, from light/material.rs). Noise comes from a small
// texture; values per window or wall come from a hash.

const NOISE_SIDE: i32 = 256;

// R: grain, G: clouds of many sizes, B and A: white noise. `at` in texels.
fn noise(at: vec2<f32>, level: f32) -> vec4<f32> {
    return textureSampleLevel(noise_map, noise_sampler, at * (1.0 / f32(NOISE_SIDE)), level);
}

// Properties of a surface at a point.
struct Finish {
    albedo: vec3<f32>,
    // Radiance of its own.
    emitted: vec3<f32>,
    // Share mirrored at normal incidence; 0: nothing is mirrored at any angle.
    mirror: f32,
    // Level of the sky map that it mirrors.
    rough: f32,
    // Share of light that goes through (leaves).
    through: f32,
    // How much of the point is under standing water.
    puddle: f32,
    // Share that a film of water on a road mirrors at normal incidence.
    film: f32,
}

// The surface at a point. pixel_m is the width of a pixel at this depth; cosine is that of the
// viewing angle.
fn finish_at(world_m: vec3<f32>, normal: vec3<f32>, uv_m: vec2<f32>, labels: vec4<u32>, pixel_m: f32, cosine: f32) -> Finish {
    let id = labels.x;
    let material = (labels.y >> 8u) & 0xffu;
    let lit_lamp = vec2(f32((labels.y >> 16u) & 1u), f32((labels.y >> 17u) & 1u));
    var base: vec4<f32>;
    var gloss: vec4<f32>;
    if SIMPLE {
        // The same table in two words, because a software rasteriser fetches word by word for every
        // pixel.
        let look = look_of(material);
        base = unpack4x8unorm(look.x) * vec4(255.0, 2.0, 255.0, 2.0);
        gloss = unpack4x8unorm(look.y) * vec4(1.0, 5.0, 1.0, 1.0);
    } else {
        base = roughness_of(material);
        gloss = mirror_of(material);
    }
    var out: Finish;

    // Grain in the plane that the surface faces most.
    let steep = abs(normal);
    let ground = steep.z >= max(steep.x, steep.y);
    let plane_m = select(vec2(select(world_m.x, world_m.y, steep.x > steep.y), world_m.z), world_m.xy, ground);
    var rough_at: vec2<f32>;
    if SIMPLE {
        // One lookup at the finest level; grain fades out where pixels are larger than it.
        let seen = noise(plane_m * base.x, 0.0).rg;
        rough_at = 0.5 + (seen - 0.5) * clamp(vec2(1.6, 6.0) - 0.5 * pixel_m * base.x * vec2(1.0, 0.25), vec2(0.0), vec2(1.0));
    } else {
        let pixel_on_plane_m = pixel_m * inverseSqrt(max(cosine, 0.04));
        rough_at.x = noise(plane_m * base.x, log2(pixel_on_plane_m * base.x)).r;
        rough_at.y = noise(plane_m * base.z + vec2(57.0, 91.0), log2(pixel_on_plane_m * base.z)).g;
    }
    var albedo = albedo_of(labels.z) * max(1.0 + base.y * (rough_at.x - 0.5) + base.w * (rough_at.y - 0.5), 0.0);

    // Slabs of 0.64 by 0.4 m, every other row moved by half of one, each of its own shade, with dark
    // joints. All repeats within 1024 m, over which places are taken.
    let row = world_m.y * 2.5;
    let row_up = floor(row);
    let slab = vec2(world_m.x * 1.5625 + 0.5 * row_up, row);
    let in_slab = fract(slab);
    let joint_m = (0.5 - abs(in_slab - 0.5)) * vec2(0.64, 0.4);
    let fine = clamp(0.07 / pixel_m - 0.5, 0.0, 1.0);
    let joint = clamp((0.008 - min(joint_m.x, joint_m.y)) / (0.6 * pixel_m + 0.004) + 0.5, 0.0, 1.0);
    let tone = fract((slab.x - in_slab.x) * 0.734375 + row_up * 0.578125 + 0.37 * fract(row_up * 0.1796875));
    albedo *= 1.0 + select(0.0, fine * (0.26 * (tone - 0.5) - 0.5 * joint), material == MATERIAL_CONCRETE && ground);
    // Leaves that face sideways or down lie in the shade of others.
    albedo *= 1.0 - 0.9 * gloss.z * (1.0 - normal.z);

    // Walls: windows with their own glass, blind and lamp.
    let wall = wall_seen(albedo, uv_m, labels, pixel_m, ground);
    albedo = wall.albedo;
    let pane = wall.pane;
    out.emitted = vec3(0.0);
    if WITH_LAMPS {
        out.emitted = window_light(wall, id);
    }

    // A lamp shines when it is switched on; lamps of the scenery also when it is dark.
    let shining = as_switched(id, albedo, light.lamps.on_ratio);
    let on = max(lit_lamp.x, shining.w * lit_lamp.y) * gloss.w;
    out.emitted += shining.rgb * (light.lamps.radiance * on);
    // Unlit, coloured glass is dark.
    let palest = min(albedo.r, min(albedo.g, albedo.b)) / max(max(albedo.r, max(albedo.g, albedo.b)), 0.01);
    albedo *= 1.0 - gloss.w * mix(0.88, 0.6, palest);

    out.mirror = max(gloss.x, 0.09 * pane);
    out.rough = mix(gloss.y, 2.0, pane);
    out.through = gloss.z;
    out.puddle = 0.0;
    out.film = 0.0;
    if WITH_WET {
        // Rain darkens surfaces that soak it up; wet roads shine, and water stands in their
        // hollows.
        let soaks = light.water.wet_ratio * (1.0 - gloss.w) * select(0.35, 1.0, ground);
        let paved = f32(ground && material >= MATERIAL_ASPHALT && material <= MATERIAL_PAINT);
        let low = noise(world_m.xy * 1.7 + vec2(11.0, 29.0), log2(pixel_m * 1.7)).g;
        out.puddle = smoothstep(0.0, 0.06, light.water.puddle_level - low) * paved * smoothstep(0.985, 0.998, normal.z);
        albedo *= (1.0 - 0.45 * soaks) * (1.0 - 0.5 * out.puddle);
        out.film = max(0.035 * light.water.wet_ratio * paved, 0.02 * f32(out.puddle > 0.0));
        out.mirror = max(out.mirror, out.film);
        out.rough = mix(mix(out.rough, 2.6, 0.9 * light.water.wet_ratio * paved), 0.0, out.puddle);
    }
    out.albedo = albedo;
    return out;
}
