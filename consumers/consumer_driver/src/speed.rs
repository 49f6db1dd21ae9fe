//! Longitudinal control: the acceleration that the road, lights and other traffic allow, and the
//! pedals for it.

use crate::idm::{COMFORT_BRAKE_MPS2, Idm, Leader, MAX_ACCEL_MPS2};

/// Hardest braking, m/s².
const MAX_BRAKE_MPS2: f64 = 8.0;
/// Gap between the front and a stop line, metres.
const LINE_GAP_M: f64 = 1.0;
/// Acceleration that full throttle is assumed to give at low speed, m/s²; the integral corrects the
/// rest.
const FULL_THROTTLE_MPS2: f64 = 4.5;
/// Deceleration that full brake is assumed to give, m/s².
const FULL_BRAKE_MPS2: f64 = 9.0;

/// Acceleration that reaches `limit_mps` after `distance_m`: unrestricted until braking is due,
/// then the braking that is needed.
pub fn ahead(speed_mps: f64, limit_mps: f64, distance_m: f64) -> f64 {
    let needed = (limit_mps * limit_mps - speed_mps * speed_mps) / (2.0 * distance_m.max(0.3));
    if needed >= 0.0 {
        return MAX_ACCEL_MPS2;
    }
    if needed <= -COMFORT_BRAKE_MPS2 {
        return needed.max(-MAX_BRAKE_MPS2);
    }
    MAX_ACCEL_MPS2 + needed / COMFORT_BRAKE_MPS2 * (MAX_ACCEL_MPS2 + COMFORT_BRAKE_MPS2)
}

/// Acceleration that stops a metre before a line `distance_m` ahead, and holds there.
pub fn stop_before(speed_mps: f64, distance_m: f64) -> f64 {
    let left = distance_m - LINE_GAP_M;
    if left < 0.4 && speed_mps < 1.5 {
        return to_stop(speed_mps, left.max(0.15)).clamp(-MAX_BRAKE_MPS2, -1.2);
    }
    ahead(speed_mps, 0.0, left)
}

/// Deceleration needed to stand after `distance_m`, m/s² (negative).
pub fn to_stop(speed_mps: f64, distance_m: f64) -> f64 {
    -speed_mps * speed_mps / (2.0 * distance_m.max(0.05))
}

/// Acceleration behind a vehicle: the Intelligent Driver Model, and the deceleration that is
/// physically needed where the model brakes too late.
pub fn follow(speed_mps: f64, idm: &Idm, leader: Leader) -> f64 {
    let gap_m = leader.gap_m;
    if gap_m < 0.3 * idm.standing_gap_m {
        return -MAX_BRAKE_MPS2;
    }
    let model = idm.accel(speed_mps, Some(leader));
    let their_stop = leader.speed_mps.max(0.0).powi(2) / (2.0 * MAX_BRAKE_MPS2);
    let hard = to_stop(speed_mps, gap_m - 0.6 * idm.standing_gap_m + their_stop);
    let braking = if hard < -COMFORT_BRAKE_MPS2 && speed_mps > leader.speed_mps {
        model.min(hard)
    } else {
        model
    };
    braking.clamp(-MAX_BRAKE_MPS2, MAX_ACCEL_MPS2)
}

/// Time for a distance with this acceleration up to a speed, seconds.
pub fn travel_secs(distance_m: f64, speed_mps: f64, most_mps: f64, accel_mps2: f64) -> f64 {
    if distance_m <= 0.0 {
        return 0.0;
    }
    let (v, most) = (speed_mps.max(0.0), most_mps.max(1.0));
    if v >= most {
        return distance_m / most;
    }
    let run_m = (most * most - v * v) / (2.0 * accel_mps2);
    if distance_m <= run_m {
        ((v * v + 2.0 * accel_mps2 * distance_m).sqrt() - v) / accel_mps2
    } else {
        (most - v) / accel_mps2 + (distance_m - run_m) / most
    }
}

/// A vehicle slower than this is braked against its idling engine, m/s, with this share of the
/// brake.
const CREEP_MPS: f64 = 1.2;
const CREEP_BRAKE: f64 = 0.15;
/// Sideways acceleration on bends, m/s².
const BEND_MPS2: f64 = 2.8;

/// Largest speed on a bend, m/s.
pub fn on_bend(curvature_per_m: f64) -> f64 {
    (BEND_MPS2 / curvature_per_m.abs().max(1e-4))
        .sqrt()
        .max(2.0)
}

/// How far the pedals are pressed, 0..=1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pressed {
    /// Throttle.
    pub throttle_ratio: f64,
    /// Brake.
    pub brake_ratio: f64,
}

impl Pressed {
    fn brake(brake_ratio: f64) -> Pressed {
        Pressed {
            throttle_ratio: 0.0,
            brake_ratio,
        }
    }

    fn throttle(throttle_ratio: f64) -> Pressed {
        Pressed {
            throttle_ratio,
            brake_ratio: 0.0,
        }
    }
}

/// The pedals of one vehicle.
#[derive(Clone, Debug, Default)]
pub struct Pedals {
    trim_mps2: f64,
    last_speed_mps: Option<f64>,
    accel_mps2: f64,
    last_wanted_mps2: f64,
}

impl Pedals {
    /// Throttle and brake for an acceleration. The brake holds a vehicle that stands and shall not
    /// move.
    pub fn press(&mut self, speed_mps: f64, wanted_mps2: f64, period_secs: f64) -> Pressed {
        let measured = self
            .last_speed_mps
            .map_or(0.0, |last| (speed_mps - last) / period_secs);
        self.last_speed_mps = Some(speed_mps);
        self.accel_mps2 += (measured - self.accel_mps2) * (period_secs / 0.15).min(1.0);
        if wanted_mps2 <= 0.05 && speed_mps.abs() < 0.3 {
            self.trim_mps2 = 0.0;
            self.last_wanted_mps2 = 0.0;
            return Pressed::brake(0.6);
        }
        // Who rolls backwards stops first.
        if speed_mps < -0.4 || speed_mps < -0.1 && wanted_mps2 < 0.3 {
            return Pressed::brake(0.8);
        }
        // The vehicle responds with a delay. Comparing with a delayed command keeps the trim from
        // reacting to steps.
        let error = self.last_wanted_mps2 - self.accel_mps2;
        self.last_wanted_mps2 +=
            (wanted_mps2 - self.last_wanted_mps2) * (period_secs / 0.25).min(1.0);
        self.trim_mps2 = (self.trim_mps2 + 0.6 * error * period_secs).clamp(-1.5, 3.0);
        let drag = 0.15 + 0.0006 * speed_mps * speed_mps;
        let force = wanted_mps2 + drag + self.trim_mps2;
        if force >= 0.0 && wanted_mps2 > -0.8 {
            Pressed::throttle((force / FULL_THROTTLE_MPS2).clamp(0.0, 0.9))
        } else {
            // Rolling resistance and the engine provide the first few tenths of m/s² by themselves,
            // but an idling engine pushes a slow vehicle on.
            let creeps = speed_mps < CREEP_MPS && wanted_mps2 < -0.3;
            let least = if creeps { CREEP_BRAKE } else { 0.0 };
            let brake = -(wanted_mps2 + 0.2) / FULL_BRAKE_MPS2;
            Pressed::brake(brake.clamp(least, 1.0))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CITY: Idm = Idm {
        desired_mps: 14.0,
        standing_gap_m: 2.2,
    };

    #[test]
    fn braking_for_a_line_ends_before_it() {
        let (mut v, mut x, dt) = (14.0, 0.0, 0.05);
        let mut hardest: f64 = 0.0;
        for _ in 0..2000 {
            let a = stop_before(v, 60.0 - x).min(CITY.free_accel(v));
            hardest = hardest.min(a);
            v = f64::max(v + a * dt, 0.0);
            x += v * dt;
        }
        assert!((57.5..59.5).contains(&x), "{x}");
        assert!(hardest > -3.5, "{hardest}");
    }

    #[test]
    fn a_follower_keeps_its_gap_behind_a_slower_one() {
        let (mut v, mut x, mut leader, dt) = (14.0, 0.0, 40.0, 0.05);
        for _ in 0..2000 {
            leader += 5.0 * dt;
            let ahead = Leader {
                gap_m: leader - x,
                speed_mps: 5.0,
            };
            let a = follow(v, &CITY, ahead);
            v = f64::max(v + a * dt, 0.0);
            x += v * dt;
            assert!(leader - x > 2.0, "{}", leader - x);
        }
        assert!(
            (v - 5.0).abs() < 0.1 && (5.0..12.0).contains(&(leader - x)),
            "{v} {}",
            leader - x
        );
    }

    #[test]
    fn travel_times_are_those_of_uniform_acceleration() {
        // From rest at 2 m/s²: 9 m take 3 s; up to 4 m/s in 2 s and 4 m, then 8 m in 2 s.
        assert!((travel_secs(9.0, 0.0, 100.0, 2.0) - 3.0).abs() < 1e-9);
        assert!((travel_secs(12.0, 0.0, 4.0, 2.0) - 4.0).abs() < 1e-9);
        assert_eq!(travel_secs(-1.0, 3.0, 4.0, 2.0), 0.0);
    }
}
