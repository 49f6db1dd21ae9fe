// Light on a surface: sun, sky, shadow, lamps, mirrors, air. Nothing here touches labels, depth or
// flow.

// Low quality: one noise lookup, one shadow cascade, and mirrors that show a plain gradient of the
// sky.
override SIMPLE: bool = false;
// Whether anything but sun and sky shines; whether there is fog; whether anything is wet.
override WITH_LAMPS: bool = true;
override WITH_FOG: bool = true;
override WITH_WET: bool = true;

// `through` is the surface's translucency: leaves cast no hard shadows on their neighbours.
fn shadow_at(point_in_camera: vec3<f32>, facing: f32, through: f32) -> f32 {
    let at = transform(views[which].shadow_from_camera, point_in_camera);
    let edge = max(abs(at.x - 0.5), abs(at.y - 0.5));
    // Slope-scaled: a texel seen at a grazing angle spans a range of depths.
    let slack = 0.6 + 3.0 * (1.0 - abs(facing)) + 16.0 * through;
    let biased = at.z - views[which].shadow_texel_depth * slack;
    let near = near_shadow(at.xy, biased);
    // Weight of the near map; beyond it the far map counts, and beyond that there is no shadow.
    let inside = views[which].has_shadows * (1.0 - smoothstep(0.42, 0.49, edge));
    if SIMPLE {
        return mix(1.0, near, inside);
    }
    let far_at = transform(views[which].far_shadow_from_camera, point_in_camera);
    let far_edge = max(abs(far_at.x - 0.5), abs(far_at.y - 0.5));
    let far_biased = far_at.z - views[which].far_shadow_texel_depth * slack;
    let far = far_shadow(far_at.xy, far_biased);
    let far_inside = views[which].has_shadows * (1.0 - smoothstep(0.42, 0.49, far_edge));
    return mix(mix(1.0, far, far_inside), near, inside);
}

// Share of a strip's width, or length, that hides the sky at a place so far inside its edge (less
// than 0: outside). Parabolas for the form factor of a long wall outside and of a floor that is as
// high as a sixth of the wall inside; both are a half at the edge.
fn hidden_by(inside_m: f32, per_m: f32) -> f32 {
    let outside = max(1.0 + inside_m * per_m, 0.0);
    let below = max(1.0 - inside_m * per_m * 6.0, 0.0);
    return select(1.0 - 0.5 * below * below, 0.5 * outside * outside, inside_m < 0.0);
}

// Share of the sky that boxes of what moves hide from a place near the ground that they stand on.
// `offset` leads there from the eye, in the world's axes.
fn blocked_sky(offset: vec3<f32>) -> f32 {
    var open = 1.0;
    for (var i = 0u; i < views[which].n_blockers; i++) {
        // Middle of its foot from the eye, one over the reach of its shade.
        let foot = blocker_of(2u * i);
        let away = offset - foot.xyz;
        let low = clamp(1.3 - 2.5 * abs(away.z), 0.0, 1.0);
        if low > 0.0 {
            // Cosine and sine of its heading; half length and width.
            let sides = blocker_of(2u * i + 1u);
            let along = abs(away.x * sides.x + away.y * sides.y);
            let across = abs(away.y * sides.x - away.x * sides.y);
            open *= 1.0 - low * hidden_by(sides.z - along, foot.w) * hidden_by(sides.w - across, foot.w);
        }
    }
    return 1.0 - open;
}

// The surface at a pixel.
struct Point {
    pixel: vec2<u32>,
    in_camera: vec3<f32>,
    normal: vec3<f32>,
    uv_m: vec2<f32>,
    // As Corner::labels, then the first word of its surface.
    labels: vec4<u32>,
    // Width of a pixel at this depth.
    pixel_m: f32,
    // Share of the sky that its surroundings leave open.
    open: f32,
}

// Radiance towards the eye, with the air in between.
fn shade(point: Point) -> vec3<f32> {
    let normal = point.normal;
    let offset = rotate_rows(views[which].world_from_camera, point.in_camera);
    let world_m = offset + vec3(views[which].world_from_camera[0].w, views[which].world_from_camera[1].w, views[which].world_from_camera[2].w);
    let distance_m = length(offset);
    let towards_point = offset / distance_m;
    let cosine = clamp(-dot(towards_point, normal), 0.0, 1.0);
    let finish = finish_at(world_m, normal, point.uv_m, point.labels, point.pixel_m, cosine);

    let sun = light.sun.towards;
    let facing = dot(normal, sun);
    let direct = max(facing, 0.0) * (1.0 - finish.through) + finish.through * (0.35 + 0.65 * abs(facing));
    // Walls see half of the ground's sky. Beneath a vehicle there is no sun, which shadow maps miss
    // near the ground.
    let blocked = blocked_sky(offset) * (0.5 + 0.5 * abs(normal.z));
    let open = point.open * (1.0 - blocked);
    let lit = shadow_at(point.in_camera, facing, finish.through) * clamp(2.0 - 2.0 * blocked, 0.0, 1.0);
    let sky = light.ambient.rgb + normal.x * light.ambient.slope_rgb[0].rgb + normal.y * light.ambient.slope_rgb[1].rgb
        + normal.z * light.ambient.slope_rgb[2].rgb;
    var falling = light.sun.rgb * (direct * lit) + max(sky, vec3(0.0)) * open;
    var mirrored = reflect(towards_point, normal);
    if WITH_WET {
        // Drops make rings in puddles.
        let ring = noise(world_m.xy * 24.0 + light.water.time_secs * vec2(31.0, 17.0), log2(point.pixel_m * 24.0)).ba - 0.5;
        let ripple = finish.puddle * light.water.rain_ratio * 0.12;
        mirrored = normalize(mirrored + vec3(ring * ripple, 0.0));
    }
    let sharp = clamp((5.5 - finish.rough) * 0.25, 0.1, 1.0);
    var glint = vec3(0.0);
    if WITH_LAMPS {
        let in_camera_normal = camera_from_world(normal);
        let lamps = lamps_at(point.pixel, point.in_camera, in_camera_normal, camera_from_world(mirrored), finish.through, mix(8.0, 180.0, sharp * sharp));
        falling += lamps.diffuse;
        // A rough surface spreads the light over more than this lobe.
        glint = lamps.glint * sharp;
    }
    var radiance = finish.albedo * falling * 0.318309886 + finish.emitted;

    // Schlick's Fresnel, weaker at grazing angles where the surface is rough.
    let away = 1.0 - cosine;
    let away2 = away * away;
    let fresnel = (finish.mirror + max(0.75 - finish.mirror, 0.0) * sharp * away2 * away2 * away) * f32(finish.mirror > 0.0);
    // Below about 20 degrees streets mirror houses, which are as bright as a wall in the shade.
    var above: vec3<f32>;
    if SIMPLE {
        above = mix(light.fog.rgb, (light.ambient.rgb + light.ambient.slope_rgb[2].rgb) * light.ambient.zenith_ratio, sqrt(clamp(mirrored.z, 0.0, 1.0)));
    } else {
        above = sky_sample(mirrored, finish.rough);
    }
    let wall = light.ambient.rgb * 0.09;
    var seen = mix(wall, above, smoothstep(-0.05, 0.35, mirrored.z)) * open;
    if !SIMPLE && fresnel > 0.01 {
        let found = mirrored_on_screen(point, camera_from_world(mirrored), sharp);
        seen = mix(seen, found.rgb, found.a);
    }
    if SIMPLE && WITH_WET && finish.film > 0.0 {
        let found = mirrored_on_wet_road(point, camera_from_world(mirrored));
        seen = mix(seen, found.rgb, found.a * clamp(sharp * 1.5 - 0.2, 0.0, 1.0));
    }
    var shine = max(dot(mirrored, sun), 0.0);
    shine = shine * shine;
    shine = shine * shine;
    shine = shine * shine;
    shine = shine * shine;
    shine = shine * shine; // 32nd power
    var keen = shine * shine;
    keen = keen * keen;
    keen = keen * keen; // 256th
    let sunlit = mix(0.5 * shine, 5.0 * keen, sharp) * lit;
    radiance = mix(radiance, seen + light.sun.rgb * sunlit + glint, fresnel);

    return rain_over(mix(radiance, air_rgb(towards_point), haze(towards_point.z, distance_m)), towards_point, distance_m);
}

fn camera_from_world(direction: vec3<f32>) -> vec3<f32> {
    return views[which].world_from_camera[0].xyz * direction.x + views[which].world_from_camera[1].xyz * direction.y
        + views[which].world_from_camera[2].xyz * direction.z;
}
