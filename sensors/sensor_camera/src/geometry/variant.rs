//! Variants of the geometry shader.

use crate::assets::Meshes;
use crate::target::Surfaces;

/// How draw calls reach the GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Submit {
    /// One by one, each with its instance as vertex attributes: for software adapters.
    Attached,
    /// One by one, instances in a list.
    Single,
    /// All of a view at once, instances in a list.
    Indirect,
}

impl Submit {
    pub fn instances(self) -> Instances {
        match self {
            Submit::Attached => Instances::Attached,
            Submit::Single | Submit::Indirect => Instances::Listed,
        }
    }
}

/// Where the shader finds instances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Instances {
    /// They come as vertex attributes.
    Attached,
    /// They lie in a list.
    Listed,
}

/// Whether the shader looks up which lamps and windows of the scenery were switched. Only slim
/// surfaces need it, because they contain the windows of walls.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum SceneryLamps {
    /// None was switched, and there is no list.
    AsBuilt,
    /// Some were switched.
    Switched,
}

impl SceneryLamps {
    pub fn of(meshes: &Meshes) -> Self {
        if meshes.is_switched() {
            SceneryLamps::Switched
        } else {
            SceneryLamps::AsBuilt
        }
    }

    /// Number of bindings of the scene with attached instances: the light, and the list if there is
    /// one.
    pub fn n_bound(self) -> usize {
        match self {
            SceneryLamps::AsBuilt => 1,
            SceneryLamps::Switched => 2,
        }
    }
}

/// A variant of the geometry shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct GeometryShader {
    pub instances: Instances,
    pub surfaces: Surfaces,
    pub lamps: SceneryLamps,
}

impl GeometryShader {
    /// Its text.
    pub fn wgsl(self) -> String {
        let instances: &[&str] = match self.instances {
            Instances::Attached => &[include_str!("../shader/geometry_attached.wgsl")],
            Instances::Listed => &[
                include_str!("../shader/instance_storage.wgsl"),
                include_str!("../shader/geometry_listed.wgsl"),
            ],
        };
        let switched = match self.lamps {
            SceneryLamps::Switched => include_str!("../shader/switched.wgsl"),
            SceneryLamps::AsBuilt => include_str!("../shader/unswitched.wgsl"),
        };
        let surfaces: &[&str] = match self.surfaces {
            Surfaces::Slim => &[
                include_str!("../shader/wall.wgsl"),
                switched,
                include_str!("../shader/surface_slim.wgsl"),
            ],
            Surfaces::Wide => &[include_str!("../shader/surface_wide.wgsl")],
        };
        let scene = [
            include_str!("../shader/scene.wgsl"),
            include_str!("../shader/bound.wgsl"),
            include_str!("../shader/view_drawn.wgsl"),
        ];
        let rest = [
            include_str!("../shader/surface.wgsl"),
            include_str!("../shader/geometry_sky.wgsl"),
        ];
        [&scene[..], surfaces, &rest, instances].concat().concat()
    }
}
