//! The Intelligent Driver Model (Treiber, Hennecke, Helbing 2000): the acceleration of a vehicle on a
//! free road and behind another one. `docs/explanation/traffic.md` has its formulas and parameters.

/// Acceleration from standstill on a free road, a, m/s².
pub const MAX_ACCEL_MPS2: f64 = 2.7;
/// Deceleration that is comfortable, b, m/s².
pub const COMFORT_BRAKE_MPS2: f64 = 2.0;
/// Time gap to the vehicle ahead, T, seconds.
pub const TIME_GAP_SECS: f64 = 1.2;
/// Exponent of the free-road term, δ.
pub const EXPONENT: i32 = 4;

/// The parameters that differ between vehicles and places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Idm {
    /// Speed on a free road, v₀, m/s.
    pub desired_mps: f64,
    /// Gap to a vehicle ahead in standstill, s₀, metres.
    pub standing_gap_m: f64,
}

/// A vehicle ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leader {
    /// Gap between its rear and our front, s, metres.
    pub gap_m: f64,
    /// Its speed, m/s.
    pub speed_mps: f64,
}

impl Idm {
    /// Acceleration on a free road, m/s². Above the desired speed it is the free term of Treiber and
    /// Kesting's improved model, which never brakes harder than comfort.
    pub fn free_accel(&self, speed_mps: f64) -> f64 {
        let (v, wanted) = (speed_mps.max(0.0), self.desired_mps);
        if v <= wanted {
            let share = v / wanted.max(1e-3);
            return MAX_ACCEL_MPS2 * (1.0 - share.powi(EXPONENT));
        }
        let exponent = MAX_ACCEL_MPS2 * f64::from(EXPONENT) / COMFORT_BRAKE_MPS2;
        -COMFORT_BRAKE_MPS2 * (1.0 - (wanted.max(0.0) / v).powf(exponent))
    }

    /// Gap that is wanted behind a vehicle with this speed, s*, metres.
    pub fn desired_gap_m(&self, speed_mps: f64, their_mps: f64) -> f64 {
        let closing = speed_mps - their_mps;
        let braking = speed_mps * closing / (2.0 * (MAX_ACCEL_MPS2 * COMFORT_BRAKE_MPS2).sqrt());
        self.standing_gap_m + (speed_mps * TIME_GAP_SECS + braking).max(0.0)
    }

    /// Acceleration with a vehicle ahead or none, m/s².
    pub fn accel(&self, speed_mps: f64, leader: Option<Leader>) -> f64 {
        let interaction = leader.map_or(0.0, |leader| {
            let wanted = self.desired_gap_m(speed_mps, leader.speed_mps);
            (wanted / leader.gap_m.max(0.1)).powi(2)
        });
        self.free_accel(speed_mps) - MAX_ACCEL_MPS2 * interaction
    }

    /// Gap that is kept behind a vehicle that drives as fast as ours, metres; infinite at the
    /// desired speed.
    pub fn equilibrium_gap_m(&self, speed_mps: f64) -> f64 {
        let free = 1.0 - (speed_mps / self.desired_mps.max(1e-3)).powi(EXPONENT);
        self.desired_gap_m(speed_mps, speed_mps) / free.max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROAD: Idm = Idm {
        desired_mps: 30.0,
        standing_gap_m: 2.0,
    };

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-4, "{a} is not {b}");
    }

    /// 2.7·(1 − (v/30)⁴) at rest, at half and at the whole of 30 m/s.
    #[test]
    fn the_free_road_term_falls_with_the_fourth_power() {
        near(ROAD.free_accel(0.0), 2.7);
        near(ROAD.free_accel(15.0), 2.7 * 15.0 / 16.0);
        near(ROAD.free_accel(30.0), 0.0);
        // Twice the desired speed: −2·(1 − 0.5^5.4).
        near(ROAD.free_accel(60.0), -1.952_634);
        let parked = Idm {
            desired_mps: 0.0,
            ..ROAD
        };
        near(parked.free_accel(5.0), -2.0);
    }

    /// s* = 2 + 20·1.2 + 20·5/(2·√(2.7·2)) = 47.51658 m; a = 2.7·(1 − (20/30)⁴ − (s*/40)²).
    #[test]
    fn acceleration_behind_a_slower_vehicle_is_that_of_the_formula() {
        near(ROAD.desired_gap_m(20.0, 15.0), 47.516_574);
        let leader = Leader {
            gap_m: 40.0,
            speed_mps: 15.0,
        };
        near(ROAD.accel(20.0, Some(leader)), -1.643_413);
        // A leader that drives away asks for the standing gap only: 2 m of 4.
        let away = Leader {
            gap_m: 4.0,
            speed_mps: 40.0,
        };
        near(ROAD.desired_gap_m(20.0, 40.0), 2.0);
        near(
            ROAD.accel(20.0, Some(away)),
            2.7 * (1.0 - 16.0 / 81.0 - 0.25),
        );
    }

    /// (2 + 15·1.2)/√(1 − 1/16) = 20.65591 m, where the acceleration is zero.
    #[test]
    fn a_follower_comes_to_the_equilibrium_gap() {
        near(ROAD.equilibrium_gap_m(15.0), 20.655_911);
        let (mut v, mut gap, dt) = (20.0, 60.0, 0.01);
        for _ in 0..12_000 {
            let leader = Leader {
                gap_m: gap,
                speed_mps: 15.0,
            };
            v += ROAD.accel(v, Some(leader)) * dt;
            gap += (15.0 - v) * dt;
        }
        assert!((gap - 20.655_911).abs() < 0.01, "{gap}");
    }
}
