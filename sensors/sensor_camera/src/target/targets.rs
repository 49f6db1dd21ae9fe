//! Render targets of a view, made when first needed.

use std::sync::Arc;

use sensor_gpu::{Gpu, Reads};

use super::image::{Image, image, layered_image, view_image};
use super::kind::{Surfaces, Target, TargetSet, Writer};
use crate::kept_groups::KeptGroups;

/// The textures of a view, or of several with a layer for each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Targets {
    images: [Option<Image>; 9],
    /// Images of one pixel, bound where compute shaders could write a target that nobody reads.
    /// They belong to these targets alone: a shared image would make the GPU serialise the
    /// dispatches.
    nowhere: [Option<Image>; 9],
    z_buffer: Option<Image>,
    n_layers: u32,
    /// Made by [`Targets::ensure`].
    drawn: bool,
    /// Copies on the copy queue that read the images.
    pub reads: Arc<Reads>,
    /// Bind groups of passes with all layers of the images.
    pub groups: Arc<KeptGroups>,
}

/// One layer of targets: the images of one view.
#[derive(Clone, Copy)]
pub(crate) struct TargetLayer<'t> {
    pub targets: &'t Targets,
    pub layer: u32,
}

impl TargetLayer<'_> {
    /// A target that was made, as an image without layers.
    pub fn view(&self, target: Target) -> wgpu::TextureView {
        self.targets.get(target).layer(self.layer)
    }
}

impl Targets {
    /// The targets of `set` with so many layers, for compute shaders. Targets that no reader gets
    /// are shared with the twin, which is used by the submissions before and after.
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
        targets.make(gpu, size_px, set, Writer::Computing, Surfaces::Wide);
        // For debug strokes.
        targets.ensure_z(gpu, size_px);
        targets
    }

    /// Makes the missing targets of `set`, for drawing, with one layer. Targets that no reader gets
    /// are shared with the twin, if it has them.
    pub fn ensure(
        &mut self,
        gpu: &Gpu,
        size_px: [u32; 2],
        set: TargetSet,
        surfaces: Surfaces,
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
        self.make(gpu, size_px, set, Writer::Drawing, surfaces);
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

    fn make(
        &mut self,
        gpu: &Gpu,
        size_px: [u32; 2],
        set: TargetSet,
        writer: Writer,
        surfaces: Surfaces,
    ) {
        let n_layers = self.n_layers;
        for target in Target::ALL
            .into_iter()
            .filter(|target| set.contains(*target))
        {
            let (format, usage) = (target.format_as(surfaces), target.usage(writer));
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
            if (lit || writer == Writer::Computing) && !set.contains(target) {
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

    /// All layers of a target of the set; for other targets, an image that nobody reads.
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
