//! Where shadow maps lie: in the layers of two textures of one size; layers are added as they are
//! needed.
//!
//! For compute shaders, all maps of a cascade lie in one pair of textures, and a layer holds
//! several small ones. A map's place in its layer follows from its cell, so that its pixels do not
//! depend on other maps. For drawn views, each map is a layer of textures of its own size.

use sensor_gpu::Gpu;

use super::caster::Casters;
use crate::target::{Image, layered_image};

/// Where a map lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SheetPlace {
    pub layer: u32,
    /// Counted in sides of the map.
    pub tile: [u32; 2],
}

/// Layer of maps of one size.
#[derive(Clone, Debug)]
struct Layer {
    side_px: u32,
    taken: Vec<[u32; 2]>,
}

/// Layers of equal size.
#[derive(Debug)]
pub(crate) struct Sheet {
    pub page_px: u32,
    layers: Vec<Layer>,
    /// No more layers than these.
    most_layers: u32,
    images: Option<Images>,
    casters: Casters,
}

/// Static maps, and maps with moving casters.
#[derive(Debug)]
struct Images {
    still: Paged,
    all: Option<Paged>,
}

#[derive(Debug)]
struct Paged {
    image: Image,
    pages: Vec<wgpu::TextureView>,
}

impl Sheet {
    /// A sheet whose textures together have at most `most_bytes`, or one layer.
    pub fn new(page_px: u32, casters: Casters, most_bytes: u64) -> Self {
        let most_layers =
            (most_bytes / Self::layer_bytes(page_px, casters)).clamp(1, MAX_LAYERS) as u32;
        Sheet {
            page_px,
            layers: Vec::new(),
            most_layers,
            images: None,
            casters,
        }
    }

    /// Bytes of a layer of all its textures.
    fn layer_bytes(page_px: u32, casters: Casters) -> u64 {
        TEXEL_BYTES * u64::from(page_px) * u64::from(page_px) * casters.n_maps()
    }

    /// Bytes of its textures.
    pub fn n_bytes(&self) -> u64 {
        let n_layers = self
            .images
            .as_ref()
            .map_or(0, |images| images.still.pages.len());
        n_layers as u64 * Self::layer_bytes(self.page_px, self.casters)
    }

    /// A place for a cell's map, if there is room.
    pub fn take(&mut self, cell: [i64; 3], side_px: u32) -> Option<SheetPlace> {
        let n = i64::from(self.page_px / side_px);
        let tile = [cell[0], cell[1]].map(|i| i.rem_euclid(n) as u32);
        let has_room = |layer: &Layer| {
            layer.taken.is_empty() || layer.side_px == side_px && !layer.taken.contains(&tile)
        };
        let layer = self.layers.iter().position(has_room)?;
        self.layers[layer].side_px = side_px;
        self.layers[layer].taken.push(tile);
        Some(SheetPlace {
            layer: layer as u32,
            tile,
        })
    }

    /// Adds a layer; `false` if the limit is reached.
    pub fn grow(&mut self) -> bool {
        let may = self.layers.len() < self.most_layers as usize;
        if may {
            self.layers.push(Layer {
                side_px: self.page_px,
                taken: Vec::new(),
            });
        }
        may
    }

    pub fn give_back(&mut self, place: SheetPlace) {
        self.layers[place.layer as usize]
            .taken
            .retain(|tile| *tile != place.tile);
    }

    pub fn clear(&mut self) {
        self.layers.iter_mut().for_each(|layer| layer.taken.clear());
    }

    /// Makes the textures large enough for all layers, with some to spare. Existing maps are
    /// copied.
    pub fn ensure(&mut self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, n_spare: u32) {
        let known = self
            .images
            .as_ref()
            .map_or(0, |images| images.still.pages.len() as u32);
        let needed = self.layers.len() as u32;
        if needed <= known {
            return;
        }
        // Moving cameras soon need another layer.
        let n_layers = (needed + n_spare.max(known / 4)).min(self.most_layers);
        (needed..n_layers).for_each(|_| {
            self.grow();
        });
        let mut grown = |old: Option<&Paged>| {
            let new = paged(gpu, self.page_px, n_layers);
            if let Some(old) = old {
                let size = wgpu::Extent3d {
                    depth_or_array_layers: known,
                    ..old.image.texture.size()
                };
                encoder.copy_texture_to_texture(
                    old.image.texture.as_image_copy(),
                    new.image.texture.as_image_copy(),
                    size,
                );
            }
            new
        };
        let old = self.images.take();
        let still = grown(old.as_ref().map(|images| &images.still));
        let all = self
            .casters
            .has_moving()
            .then(|| grown(old.as_ref().and_then(|images| images.all.as_ref())));
        self.images = Some(Images { still, all });
    }

    fn images(&self) -> &Images {
        self.images.as_ref().expect("ensure() made them")
    }

    /// A layer of static maps.
    pub fn still(&self, layer: u32) -> &wgpu::TextureView {
        &self.images().still.pages[layer as usize]
    }

    /// A layer of maps with moving casters.
    pub fn all(&self, layer: u32) -> &wgpu::TextureView {
        &self
            .images()
            .all
            .as_ref()
            .expect("it is for what moves")
            .pages[layer as usize]
    }

    /// All layers that shaders look up.
    pub fn lookup(&self) -> &wgpu::TextureView {
        let Images { still, all } = self.images();
        &all.as_ref().unwrap_or(still).image.layers
    }
}

/// Every adapter supports this number.
const MAX_LAYERS: u64 = 256;
/// Of [`wgpu::TextureFormat::Depth16Unorm`].
const TEXEL_BYTES: u64 = 2;

fn paged(gpu: &Gpu, side_px: u32, n_layers: u32) -> Paged {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
        | wgpu::TextureUsages::TEXTURE_BINDING
        | wgpu::TextureUsages::COPY_SRC
        | wgpu::TextureUsages::COPY_DST;
    let image = layered_image(
        gpu,
        "shadow maps",
        [side_px; 2],
        n_layers,
        wgpu::TextureFormat::Depth16Unorm,
        usage,
    );
    let pages = (0..n_layers).map(|layer| image.layer(layer)).collect();
    Paged { image, pages }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map's place in its layer follows from its cell alone, no two maps share a place, and a
    /// layer holds maps of one size.
    #[test]
    fn maps_have_places_of_their_own_that_follow_from_their_cells() {
        let mut rng = fastrand::Rng::with_seed(3);
        let mut sheet = Sheet::new(4096, Casters::StillAndMoving, u64::MAX);
        let mut held: Vec<(u32, SheetPlace)> = Vec::new();
        for _ in 0..2000 {
            if held.len() > 40 || (!held.is_empty() && rng.bool()) {
                let (_, place) = held.swap_remove(rng.usize(..held.len()));
                sheet.give_back(place);
                continue;
            }
            let side_px = [1024, 2048, 4096][rng.usize(..3)];
            let cell = [rng.i64(-20..20), rng.i64(-20..20), 0];
            let place = sheet.take(cell, side_px).unwrap_or_else(|| {
                assert!(sheet.grow());
                sheet.take(cell, side_px).unwrap()
            });
            let n = i64::from(4096 / side_px);
            assert_eq!(
                place.tile,
                [cell[0].rem_euclid(n) as u32, cell[1].rem_euclid(n) as u32]
            );
            assert!(held.iter().all(|(side, other)| other.layer != place.layer
                || *side == side_px && other.tile != place.tile));
            held.push((side_px, place));
        }
    }

    /// Two bytes a texel, what stands still and what moves: a layer of 4096 × 4096 has 64 MiB.
    #[test]
    fn sheets_end_where_their_memory_does() {
        for (casters, n_expected) in [(Casters::StillAndMoving, 15), (Casters::Still, 31)] {
            let mut sheet = Sheet::new(4096, casters, (1 << 30) - 1);
            assert_eq!((0..100).filter(|_| sheet.grow()).count(), n_expected);
        }
        let mut sheet = Sheet::new(4096, Casters::StillAndMoving, 0);
        assert_eq!(
            (0..100).filter(|_| sheet.grow()).count(),
            1,
            "without a single map there is no light"
        );
    }
}
