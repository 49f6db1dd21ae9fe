// Sky and air.

// Looks up the octahedral map of the upper hemisphere, which light/sky.rs paints.
fn sky_sample(direction: vec3<f32>, level: f32) -> vec3<f32> {
    let d = vec3(direction.xy, max(direction.z, 0.0));
    let p = d.xy / (abs(d.x) + abs(d.y) + d.z);
    let uv = vec2(p.x + p.y, p.x - p.y) * 0.5 + 0.5;
    return textureSampleLevel(sky_map, sky_sampler, uv, level).rgb;
}

// Share of light that the air absorbs over this distance in this direction: clear air everywhere,
// and fog that thins out with height.
fn haze(direction_z: f32, distance_m: f32) -> f32 {
    var depth = light.fog.clear_air_per_m * distance_m;
    if WITH_FOG {
        let through_m = max(distance_m - light.fog.begin_m, 0.0);
        // Integral of exp(-falloff · z) along the ray, from where the fog begins.
        let eye_z = views[which].world_from_camera[2].w + direction_z * light.fog.begin_m;
        let rise = light.fog.falloff_per_m * direction_z;
        let slope = select(rise, 1e-4, abs(rise) < 1e-4);
        let climb = clamp(slope * through_m, -30.0, 30.0);
        let column_m = (1.0 - exp(-climb)) / slope;
        depth += light.fog.per_m * exp(-clamp(light.fog.falloff_per_m * eye_z, -5.0, 30.0)) * column_m;
    }
    return 1.0 - exp(-depth);
}

// Light of the air itself in a direction: fog glows towards the sun.
fn air_rgb(direction: vec3<f32>) -> vec3<f32> {
    if !WITH_FOG {
        return light.fog.rgb;
    }
    var forward = max(dot(direction, light.sun.towards), 0.0);
    forward = forward * forward;
    forward = forward * forward;
    return light.fog.rgb + light.sun.rgb * (light.fog.forward_ratio * forward * forward);
}

fn sky_radiance(direction: vec3<f32>) -> vec3<f32> {
    var rgb = sky_sample(direction, 0.0);
    let towards = dot(direction, light.sun.towards);
    let disc = smoothstep(light.sun.disc_cosine, light.sun.disc_cosine + 0.00001, towards);
    var glow = max((towards - 0.995) * 200.0, 0.0);
    glow = glow * glow;
    glow = glow * glow * 0.02;
    rgb += light.sun.rgb * (light.sun.disc_gain * disc + glow * glow);
    // Below the horizon: distant ground in the colour of the air.
    rgb = mix(rgb, light.fog.rgb * 0.75, clamp(-direction.z * 12.0, 0.0, 1.0));
    if WITH_FOG {
        rgb = mix(rgb, air_rgb(direction), haze(direction.z, light.fog.above_m / (max(direction.z, 0.0) + 0.03)));
    }
    return rgb;
}

// Streaks of falling rain between eye and scene: three curtains, each further away and finer.
fn rain_over(radiance: vec3<f32>, direction: vec3<f32>, distance_m: f32) -> vec3<f32> {
    if !WITH_WET {
        return radiance;
    }
    let around = atan2(direction.y, direction.x) * 0.15915494;
    let up = direction.z * inverseSqrt(max(1.0 - direction.z * direction.z, 1e-3));
    var streaks = 0.0;
    for (var curtain = 0; curtain < 3; curtain++) {
        let away_m = 2.0 + 3.5 * f32(curtain);
        // Columns of 1.6 cm; drops fall 8 m/s, wind leans them.
        let across = around * 6.2831853 * away_m + light.water.lean * up * away_m;
        let at = vec2(across * 62.0, (up * away_m + light.water.time_secs * 8.0) * 1.1 + f32(curtain) * 37.0);
        let drop = noise(at, 0.0).b;
        streaks += smoothstep(1.0 - 0.26 * light.water.rain_ratio, 1.02, drop) * f32(distance_m > away_m) * (0.6 - 0.12 * f32(curtain));
    }
    let seen = light.ambient.rgb * 0.3 + light.fog.rgb * 0.25;
    return mix(radiance, seen, clamp(streaks * light.water.rain_ratio, 0.0, 0.45));
}
