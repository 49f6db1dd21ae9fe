// Light and views as uniforms.

@group(0) @binding(0) var<uniform> light: LightUniform;
// The binding begins at the first view of the dispatch or draw; `which` selects one
// (view_drawn.wgsl, view_computed.wgsl).
@group(1) @binding(0) var<uniform> views: array<ViewUniform, 32>;

// Half of a box (light.wgsl).
fn blocker_of(half: u32) -> vec4<f32> {
    return views[which].blockers[min(half, 11u)];
}

// A material's rows of the tables.
fn look_of(material: u32) -> vec2<u32> {
    return light.looks[min(material, 16u)].xy;
}

fn roughness_of(material: u32) -> vec4<f32> {
    return light.materials[min(material, 16u)];
}

fn mirror_of(material: u32) -> vec4<f32> {
    return light.mirrors[min(material, 16u)];
}
