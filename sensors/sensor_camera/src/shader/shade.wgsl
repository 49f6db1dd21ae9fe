// The shading pass: lights what the geometry pass saw, once per pixel. GPUs use a compute shader,
// where those made for computing have far more arithmetic; a software rasteriser is fastest with
// one triangle over the image. Mirrors: shade.rs, target/kind.rs.

// Furthest depth, metres, at which there can be a surface: the sky's is infinite.
const FAR_M: f32 = 1e9;

fn surface_radiance(at: vec2<u32>, depth_m: f32, ray: vec3<f32>) -> vec3<f32> {
    let packed = surface_at(at);
    let id = id_at(at);
    var point: Point;
    point.pixel = at;
    point.in_camera = ray * depth_m;
    point.normal = normal_of(packed.x);
    point.uv_m = bitcast<vec2<f32>>(packed.zw);
    point.labels = vec4(id, (packed.y >> 16u) & 0x1f00u | (packed.y >> 29u) << 16u, packed.y, packed.x);
    point.pixel_m = depth_m / views[which].lens_px.x;
    point.open = 1.0;
    if !SIMPLE {
        point.open = open_sky(point);
    }
    return shade(point);
}

fn sky_at(ray: vec3<f32>) -> vec3<f32> {
    let direction = normalize(rotate_rows(views[which].world_from_camera, ray));
    return rain_over(sky_radiance(direction), direction, 1e4);
}

// How much sky the surroundings leave open: twelve neighbours on a spiral, turned from pixel to
// pixel (as in McGuire and others, "The Alchemy screen-space ambient obscurance algorithm", 2011).
fn open_sky(point: Point) -> f32 {
    const N: i32 = 12;
    const REACH_M: f32 = 0.9;
    let normal = camera_from_world(point.normal);
    let reach_px = clamp(REACH_M / point.pixel_m, 2.0, 0.12 * views[which].size_px.x);
    let turn = 6.2831853 * fract(52.9829189 * fract(dot(vec2<f32>(point.pixel), vec2(0.06711056, 0.00583715))));
    var hidden = 0.0;
    for (var i = 0; i < N; i++) {
        let share = (f32(i) + 0.5) / f32(N);
        let angle = turn + share * 6.2831853 * 5.0;
        let at = vec2<f32>(point.pixel) + 0.5 + vec2(cos(angle), sin(angle)) * (share * reach_px);
        let pixel = vec2<u32>(clamp(at, vec2(0.0), views[which].size_px - 1.0));
        let depth_m = depth_at(pixel);
        let away = ray_in_camera(vec2<f32>(pixel) + 0.5) * min(depth_m, FAR_M) - point.in_camera;
        let squared = dot(away, away);
        let near = max(1.0 - squared / (REACH_M * REACH_M * 2.0), 0.0);
        hidden += near * max(dot(away, normal) - 0.01 - 0.002 * point.in_camera.z, 0.0) * inverseSqrt(squared + 1e-3);
    }
    let open = clamp(1.0 - 1.9 * hidden / f32(N), 0.0, 1.0);
    return mix(open, 1.0, clamp(point.in_camera.z / 90.0 - 0.3, 0.0, 1.0));
}

// Screen-space reflection at this point: colour, and the weight of what was found.
fn mirrored_on_screen(point: Point, direction: vec3<f32>, sharp: f32) -> vec4<f32> {
    if direction.z < -0.3 {
        return vec4(0.0);
    }
    var step_m = 0.25 + 0.04 * point.in_camera.z;
    var at = point.in_camera + direction * step_m * (0.5 + 0.5 * fract(52.9829189 * fract(dot(vec2<f32>(point.pixel), vec2(0.00583715, 0.06711056)))));
    for (var i = 0; i < 22; i++) {
        if at.z < views[which].near_m {
            return vec4(0.0);
        }
        let pixel = pixel_of(at);
        if pixel.x < 0.0 || pixel.y < 0.0 || pixel.x >= views[which].size_px.x || pixel.y >= views[which].size_px.y {
            return vec4(0.0);
        }
        let found = vec2<u32>(pixel);
        let depth_m = depth_at(found);
        if depth_m < at.z && depth_m > at.z - 2.0 * step_m - 0.3 {
            let packed = surface_at(found);
            let rim = min(min(pixel.x, views[which].size_px.x - pixel.x), min(pixel.y, views[which].size_px.y - pixel.y)) / (0.08 * views[which].size_px.y);
            return vec4(rough_radiance(packed, id_at(found)), clamp(rim, 0.0, 1.0) * clamp(sharp * 1.5 - 0.2, 0.0, 1.0));
        }
        at += direction * step_m;
        step_m *= 1.16;
    }
    return vec4(0.0);
}

// A surface as seen in a reflection: its colour in even light, its lamps and windows by night.
fn rough_radiance(packed: vec4<u32>, id: u32) -> vec3<f32> {
    let albedo = albedo_of(packed.y);
    let normal = normal_of(packed.x);
    let direct = max(dot(normal, light.sun.towards), 0.0);
    var radiance = albedo * (light.ambient.rgb + light.sun.rgb * direct * 0.6) * 0.318309886;
    if WITH_LAMPS {
        let material = (packed.y >> 24u) & 0x1fu;
        let shining = as_switched(id, albedo, light.lamps.on_ratio);
        let on = max(f32((packed.y >> 29u) & 1u), shining.w * f32((packed.y >> 30u) & 1u)) * mirror_of(material).w;
        radiance += shining.rgb * (light.lamps.radiance * on);
        if material == MATERIAL_FACADE || material == MATERIAL_SHOP_FRONT {
            let uv_m = bitcast<vec2<f32>>(packed.zw);
            let window = window_at(uv_m, style_of(id, material == MATERIAL_SHOP_FRONT), grain_of(0.05), material == MATERIAL_SHOP_FRONT, id);
            let warm = as_switched(id, vec3(1.0, 0.72, 0.45), light.lamps.windows_on_ratio);
            let is_lit = f32(window.lot.b < warm.w * select(0.34, 0.8, material == MATERIAL_SHOP_FRONT));
            radiance += warm.rgb * (light.lamps.window_radiance * is_lit * window.pane * 0.5);
        }
    }
    return radiance;
}

// The same with fewer lookups, for low quality.
fn plain_radiance(pixel: vec2<u32>) -> vec3<f32> {
    let packed = surface_at(pixel);
    let albedo = albedo_of(packed.y);
    let direct = max(dot(normal_of(packed.x), light.sun.towards), 0.0);
    var radiance = albedo * (light.ambient.rgb + light.sun.rgb * direct * 0.6) * 0.318309886;
    if WITH_LAMPS {
        let material = (packed.y >> 24u) & 0x1fu;
        let on = max(f32((packed.y >> 29u) & 1u), light.lamps.on_ratio * f32((packed.y >> 30u) & 1u)) * mirror_of(material).w;
        let labels = vec4(0u, material << 8u, packed.y, packed.x);
        radiance += albedo * (light.lamps.radiance * on) + 0.5 * window_light(wall_seen(albedo, bitcast<vec2<f32>>(packed.zw), labels, 0.05, false), 0u);
    }
    return radiance;
}

// Reflection in a wet road for low quality: nine steps that grow by nearly half, with a start that
// differs from pixel to pixel.
fn mirrored_on_wet_road(point: Point, direction: vec3<f32>) -> vec4<f32> {
    if direction.z < -0.3 {
        return vec4(0.0);
    }
    let size_px = views[which].size_px;
    var step_m = 0.3 + 0.05 * point.in_camera.z;
    let begin = fract(52.9829189 * fract(dot(vec2<f32>(point.pixel), vec2(0.00583715, 0.06711056))));
    var at = point.in_camera + direction * step_m * (0.4 + 0.9 * begin);
    for (var i = 0; i < 9; i++) {
        let pixel = pixel_of(at);
        if at.z < views[which].near_m || pixel.x < 0.0 || pixel.y < 0.0 || pixel.x >= size_px.x || pixel.y >= size_px.y {
            return vec4(0.0);
        }
        let depth_m = depth_at(vec2<u32>(pixel));
        if depth_m < at.z && depth_m > at.z - 2.0 * step_m - 0.3 {
            let rim = min(min(pixel.x, size_px.x - pixel.x), pixel.y) / (0.08 * size_px.y);
            return vec4(plain_radiance(vec2<u32>(pixel)), clamp(rim, 0.0, 1.0));
        }
        at += direction * step_m;
        step_m *= 1.42;
    }
    return vec4(0.0);
}
