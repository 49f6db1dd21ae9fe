//! Bundles of rays with a common origin, and the hits of their rays.
//!
//! A bundle looks along an axis. Its rays are points (u, v) of the plane one metre ahead, eight to
//! a group. Boxes are tested against the pyramid around all rays; triangles are projected onto the
//! plane and tested only against the groups that lie under their outline. A ray is inside a
//! triangle if it passes all three edges on the same side. An edge that two triangles share gives
//! the same number with opposite signs for the two, so no ray slips between them.
//!
//! Sources: Pineda, *A Parallel Algorithm for Polygon Rasterization* (1988); Reshetov, Soupikov and
//! Hurley, *Multi-Level Ray Tracing Algorithm* (2005).

use nalgebra::Vector3;
use sensor_core::vector_lanes::Lanes;

/// Rays of a group.
pub(crate) const GROUP: usize = 8;
/// Groups of a bundle.
pub(crate) const GROUPS: usize = 8;
/// Most rays of a bundle.
pub(crate) const RAYS: usize = GROUP * GROUPS;

/// Value of [`Hits::place`] for a ray that has hit nothing.
pub(crate) const NOWHERE: u32 = u32::MAX;

/// Outlines on the plane are widened by this before they are compared: far more than the rounding
/// error of `f32` there.
const MARGIN: f32 = 1e-5;
/// Smallest cosine allowed between a bundle's axis and one of its rays.
const NARROW: f64 = 0.5;

/// Rays with a common origin about an axis, in a space of their own (a sensor's).
#[derive(Clone, Debug)]
pub(crate) struct Bundle {
    /// Unit vectors: sideways, upwards, along the axis.
    pub basis: [Vector3<f64>; 3],
    pub u: [[f32; GROUP]; GROUPS],
    pub v: [[f32; GROUP]; GROUPS],
    /// Depth of the point one metre along each ray; negative in unused lanes.
    pub depth: [[f32; GROUP]; GROUPS],
    /// Smallest u, largest u, smallest v, largest v of each group, widened.
    pub bounds: [[f32; GROUPS]; 4],
    /// The same of all rays.
    pub pyramid: [f32; 4],
}

impl Bundle {
    /// A bundle of rays along unit vectors, eight to a group; `None` if the rays spread too far for
    /// one bundle.
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

/// Which sides of triangles rays hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sides {
    /// Both, as light does.
    Both,
    /// The front, from which the corners are counter-clockwise, as cameras draw.
    Front,
}

/// What the rays of a bundle have hit so far.
#[derive(Clone, Debug)]
pub(crate) struct Hits {
    /// Depth of the nearest hit, or the limit; negative in unused lanes and for rays that are
    /// switched off.
    pub depth: [[f32; GROUP]; GROUPS],
    /// Slot of the triangle that was hit: eight times its block, plus its lane.
    pub slot: [[u32; GROUP]; GROUPS],
    /// What was hit: the number of a tile of scenery, or the number of tiles plus that of a moving
    /// instance; [`NOWHERE`] without a hit.
    pub place: [[u32; GROUP]; GROUPS],
    /// Largest depth of each group.
    pub group_depth: [f32; GROUPS],
    /// Largest depth of all.
    pub farthest: f32,
    /// Which sides count.
    pub sides: Sides,
}

impl Hits {
    /// Rays of at most `max_m` that have hit nothing yet. Call [`Hits::begin`] before the first
    /// walk.
    #[inline(always)]
    pub fn new(bundle: &Bundle, max_m: f64) -> Self {
        // A little more than the limit: the exact distance decides afterwards.
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
            sides: Sides::Both,
        }
    }

    /// Switches a ray off: it hits nothing.
    #[inline(always)]
    pub fn switch_off(&mut self, ray: usize) {
        self.depth[ray / GROUP][ray % GROUP] = -1.0;
    }

    /// Computes how far the groups and the bundle reach.
    #[inline(always)]
    pub fn begin<L: Lanes>(&mut self) {
        for group in 0..GROUPS {
            self.group_depth[group] = L::load(&self.depth[group]).largest();
        }
        self.farthest = L::load(&self.group_depth).largest();
    }
}
