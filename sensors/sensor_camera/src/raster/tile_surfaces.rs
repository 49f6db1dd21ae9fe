//! What tiles keep of surfaces until they are shaded: the words of `surface_wide.wgsl`, depth and id.

use super::tiles::TILE_PX;

/// Surfaces of tiles, row by row.
#[derive(Clone, Debug, Default)]
pub(super) struct Surfaces {
    /// Pixels of a row.
    pub stride: usize,
    pub words: [Vec<u32>; 4],
    /// Bits of the depth, metres.
    pub depth: Vec<u32>,
    pub id: Vec<u32>,
}

/// The rows of a row of tiles, to be written.
pub(super) struct SurfaceRows<'s> {
    pub stride: usize,
    pub words: [&'s mut [u32]; 4],
    pub depth: &'s mut [u32],
    pub id: &'s mut [u32],
}

/// The rows of a row of tiles, to be read.
pub(super) struct SurfaceBand<'s> {
    pub stride: usize,
    pub words: [&'s [u32]; 4],
    pub depth: &'s [u32],
    pub id: &'s [u32],
}

impl Surfaces {
    /// Of a single tile.
    pub fn of_tile() -> Surfaces {
        let mut surfaces = Surfaces::default();
        surfaces.fit([1, 1]);
        surfaces
    }

    /// Makes room for so many tiles across and down.
    pub fn fit(&mut self, [across, down]: [usize; 2]) {
        self.stride = across * TILE_PX;
        let n = self.stride * down * TILE_PX;
        let lists = self.words.iter_mut().chain([&mut self.depth, &mut self.id]);
        lists.for_each(|list| list.resize(n, 0));
    }

    /// Its rows by rows of tiles.
    pub fn rows(&mut self) -> Vec<SurfaceRows<'_>> {
        let n = self.stride * TILE_PX;
        let stride = self.stride;
        let mut words = self.words.each_mut().map(|list| list.chunks_exact_mut(n));
        let depths = self.depth.chunks_exact_mut(n);
        let pairs = depths.zip(self.id.chunks_exact_mut(n));
        pairs
            .map(|(depth, id)| SurfaceRows {
                stride,
                words: words.each_mut().map(|list| list.next().unwrap_or_default()),
                depth,
                id,
            })
            .collect()
    }

    /// The rows of a row of tiles.
    pub fn band(&self, number: usize) -> SurfaceBand<'_> {
        let n = self.stride * TILE_PX;
        let at = number * n..(number + 1) * n;
        SurfaceBand {
            stride: self.stride,
            words: self.words.each_ref().map(|list| &list[at.clone()]),
            depth: &self.depth[at.clone()],
            id: &self.id[at.clone()],
        }
    }
}
