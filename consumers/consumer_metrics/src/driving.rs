//! A vehicle that a program drives: how far it came, what it hit, and how it felt.
//!
//! The driving score is that of the CARLA leaderboard 1.0: over drives, the mean of route
//! completion times a penalty, the product of 0.50 for each collision with a walker, 0.60 with a
//! vehicle and 0.65 with anything else, 0.70 for each red light run and 0.80 for each stop sign;
//! what was driven off the road does not count as completed.
//!
//! Velocities are differentiated by fitting a parabola to the samples about each moment (Savitzky
//! and Golay, 1964), once for acceleration and twice for jerk, and turned into the vehicle's frame.
//! A drive is comfortable if it keeps within the bounds of nuPlan (Caesar et al., 2021):
//! acceleration −4.05 to 2.40 m/s² along and 4.89 m/s² across, jerk 4.13 m/s³ along and 8.37 m/s³ in
//! all, yaw rate 0.95 rad/s and yaw acceleration 1.93 rad/s².
//!
//! The time to collision (Hayward, 1972) is how long two bodies need to touch if both keep their
//! velocity and heading; bodies are rectangles seen from above.

mod contact;
mod drive;
mod smoothing;

use std::collections::BTreeMap;

use consumer_report::interval::quantile;
use serde::Serialize;

use crate::numbers::{existing, mean, share};
pub use contact::{Body, time_to_collision_secs};
pub use drive::{CollisionWith, Drive, Infraction};
use smoothing::derivative;

/// What is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Times to collision below this are critical, seconds.
    pub ttc_limit_secs: f64,
    /// Length of the window in which velocities are differentiated, seconds.
    pub smooth_secs: f64,
}

impl Default for Settings {
    /// 1.5 s for both; the window is that of nuPlan's jerk.
    fn default() -> Self {
        Self {
            ttc_limit_secs: 1.5,
            smooth_secs: 1.5,
        }
    }
}

/// Keeps what drives were like: 32 bytes for each moment.
#[derive(Clone, Debug)]
pub struct Collector {
    settings: Settings,
    sums: Sums,
    /// Sizes along and across, of each moment.
    jerks: [Vec<f64>; 2],
    accelerations: [Vec<f64>; 2],
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    n_drives: u64,
    score: f64,
    completion: f64,
    penalty: f64,
    driven_m: f64,
    n_collisions: [u64; 3],
    impulse_ns: Option<f64>,
    n_red_lights: u64,
    n_stop_signs: u64,
    min_ttc_secs: Option<f64>,
    n_critical: u64,
    n_moments: u64,
    n_comfortable: u64,
}

impl Collector {
    /// Nothing added yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            sums: Sums::default(),
            jerks: [Vec::new(), Vec::new()],
            accelerations: [Vec::new(), Vec::new()],
        }
    }

    /// Adds a drive that is over.
    pub fn add(&mut self, drive: &Drive) {
        let sums = &mut self.sums;
        sums.n_drives += 1;
        sums.score += drive.completion() * drive.penalty();
        sums.completion += drive.completion();
        sums.penalty += drive.penalty();
        sums.driven_m += drive.driven_m;
        for (sum, n) in sums.n_collisions.iter_mut().zip(drive.n_collisions) {
            *sum += n;
        }
        sums.impulse_ns = most(sums.impulse_ns, drive.impulse_ns);
        sums.n_red_lights += drive.n_red_lights;
        sums.n_stop_signs += drive.n_stop_signs;
        let shortest = drive.ttc_secs.iter().copied().fold(f64::INFINITY, f64::min);
        let shortest = Some(shortest).filter(|time| time.is_finite());
        sums.min_ttc_secs = least(sums.min_ttc_secs, shortest);
        let limit = self.settings.ttc_limit_secs;
        sums.n_critical += drive.ttc_secs.iter().filter(|&&time| time < limit).count() as u64;
        sums.n_moments += drive.ttc_secs.len() as u64;

        let window = self.settings.smooth_secs;
        let dt = drive.interval_secs;
        let [acceleration, jerk] = [1, 2].map(|order| {
            let in_world =
                [0, 1].map(|axis| derivative(&drive.velocities_mps[axis], dt, window, order));
            in_vehicle(&in_world, &drive.headings_rad)
        });
        let yaw_acceleration = derivative(&drive.yaw_rates_radps, dt, window, 1);
        let within = |values: &[f64], least: f64, most: f64| {
            values.iter().all(|value| (least..=most).contains(value))
        };
        let is_comfortable = within(&acceleration[0], -4.05, 2.40)
            && within(&acceleration[1], -4.89, 4.89)
            && within(&jerk[0], -4.13, 4.13)
            && jerk[0]
                .iter()
                .zip(&jerk[1])
                .all(|(x, y)| x.hypot(*y) <= 8.37)
            && within(&drive.yaw_rates_radps, -0.95, 0.95)
            && within(&yaw_acceleration, -1.93, 1.93);
        sums.n_comfortable += u64::from(is_comfortable);
        for (all, of_drive) in [
            (&mut self.accelerations, acceleration),
            (&mut self.jerks, jerk),
        ] {
            for (all, of_drive) in all.iter_mut().zip(of_drive) {
                all.extend(of_drive.iter().map(|value| value.abs()));
            }
        }
    }

    /// Adds another collector's drives.
    pub fn merge(&mut self, other: &Self) {
        let (mine, theirs) = (&mut self.sums, &other.sums);
        mine.n_drives += theirs.n_drives;
        mine.score += theirs.score;
        mine.completion += theirs.completion;
        mine.penalty += theirs.penalty;
        mine.driven_m += theirs.driven_m;
        for (mine, theirs) in mine.n_collisions.iter_mut().zip(theirs.n_collisions) {
            *mine += theirs;
        }
        mine.impulse_ns = most(mine.impulse_ns, theirs.impulse_ns);
        mine.n_red_lights += theirs.n_red_lights;
        mine.n_stop_signs += theirs.n_stop_signs;
        mine.min_ttc_secs = least(mine.min_ttc_secs, theirs.min_ttc_secs);
        mine.n_critical += theirs.n_critical;
        mine.n_moments += theirs.n_moments;
        mine.n_comfortable += theirs.n_comfortable;
        for axis in 0..2 {
            self.jerks[axis].extend(&other.jerks[axis]);
            self.accelerations[axis].extend(&other.accelerations[axis]);
        }
    }

    /// The figures of all that was added.
    #[must_use]
    pub fn scores(&self) -> Scores {
        let sums = &self.sums;
        let spread = |values: &[f64]| {
            let mut values = values.to_vec();
            Spread {
                p50: quantile(&mut values, 0.50),
                p95: quantile(&mut values, 0.95),
                max: quantile(&mut values, 1.0),
            }
        };
        let n_collisions: u64 = sums.n_collisions.iter().sum();
        Scores {
            driving_score: mean(sums.score, sums.n_drives),
            route_completion: mean(sums.completion, sums.n_drives),
            infraction_penalty: mean(sums.penalty, sums.n_drives),
            collisions_per_km: (sums.driven_m > 0.0)
                .then(|| 1000.0 * n_collisions as f64 / sums.driven_m),
            max_impulse_ns: sums.impulse_ns,
            jerk_longitudinal: spread(&self.jerks[0]),
            jerk_lateral: spread(&self.jerks[1]),
            acceleration_longitudinal: spread(&self.accelerations[0]),
            acceleration_lateral: spread(&self.accelerations[1]),
            min_ttc_secs: sums.min_ttc_secs,
            ttc_below_limit: share(sums.n_critical, sums.n_moments),
            ttc_limit_secs: self.settings.ttc_limit_secs,
            comfortable: share(sums.n_comfortable, sums.n_drives),
            n_drives: sums.n_drives,
            n_walker_collisions: sums.n_collisions[0],
            n_vehicle_collisions: sums.n_collisions[1],
            n_static_collisions: sums.n_collisions[2],
            n_red_lights: sums.n_red_lights,
            n_stop_signs: sums.n_stop_signs,
            driven_m: sums.driven_m,
        }
    }
}

fn most(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    a.into_iter().chain(b).reduce(f64::max)
}

fn least(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    a.into_iter().chain(b).reduce(f64::min)
}

/// Along and across the vehicle.
fn in_vehicle(in_world: &[Vec<f64>; 2], headings_rad: &[f64]) -> [Vec<f64>; 2] {
    let [east, north] = in_world;
    let turned = east
        .iter()
        .zip(north)
        .zip(headings_rad)
        .map(|((x, y), heading)| {
            let (sine, cosine) = heading.sin_cos();
            (x * cosine + y * sine, y * cosine - x * sine)
        });
    let (along, across) = turned.unzip();
    [along, across]
}

/// The figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scores {
    /// CARLA's, 0 to 1.
    pub driving_score: Option<f64>,
    /// Mean share of the routes that was completed on the road, 0 to 1.
    pub route_completion: Option<f64>,
    /// Mean penalty, 1 for none, towards 0 for many infractions.
    pub infraction_penalty: Option<f64>,
    /// Collisions for each kilometre that was driven.
    pub collisions_per_km: Option<f64>,
    /// The hardest collision, newton seconds; `None` without any.
    pub max_impulse_ns: Option<f64>,
    /// Size of the jerk along the vehicle, m/s³.
    pub jerk_longitudinal: Spread,
    /// Size of the jerk across the vehicle, m/s³.
    pub jerk_lateral: Spread,
    /// Size of the acceleration along the vehicle, m/s².
    pub acceleration_longitudinal: Spread,
    /// Size of the acceleration across the vehicle, m/s².
    pub acceleration_lateral: Spread,
    /// The shortest time to collision, seconds; `None` if nothing was ever on course.
    pub min_ttc_secs: Option<f64>,
    /// Share of moments whose time to collision is below the limit, 0 to 1.
    pub ttc_below_limit: Option<f64>,
    /// The limit of the settings, seconds.
    pub ttc_limit_secs: f64,
    /// Share of drives within nuPlan's bounds of comfort, 0 to 1.
    pub comfortable: Option<f64>,
    /// Drives.
    pub n_drives: u64,
    /// Collisions with walkers.
    pub n_walker_collisions: u64,
    /// Collisions with vehicles.
    pub n_vehicle_collisions: u64,
    /// Collisions with anything else.
    pub n_static_collisions: u64,
    /// Red lights that were run.
    pub n_red_lights: u64,
    /// Stop signs that were run.
    pub n_stop_signs: u64,
    /// Path of all drives, metres.
    pub driven_m: f64,
}

/// How large something was over time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Half of the time it was less.
    pub p50: Option<f64>,
    /// 95 % of the time it was less.
    pub p95: Option<f64>,
    /// Largest.
    pub max: Option<f64>,
}

impl Scores {
    /// The figures that exist: `driving_score`, `route_completion`, `infraction_penalty`,
    /// `collisions`, `collisions_per_km`, `impulse_max`, `jerk_lon_p50`, `_p95`, `_max`, the same of
    /// `jerk_lat`, `acc_lon` and `acc_lat`, `ttc_min`, `ttc_below_1.5s`, `comfortable`,
    /// `red_lights` and `stop_signs`.
    #[must_use]
    pub fn named(&self) -> BTreeMap<String, f64> {
        let count = |n: u64| share(n, 1).filter(|_| self.n_drives > 0);
        let collisions =
            self.n_walker_collisions + self.n_vehicle_collisions + self.n_static_collisions;
        let mut named = existing([
            ("driving_score", self.driving_score),
            ("route_completion", self.route_completion),
            ("infraction_penalty", self.infraction_penalty),
            ("collisions", count(collisions)),
            ("collisions_per_km", self.collisions_per_km),
            ("impulse_max", self.max_impulse_ns),
            ("ttc_min", self.min_ttc_secs),
            ("comfortable", self.comfortable),
            ("red_lights", count(self.n_red_lights)),
            ("stop_signs", count(self.n_stop_signs)),
        ]);
        let below = format!("ttc_below_{}s", self.ttc_limit_secs);
        named.extend(existing([(below, self.ttc_below_limit)]));
        for (name, spread) in [
            ("jerk_lon", self.jerk_longitudinal),
            ("jerk_lat", self.jerk_lateral),
            ("acc_lon", self.acceleration_longitudinal),
            ("acc_lat", self.acceleration_lateral),
        ] {
            named.extend(existing([
                (format!("{name}_p50"), spread.p50),
                (format!("{name}_p95"), spread.p95),
                (format!("{name}_max"), spread.max),
            ]));
        }
        named
    }
}

#[cfg(test)]
mod tests;
