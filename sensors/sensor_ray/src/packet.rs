//! A packet of rays that walk a hierarchy together.
//!
//! Fields are arrays over the lanes, and loops run over all lanes without branches, so that the compiler makes vector code of them.

/// Rays with a common fate. A lane with negative `far` is empty and hits nothing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Packet<const N: usize> {
    pub origin: [[f32; N]; 3],
    pub direction: [[f32; N]; 3],
    inverse: [[f32; N]; 3],
    /// Distance of the nearest hit so far, or the limit.
    pub far: [f32; N],
    /// Triangle of that hit, a slot of its set.
    pub triangle: [u32; N],
    /// Where that hit was: a static set or an instance; [`NOWHERE`] without a hit.
    pub place: [u32; N],
}

/// Place of a lane that has hit nothing.
pub(crate) const NOWHERE: u32 = u32::MAX;

/// Widens a box's far side by twice the rounding of a slab test (Ize, *Robust BVH Ray Traversal*, JCGT 2013).
const SLAB_SLACK: f32 = 1.000_000_5;

/// Share of a triangle's edge by which neighbours overlap, so that no ray slips between them.
const EDGE_SLACK: f32 = 1e-6;

impl<const N: usize> Packet<N> {
    /// Empty lanes.
    pub fn empty() -> Self {
        let zero = [[0.0; N]; 3];
        Packet { origin: zero, direction: zero, inverse: zero, far: [-1.0; N], triangle: [0; N], place: [NOWHERE; N] }
    }

    /// Sets one lane's ray; its limit and hit stay.
    #[inline(always)]
    pub fn aim(&mut self, lane: usize, origin: [f32; 3], direction: [f32; 3]) {
        for axis in 0..3 {
            self.origin[axis][lane] = origin[axis];
            self.direction[axis][lane] = direction[axis];
            self.inverse[axis][lane] = finite_inverse(direction[axis]);
        }
    }

    /// Takes over the limits and hits of another packet whose rays are the same in another space.
    #[inline(always)]
    pub fn take_hits(&mut self, other: &Packet<N>) {
        self.far = other.far;
        self.triangle = other.triangle;
        self.place = other.place;
    }

    /// Smallest distance at which any lane enters the box before its own limit; infinity if none does.
    #[inline(always)]
    pub fn enter(&self, low: &[f32; 3], high: &[f32; 3]) -> f32 {
        let mut near = [0.0f32; N];
        let mut leave = self.far;
        for axis in 0..3 {
            let (origin, inverse) = (&self.origin[axis], &self.inverse[axis]);
            for lane in 0..N {
                let a = (low[axis] - origin[lane]) * inverse[lane];
                let b = (high[axis] - origin[lane]) * inverse[lane];
                near[lane] = max(near[lane], min(a, b));
                leave[lane] = min(leave[lane], max(a, b) * SLAB_SLACK);
            }
        }
        let mut first = f32::INFINITY;
        for lane in 0..N {
            first = min(first, if near[lane] <= leave[lane] { near[lane] } else { f32::INFINITY });
        }
        first
    }

    /// Tests one triangle (corner and two edges from it) against all lanes and keeps what is nearer.
    ///
    /// Of two triangles at the same distance the one with the smaller number wins, so that the order of visits does not show.
    /// Source: Möller and Trumbore, *Fast, Minimum Storage Ray/Triangle Intersection* (1997).
    #[inline(always)]
    pub fn triangle(&mut self, corner: &[f32; 3], edge1: &[f32; 3], edge2: &[f32; 3], number: u32, place: u32) {
        let [dx, dy, dz] = &self.direction;
        let mut distance = [0.0f32; N];
        let mut inside = [false; N];
        for lane in 0..N {
            let p = [
                dy[lane] * edge2[2] - dz[lane] * edge2[1],
                dz[lane] * edge2[0] - dx[lane] * edge2[2],
                dx[lane] * edge2[1] - dy[lane] * edge2[0],
            ];
            let determinant = edge1[0] * p[0] + edge1[1] * p[1] + edge1[2] * p[2];
            let inverse = 1.0 / determinant;
            let s: [f32; 3] = [self.origin[0][lane] - corner[0], self.origin[1][lane] - corner[1], self.origin[2][lane] - corner[2]];
            let u = (s[0] * p[0] + s[1] * p[1] + s[2] * p[2]) * inverse;
            let q = [s[1] * edge1[2] - s[2] * edge1[1], s[2] * edge1[0] - s[0] * edge1[2], s[0] * edge1[1] - s[1] * edge1[0]];
            let v = (dx[lane] * q[0] + dy[lane] * q[1] + dz[lane] * q[2]) * inverse;
            distance[lane] = (edge2[0] * q[0] + edge2[1] * q[1] + edge2[2] * q[2]) * inverse;
            // A ray in the triangle's plane divides by zero; the comparisons are then false, NaN included.
            inside[lane] = (u >= -EDGE_SLACK) & (v >= -EDGE_SLACK) & (u + v <= 1.0 + EDGE_SLACK) & (distance[lane] >= 0.0);
        }
        for lane in 0..N {
            let tie = (distance[lane] == self.far[lane]) & ((place, number) < (self.place[lane], self.triangle[lane]));
            let better = inside[lane] & ((distance[lane] < self.far[lane]) | tie);
            self.far[lane] = if better { distance[lane] } else { self.far[lane] };
            self.triangle[lane] = if better { number } else { self.triangle[lane] };
            self.place[lane] = if better { place } else { self.place[lane] };
        }
    }

    /// Largest limit of all lanes: what lies farther interests nobody.
    #[inline(always)]
    pub fn farthest(&self) -> f32 {
        self.far.iter().copied().fold(-1.0, max)
    }
}

/// 1/x, but finite for 0, so that slab tests make no NaN.
fn finite_inverse(x: f32) -> f32 {
    if x.abs() > 1e-20 { 1.0 / x } else { 1e20f32.copysign(x) }
}

/// One vector instruction, unlike `f32::min`, which must care for NaN.
#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// One vector instruction, unlike `f32::max`, which must care for NaN.
#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
