// Makes the matrices of static instances where they are read, from the poses of the scenery, which
// stay there, and the numbers of those that views see. Mirrors: raster/stills.rs.

struct Instance {
    camera_from_mesh: array<vec4<f32>, 3>,
    previous_from_camera: array<vec4<f32>, 3>,
    world_from_mesh_xyzw: vec4<f32>,
    marks: vec4<u32>,
}

// Mirror of StillData.
struct Still {
    // Rows of [rotation | translation].
    world_from_mesh: array<f64, 12>,
    world_from_mesh_xyzw: vec4<f32>,
    object_id: u32,
    // Unused.
    rest: array<u32, 3>,
}

// Mirror of StillView.
struct StillView {
    // Rows of [rotation | translation].
    camera_from_world: array<f64, 12>,
    previous_from_camera: array<vec4<f32>, 3>,
    // Where its numbers begin.
    first: u32,
    n: u32,
    moved: u32,
    // Unused.
    rest: u32,
}

// Mirror of StillCounts.
struct Counts {
    // Instances that lie before those that are made here.
    n_before: u32,
    // Unused.
    rest: array<u32, 3>,
}

@group(0) @binding(0) var<storage, read> views: array<StillView>;
@group(0) @binding(1) var<storage, read> stills: array<Still>;
// Numbers of static instances.
@group(0) @binding(2) var<storage, read> numbers: array<u32>;
@group(0) @binding(3) var<storage, read_write> instances: array<Instance>;
@group(0) @binding(4) var<storage, read> counts: Counts;

// An element of the product of a view's matrix and an instance's, in f64 and in the order in which
// processors add.
fn element(view: u32, number: u32, row: u32, column: u32) -> f32 {
    let first = 4u * row;
    var sum = select(0.0lf, views[view].camera_from_world[first + 3u], column == 3u);
    for (var i = 0u; i < 3u; i++) {
        sum += views[view].camera_from_world[first + i] * stills[number].world_from_mesh[4u * i + column];
    }
    return f32(sum);
}

fn row_of(view: u32, number: u32, row: u32) -> vec4<f32> {
    return vec4(
        element(view, number, row, 0u),
        element(view, number, row, 1u),
        element(view, number, row, 2u),
        element(view, number, row, 3u),
    );
}

// One static instance of one view each.
@compute @workgroup_size(64)
fn cs_instances(@builtin(global_invocation_id) at: vec3<u32>) {
    let view = at.y;
    if at.x >= views[view].n {
        return;
    }
    let place = views[view].first + at.x;
    let number = numbers[place];
    let to = counts.n_before + place;
    for (var row = 0u; row < 3u; row++) {
        instances[to].camera_from_mesh[row] = row_of(view, number, row);
        instances[to].previous_from_camera[row] = views[view].previous_from_camera[row];
    }
    instances[to].world_from_mesh_xyzw = stills[number].world_from_mesh_xyzw;
    instances[to].marks = vec4(stills[number].object_id, 0u, 0u, views[view].moved);
}
