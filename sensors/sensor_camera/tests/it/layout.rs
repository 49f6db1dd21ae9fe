//! Shaders validate without a GPU, and WGSL structs lie where their Rust mirrors do.

use std::mem::offset_of;

use sensor_camera::{
    AmbientData, BlurData, ChunkCounts, EventJob, FogData, InstanceData, LampData, LensData,
    LightData, MapPlace, PostData, RasterDraw, SceneryLampsData, StillCounts, StillData, StillView,
    SunData, ViewData, WaterData, shader_sources,
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
    .union(naga::valid::Capabilities::FLOAT64)
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

/// Asserts that a struct of one of the modules has this size and these offsets.
fn lies_there(modules: &[naga::Module], name: &str, size: usize, offsets: &[usize]) {
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
}

#[test]
fn structs_of_chunks_lie_where_rust_has_them() {
    let modules = [module("chunks")];
    lies_there(
        &modules,
        "Counts",
        size_of::<ChunkCounts>(),
        &[
            offset_of!(ChunkCounts, n_draws),
            offset_of!(ChunkCounts, n_across),
            offset_of!(ChunkCounts, rest),
        ],
    );
    for name in ["chunks", "raster"] {
        lies_there(
            &[module(name)],
            "Draw",
            size_of::<RasterDraw>(),
            &[
                offset_of!(RasterDraw, first_triangle),
                offset_of!(RasterDraw, n_triangles),
                offset_of!(RasterDraw, first_idx),
                offset_of!(RasterDraw, base_vertex),
                offset_of!(RasterDraw, instance),
                offset_of!(RasterDraw, view),
                offset_of!(RasterDraw, first_chunk),
                offset_of!(RasterDraw, rest),
            ],
        );
    }
}

#[test]
fn wgsl_structs_lie_where_rust_has_them() {
    let modules = [
        module("geometry"),
        module("shade, drawn"),
        module("blur"),
        module("post"),
        module("lens"),
        module("events"),
        module("stills"),
    ];
    let check =
        |name: &str, size: usize, offsets: &[usize]| lies_there(&modules, name, size, offsets);
    check(
        "Job",
        size_of::<EventJob>(),
        &[
            offset_of!(EventJob, size_px),
            offset_of!(EventJob, n_tiles),
            offset_of!(EventJob, threshold_up),
            offset_of!(EventJob, threshold_down),
            offset_of!(EventJob, log_eps),
            offset_of!(EventJob, substep_px),
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
        "Still",
        size_of::<StillData>(),
        &[
            offset_of!(StillData, world_from_mesh),
            offset_of!(StillData, world_from_mesh_xyzw),
            offset_of!(StillData, object_id),
            offset_of!(StillData, rest),
        ],
    );
    check(
        "StillView",
        size_of::<StillView>(),
        &[
            offset_of!(StillView, camera_from_world),
            offset_of!(StillView, previous_from_camera),
            offset_of!(StillView, first),
            offset_of!(StillView, n),
            offset_of!(StillView, moved),
            offset_of!(StillView, rest),
        ],
    );
    check(
        "Counts",
        size_of::<StillCounts>(),
        &[
            offset_of!(StillCounts, n_before),
            offset_of!(StillCounts, rest),
        ],
    );
    check(
        "MapPlace",
        size_of::<MapPlace>(),
        &[
            offset_of!(MapPlace, tile),
            offset_of!(MapPlace, side),
            offset_of!(MapPlace, layer),
        ],
    );
    check(
        "ViewUniform",
        size_of::<ViewData>(),
        &[
            offset_of!(ViewData, lens_px),
            offset_of!(ViewData, size_px),
            offset_of!(ViewData, near_m),
            offset_of!(ViewData, sky_depth_m),
            offset_of!(ViewData, world_from_camera),
            offset_of!(ViewData, previous_from_camera),
            offset_of!(ViewData, shadow_from_camera),
            offset_of!(ViewData, far_shadow_from_camera),
            offset_of!(ViewData, turned),
            offset_of!(ViewData, has_shadows),
            offset_of!(ViewData, shadow_texel_depth),
            offset_of!(ViewData, far_shadow_texel_depth),
            offset_of!(ViewData, first_lamp),
            offset_of!(ViewData, first_lamp_tile),
            offset_of!(ViewData, layer),
            offset_of!(ViewData, wanted),
            offset_of!(ViewData, first_draw),
            offset_of!(ViewData, n_draws),
            offset_of!(ViewData, first_pixel),
            offset_of!(ViewData, n_blockers),
            offset_of!(ViewData, near_map),
            offset_of!(ViewData, far_map),
            offset_of!(ViewData, blockers),
            offset_of!(ViewData, rest),
        ],
    );
    check(
        "Sun",
        size_of::<SunData>(),
        &[
            offset_of!(SunData, towards),
            offset_of!(SunData, disc_cosine),
            offset_of!(SunData, rgb),
            offset_of!(SunData, disc_gain),
        ],
    );
    check(
        "Ambient",
        size_of::<AmbientData>(),
        &[
            offset_of!(AmbientData, rgb),
            offset_of!(AmbientData, zenith_ratio),
            offset_of!(AmbientData, slope_rgb),
        ],
    );
    check(
        "Fog",
        size_of::<FogData>(),
        &[
            offset_of!(FogData, rgb),
            offset_of!(FogData, begin_m),
            offset_of!(FogData, per_m),
            offset_of!(FogData, falloff_per_m),
            offset_of!(FogData, above_m),
            offset_of!(FogData, forward_ratio),
            offset_of!(FogData, clear_air_per_m),
            offset_of!(FogData, unused),
            offset_of!(FogData, unused) + 4,
            offset_of!(FogData, unused) + 8,
        ],
    );
    check(
        "Water",
        size_of::<WaterData>(),
        &[
            offset_of!(WaterData, rain_ratio),
            offset_of!(WaterData, lean),
            offset_of!(WaterData, time_secs),
            offset_of!(WaterData, puddle_level),
            offset_of!(WaterData, wet_ratio),
            offset_of!(WaterData, unused),
            offset_of!(WaterData, unused) + 4,
            offset_of!(WaterData, unused) + 8,
        ],
    );
    check(
        "SceneryLamps",
        size_of::<SceneryLampsData>(),
        &[
            offset_of!(SceneryLampsData, on_ratio),
            offset_of!(SceneryLampsData, windows_on_ratio),
            offset_of!(SceneryLampsData, radiance),
            offset_of!(SceneryLampsData, window_radiance),
        ],
    );
    check(
        "LightUniform",
        size_of::<LightData>(),
        &[
            offset_of!(LightData, sun),
            offset_of!(LightData, ambient),
            offset_of!(LightData, fog),
            offset_of!(LightData, water),
            offset_of!(LightData, lamps),
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
            offset_of!(PostData, per_px),
            offset_of!(PostData, factor),
            offset_of!(PostData, is_metered),
            offset_of!(PostData, gamma_exponent),
            offset_of!(PostData, has_film),
            offset_of!(PostData, min_ev100),
            offset_of!(PostData, max_ev100),
            offset_of!(PostData, up_share),
            offset_of!(PostData, down_share),
            offset_of!(PostData, white_cd_per_m2),
            offset_of!(PostData, calibration),
            offset_of!(PostData, smooths_edges),
            offset_of!(PostData, bloom),
            offset_of!(PostData, distortion_k),
            offset_of!(PostData, distortion_k_cubed),
            offset_of!(PostData, distortion_size),
            offset_of!(PostData, vignette_multiplier),
            offset_of!(PostData, vignette_falloff),
            offset_of!(PostData, aberration),
            offset_of!(PostData, aberration_start),
            offset_of!(PostData, white_rgb),
            offset_of!(PostData, layer),
            offset_of!(PostData, out_px),
            offset_of!(PostData, flare),
            offset_of!(PostData, is_shaped),
            offset_of!(PostData, slope),
            offset_of!(PostData, toe_at),
            offset_of!(PostData, shoulder_at),
            offset_of!(PostData, straight_offset),
            offset_of!(PostData, toe_height),
            offset_of!(PostData, shoulder_height),
            offset_of!(PostData, black_clip),
            offset_of!(PostData, white_clip),
            offset_of!(PostData, rest),
        ],
    );
    check(
        "Blur",
        size_of::<BlurData>(),
        &[
            offset_of!(BlurData, size_px),
            offset_of!(BlurData, far_radius_px),
            offset_of!(BlurData, focus_m),
            offset_of!(BlurData, haze_px),
            offset_of!(BlurData, haze_per_m),
            offset_of!(BlurData, longest_px),
            offset_of!(BlurData, half_exposure_ratio),
            offset_of!(BlurData, n_blades),
            offset_of!(BlurData, blade_radius),
            offset_of!(BlurData, blades_area),
            offset_of!(BlurData, unused),
        ],
    );
    check(
        "Lens",
        size_of::<LensData>(),
        &[
            offset_of!(LensData, out_px),
            offset_of!(LensData, margin_px),
            offset_of!(LensData, distortion_size),
            offset_of!(LensData, distortion_k),
            offset_of!(LensData, distortion_k_cubed),
        ],
    );
}
