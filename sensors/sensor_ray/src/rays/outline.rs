//! Tests triangles against a bundle of rays: their outlines on the plane one metre ahead, and which
//! rays lie inside.

use sensor_core::vector_lanes::Lanes;

use super::bundle::{Bundle, GROUPS, Hits, Sides};
use super::walk::{BundleAxes, Leaves, Stack, dot, splat3, walk};
use crate::bvh::{Block, TriangleTree, WIDTH};

/// Vertices whose depth is below this share of their sideways distance are not projected: the
/// rounding error of `f32` would be too large.
const FLATTEST: f32 = 0.05;

/// Triangles at the leaves.
struct Blocks<'t> {
    blocks: &'t [Block],
    axes: &'t BundleAxes,
    place: u32,
}

impl TriangleTree {
    /// Finds the nearest hit of each ray within its limit; a hit records `place` and the triangle's
    /// slot.
    #[inline(always)]
    pub fn intersect<L: Lanes>(
        &self,
        axes: &BundleAxes,
        bundle: &Bundle,
        hits: &mut Hits,
        place: u32,
        stack: &mut Stack,
    ) {
        walk::<L>(
            &self.tree,
            axes,
            bundle,
            hits,
            stack,
            &mut Blocks {
                blocks: &self.blocks,
                axes,
                place,
            },
        );
    }
}

/// A block of triangles in the bundle's axes, prepared for testing one triangle at a time.
struct Outlines {
    /// `edge[vertex][axis]`: normal of the plane through the origin and the edge opposite a vertex.
    edge: [[[f32; WIDTH]; 3]; 3],
    /// Depths of the vertices.
    depth: [[f32; WIDTH]; 3],
    /// Smallest and largest u and v, and the smallest depth.
    bounds: [[f32; WIDTH]; 5],
}

impl Leaves for Blocks<'_> {
    #[inline(always)]
    fn prefetch<L: Lanes>(&self, leaf: u32) {
        L::prefetch(&self.blocks[leaf as usize]);
    }

    #[inline(always)]
    fn visit<L: Lanes>(&mut self, bundle: &Bundle, hits: &mut Hits, leaf: u32) {
        let block = &self.blocks[leaf as usize];
        let basis = [
            splat3(&self.axes.basis[0]),
            splat3(&self.axes.basis[1]),
            splat3(&self.axes.basis[2]),
        ];
        let origin = splat3(&self.axes.origin);
        let vertices: [[L; 3]; 3] = [
            seen_from(&block.corner[0], &origin, &basis),
            seen_from(&block.corner[1], &origin, &basis),
            seen_from(&block.corner[2], &origin, &basis),
        ];
        let mut outlines = Outlines {
            edge: [[[0.0; WIDTH]; 3]; 3],
            depth: [[0.0; WIDTH]; 3],
            bounds: [[0.0; WIDTH]; 5],
        };
        let mut bits = outlines.bound(&vertices, &bundle.pyramid, hits.farthest);
        if bits == 0 {
            return;
        }
        outlines.set_edges(&vertices);
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize % WIDTH;
            bits &= bits - 1;
            let groups = outlines.groups::<L>(lane, bundle, hits);
            outlines.test::<L>(
                lane,
                groups,
                bundle,
                hits,
                leaf * WIDTH as u32 + lane as u32,
                self.place,
            );
        }
        hits.farthest = L::load(&hits.group_depth).largest();
    }
}

#[inline(always)]
fn cross<L: Lanes>(a: &[L; 3], b: &[L; 3]) -> [L; 3] {
    [
        a[1].mul(b[2]).sub(a[2].mul(b[1])),
        a[2].mul(b[0]).sub(a[0].mul(b[2])),
        a[0].mul(b[1]).sub(a[1].mul(b[0])),
    ]
}

/// A vertex of each triangle in the bundle's axes.
#[inline(always)]
fn seen_from<L: Lanes>(corner: &[[f32; WIDTH]; 3], origin: &[L; 3], basis: &[[L; 3]; 3]) -> [L; 3] {
    let from = [
        L::load(&corner[0]).sub(origin[0]),
        L::load(&corner[1]).sub(origin[1]),
        L::load(&corner[2]).sub(origin[2]),
    ];
    [
        dot(&from, &basis[0]),
        dot(&from, &basis[1]),
        dot(&from, &basis[2]),
    ]
}

/// Normal of the plane through the origin and an edge: (a + b) × (b − a) = 2 a × b. This form stays
/// accurate for short edges, and the triangle beyond the edge gets exactly the negative.
#[inline(always)]
fn edge_normal<L: Lanes>(a: &[L; 3], b: &[L; 3]) -> [L; 3] {
    cross(
        &[a[0].add(b[0]), a[1].add(b[1]), a[2].add(b[2])],
        &[b[0].sub(a[0]), b[1].sub(a[1]), b[2].sub(a[2])],
    )
}

/// Whether the vertices lie far enough ahead to be projected.
#[inline(always)]
fn is_ahead<L: Lanes>([x, y, z]: &[L; 3]) -> L::Mask {
    let zero = L::splat(0.0);
    let (x, y) = (x.max(zero.sub(*x)), y.max(zero.sub(*y)));
    x.add(y).mul(L::splat(FLATTEST)).lt(*z)
}

/// Where the interval `low..=high` overlaps `from..=to`.
#[inline(always)]
fn overlap<L: Lanes>(low: L, high: L, from: L, to: L) -> L::Mask {
    L::and(low.le(to), from.le(high))
}

impl Outlines {
    /// Sets the bounds and returns which triangles may lie in the pyramid, nearer than `farthest`.
    #[inline(always)]
    fn bound<L: Lanes>(
        &mut self,
        vertices: &[[L; 3]; 3],
        pyramid: &[f32; 4],
        farthest: f32,
    ) -> u32 {
        let [a, b, c] = vertices;
        let nearest = a[2].min(b[2]).min(c[2]);
        let deepest = a[2].max(b[2]).max(c[2]);
        let projected = L::and(L::and(is_ahead(a), is_ahead(b)), is_ahead(c));
        let one = L::splat(1.0);
        let inverse = [one.div(a[2]), one.div(b[2]), one.div(c[2])];
        let mut bounds = [nearest; 5];
        for axis in 0..2 {
            let at = [
                a[axis].mul(inverse[0]),
                b[axis].mul(inverse[1]),
                c[axis].mul(inverse[2]),
            ];
            let (low, high) = (at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2]));
            bounds[2 * axis] = L::select(projected, low, L::splat(f32::NEG_INFINITY));
            bounds[2 * axis + 1] = L::select(projected, high, L::splat(f32::INFINITY));
        }
        // A hit lies between the depths of the vertices, up to rounding.
        bounds[4] = nearest.mul(L::splat(1.0 - 2e-6));
        let in_u = overlap(
            bounds[0],
            bounds[1],
            L::splat(pyramid[0]),
            L::splat(pyramid[1]),
        );
        let in_v = overlap(
            bounds[2],
            bounds[3],
            L::splat(pyramid[2]),
            L::splat(pyramid[3]),
        );
        let in_depth = overlap(bounds[4], deepest, L::splat(0.0), L::splat(farthest));
        for (kept, bound) in self.bounds.iter_mut().zip(bounds) {
            *kept = bound.store();
        }
        self.depth = [a[2].store(), b[2].store(), c[2].store()];
        L::bits(L::and(L::and(in_u, in_v), in_depth))
    }

    #[inline(always)]
    fn set_edges<L: Lanes>(&mut self, [a, b, c]: &[[L; 3]; 3]) {
        let edges = [edge_normal(b, c), edge_normal(c, a), edge_normal(a, b)];
        for (kept, edge) in self.edge.iter_mut().zip(edges) {
            *kept = [edge[0].store(), edge[1].store(), edge[2].store()];
        }
    }

    /// Groups of rays that lie under a triangle's outline and have hit nothing nearer than all of
    /// it.
    #[inline(always)]
    fn groups<L: Lanes>(&self, lane: usize, bundle: &Bundle, hits: &Hits) -> u32 {
        let [u0, u1, v0, v1, nearest] = &self.bounds;
        let [low_u, high_u, low_v, high_v] = &bundle.bounds;
        let in_u = overlap(
            L::splat(u0[lane]),
            L::splat(u1[lane]),
            L::load(low_u),
            L::load(high_u),
        );
        let in_v = overlap(
            L::splat(v0[lane]),
            L::splat(v1[lane]),
            L::load(low_v),
            L::load(high_v),
        );
        L::bits(L::and(
            L::and(in_u, in_v),
            L::splat(nearest[lane]).le(L::load(&hits.group_depth)),
        ))
    }

    /// Tests one triangle against the rays of some groups and keeps what is nearer.
    ///
    /// Of two triangles of a set at the same depth the one with the smaller slot wins, of two sets
    /// the one visited first.
    #[inline(always)]
    fn test<L: Lanes>(
        &self,
        lane: usize,
        mut groups: u32,
        bundle: &Bundle,
        hits: &mut Hits,
        slot: u32,
        place: u32,
    ) {
        if groups == 0 {
            return;
        }
        let zero = L::splat(0.0);
        let of = |x: &[[f32; WIDTH]; 3]| [x[0][lane], x[1][lane], x[2][lane]];
        let edge: [[L; 3]; 3] = [
            splat3(&of(&self.edge[0])),
            splat3(&of(&self.edge[1])),
            splat3(&of(&self.edge[2])),
        ];
        let depth: [L; 3] = splat3(&of(&self.depth));
        // Of a triangle that shows its front all weights are negative.
        let most = L::splat(match hits.sides {
            Sides::Both => f32::INFINITY,
            Sides::Front => f32::NEG_INFINITY,
        });
        while groups != 0 {
            let group = groups.trailing_zeros() as usize % GROUPS;
            groups &= groups - 1;
            let ray = [
                L::load(&bundle.u[group]),
                L::load(&bundle.v[group]),
                L::splat(1.0),
            ];
            let weight = [
                dot(&edge[0], &ray),
                dot(&edge[1], &ray),
                dot(&edge[2], &ray),
            ];
            let (low, high) = (
                weight[0].min(weight[1]).min(weight[2]),
                weight[0].max(weight[1]).max(weight[2]),
            );
            let inside = L::or(zero.le(low.min(most)), high.le(zero));
            if L::bits(inside) == 0 {
                continue;
            }
            let sum = weight[0].add(weight[1]).add(weight[2]);
            let (at, limit) = (dot(&weight, &depth).div(sum), L::load(&hits.depth[group]));
            // A triangle without area has a zero sum: `at` is NaN, and comparisons with NaN are
            // false.
            let reached = L::and(inside, L::and(zero.le(at), at.le(limit)));
            if L::bits(reached) != 0 {
                hits.take::<L>(group, reached, at, limit, slot, place);
            }
        }
    }
}

impl Hits {
    #[inline(always)]
    fn take<L: Lanes>(
        &mut self,
        group: usize,
        reached: L::Mask,
        at: L,
        limit: L,
        slot: u32,
        place: u32,
    ) {
        let mut nearer = L::and(reached, at.lt(limit));
        let tied = L::bits(reached) & !L::bits(nearer);
        if tied != 0 {
            let mut wins = [1.0; 8];
            for (i, wins) in wins.iter_mut().enumerate() {
                if tied >> i & 1 != 0 && self.place[group][i] == place && slot < self.slot[group][i]
                {
                    *wins = 0.0;
                }
            }
            nearer = L::or(nearer, L::load(&wins).le(L::splat(0.0)));
        }
        let depth = L::select(nearer, at, limit);
        self.depth[group] = depth.store();
        self.slot[group] = words(L::select(
            nearer,
            L::splat(f32::from_bits(slot)),
            lanes(&self.slot[group]),
        ));
        self.place[group] = words(L::select(
            nearer,
            L::splat(f32::from_bits(place)),
            lanes(&self.place[group]),
        ));
        self.group_depth[group] = depth.largest();
    }
}

/// Reinterprets words as lanes of the same bits.
#[inline(always)]
fn lanes<L: Lanes>(words: &[u32; 8]) -> L {
    L::load(bytemuck::cast_ref(words))
}

#[inline(always)]
fn words<L: Lanes>(lanes: L) -> [u32; 8] {
    bytemuck::cast(lanes.store())
}
