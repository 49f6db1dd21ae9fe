// Conversion of radiance to stored values.

fn luminance_of(rgb: vec3<f32>) -> f32 {
    return dot(rgb, vec3(0.2126, 0.7152, 0.0722));
}

// Filmic curve with the display's gamma in it (Hejl and Burgess-Dawson 2010).
fn display(radiance: vec3<f32>) -> vec3<f32> {
    let x = max(radiance - 0.004, vec3(0.0));
    return (x * (6.2 * x + 0.5)) / (x * (6.2 * x + 1.7) + 0.06);
}

// B, G, R, A bytes.
fn packed_color(radiance: vec3<f32>) -> u32 {
    return pack4x8unorm(vec4(display(radiance).bgr, 1.0));
}
