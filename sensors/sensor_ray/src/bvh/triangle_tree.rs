//! Triangles under a hierarchy of boxes: built by obvhs (PLOC with reinsertion), then folded.

use std::time::Duration;

use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::triangle::Triangle;

use super::packed::Packed;
use super::tree::{Tree, WIDTH};

/// Most triangles of a leaf on the GPU.
const GPU_LEAF: u32 = 4;

/// Boxes are widened for the GPU by this share of the largest coordinate.
pub(crate) const MARGIN: f32 = 1e-6;

/// Marks a lane of a block that has no triangle.
pub(crate) const NO_TRIANGLE: u32 = u32::MAX;

/// Up to eight triangles.
#[derive(Clone, Debug)]
#[repr(C, align(32))]
pub(crate) struct Block {
    /// `corner[vertex][axis]`. In lanes without a triangle all three corners are one point, which
    /// no ray hits.
    pub corner: [[[f32; WIDTH]; 3]; 3],
}

impl Block {
    fn set(&mut self, lane: usize, corners: &[[f32; 3]; 3]) {
        for (of_all, corner) in self.corner.iter_mut().zip(corners) {
            for (of_all, x) in of_all.iter_mut().zip(corner) {
                of_all[lane] = *x;
            }
        }
    }
}

/// Triangles under a hierarchy.
#[derive(Debug, Default)]
pub(crate) struct TriangleTree {
    pub tree: Tree,
    pub blocks: Vec<Block>,
    /// By block and lane: the index of the triangle as it was given, or [`NO_TRIANGLE`].
    pub numbers: Vec<[u32; WIDTH]>,
    /// The same hierarchy packed for the GPU, if it was asked for; its items are triangle numbers.
    pub packed: Option<Packed>,
}

impl TriangleTree {
    /// Builds a hierarchy over triangles, whose numbers are indices into `corners`. Triangles with
    /// a corner that is not finite are left out.
    pub fn new(corners: &[[[f32; 3]; 3]], for_gpu: bool) -> Self {
        let finite = |c: &[[f32; 3]; 3]| c.iter().flatten().all(|x| x.is_finite());
        let numbers: Vec<u32> = (0..corners.len() as u32)
            .filter(|i| finite(&corners[*i as usize]))
            .collect();
        let triangles: Vec<Triangle> = numbers
            .iter()
            .map(|i| {
                let [v0, v1, v2] = corners[*i as usize].map(Vec3A::from);
                Triangle { v0, v1, v2 }
            })
            .collect();
        if triangles.is_empty() {
            return TriangleTree::default();
        }
        let bvh = build_bvh2_from_tris(
            &triangles,
            BvhBuildParams {
                max_prims_per_leaf: GPU_LEAF,
                ..BvhBuildParams::medium_build()
            },
            &mut Duration::default(),
        );
        let (mut blocks, mut block_numbers) = (
            Vec::with_capacity(triangles.len() / 4),
            Vec::with_capacity(triangles.len() / 4),
        );
        let tree = Tree::fold(&bvh, WIDTH as u32, |items| {
            let first = blocks.len() as u32;
            assert!(items.len() <= WIDTH, "a leaf of {} triangles", items.len());
            blocks.push(block(
                items
                    .iter()
                    .map(|i| &corners[numbers[*i as usize] as usize]),
            ));
            block_numbers.push([0, 1, 2, 3, 4, 5, 6, 7].map(|lane| {
                items
                    .get(lane)
                    .map_or(NO_TRIANGLE, |i| numbers[*i as usize])
            }));
            first
        });
        let packed = for_gpu.then(|| {
            let mut leaves: Vec<Vec<u32>> = Vec::new();
            let narrow = Tree::fold(&bvh, GPU_LEAF, |items| {
                leaves.push(items.iter().map(|i| numbers[*i as usize]).collect());
                leaves.len() as u32 - 1
            });
            let mut packed = Packed::new(
                &narrow,
                |leaf| &leaves[leaf as usize],
                MARGIN * narrow.reach,
            );
            packed.corners = packed
                .items
                .iter()
                .map(|number| corners[*number as usize])
                .collect();
            packed
        });
        TriangleTree {
            tree,
            blocks,
            numbers: block_numbers,
            packed,
        }
    }

    /// Lower and upper corner of the box around everything; `None` without triangles.
    #[inline]
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        self.tree.bounds
    }

    /// Replaces the triangle at a slot: its corners, and the number that hits report.
    pub fn set(&mut self, slot: u32, corners: &[[f32; 3]; 3], number: u32) {
        let (block, lane) = (slot as usize / WIDTH, slot as usize % WIDTH);
        self.blocks[block].set(lane, corners);
        self.numbers[block][lane] = number;
    }

    /// Number of the triangle at a slot, as it was given.
    #[inline(always)]
    pub fn number(&self, slot: u32) -> u32 {
        self.numbers[slot as usize / WIDTH][slot as usize % WIDTH]
    }
}

fn block<'c>(triangles: impl Iterator<Item = &'c [[f32; 3]; 3]>) -> Block {
    let mut block = Block {
        corner: [[[0.0; WIDTH]; 3]; 3],
    };
    let (mut n, mut last) = (0, [0.0; 3]);
    for (lane, corners) in triangles.enumerate() {
        block.set(lane, corners);
        (n, last) = (lane + 1, corners[0]);
    }
    (n..WIDTH).for_each(|lane| block.set(lane, &[last; 3]));
    block
}
