//! How moving instances get from tick to tick, so that a ray meets them where they were when it was
//! fired: the mesh's origin goes straight ahead, the rotation turns about one axis.

use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Unit, Vector3};

use super::placed::{NO_LEG, Placed, box_about};
use crate::bvh::Bounds;

/// Terms of the series of sine and cosine: exact to the last bit for a quarter turn.
const TERMS: u32 = 11;

/// The way of an instance in one tick, from its later pose back to its earlier one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Leg {
    /// Where the mesh's origin is at the later end, world.
    pub later_m: Vector3<f64>,
    /// From there to the earlier end.
    pub step_m: Vector3<f64>,
    /// `world_from_mesh` rotation at the later end.
    pub later: Quaternion<f64>,
    /// Axis of the turn to the earlier end, in the mesh's space, with half of its angle as length: at
    /// most a quarter turn.
    pub half_turn: Vector3<f64>,
    /// The pose at the earlier end.
    earlier: Isometry3<f64>,
}

/// When a ray is fired.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Moment {
    /// Which leg, counted from the newest.
    pub leg: u32,
    /// Share of the way back to its earlier end.
    pub share: f64,
}

impl Moment {
    /// The moment `age_nanos` before the tick; `None` at the tick itself, and where nothing moved.
    /// `ages_nanos` are those of the ticks before, rising; the oldest poses stand for all before them.
    pub fn at(ages_nanos: &[u64], age_nanos: f64) -> Option<Moment> {
        let last = ages_nanos.len().checked_sub(1)?;
        if age_nanos.is_nan() || age_nanos <= 0.0 {
            return None;
        }
        let leg = ages_nanos
            .partition_point(|age| (*age as f64) < age_nanos)
            .min(last);
        let begin = leg.checked_sub(1).map_or(0, |before| ages_nanos[before]) as f64;
        let share = (age_nanos - begin) / (ages_nanos[leg] as f64 - begin);
        Some(Moment {
            leg: leg as u32,
            share: share.min(1.0),
        })
    }
}

impl Leg {
    pub fn new(later: &Isometry3<f64>, earlier: &Isometry3<f64>) -> Leg {
        let mut turn = *(later.rotation.inverse() * earlier.rotation).quaternion();
        if later.rotation == earlier.rotation {
            turn = Quaternion::identity();
        }
        // Of two rotations that look the same, the shorter way.
        if turn.w < 0.0 {
            turn = -turn;
        }
        let (sin, axis) = (turn.imag().norm(), turn.imag());
        let half_turn = if sin > 0.0 {
            axis * (sin.atan2(turn.w) / sin)
        } else {
            Vector3::zeros()
        };
        Leg {
            later_m: later.translation.vector,
            step_m: earlier.translation.vector - later.translation.vector,
            later: *later.rotation.quaternion(),
            half_turn,
            earlier: *earlier,
        }
    }

    /// Where the mesh's origin is, and `mesh_from_world`, at a share of the way back.
    #[inline]
    pub fn at(&self, share: f64) -> (Vector3<f64>, Matrix3<f64>) {
        let (cos, ratio) = series(self.half_turn.norm_squared() * share * share);
        let turn = self.later * Quaternion::from_parts(cos, self.half_turn * (ratio * share));
        let mesh_from_world = Unit::new_unchecked(turn.conjugate()).to_rotation_matrix();
        (
            self.later_m + self.step_m * share,
            *mesh_from_world.matrix(),
        )
    }

    /// Box about all places on the way, relative to `origin_m`.
    fn bounds(&self, origin_m: &Point3<f64>, later: &Isometry3<f64>, mesh: Bounds) -> Bounds {
        let ends = [later, &self.earlier];
        let [(low, high), (low_b, high_b)] = ends.map(|pose| box_about(origin_m, pose, mesh));
        let corner = |axis: usize| f64::from(mesh.0[axis].abs().max(mesh.1[axis].abs()));
        let reach_m = Vector3::new(corner(0), corner(1), corner(2)).norm();
        // A point that turns by an angle θ at a distance r from the axis leaves the straight way
        // between its ends by at most r·θ²/8, and θ is twice the length of `half_turn`.
        let bulge = (0.5 * reach_m * self.half_turn.norm_squared()) as f32 * 1.000_001;
        (
            [0, 1, 2].map(|i| low[i].min(low_b[i]) - bulge),
            [0, 1, 2].map(|i| high[i].max(high_b[i]) + bulge),
        )
    }
}

/// The cosine of x, and the sine of x over x, from x² up to a quarter turn's.
#[inline]
fn series(square: f64) -> (f64, f64) {
    let (mut cos, mut ratio) = (1.0, 1.0);
    for n in (1..TERMS).rev() {
        let n = f64::from(2 * n);
        cos = 1.0 - cos * square / ((n - 1.0) * n);
        ratio = 1.0 - ratio * square / (n * (n + 1.0));
    }
    (cos, ratio)
}

/// The ways of all instances that moved.
#[derive(Debug, Default)]
pub(crate) struct Motion {
    /// How long before the tick the ticks were between which legs lead, nanoseconds, rising.
    pub ages_nanos: Vec<u64>,
    /// As many as there are ages for each instance that moved, its newest first.
    pub legs: Vec<Leg>,
}

impl Motion {
    pub fn clear(&mut self) {
        self.ages_nanos.clear();
        self.legs.clear();
    }

    /// Adds the way of an instance through these earlier poses and returns the number of its first
    /// leg.
    pub fn add(&mut self, now: &Isometry3<f64>, earlier: &[Isometry3<f64>]) -> u32 {
        let first = self.legs.len() as u32;
        let mut later = now;
        for pose in earlier {
            self.legs.push(Leg::new(later, pose));
            later = pose;
        }
        first
    }

    /// The leg of an instance that a moment lies in; `None` if it stands still.
    #[inline(always)]
    pub fn leg(&self, placed: &Placed, moment: Option<Moment>) -> Option<(&Leg, f64)> {
        let moment = moment.filter(|_| placed.first_leg != NO_LEG)?;
        Some((
            &self.legs[(placed.first_leg + moment.leg) as usize],
            moment.share,
        ))
    }

    /// Widens the box of an instance by all places on its way.
    pub fn sweep(
        &self,
        placed: &Placed,
        origin_m: &Point3<f64>,
        mesh: Bounds,
        mut bounds: Bounds,
    ) -> Bounds {
        if placed.first_leg == NO_LEG {
            return bounds;
        }
        let mut later = &placed.world_from_mesh;
        for leg in &self.legs[placed.first_leg as usize..][..self.ages_nanos.len()] {
            let (low, high) = leg.bounds(origin_m, later, mesh);
            bounds = (
                [0, 1, 2].map(|i| bounds.0[i].min(low[i])),
                [0, 1, 2].map(|i| bounds.1[i].max(high[i])),
            );
            later = &leg.earlier;
        }
        bounds
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;

    fn random_pose(rng: &mut fastrand::Rng, angle: f64) -> Isometry3<f64> {
        let mut side = |scale: f64| (rng.f64() - 0.5) * scale;
        Isometry3::from_parts(
            Vector3::new(side(4.0), side(4.0), side(4.0)).into(),
            UnitQuaternion::from_scaled_axis(Vector3::new(side(angle), side(angle), side(angle))),
        )
    }

    #[test]
    fn a_leg_goes_straight_and_turns_evenly_the_shorter_way() {
        let mut rng = fastrand::Rng::with_seed(3);
        for round in 0..2000 {
            let angle = if round % 2 == 0 { 0.2 } else { 3.4 };
            let (later, earlier) = (random_pose(&mut rng, angle), random_pose(&mut rng, angle));
            let (leg, share) = (Leg::new(&later, &earlier), rng.f64());
            let (at, mesh_from_world) = leg.at(share);
            let expected = later.lerp_slerp(&earlier, share);
            assert!((at - expected.translation.vector).norm() < 1e-12);
            let turn = expected.rotation.inverse().to_rotation_matrix();
            assert!(
                (mesh_from_world - turn.matrix()).norm() < 1e-9,
                "{later} {earlier} {share}"
            );
        }
        let pose = random_pose(&mut rng, 1.0);
        let (at, mesh_from_world) = Leg::new(&pose, &pose).at(0.7);
        assert_eq!(at, pose.translation.vector);
        assert_eq!(
            mesh_from_world,
            *pose.rotation.inverse().to_rotation_matrix().matrix()
        );
    }

    #[test]
    fn boxes_hold_every_corner_at_every_share() {
        let mut rng = fastrand::Rng::with_seed(4);
        let mesh = ([-1.0, -0.5, -0.2], [2.0, 0.7, 1.5]);
        let origin = Point3::new(1.0, 2.0, 3.0);
        for round in 0..300 {
            let angle = [0.1, 1.0, 3.6][round % 3];
            let poses: Vec<_> = (0..4).map(|_| random_pose(&mut rng, angle)).collect();
            let mut motion = Motion {
                ages_nanos: vec![1, 2, 3],
                ..Motion::default()
            };
            let first_leg = motion.add(&poses[0], &poses[1..]);
            let placed = Placed {
                first_leg,
                ..Placed::new(sensor_core::MeshId(0), &poses[0], schema_types::ObjectId(1))
            };
            let own = box_about(&origin, &poses[0], mesh);
            let (low, high) = motion.sweep(&placed, &origin, mesh, own);
            for step in 0..=60 {
                let moment = Moment::at(&motion.ages_nanos, 3.0 * f64::from(step) / 60.0);
                let (at, world_from_mesh) = match motion.leg(&placed, moment) {
                    Some((leg, share)) => {
                        let (at, mesh_from_world) = leg.at(share);
                        (at, mesh_from_world.transpose())
                    }
                    None => (
                        poses[0].translation.vector,
                        *poses[0].rotation.to_rotation_matrix().matrix(),
                    ),
                };
                for corner in 0..8 {
                    let side = |i: usize| {
                        f64::from(if corner >> i & 1 == 0 {
                            mesh.0[i]
                        } else {
                            mesh.1[i]
                        })
                    };
                    let point = at + world_from_mesh * Vector3::new(side(0), side(1), side(2))
                        - origin.coords;
                    assert!(
                        (0..3).all(
                            |i| f64::from(low[i]) <= point[i] && point[i] <= f64::from(high[i])
                        ),
                        "{point} sticks out of {low:?} {high:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn moments_count_back_from_the_tick() {
        let ages = [50, 100, 200];
        let at = |age: f64| Moment::at(&ages, age).map(|moment| (moment.leg, moment.share));
        assert_eq!(at(0.0), None);
        assert_eq!(at(-1.0), None);
        assert_eq!(at(f64::NAN), None);
        assert_eq!(at(25.0), Some((0, 0.5)));
        assert_eq!(at(50.0), Some((0, 1.0)));
        assert_eq!(at(75.0), Some((1, 0.5)));
        assert_eq!(at(125.0), Some((2, 0.25)));
        assert_eq!(at(1e9), Some((2, 1.0)));
        assert_eq!(Moment::at(&[], 25.0), None);
    }
}
