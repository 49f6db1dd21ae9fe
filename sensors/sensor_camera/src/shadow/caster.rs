//! A draw call in a shadow map.

use nalgebra::Matrix4;

use crate::assets::MeshDraw;

/// Three rows of `[rotation | translation]`.
pub(crate) type MatrixRows = [[f32; 4]; 3];

/// Which instances cast shadows in a cascade.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Casters {
    /// Static ones.
    Still,
    /// Static and moving ones: there are two maps of each cell.
    StillAndMoving,
}

impl Casters {
    pub fn has_moving(self) -> bool {
        self == Casters::StillAndMoving
    }

    /// Maps of each cell.
    pub fn n_maps(self) -> u64 {
        match self {
            Casters::Still => 1,
            Casters::StillAndMoving => 2,
        }
    }
}

/// A draw call with its matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Caster {
    pub mesh: MeshDraw,
    pub matrix: MatrixRows,
    /// Pixels it can cover: x, y, width, height, in the map.
    pub rect_px: [u32; 4],
}

pub(crate) fn top_rows(m: &Matrix4<f64>) -> MatrixRows {
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)] as f32))
}
