// Instances in a list, for GPUs, which take all draw calls of a view at once.

@group(0) @binding(1) var<storage, read> instances: array<Instance>;

fn point_in_camera(instance: u32, point: vec3<f32>) -> vec3<f32> {
    return transform(instances[instance].camera_from_mesh, point);
}

fn point_before(instance: u32, point: vec3<f32>) -> vec3<f32> {
    return transform(instances[instance].previous_from_camera, point);
}

fn direction_in_world(instance: u32, direction: vec3<f32>) -> vec3<f32> {
    return rotate(instances[instance].world_from_mesh_xyzw, direction);
}

// Object id, tint, lamps, whether it moved.
fn marks_of(instance: u32) -> vec4<u32> {
    return vec4(instances[instance].object_id, instances[instance].tint, instances[instance].lamps, instances[instance].moved);
}

// Flow at a pixel that shows a point of an instance at this depth.
fn flow_of(at: vec2<f32>, depth_m: f32, instance: u32) -> vec2<f32> {
    if marks_of(instance).w == 0u {
        return vec2(0.0);
    }
    let before = point_before(instance, ray_in_camera(at) * depth_m);
    // No flow if the point was behind the near plane, and so not in the image.
    if before.z < views[which].near_m {
        return vec2(0.0);
    }
    return at - pixel_of(before);
}
