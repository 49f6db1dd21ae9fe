//! The one place where Gantry's axes and units become CARLA's and back.
//!
//! Gantry is right-handed: x forward, y left, z up, in metres, radians and quaternions. CARLA is
//! left-handed with y to the right, and writes rotations as pitch, yaw and roll in degrees.
//!
//! The conversion mirrors y: a point `(x, y, z)` becomes `(x, −y, z)`, an axial vector such as an
//! angular velocity becomes `(−x, y, −z)`, a rotation matrix `R` becomes `S R S` with `S = diag(1,
//! −1, 1)`, and steering changes its sign.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use schema_frames::BodyBox;
use schema_types::Pose;

/// A pose as CARLA writes it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Transform {
    /// x forward, y right, z up; metres.
    pub location_m: [f64; 3],
    /// Pitch, yaw, roll; degrees.
    pub rotation_deg: [f64; 3],
}

/// Converts a point or a polar vector (velocity, acceleration) in either direction.
pub fn mirror<T: Copy + std::ops::Neg<Output = T>>([x, y, z]: [T; 3]) -> [T; 3] {
    [x, -y, z]
}

/// Converts an angular velocity from rad/s to CARLA's deg/s.
pub fn angular_velocity_deg([x, y, z]: [f64; 3]) -> [f64; 3] {
    [-x.to_degrees(), y.to_degrees(), -z.to_degrees()]
}

/// Converts CARLA's angular velocity in deg/s to rad/s.
pub fn angular_velocity_rad([x, y, z]: [f64; 3]) -> [f64; 3] {
    [-x.to_radians(), y.to_radians(), -z.to_radians()]
}

/// Converts steering in either direction: CARLA's is positive to the right, Gantry's to the left.
pub fn steer(ratio: f32) -> f32 {
    -ratio
}

/// Converts the sun's azimuth in either direction: CARLA counts clockwise from x, Gantry
/// counter-clockwise. The result lies in [0, 360).
pub fn azimuth_deg(azimuth_deg: f32) -> f32 {
    let turned = (-azimuth_deg).rem_euclid(360.0);
    // A tiny negative angle rounds up to a whole turn.
    if turned >= 360.0 { 0.0 } else { turned }
}

/// Converts m/s to km/h.
pub fn kmh(mps: f32) -> f32 {
    mps * 3.6
}

/// Converts a pose to CARLA's transform. Yaw and roll lie in (−180, 180], pitch in [−90, 90]; roll
/// is 0 if the nose points straight up or down.
pub fn transform(pose: &Pose) -> Transform {
    let iso = pose.isometry();
    let m = iso.rotation.to_rotation_matrix().into_inner();
    // S R S: elements with exactly one index of y change their sign.
    let (m00, m01, m10, m11) = (m[(0, 0)], -m[(0, 1)], -m[(1, 0)], m[(1, 1)]);
    let (m20, m21, m22) = (m[(2, 0)], -m[(2, 1)], m[(2, 2)]);
    let pitch = m20.atan2(m00.hypot(m10));
    let (yaw, roll) = if m00.hypot(m10) > 1e-9 {
        (m10.atan2(m00), (-m21).atan2(m22))
    } else {
        ((-m01).atan2(m11), 0.0)
    };
    Transform {
        location_m: mirror(pose.translation_m),
        rotation_deg: [pitch, yaw, roll].map(|angle| whole(angle.to_degrees())),
    }
}

/// The pose of a light or sign in CARLA's convention: its x axis points across the road, to the
/// right of the traffic that it is for; in Gantry it faces that traffic.
pub fn sign_pose(pose: &Pose) -> Pose {
    let quarter = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
    (pose.isometry() * quarter).into()
}

/// A box in a sign's space, see [`sign_pose`].
pub fn sign_box(body: &BodyBox) -> BodyBox {
    let ([x, y, z], [half_x, half_y, half_z]) = (body.centre_m, body.half_m);
    BodyBox {
        centre_m: [y, -x, z],
        half_m: [half_y, half_x, half_z],
    }
}

/// Turns −0, which CARLA's scripts would print, into 0, and −180 into 180. What is −180 only in the
/// wire's `f32` counts too: a spawn point's 180 comes back from a snapshot a rounding beyond it.
fn whole(angle_deg: f64) -> f64 {
    if angle_deg as f32 <= -180.0 {
        180.0
    } else {
        angle_deg + 0.0
    }
}

/// Converts CARLA's transform to a pose.
pub fn pose(transform: &Transform) -> Pose {
    let [pitch, yaw, roll] = transform.rotation_deg.map(f64::to_radians);
    let ((sp, cp), (sy, cy), (sr, cr)) = (pitch.sin_cos(), yaw.sin_cos(), roll.sin_cos());
    let mirrored = Matrix3::new(
        cp * cy,
        -(cy * sp * sr - sy * cr),
        -cy * sp * cr - sy * sr,
        -(cp * sy),
        sy * sp * sr + cy * cr,
        -(-sy * sp * cr + cy * sr),
        sp,
        cp * sr,
        cp * cr,
    );
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(mirrored));
    Isometry3::from_parts(
        Translation3::from(Vector3::from(mirror(transform.location_m))),
        rotation,
    )
    .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random_transform(rng: &mut fastrand::Rng) -> Transform {
        let mut within = |half: f64| (rng.f64() * 2.0 - 1.0) * half;
        Transform {
            location_m: [within(1e4), within(1e4), within(100.0)],
            rotation_deg: [within(89.9), within(180.0), within(180.0)],
        }
    }

    #[test]
    fn half_a_turn_is_180_on_the_wire_whatever_the_rounding() {
        for beyond in [0.0, 1e-12, -1e-12, 1e-9, 1e-7, -1e-7] {
            let turned = UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::PI + beyond);
            let pose = Pose::from(Isometry3::from_parts(Translation3::identity(), turned));
            let yaw = transform(&pose).rotation_deg[1] as f32;
            assert!(
                (yaw - 180.0).abs() < 1e-4,
                "{yaw} for half a turn and {beyond}"
            );
        }
    }

    /// CARLA's published matrix, columns forward, right, up.
    fn carla_matrix(t: &Transform) -> Matrix3<f64> {
        let [p, y, r] = t.rotation_deg.map(f64::to_radians);
        let (sp, cp, sy, cy, sr, cr) = (p.sin(), p.cos(), y.sin(), y.cos(), r.sin(), r.cos());
        Matrix3::new(
            cp * cy,
            cy * sp * sr - sy * cr,
            -cy * sp * cr - sy * sr,
            cp * sy,
            sy * sp * sr + cy * cr,
            -sy * sp * cr + cy * sr,
            sp,
            -cp * sr,
            cp * cr,
        )
    }

    #[test]
    fn there_and_back_is_the_same() {
        let mut rng = fastrand::Rng::with_seed(1);
        for _ in 0..10_000 {
            let t = random_transform(&mut rng);
            let again = transform(&pose(&t));
            for i in 0..3 {
                assert!(
                    (again.location_m[i] - t.location_m[i]).abs() < 1e-9,
                    "{t:?} {again:?}"
                );
                let turn = (again.rotation_deg[i] - t.rotation_deg[i]).rem_euclid(360.0);
                assert!(turn.min(360.0 - turn) < 1e-6, "{t:?} {again:?}");
            }
        }
    }

    #[test]
    fn points_move_alike_in_both_worlds() {
        let mut rng = fastrand::Rng::with_seed(2);
        for _ in 0..10_000 {
            let t = random_transform(&mut rng);
            let local = Vector3::new(rng.f64() * 9.0, rng.f64() * 9.0, rng.f64() * 9.0);
            let theirs = carla_matrix(&t) * local + Vector3::from(t.location_m);
            let ours =
                pose(&t).isometry() * nalgebra::Point3::from(Vector3::from(mirror(local.into())));
            assert!(
                (Vector3::from(mirror(ours.coords.into())) - theirs).norm() < 1e-8,
                "{t:?}"
            );
        }
    }

    #[test]
    fn the_wheels_own_check_value() {
        let forward = pose(&Transform {
            location_m: [0.0; 3],
            rotation_deg: [10.0, 20.0, 30.0],
        })
        .isometry()
        .rotation
            * Vector3::x();
        let forward = mirror(forward.into());
        for (is, wanted) in forward.into_iter().zip([0.925417, 0.336824, 0.173648]) {
            assert!((is - wanted).abs() < 1e-6, "{forward:?}");
        }
    }

    #[test]
    fn a_spinning_point_has_the_same_velocity_in_both_worlds() {
        let mut rng = fastrand::Rng::with_seed(3);
        for _ in 0..1000 {
            let mut v = || Vector3::new(rng.f64() - 0.5, rng.f64() - 0.5, rng.f64() - 0.5);
            let (spin, lever) = (v(), v());
            let theirs = Vector3::from(angular_velocity_deg(spin.into()).map(f64::to_radians))
                .cross(&Vector3::from(mirror(lever.into())));
            assert!((Vector3::from(mirror(spin.cross(&lever).into())) - theirs).norm() < 1e-12);
            let back = Vector3::from(angular_velocity_rad(angular_velocity_deg(spin.into())));
            assert!((back - spin).norm() < 1e-12);
        }
    }

    #[test]
    fn straight_up_is_still_a_rotation() {
        for pitch in [90.0, -90.0] {
            let t = Transform {
                location_m: [0.0; 3],
                rotation_deg: [pitch, 33.0, 0.0],
            };
            let again = transform(&pose(&t));
            assert!(
                (again.rotation_deg[0] - pitch).abs() < 1e-5
                    && (again.rotation_deg[1] - 33.0).abs() < 1e-5,
                "{again:?}"
            );
        }
    }

    #[test]
    fn turning_right_and_the_sun() {
        assert_eq!(steer(0.5), -0.5);
        assert_eq!(azimuth_deg(azimuth_deg(130.0)), 130.0);
        assert_eq!(azimuth_deg(-1e-9), 1e-9);
        assert_eq!(azimuth_deg(0.0), 0.0);
        let right = Pose::from_xyz_yaw(0.0, 0.0, 0.0, -0.5);
        assert!((transform(&right).rotation_deg[1] - 0.5f64.to_degrees()).abs() < 1e-12);
    }
}
