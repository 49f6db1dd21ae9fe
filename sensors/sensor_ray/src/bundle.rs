//! Bundles of rays with a common origin, and how they walk a hierarchy together.
//!
//! A bundle looks along an axis. Its rays are points (u, v) of the plane one metre ahead, eight to
//! a group; boxes are tested against the
//! pyramid about all of them, triangles are projected to the plane and tested only against the
//! groups that lie under their outline.
//! A ray is inside a triangle if it passes all three edges on the same side: an edge that two
//! triangles share gives the same number with
//! the other sign for the other one, so that no ray slips between them.
//! Sources: Pineda, *A Parallel Algorithm for Polygon Rasterization* (1988); Reshetov, Soupikov and
//! Hurley, *Multi-Level Ray Tracing
//! Algorithm* (2005).

use nalgebra::Vector3;
use sensor_core::lanes::Lanes;

use crate::tree::{LEAF, Node, Tree, WIDTH};

/// Rays of a group.
pub(crate) const GROUP: usize = 8;
/// Groups of a bundle.
pub(crate) const GROUPS: usize = 8;
/// Most rays of a bundle.
pub(crate) const RAYS: usize = GROUP * GROUPS;

/// Place of a ray that has hit nothing.
pub(crate) const NOWHERE: u32 = u32::MAX;

/// By how much outlines on the plane are widened before they are compared: far more than `f32`
/// loses there.
const MARGIN: f32 = 1e-5;
/// Share of the largest coordinate by which boxes may be off.
const SLACK: f32 = 2e-6;
/// Least cosine between a bundle's axis and its rays.
const NARROW: f64 = 0.5;

/// Rays with a common origin about an axis, in a space of their own (a sensor's).
#[derive(Clone, Debug)]
pub(crate) struct Bundle {
    /// Unit vectors: sideways, upwards, along the axis.
    pub basis: [Vector3<f64>; 3],
    pub u: [[f32; GROUP]; GROUPS],
    pub v: [[f32; GROUP]; GROUPS],
    /// Depth of a point one metre along each ray; negative for rays that are not there.
    pub depth: [[f32; GROUP]; GROUPS],
    /// Smallest u, largest u, smallest v, largest v of each group, widened.
    pub bounds: [[f32; GROUPS]; 4],
    /// The same of all rays.
    pub pyramid: [f32; 4],
}

impl Bundle {
    /// Rays along unit vectors, eight to a group; `None` if they lie too far apart for one bundle.
    pub fn new(directions: &[Option<Vector3<f64>>]) -> Option<Bundle> {
        assert!(
            directions.len() <= RAYS,
            "{} rays in a bundle",
            directions.len()
        );
        let sum: Vector3<f64> = directions.iter().flatten().sum();
        let axis = sum.try_normalize(1e-6)?;
        let reference = if axis.z.abs() < 0.9 {
            Vector3::z()
        } else {
            Vector3::x()
        };
        let side = reference.cross(&axis).normalize();
        let up = axis.cross(&side);
        let mut bundle = Bundle {
            basis: [side, up, axis],
            u: [[0.0; GROUP]; GROUPS],
            v: [[0.0; GROUP]; GROUPS],
            depth: [[-1.0; GROUP]; GROUPS],
            bounds: [
                [f32::INFINITY; GROUPS],
                [f32::NEG_INFINITY; GROUPS],
                [f32::INFINITY; GROUPS],
                [f32::NEG_INFINITY; GROUPS],
            ],
            pyramid: [
                f32::INFINITY,
                f32::NEG_INFINITY,
                f32::INFINITY,
                f32::NEG_INFINITY,
            ],
        };
        for (ray, direction) in directions.iter().enumerate() {
            let Some(direction) = direction else { continue };
            let depth = direction.dot(&axis);
            if depth < NARROW {
                return None;
            }
            bundle.put(
                ray,
                [
                    direction.dot(&side) / depth,
                    direction.dot(&up) / depth,
                    depth,
                ]
                .map(|x| x as f32),
            );
        }
        Some(bundle)
    }

    fn put(&mut self, ray: usize, [u, v, depth]: [f32; 3]) {
        let (group, lane) = (ray / GROUP, ray % GROUP);
        (
            self.u[group][lane],
            self.v[group][lane],
            self.depth[group][lane],
        ) = (u, v, depth);
        for (i, x) in [u - MARGIN, u + MARGIN, v - MARGIN, v + MARGIN]
            .into_iter()
            .enumerate()
        {
            let wider = |bound: f32| {
                if i % 2 == 0 {
                    bound.min(x)
                } else {
                    bound.max(x)
                }
            };
            self.bounds[i][group] = wider(self.bounds[i][group]);
            self.pyramid[i] = wider(self.pyramid[i]);
        }
    }
}

/// What the rays of a bundle have hit so far.
#[derive(Clone, Debug)]
pub(crate) struct Hits {
    /// Depth of the nearest hit, or the limit; negative for rays that are not there or do not fire.
    pub depth: [[f32; GROUP]; GROUPS],
    /// Slot of the triangle: its block times eight, and its lane.
    pub slot: [[u32; GROUP]; GROUPS],
    /// Where that hit was: a static set or an instance; [`NOWHERE`] without a hit.
    pub place: [[u32; GROUP]; GROUPS],
    /// Largest depth of each group.
    pub group_depth: [f32; GROUPS],
    /// Largest depth of all.
    pub farthest: f32,
}

impl Hits {
    /// Nothing hit yet: [`Hits::begin`] before the first walk.
    #[inline(always)]
    pub fn new(bundle: &Bundle, max_m: f64) -> Self {
        // A little beyond the limit: the exact distance decides afterwards.
        let limit = (max_m * (1.0 + 1e-6) + 1e-3) as f32;
        let mut depth = bundle.depth;
        for group in &mut depth {
            for depth in group {
                *depth *= limit;
            }
        }
        Hits {
            depth,
            slot: [[0; GROUP]; GROUPS],
            place: [[NOWHERE; GROUP]; GROUPS],
            group_depth: [-1.0; GROUPS],
            farthest: -1.0,
        }
    }

    /// Leaves a ray out.
    #[inline(always)]
    pub fn switch_off(&mut self, ray: usize) {
        self.depth[ray / GROUP][ray % GROUP] = -1.0;
    }

    /// Takes note of how far the rays go.
    #[inline(always)]
    pub fn begin<L: Lanes>(&mut self) {
        for group in 0..GROUPS {
            self.group_depth[group] = L::load(&self.depth[group]).largest();
        }
        self.farthest = L::load(&self.group_depth).largest();
    }
}

/// A bundle's origin and axes in the space of a hierarchy.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub origin: [f32; 3],
    pub basis: [[f32; 3]; 3],
}

impl Frame {
    pub fn new(origin: &Vector3<f64>, basis: &[Vector3<f64>; 3]) -> Self {
        Frame {
            origin: origin.cast::<f32>().into(),
            basis: basis.map(|axis| axis.cast::<f32>().into()),
        }
    }
}

/// Nodes and blocks still to be visited, with the least depth of what is in them.
pub(crate) type Stack = Vec<(u32, f32)>;

/// A half space n·p ≥ offset, with the side of a box that lies farthest along n for each axis.
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

    /// Height over the plane of the corner that was asked for, for each child.
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

/// What is done at leaves. A trait, because closures cannot be told to be inlined.
pub(crate) trait Leaves {
    /// Tries a leaf.
    fn visit<L: Lanes>(&mut self, bundle: &Bundle, hits: &mut Hits, leaf: u32);
    /// Begins to fetch a leaf.
    fn prefetch<L: Lanes>(&self, leaf: u32);
}

/// Visits every leaf whose box some ray may enter before its hit, roughly in order of depth.
#[inline(always)]
pub(crate) fn walk<L: Lanes>(
    tree: &Tree,
    frame: &Frame,
    bundle: &Bundle,
    hits: &mut Hits,
    stack: &mut Stack,
    leaves: &mut impl Leaves,
) {
    if tree.nodes.is_empty() {
        return;
    }
    let Frame {
        origin,
        basis: [side, up, axis],
    } = frame;
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
            // The nearest goes on top.
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
