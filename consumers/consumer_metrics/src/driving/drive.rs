//! A drive, moment by moment.

use super::contact::{Body, time_to_collision_secs};

/// What was hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CollisionWith {
    /// Somebody on foot.
    Walker,
    /// A vehicle.
    Vehicle,
    /// Anything else.
    Static,
}

/// A rule that was broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Infraction {
    /// A red light was run.
    RedLight,
    /// A stop sign was run.
    StopSign,
}

/// What happened on a drive; 56 bytes for each moment.
#[derive(Clone, Debug)]
pub struct Drive {
    pub(super) interval_secs: f64,
    pub(super) route_m: f64,
    pub(super) completed_m: f64,
    pub(super) off_road_m: f64,
    pub(super) driven_m: f64,
    pub(super) velocities_mps: [Vec<f64>; 2],
    pub(super) headings_rad: Vec<f64>,
    pub(super) yaw_rates_radps: Vec<f64>,
    pub(super) ttc_secs: Vec<f64>,
    pub(super) last_m: Option<[f64; 2]>,
    /// With walkers, vehicles and anything else.
    pub(super) n_collisions: [u64; 3],
    pub(super) impulse_ns: Option<f64>,
    pub(super) n_red_lights: u64,
    pub(super) n_stop_signs: u64,
}

impl Drive {
    /// A drive along a route of this length, of which every so many seconds a moment is added.
    #[must_use]
    pub fn new(interval_secs: f64, route_m: f64) -> Self {
        Self {
            interval_secs,
            route_m,
            completed_m: 0.0,
            off_road_m: 0.0,
            driven_m: 0.0,
            velocities_mps: [Vec::new(), Vec::new()],
            headings_rad: Vec::new(),
            yaw_rates_radps: Vec::new(),
            ttc_secs: Vec::new(),
            last_m: None,
            n_collisions: [0; 3],
            impulse_ns: None,
            n_red_lights: 0,
            n_stop_signs: 0,
        }
    }

    /// Adds the next moment: the vehicle, and all that it could hit at its height. A vehicle whose
    /// numbers are not finite is as it was the moment before.
    pub fn add(&mut self, ego: &Body, yaw_rate_radps: f64, others: &[Body]) {
        let numbers = [ego.heading_rad, yaw_rate_radps];
        let is_finite = |it: &f64| it.is_finite();
        let is_usable = ego
            .centre_m
            .iter()
            .chain(&ego.velocity_mps)
            .chain(&numbers)
            .all(is_finite);
        let last = |values: &[f64]| values.last().copied().unwrap_or(0.0);
        if is_usable {
            if let Some(last) = self.last_m {
                self.driven_m += (ego.centre_m[0] - last[0]).hypot(ego.centre_m[1] - last[1]);
            }
            self.last_m = Some(ego.centre_m);
        }
        for (values, value) in self.velocities_mps.iter_mut().zip(ego.velocity_mps) {
            let value = if is_usable { value } else { last(values) };
            values.push(value);
        }
        for (values, value) in [
            (&mut self.headings_rad, ego.heading_rad),
            (&mut self.yaw_rates_radps, yaw_rate_radps),
        ] {
            let value = if is_usable { value } else { last(values) };
            values.push(value);
        }
        let times = others
            .iter()
            .filter_map(|other| time_to_collision_secs(ego, other));
        self.ttc_secs.push(times.fold(f64::INFINITY, f64::min));
    }

    /// A collision, with the size of its impulse in newton seconds.
    pub fn collide(&mut self, with: CollisionWith, impulse_ns: f64) {
        self.n_collisions[match with {
            CollisionWith::Walker => 0,
            CollisionWith::Vehicle => 1,
            CollisionWith::Static => 2,
        }] += 1;
        if impulse_ns.is_finite() {
            self.impulse_ns = Some(
                self.impulse_ns
                    .map_or(impulse_ns, |most| most.max(impulse_ns)),
            );
        }
    }

    /// A broken rule.
    pub fn infringe(&mut self, what: Infraction) {
        match what {
            Infraction::RedLight => self.n_red_lights += 1,
            Infraction::StopSign => self.n_stop_signs += 1,
        }
    }

    /// How much of the route is done by now, metres.
    pub fn complete(&mut self, metres: f64) {
        self.completed_m = self.completed_m.max(metres);
    }

    /// So many metres more of what is done were off the road.
    pub fn off_road(&mut self, metres: f64) {
        if metres.is_finite() {
            self.off_road_m += metres.max(0.0);
        }
    }

    /// Share of the route that was completed on the road.
    pub(super) fn completion(&self) -> f64 {
        if self.route_m > 0.0 {
            ((self.completed_m - self.off_road_m) / self.route_m).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }

    pub(super) fn penalty(&self) -> f64 {
        let [walkers, vehicles, others] = self.n_collisions;
        [
            (0.50, walkers),
            (0.60, vehicles),
            (0.65, others),
            (0.70, self.n_red_lights),
            (0.80, self.n_stop_signs),
        ]
        .into_iter()
        .map(|(factor, n): (f64, u64)| factor.powf(n as f64))
        .product()
    }
}
