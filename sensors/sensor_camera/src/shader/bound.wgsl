// Light and views where they are bound.

@group(0) @binding(0) var<uniform> light: LightUniform;
// Views from the one on at which the binding begins; `which` of them is meant: view_drawn.wgsl, view_computed.wgsl.
@group(1) @binding(0) var<uniform> views: array<ViewUniform, 32>;

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
