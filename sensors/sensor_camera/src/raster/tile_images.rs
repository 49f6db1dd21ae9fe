//! Images that tiles make of a view, in the bytes that readers get.

use super::tiles::TILE_PX;
use crate::target::{Target, TargetSet};

/// Images of a view, row by row; those that nobody asked for are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TileImages {
    /// Width, height.
    pub size_px: [usize; 2],
    /// Bytes B, G, R, A, the first in the lowest bits.
    pub color: Vec<u32>,
    /// Depth along the optical axis; infinite where there is sky.
    pub depth_m: Vec<f32>,
    /// Numbers of classes.
    pub class_code: Vec<u8>,
    /// Numbers of objects; 0 where there is sky.
    pub instance: Vec<u32>,
    /// Where the pixel is minus where it was.
    pub flow_px: Vec<[f32; 2]>,
    /// Unit normals in the world; zero where there is sky.
    pub normal: Vec<[f32; 3]>,
}

/// The rows of all images that a row of tiles makes.
pub(super) struct Band<'b> {
    pub width: usize,
    pub color: &'b mut [u32],
    pub depth_m: &'b mut [f32],
    pub class_code: &'b mut [u8],
    pub instance: &'b mut [u32],
    pub flow_px: &'b mut [[f32; 2]],
    pub normal: &'b mut [[f32; 3]],
}

/// Makes a list as long as it must be; what it holds is written over.
fn fit<T: Clone + Default>(list: &mut Vec<T>, n: usize, wanted: bool) {
    list.resize(if wanted { n } else { 0 }, T::default());
}

impl TileImages {
    /// Makes room for the images of a set, and for no others.
    pub(super) fn fit(&mut self, size_px: [usize; 2], set: TargetSet) {
        self.size_px = size_px;
        let n = size_px[0] * size_px[1];
        fit(&mut self.color, n, set.contains(Target::Color));
        fit(&mut self.depth_m, n, set.contains(Target::Depth));
        fit(&mut self.class_code, n, set.contains(Target::Class));
        fit(&mut self.instance, n, set.contains(Target::Instance));
        fit(&mut self.flow_px, n, set.contains(Target::Flow));
        fit(&mut self.normal, n, set.contains(Target::Normals));
    }

    /// Its rows by rows of tiles.
    pub(super) fn bands(&mut self) -> Vec<Band<'_>> {
        let [width, height] = self.size_px;
        let n = TILE_PX * width;
        let mut color = self.color.chunks_mut(n);
        let mut depth_m = self.depth_m.chunks_mut(n);
        let mut class_code = self.class_code.chunks_mut(n);
        let mut instance = self.instance.chunks_mut(n);
        let mut flow_px = self.flow_px.chunks_mut(n);
        let mut normal = self.normal.chunks_mut(n);
        (0..height.div_ceil(TILE_PX))
            .map(|_| Band {
                width,
                color: color.next().unwrap_or_default(),
                depth_m: depth_m.next().unwrap_or_default(),
                class_code: class_code.next().unwrap_or_default(),
                instance: instance.next().unwrap_or_default(),
                flow_px: flow_px.next().unwrap_or_default(),
                normal: normal.next().unwrap_or_default(),
            })
            .collect()
    }
}
