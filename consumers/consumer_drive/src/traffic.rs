//! What a driver sees: vehicles, walkers and traffic lights of one snapshot.

use std::collections::BTreeMap;

use schema_frames::{ActorKind, ActorList, ActorRecord, LightState};

use crate::path::distance;

/// How far ahead the way of a walker is predicted, seconds, and in how many steps.
const FORESIGHT_SECS: f64 = 2.5;
const FORESIGHT_STEPS: u32 = 5;
/// A walker slower than this stands, m/s.
const STROLLING_MPS: f64 = 0.2;

/// A vehicle or walker.
#[derive(Clone, Debug, Default)]
pub struct Mover {
    /// Actor id.
    pub id: u32,
    /// Whether it is a vehicle.
    pub is_vehicle: bool,
    /// World position of its origin, metres.
    pub position_m: [f64; 3],
    /// Heading, radians.
    pub yaw_rad: f64,
    /// Speed along its heading, m/s.
    pub speed_mps: f64,
    /// Velocity in the world, m/s.
    pub velocity_mps: [f64; 2],
    /// Rate of turn, rad/s.
    pub yaw_rate_radps: f64,
    /// Half length and half width of its box, metres.
    pub half_m: [f64; 2],
    /// Centre of its box in its own space, metres.
    pub centre_m: [f64; 2],
    /// Applied steering, −1..=1.
    pub steer_ratio: f64,
    /// Angle of its front wheels, radians.
    pub wheel_steer_rad: f64,
}

impl Mover {
    /// World position of a point of its own space.
    pub fn point(&self, x_m: f64, y_m: f64) -> [f64; 2] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        [
            self.position_m[0] + cos * x_m - sin * y_m,
            self.position_m[1] + sin * x_m + cos * y_m,
        ]
    }

    /// World position of the middle of its box.
    pub fn middle(&self) -> [f64; 2] {
        self.point(self.centre_m[0], self.centre_m[1])
    }

    /// Distance from its origin to its front, metres.
    pub fn front_m(&self) -> f64 {
        self.centre_m[0] + self.half_m[0]
    }

    /// Distance from its origin to its rear, metres.
    pub fn rear_m(&self) -> f64 {
        self.half_m[0] - self.centre_m[0]
    }

    /// Points around its outline, at most about 1.5 m apart.
    pub fn outline(&self) -> Vec<[f64; 2]> {
        let [half_x, half_y] = self.half_m;
        let pieces = (2.0 * half_x / 1.5).ceil().max(1.0) as usize;
        let mut points = Vec::with_capacity(2 * pieces + 4);
        for i in 0..=pieces {
            let x = self.centre_m[0] - half_x + 2.0 * half_x * i as f64 / pieces as f64;
            points.push(self.point(x, self.centre_m[1] + half_y));
            points.push(self.point(x, self.centre_m[1] - half_y));
        }
        points.push(self.point(self.centre_m[0] - half_x, self.centre_m[1]));
        points.push(self.point(self.centre_m[0] + half_x, self.centre_m[1]));
        points
    }

    /// Where a walker will be in the next moments if it keeps its velocity; empty for vehicles and
    /// for walkers that stand.
    pub fn steps_ahead(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        let [vx, vy] = self.velocity_mps;
        let n = if self.is_vehicle || vx.hypot(vy) < STROLLING_MPS {
            0
        } else {
            FORESIGHT_STEPS
        };
        let [x, y] = self.middle();
        (1..=n)
            .map(move |i| f64::from(i) * FORESIGHT_SECS / f64::from(FORESIGHT_STEPS))
            .map(move |t| [x + vx * t, y + vy * t])
    }

    /// How far ahead of our middle the other's middle is, along our heading, metres.
    pub fn ahead_m(&self, other: &Mover) -> f64 {
        let (a, b) = (self.middle(), other.middle());
        (b[0] - a[0]) * self.yaw_rad.cos() + (b[1] - a[1]) * self.yaw_rad.sin()
    }

    /// Whether two boxes overlap (separating axes), grown by `margin_m` together.
    pub fn overlaps(&self, other: &Mover, margin_m: f64) -> bool {
        let (a, b) = (self.middle(), other.middle());
        if distance(a, b)
            > self.half_m[0] + self.half_m[1] + other.half_m[0] + other.half_m[1] + margin_m
        {
            return false;
        }
        let between = [b[0] - a[0], b[1] - a[1]];
        let axis = |yaw: f64| [yaw.cos(), yaw.sin()];
        [
            self.yaw_rad,
            self.yaw_rad + std::f64::consts::FRAC_PI_2,
            other.yaw_rad,
            other.yaw_rad + std::f64::consts::FRAC_PI_2,
        ]
        .into_iter()
        .all(|direction| {
            let n = axis(direction);
            let reach = |m: &Mover| {
                let turn = direction - m.yaw_rad;
                m.half_m[0] * turn.cos().abs() + m.half_m[1] * turn.sin().abs()
            };
            (between[0] * n[0] + between[1] * n[1]).abs() < reach(self) + reach(other) + margin_m
        })
    }
}

/// The vehicles, walkers and traffic lights of one snapshot.
#[derive(Clone, Debug, Default)]
pub struct Traffic {
    /// Tick.
    pub tick: u64,
    /// Simulated time, seconds.
    pub time_secs: f64,
    /// Length of the tick, seconds.
    pub period_secs: f64,
    /// Vehicles and walkers by rising id.
    pub movers: Vec<Mover>,
    /// States of traffic lights by OpenDRIVE id.
    pub lights: BTreeMap<String, LightState>,
}

impl Traffic {
    /// The traffic of a snapshot's records; `actors` tells where boxes are not centred.
    pub fn from_records(
        tick: u64,
        sim_nanos: u64,
        period_nanos: u64,
        records: &[ActorRecord],
        actors: &ActorList,
    ) -> Traffic {
        let mut traffic = Traffic {
            tick,
            time_secs: sim_nanos as f64 * 1e-9,
            period_secs: (period_nanos as f64 * 1e-9).clamp(1e-4, 1.0),
            ..Traffic::default()
        };
        for record in records {
            match record.kind() {
                Some(ActorKind::Vehicle | ActorKind::Walker) => {
                    traffic.movers.push(mover(record, actors))
                }
                Some(ActorKind::TrafficLight) => {
                    if let Some(light) = record.traffic_light() {
                        traffic.lights.insert(
                            light.opendrive_id().to_owned(),
                            LightState::from_code(light.state),
                        );
                    }
                }
                _ => {}
            }
        }
        traffic.movers.sort_by_key(|mover| mover.id);
        traffic
    }

    /// The vehicle or walker that is less than `room_m` behind `me`.
    pub(crate) fn behind(&self, me: &Mover, room_m: f64) -> Option<u32> {
        let mut ghost = me.clone();
        ghost.half_m[0] += room_m;
        ghost.centre_m[0] -= room_m;
        let is_behind = |other: &&Mover| {
            other.id != me.id && ghost.overlaps(other, 0.2) && me.ahead_m(other) < 0.0
        };
        self.movers.iter().find(is_behind).map(|other| other.id)
    }

    /// A mover by id.
    pub fn mover(&self, id: u32) -> Option<&Mover> {
        self.movers
            .binary_search_by_key(&id, |m| m.id)
            .ok()
            .map(|idx| &self.movers[idx])
    }
}

fn mover(record: &ActorRecord, actors: &ActorList) -> Mover {
    let yaw_rad = record.world_from_actor.yaw_rad();
    let [vx, vy, _] = record.velocity_in_world_mps;
    let info = actors
        .actors
        .binary_search_by_key(&record.id, |a| a.id)
        .ok()
        .map(|idx| &actors.actors[idx]);
    let part = record.vehicle();
    Mover {
        id: record.id,
        is_vehicle: part.is_some(),
        position_m: record.world_from_actor.translation_m,
        yaw_rad,
        speed_mps: vx * yaw_rad.cos() + vy * yaw_rad.sin(),
        velocity_mps: [vx, vy],
        yaw_rate_radps: record.angular_velocity_in_world_radps[2],
        half_m: [
            f64::from(record.half_box_m[0]).max(0.2),
            f64::from(record.half_box_m[1]).max(0.2),
        ],
        centre_m: info.map_or([0.0; 2], |i| {
            [
                f64::from(i.body_box.centre_m[0]),
                f64::from(i.body_box.centre_m[1]),
            ]
        }),
        steer_ratio: part.map_or(0.0, |p| f64::from(p.steer_ratio)),
        wheel_steer_rad: part.map_or(0.0, |p| f64::from(p.wheel_steer_rad)),
    }
}
