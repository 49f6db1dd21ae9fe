//! What a view can be drawn into, and in which format.

/// A kind of image that a view is drawn into; its number is the location in `surface.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    /// What shading needs to know of the surface: normal, albedo with material, texture
    /// coordinates.
    Surface = 0,
    Depth = 1,
    Class = 2,
    Instance = 3,
    Flow = 4,
    Normals = 5,
    /// B, G, R, A bytes in one word.
    Color = 6,
    Luminance = 7,
    /// The source of colour if the camera does more than the film curve: red, green, blue, exposed
    /// for the weather.
    Radiance = 8,
}

impl Target {
    pub const ALL: [Target; 9] = [
        Target::Surface,
        Target::Depth,
        Target::Class,
        Target::Instance,
        Target::Flow,
        Target::Normals,
        Target::Color,
        Target::Luminance,
        Target::Radiance,
    ];

    /// Those that the geometry pass can write, by location.
    pub const DRAWN: [Target; 6] = [
        Target::Surface,
        Target::Depth,
        Target::Class,
        Target::Instance,
        Target::Flow,
        Target::Normals,
    ];

    pub fn format(self) -> wgpu::TextureFormat {
        match self {
            Target::Surface => wgpu::TextureFormat::Rgba32Uint,
            Target::Depth | Target::Luminance => wgpu::TextureFormat::R32Float,
            Target::Class => wgpu::TextureFormat::R8Uint,
            Target::Instance | Target::Color => wgpu::TextureFormat::R32Uint,
            Target::Flow => wgpu::TextureFormat::Rg32Float,
            Target::Normals | Target::Radiance => wgpu::TextureFormat::Rgba16Float,
        }
    }

    /// The same with surfaces of this kind.
    pub fn format_as(self, surfaces: Surfaces) -> wgpu::TextureFormat {
        match (self, surfaces) {
            (Target::Surface, Surfaces::Slim) => wgpu::TextureFormat::Rg32Uint,
            _ => self.format(),
        }
    }

    pub fn element_bytes(self) -> usize {
        match self {
            Target::Class => 1,
            Target::Color | Target::Depth | Target::Luminance | Target::Instance => 4,
            Target::Flow | Target::Normals | Target::Radiance => 8,
            Target::Surface => 16,
        }
    }

    pub fn usage(self, writer: Writer) -> wgpu::TextureUsages {
        let more = match self {
            Target::Color | Target::Radiance | Target::Luminance => {
                wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING
            }
            _ if writer == Writer::Computing => {
                wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING
            }
            _ => wgpu::TextureUsages::TEXTURE_BINDING,
        };
        more | wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC
    }

    /// Whether it is a modality's image, which is copied to readers unchanged.
    pub fn is_image(self) -> bool {
        matches!(
            self,
            Target::Depth
                | Target::Class
                | Target::Instance
                | Target::Flow
                | Target::Normals
                | Target::Color
        )
    }

    pub fn bit(self) -> TargetSet {
        TargetSet(1 << self as u8)
    }
}

/// What the geometry pass leaves of a surface for shading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Surfaces {
    /// Four words, as in `surface_wide.wgsl`.
    Wide,
    /// Two words, as in `surface_slim.wgsl`: for shading by a software rasteriser.
    Slim,
}

/// What writes the targets of the geometry pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Writer {
    /// Draw calls.
    Drawing,
    /// Compute shaders.
    Computing,
}

/// A set of [`Target`]s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct TargetSet(pub u16);

impl TargetSet {
    pub fn contains(self, target: Target) -> bool {
        self.0 & target.bit().0 != 0
    }

    pub fn union(self, other: TargetSet) -> TargetSet {
        TargetSet(self.0 | other.0)
    }

    /// Those that the geometry pass writes.
    pub fn drawn(self) -> TargetSet {
        TargetSet(self.0 & ((1 << Target::DRAWN.len()) - 1))
    }

    /// Whether any of them needs light.
    pub fn is_lit(self) -> bool {
        self.contains(Target::Color) || self.contains(Target::Luminance)
    }
}
