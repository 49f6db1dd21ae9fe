// Colour: procedural surfaces, sun, sky, shadow, air, film. Nothing here touches labels, depth or flow.

fn luminance_of(rgb: vec3<f32>) -> f32 {
    return dot(rgb, vec3(0.2126, 0.7152, 0.0722));
}

// Filmic curve (Narkowicz 2015, fit of ACES), then the sRGB curve (IEC 61966-2-1).
fn display(radiance: vec3<f32>) -> vec3<f32> {
    let x = radiance * 0.8;
    let film = clamp((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), vec3(0.0), vec3(1.0));
    return select(1.055 * pow(film, vec3(1.0 / 2.4)) - 0.055, film * 12.92, film <= vec3(0.0031308));
}

// sRGB bytes to linear, without a power: Chilliant's cubic, good to 0.5 % of white.
fn linear_of(packed: u32) -> vec3<f32> {
    let s = unpack4x8unorm(packed).rgb;
    return s * (s * (s * 0.305306011 + 0.682171111) + 0.012522878);
}

// Integer hash (pcg, Jarzynski & Olano 2020) to 0..1.
fn hash(seed: u32) -> f32 {
    let state = seed * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return f32((word >> 22u) ^ word) * (1.0 / 4294967296.0);
}

fn hash2(cell: vec2<i32>) -> f32 {
    // Modulo 1024 cells, because the eye's position is taken modulo 1024 m.
    return hash(u32(cell.x & 1023) + u32(cell.y & 1023) * 1024u);
}

// Smooth value noise, period 1024.
fn noise2(p: vec2<f32>) -> f32 {
    let cell = vec2<i32>(floor(p));
    let f = fract(p);
    let w = f * f * (3.0 - 2.0 * f);
    let low = mix(hash2(cell), hash2(cell + vec2(1, 0)), w.x);
    let high = mix(hash2(cell + vec2(0, 1)), hash2(cell + vec2(1, 1)), w.x);
    return mix(low, high, w.y);
}

// Octahedral map of the upper hemisphere: sky.rs writes what this reads.
fn sky_sample(direction: vec3<f32>, level: f32) -> vec3<f32> {
    let d = vec3(direction.xy, max(direction.z, 0.0));
    let p = d.xy / (abs(d.x) + abs(d.y) + d.z);
    let uv = vec2(p.x + p.y, p.x - p.y) * 0.5 + 0.5;
    return textureSampleLevel(sky_map, sky_sampler, uv, level).rgb;
}

fn sky_radiance(direction: vec3<f32>) -> vec3<f32> {
    var rgb = sky_sample(direction, 0.0);
    let towards = dot(direction, light.sun_towards.xyz);
    if towards > 0.995 {
        let disc = smoothstep(light.sun_towards.w, light.sun_towards.w + 0.00001, towards);
        let glow = pow(max((towards - 0.995) * 200.0, 0.0), 8.0) * 0.02;
        rgb += light.sun_rgb.rgb * (light.sun_rgb.w * disc + glow);
    }
    // Below the horizon: ground far away, as the air shows it.
    return mix(rgb, light.fog_rgb.rgb * 0.75, clamp(-direction.z * 12.0, 0.0, 1.0));
}

fn shadow_at(point_in_camera: vec3<f32>, normal: vec3<f32>) -> f32 {
    if view.options.y == 0.0 {
        return 1.0;
    }
    let at = transform(view.shadow_from_camera, point_in_camera);
    let edge = max(abs(at.x - 0.5), abs(at.y - 0.5));
    if edge > 0.49 || at.z > 1.0 {
        return 1.0;
    }
    // Slope-scaled: a texel seen at a grazing angle spans a range of depths.
    let slope = 1.0 - abs(dot(normal, light.sun_towards.xyz));
    let biased = at.z - view.options.w * (0.6 + 3.0 * slope);
    let lit = textureSampleCompareLevel(shadow_map, shadow_sampler, at.xy, biased);
    return mix(lit, 1.0, smoothstep(0.42, 0.49, edge));
}

struct Surface {
    albedo: vec3<f32>,
    emitted: vec3<f32>,
    // Share of mirrored sky at normal incidence, and level of the sky map it comes from.
    mirror: f32,
    blur: f32,
    // Light that passes through leaves.
    through: f32,
}

// Share of a pattern of this size that a pixel still resolves.
fn detail(size_m: f32, pixel_m: f32) -> f32 {
    return clamp(size_m / pixel_m - 0.5, 0.0, 1.0);
}

// A wall with a grid of windows; every window has its own glass, blind and lamp.
fn facade(in: Surface, uv_m: vec2<f32>, id: u32, pixel_m: f32, shop: bool) -> Surface {
    var out = in;
    let style = hash(id);
    let pitch = select(vec2(2.6 + 1.4 * style, 3.1), vec2(4.2, 3.6), shop);
    let share = select(vec2(0.42 + 0.3 * hash(id + 7u), 0.52), vec2(0.86, 0.72), shop);
    let grid = uv_m / pitch;
    let cell = floor(grid);
    let centred = abs(fract(grid) - vec2(0.5, select(0.52, 0.44, shop)));
    let soft = 0.7 * pixel_m / pitch + 0.002;
    let pane2 = 1.0 - smoothstep(0.5 * share - soft, 0.5 * share + soft, centred);
    let frame2 = 1.0 - smoothstep(0.5 * share + 0.03 - soft, 0.5 * share + 0.03 + soft, centred);
    let fine = detail(0.5, pixel_m);
    let pane = mix(share.x * share.y, pane2.x * pane2.y, fine);
    let frame = max(frame2.x * frame2.y * fine - pane, 0.0);
    let window = u32(i32(cell.x) + 512) * 4099u + u32(i32(cell.y) + 64) * 131u + id;
    let luck = hash(window);
    // Plaster: stains below sills, a little variation.
    let grain = mix(0.5, noise2(uv_m * vec2(1.7, 0.6) + vec2(style * 61.0, 0.0)), detail(1.0, pixel_m));
    out.albedo = in.albedo * (0.82 + 0.3 * grain);
    out.albedo = mix(out.albedo, vec3(0.62, 0.6, 0.56) * (0.35 + 0.65 * style), frame);
    let curtain = select(vec3(0.02, 0.024, 0.03), vec3(0.32, 0.3, 0.26) * (0.5 + 0.5 * hash(window + 3u)), luck > 0.7 && !shop);
    let warm = mix(vec3(1.0, 0.72, 0.42), vec3(0.85, 0.92, 1.0), step(0.8, hash(window + 5u)));
    let burning = step(luck, light.air.w * select(0.45, 0.85, shop));
    out.albedo = mix(out.albedo, curtain, pane);
    out.emitted = warm * (light.lamps.y * burning * pane * (0.4 + 0.6 * hash(window + 9u)));
    out.mirror = mix(0.0, 0.16, pane);
    out.blur = 2.0;
    return out;
}

fn surface_of(material: u32, lit: u32, albedo: vec3<f32>, world_m: vec3<f32>, normal: vec3<f32>, uv_m: vec2<f32>, id: u32, pixel_m: f32) -> Surface {
    var out = Surface(albedo, vec3(0.0), 0.0, 5.0, 0.0);
    let wet = light.air.z;
    switch material {
        case 1u: { // asphalt
            let coarse = noise2(world_m.xy * 0.25) - 0.5;
            let patches = noise2(world_m.xy * 2.0) - 0.5;
            let fine = (noise2(world_m.xy * 16.0) - 0.5) * detail(0.0625, pixel_m);
            out.albedo = albedo * (1.0 + 0.35 * coarse + 0.16 * patches * detail(0.5, pixel_m) + 0.3 * fine) * (1.0 - 0.5 * wet);
            out.mirror = 0.02 + 0.1 * wet;
            out.blur = 5.0 - 3.0 * wet;
        }
        case 2u: { // concrete: slabs of one metre
            let joint = abs(fract(world_m.xy) - 0.5);
            let line = smoothstep(0.485 - pixel_m, 0.49, max(joint.x, joint.y)) * detail(0.1, pixel_m) * step(0.7, normal.z);
            let slab = hash2(vec2<i32>(floor(world_m.xy))) - 0.5;
            out.albedo = albedo * (1.0 + 0.14 * slab * detail(1.0, pixel_m) - 0.35 * line) * (1.0 - 0.35 * wet);
        }
        case 3u: { // paint on the road: worn
            let worn = noise2(world_m.xy * 4.0) * noise2(world_m.xy * 0.5);
            out.albedo = albedo * (1.0 - 0.45 * worn);
        }
        case 4u: { out = facade(out, uv_m, id, pixel_m, false); }
        case 5u: { out = facade(out, uv_m, id, pixel_m, true); }
        case 6u: { // roof
            out.albedo = albedo * (0.85 + 0.3 * noise2(world_m.xy * 2.0 + world_m.z));
        }
        case 7u: { // foliage
            let leaves = noise2(world_m.xy * 4.0 + world_m.z * vec2(3.1, 2.3)) * detail(0.25, pixel_m) + 0.5 * (1.0 - detail(0.25, pixel_m));
            let clumps = noise2(world_m.xy * 1.0 + world_m.z * vec2(0.9, 0.7));
            out.albedo = albedo * (0.45 + 0.6 * leaves + 0.5 * clumps);
            out.through = 0.35;
        }
        case 8u: { // bark
            out.albedo = albedo * (0.7 + 0.6 * noise2(world_m.xy * 16.0 + world_m.z * vec2(1.0, 2.0)));
        }
        case 9u: { // grass
            let tufts = (noise2(world_m.xy * 8.0) - 0.5) * detail(0.125, pixel_m);
            let meadow = noise2(world_m.xy * 0.125) + noise2(world_m.xy * 0.5) - 1.0;
            out.albedo = albedo * (1.0 + 0.5 * tufts + 0.3 * meadow) * mix(vec3(1.0), vec3(1.12, 1.0, 0.8), clamp(0.5 + meadow, 0.0, 1.0));
            out.through = 0.1;
        }
        case 10u: { // car paint
            out.mirror = 0.06;
            out.blur = 3.0;
        }
        case 11u: { // glass
            out.albedo = albedo * 0.25;
            out.mirror = 0.14;
            out.blur = 1.0;
        }
        case 12u: { // metal
            out.albedo = albedo * 0.6;
            out.mirror = 0.25;
            out.blur = 4.0;
        }
        case 14u: { // lamp: on when told, and scenery's lamps when it is dark
            let on = max(f32(lit), light.air.x * f32(id >> 31u));
            out.albedo = albedo * 0.35;
            out.emitted = albedo * (light.lamps.x * on);
            out.mirror = 0.05;
            out.blur = 3.0;
        }
        case 16u: { // water
            out.albedo = albedo * 0.3;
            out.mirror = 0.05;
            out.blur = 1.0;
        }
        default: {}
    }
    return out;
}

// Radiance towards the eye, with the air in between. pixel_m: width of a pixel at this depth.
fn shade(point_in_camera: vec3<f32>, normal: vec3<f32>, uv_m: vec2<f32>, labels: vec4<u32>, pixel_m: f32) -> vec3<f32> {
    let offset = rotate_rows(view.world_from_camera, point_in_camera);
    let world_m = offset + vec3(view.world_from_camera[0].w, view.world_from_camera[1].w, view.world_from_camera[2].w);
    let distance_m = length(offset);
    let towards_point = offset / distance_m;
    let material = (labels.y >> 8u) & 0xffu;
    let s = surface_of(material, labels.y >> 16u, linear_of(labels.z), world_m, normal, uv_m, labels.x, pixel_m);

    let sun = light.sun_towards.xyz;
    let facing = dot(normal, sun);
    let direct = max(facing, 0.0) * (1.0 - s.through) + s.through * (0.35 + 0.65 * abs(facing));
    var lit = 0.0;
    if direct > 0.0 {
        lit = shadow_at(point_in_camera, normal);
    }
    let sky = light.ambient_rgb.rgb + normal.x * light.ambient_slope_rgb[0].rgb + normal.y * light.ambient_slope_rgb[1].rgb
        + normal.z * light.ambient_slope_rgb[2].rgb;
    var radiance = s.albedo * (light.sun_rgb.rgb * (direct * lit) + max(sky, vec3(0.0))) * 0.318309886 + s.emitted;

    if s.mirror > 0.0 {
        // Schlick's Fresnel; the mirrored world is the sky above and dark ground below.
        let cosine = clamp(-dot(towards_point, normal), 0.0, 1.0);
        let fresnel = s.mirror + (0.75 - 0.75 * s.mirror) * pow(1.0 - cosine, 5.0);
        let mirrored = reflect(towards_point, normal);
        var seen = sky_sample(mirrored, s.blur);
        seen = mix(light.ambient_rgb.rgb * 0.08, seen, clamp(mirrored.z * 3.0 + 0.55, 0.0, 1.0));
        let glint = pow(max(dot(mirrored, sun), 0.0), select(60.0, 400.0, s.blur < 3.5)) * lit;
        radiance = mix(radiance, seen + light.sun_rgb.rgb * (glint * select(0.6, 4.0, s.blur < 3.5)), fresnel);
    }

    let haze = 1.0 - exp(-light.fog_rgb.w * max(distance_m - light.air.y, 0.0));
    return mix(radiance, light.fog_rgb.rgb, haze);
}
