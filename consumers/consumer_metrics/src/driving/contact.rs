//! When two bodies touch.

/// A body seen from above, in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Centre of its box, metres.
    pub centre_m: [f64; 2],
    /// Which way it points, from x towards y.
    pub heading_rad: f64,
    /// Its velocity, m/s.
    pub velocity_mps: [f64; 2],
    /// Half of its length and half of its width, metres.
    pub half_m: [f64; 2],
}

impl Body {
    /// Unit vectors along and across.
    fn axes(&self) -> [[f64; 2]; 2] {
        let (sine, cosine) = self.heading_rad.sin_cos();
        [[cosine, sine], [-sine, cosine]]
    }

    /// How far it reaches from its centre in a direction.
    fn reach(&self, direction: [f64; 2]) -> f64 {
        let [along, across] = self.axes();
        self.half_m[0] * dot(along, direction).abs() + self.half_m[1] * dot(across, direction).abs()
    }
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// How long until two bodies touch if both keep velocity and heading, seconds; 0 if they overlap,
/// `None` if they never do or if a number is not finite.
#[must_use]
pub fn time_to_collision_secs(ego: &Body, other: &Body) -> Option<f64> {
    let between = |a: [f64; 2], b: [f64; 2]| [b[0] - a[0], b[1] - a[1]];
    let offset = between(ego.centre_m, other.centre_m);
    let approach = between(ego.velocity_mps, other.velocity_mps);
    // Rectangles overlap while their shadows do on the axes of both.
    let (mut begin, mut end) = (0.0_f64, f64::INFINITY);
    for axis in ego.axes().into_iter().chain(other.axes()) {
        let reach = ego.reach(axis) + other.reach(axis);
        let (at, speed) = (dot(offset, axis), dot(approach, axis));
        if !(reach.is_finite() && at.is_finite() && speed.is_finite()) {
            return None;
        }
        if speed == 0.0 {
            if at.abs() > reach {
                return None;
            }
            continue;
        }
        let (first, second) = ((-reach - at) / speed, (reach - at) / speed);
        begin = begin.max(first.min(second));
        end = end.min(first.max(second));
    }
    (begin <= end).then_some(begin)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAR: Body = Body {
        centre_m: [0.0, 0.0],
        heading_rad: 0.0,
        velocity_mps: [10.0, 0.0],
        half_m: [2.0, 1.0],
    };

    #[test]
    fn the_gap_over_the_speed() {
        let parked = Body {
            centre_m: [24.0, 1.5],
            velocity_mps: [0.0, 0.0],
            ..CAR
        };
        assert_eq!(time_to_collision_secs(&CAR, &parked), Some(2.0));
        // Beside the lane, behind, and going as fast.
        let beside = Body {
            centre_m: [24.0, 2.5],
            ..parked
        };
        let behind = Body {
            centre_m: [-24.0, 0.0],
            ..parked
        };
        let ahead = Body {
            velocity_mps: [10.0, 0.0],
            ..parked
        };
        for other in [beside, behind, ahead] {
            assert_eq!(time_to_collision_secs(&CAR, &other), None);
        }
        let inside = Body {
            centre_m: [3.0, 0.0],
            ..parked
        };
        assert_eq!(time_to_collision_secs(&CAR, &inside), Some(0.0));
        let unknown = Body {
            heading_rad: f64::NAN,
            ..parked
        };
        assert_eq!(time_to_collision_secs(&CAR, &unknown), None);
    }

    #[test]
    fn a_corner_comes_first() {
        // A square turned by 45 degrees reaches half its diagonal.
        let diamond = Body {
            centre_m: [20.0, 0.0],
            heading_rad: std::f64::consts::FRAC_PI_4,
            velocity_mps: [0.0, 0.0],
            half_m: [1.0, 1.0],
        };
        let time = time_to_collision_secs(&CAR, &diamond).unwrap();
        assert!((time - (20.0 - 2.0 - 2.0_f64.sqrt()) / 10.0).abs() < 1e-12);
    }

    #[test]
    fn no_moment_before_shows_an_overlap() {
        // Against small steps in time, with the corners of one rectangle inside the other.
        let mut random = fastrand::Rng::with_seed(3);
        let mut n_hits = 0;
        for _ in 0..300 {
            let mut body = |far: f64| Body {
                centre_m: [far * (random.f64() - 0.5), far * (random.f64() - 0.5)],
                heading_rad: 7.0 * random.f64(),
                velocity_mps: [20.0 * (random.f64() - 0.5), 20.0 * (random.f64() - 0.5)],
                half_m: [1.0 + random.f64(), 0.5 + random.f64()],
            };
            let (ego, other) = (body(1.0), body(40.0));
            let at = |body: &Body, time: f64| Body {
                centre_m: [0, 1].map(|i| body.centre_m[i] + time * body.velocity_mps[i]),
                velocity_mps: [0.0; 2],
                ..*body
            };
            let overlap =
                |time: f64| time_to_collision_secs(&at(&ego, time), &at(&other, time)).is_some();
            match time_to_collision_secs(&ego, &other) {
                Some(time) => {
                    n_hits += 1;
                    assert!(overlap(time + 1e-9));
                    assert!(
                        (0..100)
                            .all(|step| !overlap(time * f64::from(step) / 100.0 - 1e-9)
                                || time == 0.0)
                    );
                }
                None => assert!((0..1000).all(|step| !overlap(f64::from(step) * 0.01))),
            }
        }
        assert!(n_hits > 20, "{n_hits}");
    }
}
