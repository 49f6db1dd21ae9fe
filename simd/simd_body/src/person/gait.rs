//! How a body holds its limbs: a walking and running cycle from phase and speed, seated, in the
//! air, lying.
//!
//! Angles follow the textbook curves of human gait: the foot is on the ground for 60 % of a walking
//! cycle, the knee bends by about 60° in the swing, arms swing against the legs. The pelvis is put
//! where the lowest sole just touches the ground.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Joint heights and offsets, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skeleton {
    /// From the sole to the crown.
    pub height_m: f64,
    /// Hip joints over the ground.
    pub hip_m: f64,
    /// Half the distance between the hip joints.
    pub hip_half_m: f64,
    /// Knees over the ground.
    pub knee_m: f64,
    /// Ankles over the ground.
    pub ankle_m: f64,
    /// Shoulder joints over the ground.
    pub shoulder_m: f64,
    /// Half the distance between the shoulder joints.
    pub shoulder_half_m: f64,
    /// Shoulder to elbow.
    pub upper_arm_m: f64,
    /// Elbow to wrist.
    pub forearm_m: f64,
    /// Base of the neck over the ground.
    pub neck_m: f64,
    /// Behind the ankle to the heel.
    pub heel_m: f64,
    /// From the ankle to the tip of the toes.
    pub toe_m: f64,
}

/// Number of parts of a body.
pub const N_PARTS: usize = 12;

/// Parts by their number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Pelvis to shoulders.
    Torso = 0,
    /// Head.
    Head = 1,
    /// Upper arm, left.
    UpperArmLeft = 2,
    /// Upper arm, right.
    UpperArmRight = 3,
    /// Forearm and hand, left.
    ForearmLeft = 4,
    /// Forearm and hand, right.
    ForearmRight = 5,
    /// Thigh, left.
    ThighLeft = 6,
    /// Thigh, right.
    ThighRight = 7,
    /// Shin, left.
    ShinLeft = 8,
    /// Shin, right.
    ShinRight = 9,
    /// Foot, left.
    FootLeft = 10,
    /// Foot, right.
    FootRight = 11,
}

/// Posture of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Posture {
    /// Stands, walks or runs, depending on phase and speed.
    Upright {
        /// Phase of the cycle, radians; at 0 the left heel meets the ground.
        phase_rad: f64,
        /// Speed over ground, m/s.
        speed_mps: f64,
    },
    /// Feet off the ground.
    Airborne,
    /// Sits in a chair.
    Seated,
    /// Lies limp.
    Lying,
}

/// Length of a cycle (two steps) at a speed: grows with the square root of the speed and, by
/// dynamic similarity, with the leg.
pub fn stride_m(leg_m: f64, speed_mps: f64) -> f64 {
    1.25 * (leg_m / 0.93).powf(0.75) * speed_mps.max(0.16).sqrt()
}

/// Angles of one side, radians: flexion of hip, knee, shoulder, elbow, and the sole's pitch (toes
/// down is positive).
#[derive(Clone, Copy, Debug, Default)]
struct Side {
    hip: f64,
    knee: f64,
    sole: f64,
    shoulder: f64,
    elbow: f64,
}

/// A bump of height 1 about `middle` of the cycle, wrapped.
fn bump(share: f64, middle: f64, width: f64) -> f64 {
    let away = (share - middle + 0.5).rem_euclid(1.0) - 0.5;
    (-(away / width).powi(2)).exp()
}

fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

impl Skeleton {
    /// Length of the leg.
    pub fn leg_m(&self) -> f64 {
        self.hip_m - self.ankle_m
    }

    /// Length of a cycle at a speed, metres.
    pub fn stride_m(&self, speed_mps: f64) -> f64 {
        stride_m(self.leg_m(), speed_mps)
    }

    fn walking(&self, share: f64, speed_mps: f64) -> Side {
        let run = smooth((speed_mps - 1.8) / 1.0);
        // The gait fades in from standing to a slow walk.
        let on = smooth(speed_mps / 0.35);
        let stance = 0.60 - 0.22 * run;
        let share = share.rem_euclid(1.0);
        // The hip is furthest back a little before the toes leave the ground.
        let back = stance - 0.06;
        let angle = if share < back {
            PI * share / back
        } else {
            PI + PI * (share - back) / (1.0 - back)
        };
        // With this swing the foot goes back under the body, over the middle of the stance, as fast
        // as the body goes forward.
        let reach = (1.08 * back * self.stride_m(speed_mps) / (PI * self.leg_m())).min(0.75);
        let deg = |x: f64| x.to_radians();
        let pace = (speed_mps / 1.4).clamp(0.3, 1.6).sqrt();
        let mid_swing = 0.5 * (1.0 + stance);
        let loading = deg(12.0 + 14.0 * run) * pace * bump(share, 0.5 * stance - 0.1, 0.09);
        let knee = deg(4.0)
            + loading
            + deg(56.0 + 34.0 * run) * pace.min(1.1) * bump(share, mid_swing - 0.07, 0.12);
        let sole = deg(30.0) * pace * bump(share, stance + 0.01, 0.07)
            - deg(16.0) * (1.0 - run) * pace * bump(share, 0.985, 0.045)
            + deg(22.0) * bump(share, mid_swing - 0.08, 0.09);
        Side {
            // Half of the knee's bend under load is compensated at the hip, so that the foot stays
            // in place.
            hip: on * (deg(4.0 + 6.0 * run) + reach * angle.cos() + 0.5 * loading),
            knee: on * knee,
            sole: on * sole,
            shoulder: deg(2.0) - on * 0.85 * reach * angle.cos(),
            elbow: deg(8.0) + on * (deg(8.0 + 66.0 * run) - deg(6.0) * angle.cos()),
        }
    }

    /// Pose of every part, about its own joint, in the body's space: origin on the ground between
    /// the feet, x forward, y left, z up.
    pub fn parts(&self, posture: Posture) -> [Isometry3<f64>; N_PARTS] {
        let deg = |x: f64| x.to_radians();
        let (sides, lean, seat_m) = match posture {
            Posture::Upright {
                phase_rad,
                speed_mps,
            } => {
                let share = phase_rad / TAU;
                let lean =
                    deg(1.5) * smooth(speed_mps / 1.4) + deg(7.0) * smooth((speed_mps - 1.8) / 1.5);
                (
                    [
                        self.walking(share, speed_mps),
                        self.walking(share + 0.5, speed_mps),
                    ],
                    lean,
                    None,
                )
            }
            Posture::Airborne => {
                let side = Side {
                    hip: deg(28.0),
                    knee: deg(48.0),
                    sole: deg(18.0),
                    shoulder: deg(30.0),
                    elbow: deg(35.0),
                };
                (
                    [
                        side,
                        Side {
                            hip: deg(14.0),
                            knee: deg(30.0),
                            ..side
                        },
                    ],
                    deg(4.0),
                    None,
                )
            }
            Posture::Seated => {
                let side = Side {
                    hip: deg(86.0),
                    knee: deg(78.0),
                    sole: 0.0,
                    shoulder: deg(22.0),
                    elbow: deg(48.0),
                };
                ([side; 2], 0.0, Some(0.52))
            }
            Posture::Lying => {
                let side = Side {
                    hip: deg(6.0),
                    knee: deg(14.0),
                    sole: deg(25.0),
                    shoulder: deg(28.0),
                    elbow: deg(40.0),
                };
                (
                    [
                        side,
                        Side {
                            hip: deg(22.0),
                            knee: deg(48.0),
                            shoulder: deg(-12.0),
                            ..side
                        },
                    ],
                    0.0,
                    Some(self.hip_m),
                )
            }
        };
        self.assemble(&sides, lean, seat_m)
    }

    fn assemble(
        &self,
        sides: &[Side; 2],
        lean: f64,
        seat_m: Option<f64>,
    ) -> [Isometry3<f64>; N_PARTS] {
        let about_y = |angle: f64| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
        let about_x = |angle: f64| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle);
        let place = |x: f64, y: f64, z: f64, turn: UnitQuaternion<f64>| {
            Isometry3::from_parts(Translation3::new(x, y, z), turn)
        };
        let mut parts = [Isometry3::identity(); N_PARTS];
        parts[Part::Torso as usize] = place(0.0, 0.0, 0.0, about_y(lean));
        let torso = parts[Part::Torso as usize];
        parts[Part::Head as usize] =
            torso * place(0.0, 0.0, self.neck_m - self.hip_m, about_y(-0.7 * lean));
        for (i, side) in sides.iter().enumerate() {
            let left = if i == 0 { 1.0 } else { -1.0 };
            let shoulder = place(
                0.0,
                left * self.shoulder_half_m,
                self.shoulder_m - self.hip_m,
                about_y(-side.shoulder),
            );
            let upper_arm = torso * shoulder;
            let forearm = upper_arm * place(0.0, 0.0, -self.upper_arm_m, about_y(-side.elbow));
            // The legs hang from the pelvis and take no part in the lean; the feet come a little
            // together when walking fast.
            let thigh = place(
                0.0,
                left * self.hip_half_m,
                0.0,
                about_y(-side.hip) * about_x(left * -0.01),
            );
            let shin = thigh * place(0.0, 0.0, self.knee_m - self.hip_m, about_y(side.knee));
            let ankle = shin * Isometry3::translation(0.0, 0.0, self.ankle_m - self.knee_m);
            let foot = Isometry3::from_parts(ankle.translation, about_y(side.sole));
            let part = |first: Part| first as usize + i;
            parts[part(Part::UpperArmLeft)] = upper_arm;
            parts[part(Part::ForearmLeft)] = forearm;
            parts[part(Part::ThighLeft)] = thigh;
            parts[part(Part::ShinLeft)] = shin;
            parts[part(Part::FootLeft)] = foot;
        }
        let lowest =
            [Part::FootLeft, Part::FootRight].map(|foot| self.lowest_m(&parts[foot as usize]));
        let pelvis_m = seat_m.unwrap_or(-lowest[0].min(lowest[1]));
        parts.map(|part| Translation3::new(0.0, 0.0, pelvis_m) * part)
    }

    /// Height of the lowest point of a sole.
    fn lowest_m(&self, foot: &Isometry3<f64>) -> f64 {
        let down = |x: f64| (foot * nalgebra::Point3::new(x, 0.0, -self.ankle_m)).z;
        down(-self.heel_m).min(down(self.toe_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::person::{Age, PersonShape};

    #[test]
    fn soles_meet_the_ground_and_knees_never_bend_forwards() {
        for age in [Age::Child, Age::Adult] {
            let skeleton = PersonShape::plain(age, 1.86).skeleton();
            for speed_mps in [0.0, 0.3, 1.0, 1.4, 2.0, 3.5, 6.0] {
                for k in 0..64 {
                    let phase_rad = TAU * k as f64 / 64.0;
                    let parts = skeleton.parts(Posture::Upright {
                        phase_rad,
                        speed_mps,
                    });
                    let soles = [Part::FootLeft, Part::FootRight]
                        .map(|foot| skeleton.lowest_m(&parts[foot as usize]));
                    assert!(soles[0].min(soles[1]).abs() < 1e-9, "{soles:?}");
                    for (thigh, shin) in [
                        (Part::ThighLeft, Part::ShinLeft),
                        (Part::ThighRight, Part::ShinRight),
                    ] {
                        let bend = parts[thigh as usize].rotation.inverse()
                            * parts[shin as usize].rotation;
                        let knee = bend.euler_angles().1;
                        assert!((-1e-9..2.1).contains(&knee), "{speed_mps} m/s: {knee}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_standing_foot_goes_back_as_fast_as_the_body_goes_forward() {
        let skeleton = PersonShape::plain(Age::Adult, 1.8).skeleton();
        for speed_mps in [0.8, 1.4, 1.8] {
            let stride_m = skeleton.stride_m(speed_mps);
            let x_at = |share: f64| {
                skeleton.parts(Posture::Upright {
                    phase_rad: TAU * share,
                    speed_mps,
                })[Part::FootLeft as usize]
                    .translation
                    .x
            };
            // Middle half of the stance, over which the foot must keep its place on the ground to a
            // few centimetres.
            let (from, to) = (0.13, 0.43);
            let back_m = x_at(from) - x_at(to);
            let forward_m = (to - from) * stride_m;
            assert!(
                (back_m - forward_m).abs() < 0.12 * forward_m,
                "{speed_mps} m/s: {back_m} {forward_m}"
            );
        }
    }

    #[test]
    fn stride_and_cadence_are_those_of_people() {
        // Grown people walk at 1.4 m/s with strides of 1.4 to 1.6 m, about 110 to 120 steps a
        // minute.
        let stride = stride_m(0.9, 1.4);
        assert!((1.35..1.6).contains(&stride), "{stride}");
        let steps_per_minute = 2.0 * 60.0 * 1.4 / stride;
        assert!(
            (100.0..125.0).contains(&steps_per_minute),
            "{steps_per_minute}"
        );
    }
}
