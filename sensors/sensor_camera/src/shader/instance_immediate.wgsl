// What is drawn comes with each draw call; a software rasteriser reads it once, and not once per vertex and pixel.

var<immediate> drawn: Instance;

fn point_in_camera(instance: u32, point: vec3<f32>) -> vec3<f32> {
    return transform(drawn.camera_from_mesh, point);
}

fn point_before(instance: u32, point: vec3<f32>) -> vec3<f32> {
    return transform(drawn.previous_from_camera, point);
}

fn direction_in_world(instance: u32, direction: vec3<f32>) -> vec3<f32> {
    return rotate(drawn.world_from_mesh_xyzw, direction);
}

// Object id, tint, lamps, whether it moved.
fn marks_of(instance: u32) -> vec4<u32> {
    return vec4(drawn.object_id, drawn.tint, drawn.lamps, drawn.moved);
}
