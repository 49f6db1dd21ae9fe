//! Shaders validate without a GPU, and WGSL structs lie where their Rust mirrors do.

use std::mem::offset_of;

use sensor_camera::{
    EventJob, InstanceData, LampData, LightData, PostData, ViewData, shader_sources,
};

fn module(name: &str) -> naga::Module {
    let (_, text) = shader_sources()
        .into_iter()
        .find(|(known, _)| *known == name)
        .unwrap();
    naga::front::wgsl::parse_str(&text)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(&text)))
}

const CAPABILITIES: naga::valid::Capabilities = naga::valid::Capabilities::IMMEDIATES
    .union(naga::valid::Capabilities::SHADER_INT64)
    .union(naga::valid::Capabilities::SHADER_INT64_ATOMIC_MIN_MAX);

#[test]
fn every_shader_validates() {
    for (name, _) in shader_sources() {
        let module = module(name);
        let mut validator =
            naga::valid::Validator::new(naga::valid::ValidationFlags::all(), CAPABILITIES);
        validator
            .validate(&module)
            .unwrap_or_else(|error| panic!("{name}: {error:?}"));
    }
}

#[test]
fn wgsl_structs_lie_where_rust_has_them() {
    let modules = [
        module("geometry"),
        module("shade, drawn"),
        module("post"),
        module("events"),
    ];
    let check = |name: &str, size: usize, offsets: &[usize]| {
        let mut types = modules.iter().flat_map(|module| module.types.iter());
        let (_, found) = types
            .find(|(_, ty)| ty.name.as_deref() == Some(name))
            .unwrap();
        let naga::TypeInner::Struct { members, span } = &found.inner else {
            panic!("{name} is not a struct")
        };
        let found: Vec<usize> = members
            .iter()
            .map(|member| member.offset as usize)
            .collect();
        assert_eq!(
            (found.as_slice(), *span as usize),
            (offsets, size),
            "{name}"
        );
    };
    check(
        "Job",
        size_of::<EventJob>(),
        &[
            offset_of!(EventJob, size_px),
            offset_of!(EventJob, n_tiles),
            offset_of!(EventJob, thresholds),
            offset_of!(EventJob, leak),
            offset_of!(EventJob, ratio),
            offset_of!(EventJob, nanos),
            offset_of!(EventJob, refractory_nanos),
            offset_of!(EventJob, slices),
            offset_of!(EventJob, capacity),
            offset_of!(EventJob, level),
            offset_of!(EventJob, moves),
            offset_of!(EventJob, differs),
            offset_of!(EventJob, writes),
            offset_of!(EventJob, now),
        ],
    );
    check(
        "Instance",
        size_of::<InstanceData>(),
        &[
            offset_of!(InstanceData, camera_from_mesh),
            offset_of!(InstanceData, previous_from_camera),
            offset_of!(InstanceData, world_from_mesh_xyzw),
            offset_of!(InstanceData, object_id),
            offset_of!(InstanceData, tint),
            offset_of!(InstanceData, lamps),
            offset_of!(InstanceData, moved),
        ],
    );
    check(
        "ViewUniform",
        size_of::<ViewData>(),
        &[
            offset_of!(ViewData, lens_px),
            offset_of!(ViewData, frame),
            offset_of!(ViewData, world_from_camera),
            offset_of!(ViewData, previous_from_camera),
            offset_of!(ViewData, shadow_from_camera),
            offset_of!(ViewData, far_shadow_from_camera),
            offset_of!(ViewData, options),
            offset_of!(ViewData, lamps),
            offset_of!(ViewData, raster),
            offset_of!(ViewData, layers),
            offset_of!(ViewData, tile),
            offset_of!(ViewData, far_tile),
            offset_of!(ViewData, rest),
        ],
    );
    check(
        "LightUniform",
        size_of::<LightData>(),
        &[
            offset_of!(LightData, sun_towards),
            offset_of!(LightData, sun_rgb),
            offset_of!(LightData, ambient_rgb),
            offset_of!(LightData, ambient_slope_rgb),
            offset_of!(LightData, fog_rgb),
            offset_of!(LightData, air),
            offset_of!(LightData, lamps),
            offset_of!(LightData, fog),
            offset_of!(LightData, rain),
            offset_of!(LightData, materials),
            offset_of!(LightData, mirrors),
            offset_of!(LightData, looks),
        ],
    );
    check(
        "Lamp",
        size_of::<LampData>(),
        &[
            offset_of!(LampData, place),
            offset_of!(LampData, axis),
            offset_of!(LampData, rgb),
        ],
    );
    check(
        "Post",
        size_of::<PostData>(),
        &[
            offset_of!(PostData, size_px),
            offset_of!(PostData, exposure),
            offset_of!(PostData, range),
            offset_of!(PostData, meter),
            offset_of!(PostData, lens),
            offset_of!(PostData, rim),
            offset_of!(PostData, white),
            offset_of!(PostData, layers),
            offset_of!(PostData, rest),
        ],
    );
}
