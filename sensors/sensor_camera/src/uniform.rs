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

/// Mirror of `ViewUniform`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ViewData {
    /// Focal length x, y, principal point x, y, pixels.
    pub lens_px: [f32; 4],
    /// Width, height in pixels, near plane in metres, +∞.
    pub frame: [f32; 4],
    /// Camera space to world, rows; the last column is the eye's position modulo 1024 m (z: not
    /// wrapped).
    pub world_from_camera: [[f32; 4]; 3],
    /// Rotation of camera space now to camera space at the previous firing, rows; last column 0.
    pub previous_from_camera: [[f32; 4]; 3],
    /// Camera space to the shadow map: u, v, depth rows.
    pub shadow_from_camera: [[f32; 4]; 3],
    /// The same for the map of what is further away.
    pub far_shadow_from_camera: [[f32; 4]; 3],
    /// 1 if the camera turned, 1 if there are shadow maps, 0, a texel of the near map in units of
    /// its depth.
    pub options: [f32; 4],
    /// First lamp, first tile of lamps, bits of an `f32`: a texel of the far shadow map in units of
    /// its depth; 0.
    pub lamps: [u32; 4],
    /// First draw call, their number, first pixel in the list of what was seen (where the compute
    /// shader rasterises); wanted targets.
    pub raster: [u32; 4],
    /// Layer of its targets, of its shadow map and of its far shadow map, for compute shaders; 0.
    pub layers: [u32; 4],
    /// Where its shadow map lies in the layer: x, y in sides of the map, its side in sides of the
    /// layer; 0.
    pub tile: [f32; 4],
    /// The same of its far shadow map.
    pub far_tile: [f32; 4],
    /// Unused: a uniform's offset can be a multiple of 256 only.
    pub rest: [[u32; 4]; 12],
}

/// Views that one binding holds, and so one dispatch can do: 16 KiB of uniforms are what every
/// adapter can bind.
pub(crate) const MAX_TOGETHER: usize = 32;

/// Mirror of `Lamp` in `shader/lamps.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LampData {
    /// Camera space, metres; w is its reach.
    pub place: [f32; 4],
    /// Where it shines, camera space; w is the cosine of its outermost ray.
    pub axis: [f32; 4],
    /// Illuminance at 1 m on the axis, exposed; w is 1 / (cosine of the full beam − w of `axis`).
    pub rgb: [f32; 4],
}

/// Mirror of `LightUniform`: sun, sky, air, exposure. Radiometric values are multiplied by the
/// exposure already: 1 is white.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LightData {
    /// Direction to the sun (or moon), world; w is the cosine of the disc's radius.
    pub sun_towards: [f32; 4],
    /// Irradiance of a surface facing the sun, R G B; w is the disc's radiance divided by it.
    pub sun_rgb: [f32; 4],
    /// Irradiance from sky and ground, constant term; w is the zenith's radiance over what falls on
    /// level ground.
    pub ambient_rgb: [f32; 4],
    /// Its change along world x, y, z.
    pub ambient_slope_rgb: [[f32; 4]; 3],
    /// Colour of the air far away; w unused.
    pub fog_rgb: [f32; 4],
    /// Share of scenery's lamps that shine, start of the fog m, wetness, share of windows lit;
    /// ratios 0..=1.
    pub air: [f32; 4],
    /// Radiance of lamps, radiance of lit windows, extinction of clear air per metre, 0.
    pub lamps: [f32; 4],
    /// Extinction of fog per metre at height 0, its fall per metre of height, metres of fog above
    /// the eye towards the zenith, how much of the
    /// sun's light it throws forward.
    pub fog: [f32; 4],
    /// Rain 0..=1, lean of its streaks, time in seconds (wrapped), share of roads under puddles (on
    /// the scale of the noise's clouds).
    pub rain: [f32; 4],
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
