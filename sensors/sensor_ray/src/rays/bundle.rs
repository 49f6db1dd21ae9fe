//! Bundles of rays with a common origin, and how they walk a hierarchy together.
//!
//! A bundle looks along an axis. Its rays are points (u, v) of the plane one metre ahead, eight to
//! a group; boxes are tested against the pyramid about all of them, triangles are projected to the
//! plane and tested only against the groups that lie under their outline. A ray is inside a
//! triangle if it passes all three edges on the same side: an edge that two triangles share gives
//! the same number with the other sign for the other one, so that no ray slips between them.
//! Sources: Pineda, *A Parallel Algorithm for Polygon Rasterization* (1988); Reshetov, Soupikov and
//! Hurley, *Multi-Level Ray Tracing Algorithm* (2005).

use nalgebra::Vector3;
use sensor_core::lanes::Lanes;

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
