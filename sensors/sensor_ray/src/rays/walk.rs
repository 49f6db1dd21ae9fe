//! How a bundle of rays walks a hierarchy of boxes.

use nalgebra::Vector3;
use sensor_core::vector_lanes::Lanes;

use super::bundle::{Bundle, Hits};
use crate::bvh::{LEAF, Node, Tree, WIDTH};

/// Boxes may be wrong by this share of the largest coordinate.
const SLACK: f32 = 2e-6;

/// A bundle's origin and axes in the space of a hierarchy.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BundleAxes {
    pub origin: [f32; 3],
    pub basis: [[f32; 3]; 3],
}

impl BundleAxes {
    pub fn new(origin: &Vector3<f64>, basis: &[Vector3<f64>; 3]) -> Self {
        BundleAxes {
            origin: origin.cast::<f32>().into(),
            basis: basis.map(|axis| axis.cast::<f32>().into()),
        }
    }
}

/// Nodes and leaves still to be visited, each with the least depth of its box.
pub(crate) type Stack = Vec<(u32, f32)>;

/// A half space n·p ≥ offset, and per axis the side of a box that gives the corner to be tested.
struct Plane<L> {
    normal: [L; 3],
    offset: L,
    side: [usize; 3],
}

impl<L: Lanes> Plane<L> {
    #[inline(always)]
    fn new(normal: [f32; 3], origin: &[f32; 3], slack: f32, farthest: bool) -> Self {
        let side = |n: f32| ((n >= 0.0) == farthest) as usize;
        let offset = normal[0] * origin[0] + normal[1] * origin[1] + normal[2] * origin[2];
        Plane {
            normal: splat3(&normal),
            offset: L::splat(offset - slack),
            side: [side(normal[0]), side(normal[1]), side(normal[2])],
        }
    }

    /// Height of the tested corner above the plane, for each child.
    #[inline(always)]
    fn height(&self, node: &Node) -> L {
        let corner = [
            L::load(&node.bounds[0][self.side[0] % 2]),
            L::load(&node.bounds[1][self.side[1] % 2]),
            L::load(&node.bounds[2][self.side[2] % 2]),
        ];
        dot(&corner, &self.normal).sub(self.offset)
    }
}

/// What a walk does at leaves. A trait rather than closures, because closures cannot be marked
/// `#[inline(always)]`.
pub(crate) trait Leaves {
    /// Tests the rays against what is in a leaf.
    fn visit<L: Lanes>(&mut self, bundle: &Bundle, hits: &mut Hits, leaf: u32);
    /// Prefetches a leaf that is visited soon.
    fn prefetch<L: Lanes>(&self, leaf: u32);
}

/// Visits every leaf whose box some ray may enter before its hit, roughly in order of depth.
#[inline(always)]
pub(crate) fn walk<L: Lanes>(
    tree: &Tree,
    axes: &BundleAxes,
    bundle: &Bundle,
    hits: &mut Hits,
    stack: &mut Stack,
    leaves: &mut impl Leaves,
) {
    if tree.nodes.is_empty() {
        return;
    }
    let BundleAxes {
        origin,
        basis: [side, up, axis],
    } = axes;
    let reach = origin
        .iter()
        .fold(tree.reach, |reach, x| reach.max(x.abs()));
    let slack = SLACK * reach;
    let [u0, u1, v0, v1] = bundle.pyramid;
    let tilt = |a: &[f32; 3], sign: f32, at: f32| {
        [
            sign * (a[0] - at * axis[0]),
            sign * (a[1] - at * axis[1]),
            sign * (a[2] - at * axis[2]),
        ]
    };
    let planes = [
        Plane::<L>::new(tilt(side, 1.0, u0), origin, slack, true),
        Plane::<L>::new(tilt(side, -1.0, u1), origin, slack, true),
        Plane::<L>::new(tilt(up, 1.0, v0), origin, slack, true),
        Plane::<L>::new(tilt(up, -1.0, v1), origin, slack, true),
    ];
    let nearest = Plane::<L>::new(*axis, origin, -slack, false);
    let zero = L::splat(0.0);
    stack.clear();
    stack.push((0, 0.0));
    while let Some((at, depth)) = stack.pop() {
        if depth > hits.farthest {
            continue;
        }
        if at & LEAF != 0 {
            leaves.visit::<L>(bundle, hits, at & !LEAF);
            continue;
        }
        let node = &tree.nodes[at as usize];
        let near = nearest.height(node);
        let mut mask = near.le(L::splat(hits.farthest));
        for plane in &planes {
            mask = L::and(mask, zero.le(plane.height(node)));
        }
        let mut bits = L::bits(mask) & ((1 << node.n_children) - 1);
        let near = near.store();
        let first = stack.len();
        while bits != 0 {
            let i = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let entry = (node.child[i % WIDTH], near[i % WIDTH]);
            if entry.0 & LEAF != 0 {
                leaves.prefetch::<L>(entry.0 & !LEAF);
            } else {
                L::prefetch(&tree.nodes[entry.0 as usize]);
            }
            // Insertion sort: the nearest entry ends on top of the stack.
            let mut to = stack.len();
            stack.push(entry);
            while to > first && stack[to - 1].1 < entry.1 {
                stack[to] = stack[to - 1];
                to -= 1;
            }
            stack[to] = entry;
        }
    }
}

// Closures and the methods of arrays are not always inlined, so the loops over three axes are
// written out.

#[inline(always)]
pub(crate) fn splat3<L: Lanes>(x: &[f32; 3]) -> [L; 3] {
    [L::splat(x[0]), L::splat(x[1]), L::splat(x[2])]
}

#[inline(always)]
pub(crate) fn dot<L: Lanes>(a: &[L; 3], b: &[L; 3]) -> L {
    a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
}
