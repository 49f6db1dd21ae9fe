//! Render targets of a view, made when first needed.

use std::sync::Arc;

use sensor_gpu::{Gpu, Reads};

/// What a view is drawn into; the number is the location in `surface.wgsl`.
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
    /// What color is made from, if the camera does more than the film curve: red, green, blue,
    /// exposed by the weather.
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

    /// The same; `slim`: surfaces are as `surface_slim.wgsl` has them.
    pub fn format_if(self, slim: bool) -> wgpu::TextureFormat {
        if slim && self == Target::Surface {
            wgpu::TextureFormat::Rg32Uint
        } else {
            self.format()
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
            Target::Color => wgpu::TextureUsages::STORAGE_BINDING,
            Target::Radiance | Target::Luminance => {
                wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING
            }
            _ if stored => {
                wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING
            }
            _ => wgpu::TextureUsages::TEXTURE_BINDING,
        };
        more | wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC
    }

    /// Whether it is a modality's image, which goes to readers as it is.
    fn is_image(self) -> bool {
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

/// A texture, its first layer, and all its layers.
#[derive(Clone, Debug)]
pub(crate) struct Image {
    pub texture: wgpu::Texture,
    pub view: wgpu::TextureView,
    pub layers: wgpu::TextureView,
    /// Whether it can be copied beside the drawing of other targets.
    pub is_shared: bool,
}

impl Image {
    /// One layer as an image without layers.
    pub fn layer(&self, layer: u32) -> wgpu::TextureView {
        self.texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer: layer,
            array_layer_count: Some(1),
            ..Default::default()
        })
    }

    /// One layer as the only one.
    pub fn single_layer(&self, layer: u32) -> wgpu::TextureView {
        self.texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            base_array_layer: layer,
            array_layer_count: Some(1),
            ..Default::default()
        })
    }
}

/// The textures of a view, or of several with a layer for each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Targets {
    images: [Option<Image>; 9],
    /// One pixel each, bound where compute shaders could write what nobody reads. No one else's:
    /// shared ones would make the GPU do one
    /// after the other.
    nowhere: [Option<Image>; 9],
    z_buffer: Option<Image>,
    n_layers: u32,
    /// Made by [`Targets::ensure`].
    drawn: bool,
    /// Copies beside the drawing that read the images.
    pub reads: Arc<Reads>,
}

impl Targets {
    /// Those of `set`, for compute shaders, in so many layers. What no reader gets is the twin's,
    /// whose turn is before or after.
    pub fn layered(
        gpu: &Gpu,
        size_px: [u32; 2],
        set: TargetSet,
        n_layers: u32,
        twin: Option<&Targets>,
    ) -> Targets {
        let mut targets = Targets {
            n_layers,
            ..Default::default()
        };
        targets.borrow(twin);
        targets.make(gpu, size_px, set, true, false);
        // For debug strokes.
        targets.ensure_z(gpu, size_px);
        targets
    }

    /// Makes what `set` lacks, to be drawn, in one layer; `slim`: with slim surfaces. What no
    /// reader gets is the twin's, if it has it.
    pub fn ensure(
        &mut self,
        gpu: &Gpu,
        size_px: [u32; 2],
        set: TargetSet,
        slim: bool,
        twin: &Targets,
    ) {
        if !self.drawn {
            *self = Targets {
                n_layers: 1,
                drawn: true,
                ..Default::default()
            };
            self.borrow(Some(twin).filter(|twin| twin.drawn));
        }
        self.make(gpu, size_px, set, false, slim);
        self.ensure_z(gpu, size_px);
    }

    fn borrow(&mut self, twin: Option<&Targets>) {
        let Some(twin) = twin else { return };
        for target in Target::ALL.into_iter().filter(|target| !target.is_image()) {
            self.images[target as usize] = twin.images[target as usize].clone();
        }
        self.nowhere = twin.nowhere.clone();
        self.z_buffer = twin.z_buffer.clone();
    }

    fn make(&mut self, gpu: &Gpu, size_px: [u32; 2], set: TargetSet, stored: bool, slim: bool) {
        let n_layers = self.n_layers;
        for target in Target::ALL
            .into_iter()
            .filter(|target| set.contains(*target))
        {
            let (format, usage) = (target.format_if(slim), target.usage(stored));
            let make = || match target.is_image() {
                true => view_image(gpu.shared_texture_layers(
                    "view target",
                    size_px,
                    n_layers,
                    format,
                    usage,
                )),
                false => layered_image(gpu, "view target", size_px, n_layers, format, usage),
            };
            self.images[target as usize].get_or_insert_with(make);
        }
        for target in Target::ALL {
            let lit = matches!(target, Target::Color | Target::Luminance | Target::Radiance);
            if (lit || stored) && !set.contains(target) {
                let usage = wgpu::TextureUsages::STORAGE_BINDING;
                self.nowhere[target as usize]
                    .get_or_insert_with(|| image(gpu, "nowhere", [1, 1], target.format(), usage));
            }
        }
    }

    fn ensure_z(&mut self, gpu: &Gpu, size_px: [u32; 2]) {
        self.z_buffer.get_or_insert_with(|| {
            let usage =
                wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
            image(
                gpu,
                "view z",
                size_px,
                wgpu::TextureFormat::Depth32Float,
                usage,
            )
        });
    }

    /// How many views they have room for.
    pub fn n_layers(&self) -> u32 {
        self.n_layers
    }

    /// A target that was made.
    pub fn get(&self, target: Target) -> &Image {
        self.images[target as usize]
            .as_ref()
            .expect("every target of the set was made")
    }

    /// Width and height of the targets of a set that is not empty.
    pub fn size_px(&self, set: TargetSet) -> [u32; 2] {
        let known = Target::ALL
            .into_iter()
            .filter(|target| set.contains(*target))
            .find_map(|target| self.images[target as usize].as_ref());
        known.map_or([0; 2], |image| {
            [image.texture.width(), image.texture.height()]
        })
    }

    /// All layers of a target of the set, or a pixel that nobody reads.
    pub fn get_or_nowhere(&self, target: Target, set: TargetSet) -> &wgpu::TextureView {
        let images = if set.contains(target) {
            &self.images
        } else {
            &self.nowhere
        };
        &images[target as usize]
            .as_ref()
            .expect("it was made with the set")
            .layers
    }

    pub fn z_buffer(&self) -> &Image {
        self.z_buffer
            .as_ref()
            .expect("it was made with the targets")
    }
}

pub(crate) fn image(
    gpu: &Gpu,
    label: &str,
    size_px: [u32; 2],
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> Image {
    layered_image(gpu, label, size_px, 1, format, usage)
}

pub(crate) fn layered_image(
    gpu: &Gpu,
    label: &str,
    size_px: [u32; 2],
    n_layers: u32,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> Image {
    view_image((
        gpu.texture_layers(label, size_px, n_layers, format, usage),
        false,
    ))
}

fn view_image((texture, is_shared): (wgpu::Texture, bool)) -> Image {
    let n_layers = texture.depth_or_array_layers();
    let [view, layers] = [
        (wgpu::TextureViewDimension::D2, 1),
        (wgpu::TextureViewDimension::D2Array, n_layers),
    ]
    .map(|(dimension, n)| {
        texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(dimension),
            array_layer_count: Some(n),
            ..Default::default()
        })
    });
    Image {
        texture,
        view,
        layers,
        is_shared,
    }
}
