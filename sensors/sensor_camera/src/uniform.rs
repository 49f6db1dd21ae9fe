//! Rust mirrors of the WGSL structs in `shader/scene.wgsl`; a test compares every offset.

use bytemuck::{Pod, Zeroable};

/// Mirror of `Instance`: one visible mesh in one view. Matrices are three rows of `[rotation |
/// translation]`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct InstanceData {
    /// Mesh space to camera space, metres.
    pub camera_from_mesh: [[f32; 4]; 3],
    /// Camera space now to camera space at the previous firing, moving with the instance.
    pub previous_from_camera: [[f32; 4]; 3],
    /// Rotation of mesh space to world, quaternion xyzw.
    pub world_from_mesh_xyzw: [f32; 4],
    /// Object id.
    pub object_id: u32,
    /// Tint of car paint: R, G, B, and 255 if there is one.
    pub tint: [u8; 4],
    /// Lamp bits that shine.
    pub lamps: u32,
    /// 1 if `previous_from_camera` is not the identity.
    pub moved: u32,
}

/// Mirror of `Still` in `shader/stills.wgsl`: a static instance in the world.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct StillData {
    /// Mesh space to world, metres: rows of `[rotation | translation]`.
    pub world_from_mesh: [[f64; 4]; 3],
    /// Its rotation, quaternion xyzw.
    pub world_from_mesh_xyzw: [f32; 4],
    /// Object id.
    pub object_id: u32,
    /// Unused.
    pub rest: [u32; 3],
}

/// Mirror of `MapPlace`: where a shadow map lies in its layer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct MapPlace {
    /// x, y in sides of the map.
    pub tile: [f32; 2],
    /// Side of the map in sides of the layer.
    pub side: f32,
    /// Number of the layer.
    pub layer: u32,
}

/// Mirror of `ViewUniform`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ViewData {
    /// Focal length x, y, principal point x, y, pixels.
    pub lens_px: [f32; 4],
    /// Width, height.
    pub size_px: [f32; 2],
    /// Near plane.
    pub near_m: f32,
    /// +∞.
    pub sky_depth_m: f32,
    /// Camera space to world, rows; the last column is the eye's position modulo 1024 m (z: not
    /// wrapped).
    pub world_from_camera: [[f32; 4]; 3],
    /// Rotation of camera space now to camera space at the previous firing, rows; last column 0.
    pub previous_from_camera: [[f32; 4]; 3],
    /// Camera space to the shadow map: u, v, depth rows.
    pub shadow_from_camera: [[f32; 4]; 3],
    /// The same for the map of what is further away.
    pub far_shadow_from_camera: [[f32; 4]; 3],
    /// 1 if the camera turned.
    pub turned: f32,
    /// 1 if there are shadow maps.
    pub has_shadows: f32,
    /// A texel of the near map in units of its depth.
    pub shadow_texel_depth: f32,
    /// The same of the far map.
    pub far_shadow_texel_depth: f32,
    /// First lamp.
    pub first_lamp: u32,
    /// First tile of lamps.
    pub first_lamp_tile: u32,
    /// Layer of its targets, for compute shaders.
    pub layer: u32,
    /// Bits of the targets that are wanted.
    pub wanted: u32,
    /// First draw call, where the compute shader rasterises.
    pub first_draw: u32,
    /// Number of draw calls there.
    pub n_draws: u32,
    /// First pixel in the list of what was seen.
    pub first_pixel: u32,
    /// Number of `blockers`.
    pub n_blockers: u32,
    /// Where compute shaders find its shadow map.
    pub near_map: MapPlace,
    /// The same of its far shadow map.
    pub far_map: MapPlace,
    /// What stands on the ground and moves, two each: see `contact.rs`.
    pub blockers: [[f32; 4]; 2 * MAX_BLOCKERS],
    /// Unused: a uniform's offset can be a multiple of 256 only.
    pub rest: [u32; 4],
}

/// Room for boxes that take the light of the sky from the ground about them, in one view.
pub(crate) const MAX_BLOCKERS: usize = 6;

/// Views in one binding, and so in one dispatch: every adapter can bind 16 KiB of uniforms.
pub(crate) const MAX_TOGETHER: usize = 32;

/// Mirror of `Lamp` in `shader/lamps.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LampData {
    /// Camera space, metres; w is its reach.
    pub place: [f32; 4],
    /// Direction of its light, camera space; w is the cosine of its outermost ray.
    pub axis: [f32; 4],
    /// Illuminance at 1 m on the axis, exposed; w is 1 / (cosine of the full beam − w of `axis`).
    pub rgb: [f32; 4],
}

/// Mirror of `Sun`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SunData {
    /// Direction to the sun, world.
    pub towards: [f32; 3],
    /// Cosine of the disc's radius.
    pub disc_cosine: f32,
    /// Irradiance of a surface that faces the sun, R G B.
    pub rgb: [f32; 3],
    /// Radiance of the disc over `rgb`.
    pub disc_gain: f32,
}

/// Mirror of `Ambient`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct AmbientData {
    /// Irradiance from sky and ground, constant term.
    pub rgb: [f32; 3],
    /// The zenith's radiance over what falls on level ground.
    pub zenith_ratio: f32,
    /// Change of `rgb` along world x, y, z; w is unused.
    pub slope_rgb: [[f32; 4]; 3],
}

/// Mirror of `Fog`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct FogData {
    /// Colour of the air far away.
    pub rgb: [f32; 3],
    /// Where the fog begins.
    pub begin_m: f32,
    /// Extinction of fog at height 0.
    pub per_m: f32,
    /// Its fall per metre of height.
    pub falloff_per_m: f32,
    /// Metres of fog above the eye towards the zenith.
    pub above_m: f32,
    /// How much of the sun's light it throws forward.
    pub forward_ratio: f32,
    /// Extinction of clear air.
    pub clear_air_per_m: f32,
    /// Unused.
    pub unused: [u32; 3],
}

/// Mirror of `Water`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct WaterData {
    /// Rain, 0..=1.
    pub rain_ratio: f32,
    /// Lean of its streaks.
    pub lean: f32,
    /// Time, wrapped.
    pub time_secs: f32,
    /// Roads are under puddles where the cloud noise is below this.
    pub puddle_level: f32,
    /// Wetness, 0..=1.
    pub wet_ratio: f32,
    /// Unused.
    pub unused: [u32; 3],
}

/// Mirror of `SceneryLamps`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SceneryLampsData {
    /// Share of lamps that shine.
    pub on_ratio: f32,
    /// Share of windows that are lit.
    pub windows_on_ratio: f32,
    /// Radiance of a lamp.
    pub radiance: f32,
    /// Radiance of a lit window.
    pub window_radiance: f32,
}

/// Mirror of `LightUniform`. Radiometric values are multiplied by the exposure already: 1 is white.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LightData {
    /// The sun, or the moon.
    pub sun: SunData,
    /// Light of sky and ground.
    pub ambient: AmbientData,
    /// Fog and air.
    pub fog: FogData,
    /// Rain, wetness and puddles.
    pub water: WaterData,
    /// Lamps and windows of the scenery.
    pub lamps: SceneryLampsData,
    /// Per material: texels of grain per metre, its strength, texels of clouds per metre, their
    /// strength.
    pub materials: [[f32; 4]; 17],
    /// Per material: share mirrored at normal incidence, level of the sky map it mirrors, light let
    /// through, 1 for lamps.
    pub mirrors: [[f32; 4]; 17],
    /// Both in bytes for low quality: `materials` as n, 0..=2, n, 0..=2; `mirrors` as 0..=1, 0..=5,
    /// 0..=1, 0..=1; two words unused.
    pub looks: [[u32; 4]; 17],
}
