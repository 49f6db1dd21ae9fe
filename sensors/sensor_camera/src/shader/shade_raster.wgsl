// Shading by a triangle over the image; the depth test separates sky from surfaces before the
// shader runs.

override WITH_COLOR: bool = true;
override WITH_LUMINANCE: bool = true;
override WITH_RADIANCE: bool = true;

@group(2) @binding(0) var surface_map: texture_2d<u32>;
// The rasteriser's own depth buffer.
@group(2) @binding(1) var depth_map: texture_depth_2d;
@group(2) @binding(2) var instance_map: texture_2d<u32>;

fn surface_at(pixel: vec2<u32>) -> vec4<u32> {
    return textureLoad(surface_map, pixel, 0);
}

fn depth_at(pixel: vec2<u32>) -> f32 {
    return views[which].near_m / textureLoad(depth_map, pixel, 0);
}

// Ids are needed only for switched lamps.
fn id_at(pixel: vec2<u32>) -> u32 {
    if !WITH_SWITCHED {
        return 0u;
    }
    return textureLoad(instance_map, pixel, 0).r;
}

struct Lit {
    @location(0) color: u32,
    @location(1) luminance: f32,
    @location(2) radiance: vec4<f32>,
}

fn lit(radiance: vec3<f32>) -> Lit {
    var out: Lit;
    if WITH_LUMINANCE {
        out.luminance = luminance_of(radiance);
    }
    if WITH_RADIANCE {
        out.radiance = vec4(min(radiance, vec3(60000.0)), 1.0);
    }
    if WITH_COLOR {
        out.color = packed_color(radiance);
    }
    return out;
}

@vertex
fn vs_main(@builtin(vertex_index) corner: u32) -> Carried {
    let xy = vec2(f32((corner << 1u) & 2u), f32(corner & 2u)) * 2.0 - 1.0;
    return carry(vec4(xy, 0.0, 1.0));
}

@fragment
fn fs_surface(carried: Carried) -> Lit {
    unload(carried);
    let pixel = vec2<u32>(carried.at.xy);
    return lit(surface_radiance(pixel, depth_at(pixel), ray_in_camera(carried.at.xy)));
}

@fragment
fn fs_sky(carried: Carried) -> Lit {
    unload(carried);
    return lit(sky_at(ray_in_camera(carried.at.xy)));
}
