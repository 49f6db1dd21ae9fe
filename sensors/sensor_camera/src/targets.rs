//! Render targets of a view, made when first needed.

use sensor_gpu::Gpu;

/// What a view is drawn into; the number is the location in `geometry.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    /// What shading needs to know of the surface: normal, albedo with material, texture coordinates.
    Surface = 0,
    Depth = 1,
    Class = 2,
    Instance = 3,
    Flow = 4,
    Normals = 5,
    /// B, G, R, A bytes in one word.
    Color = 6,
    Luminance = 7,
    /// What color is made from, if the camera does more than the film curve: red, green, blue, exposed by the weather.
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
    pub const DRAWN: [Target; 6] = [Target::Surface, Target::Depth, Target::Class, Target::Instance, Target::Flow, Target::Normals];

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

    pub fn element_bytes(self) -> usize {
        match self {
            Target::Class => 1,
            Target::Color | Target::Depth | Target::Luminance | Target::Instance => 4,
            Target::Flow | Target::Normals | Target::Radiance => 8,
            Target::Surface => 16,
        }
    }

    /// `stored`: compute shaders write what drawing writes elsewhere.
    fn usage(self, stored: bool) -> wgpu::TextureUsages {
        let more = match self {
            Target::Color | Target::Luminance => wgpu::TextureUsages::STORAGE_BINDING,
            Target::Radiance => wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
            _ if stored => wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
            _ => wgpu::TextureUsages::TEXTURE_BINDING,
        };
        more | wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC
    }

    pub fn bit(self) -> TargetSet {
        TargetSet(1 << self as u8)
    }
}

/// A set of [`Target`]s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
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

/// A texture and its view.
#[derive(Clone, Debug)]
pub(crate) struct Image {
    pub texture: wgpu::Texture,
    pub view: wgpu::TextureView,
}

/// The textures of one view.
#[derive(Clone, Debug, Default)]
pub(crate) struct Targets {
    images: [Option<Image>; 9],
    /// One pixel each, bound where compute shaders could write what nobody reads. A view's own: shared ones would make the GPU do one view
    /// after the other.
    nowhere: [Option<Image>; 9],
    z_buffer: Option<Image>,
}

impl Targets {
    /// Makes what `set` lacks.
    pub fn ensure(&mut self, gpu: &Gpu, size_px: [u32; 2], set: TargetSet, stored: bool) {
        for target in Target::ALL.into_iter().filter(|target| set.contains(*target)) {
            self.images[target as usize].get_or_insert_with(|| image(gpu, "view target", size_px, target.format(), target.usage(stored)));
        }
        for target in Target::ALL {
            let lit = matches!(target, Target::Color | Target::Luminance | Target::Radiance);
            // Colour may be wanted and made from radiance in a second step.
            if (lit || stored) && (!set.contains(target) || target == Target::Color) {
                let usage = wgpu::TextureUsages::STORAGE_BINDING;
                self.nowhere[target as usize].get_or_insert_with(|| image(gpu, "nowhere", [1, 1], target.format(), usage));
            }
        }
        self.z_buffer.get_or_insert_with(|| {
            image(gpu, "view z", size_px, wgpu::TextureFormat::Depth32Float, wgpu::TextureUsages::RENDER_ATTACHMENT)
        });
    }

    /// A target that [`Targets::ensure`] made.
    pub fn get(&self, target: Target) -> &Image {
        self.images[target as usize].as_ref().expect("ensure() made every target of the set")
    }

    /// Width and height of the targets of a set that is not empty.
    pub fn size_px(&self, set: TargetSet) -> [u32; 2] {
        let known = Target::ALL.into_iter().filter(|target| set.contains(*target)).find_map(|target| self.images[target as usize].as_ref());
        known.map_or([0; 2], |image| [image.texture.width(), image.texture.height()])
    }

    /// A target of the set, or a pixel that nobody reads.
    pub fn get_or_nowhere(&self, target: Target, set: TargetSet) -> &wgpu::TextureView {
        let images = if set.contains(target) { &self.images } else { &self.nowhere };
        &images[target as usize].as_ref().expect("ensure() made it").view
    }

    pub fn z_buffer(&self) -> &Image {
        self.z_buffer.as_ref().expect("ensure() made the z buffer")
    }
}

pub(crate) fn image(gpu: &Gpu, label: &str, size_px: [u32; 2], format: wgpu::TextureFormat, usage: wgpu::TextureUsages) -> Image {
    let texture = gpu.texture(label, size_px, 1, format, usage);
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    Image { texture, view }
}
