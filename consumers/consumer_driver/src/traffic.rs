//! What a driver sees: vehicles, walkers and traffic lights of one snapshot.

use std::collections::BTreeMap;

use schema_frames::{ActorKind, ActorList, ActorRecord, LightState, WalkerPart};

use crate::plane::distance;

/// A vehicle counts as standing below this, m/s.
pub(crate) const STANDING_MPS: f64 = 0.3;

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
    /// Its place among the actors of the episode, by which choices are made: ids go on counting when
    /// a map is loaded again, and the same vehicles must choose the same.
    pub number: u32,
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
    /// Lamps that are on, bits as in `VehiclePart::lamps`.
    pub lamps: u32,
    /// Speed limit that is posted where it is, m/s; 0 if none is known.
    pub limit_mps: f64,
    /// Whether its role is that of an ego vehicle.
    pub is_hero: bool,
    /// Whether it is a walker that was knocked down.
    pub lies: bool,
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

    /// World position of its origin in the plane.
    pub fn origin(&self) -> [f64; 2] {
        [self.position_m[0], self.position_m[1]]
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
    pub fn outline(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        let (sin, cos) = self.yaw_rad.sin_cos();
        self.outline_along([cos, sin])
    }

    /// The same, with the cosine and sine of its heading.
    pub(crate) fn outline_along(
        &self,
        [cos, sin]: [f64; 2],
    ) -> impl Iterator<Item = [f64; 2]> + '_ {
        let [half_x, half_y] = self.half_m;
        let [middle_x, middle_y] = self.centre_m;
        let point = move |x: f64, y: f64| {
            [
                self.position_m[0] + cos * x - sin * y,
                self.position_m[1] + sin * x + cos * y,
            ]
        };
        let pieces = (2.0 * half_x / 1.5).ceil().max(1.0) as usize;
        let sides = (0..=pieces).flat_map(move |i| {
            let x = middle_x - half_x + 2.0 * half_x * i as f64 / pieces as f64;
            [point(x, middle_y + half_y), point(x, middle_y - half_y)]
        });
        let ends = [
            point(middle_x - half_x, middle_y),
            point(middle_x + half_x, middle_y),
        ];
        sides.chain(ends)
    }

    /// Where a walker will be in the next moments if it keeps its velocity; empty for vehicles and
    /// for walkers that stand.
    pub fn steps_ahead(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        let [vx, vy] = self.velocity_mps;
        let n = if self.is_vehicle || (vx * vx + vy * vy).sqrt() < STROLLING_MPS {
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

/// What a simulator tells about one tick.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'r> {
    /// Tick.
    pub tick: u64,
    /// Simulated time since the episode began, nanoseconds.
    pub sim_nanos: u64,
    /// Length of the tick, nanoseconds.
    pub period_nanos: u64,
    /// Actors as they are in this tick, in world space.
    pub records: &'r [ActorRecord],
    /// What is known of the same actors besides, by rising id: roles, and where boxes are not
    /// centred.
    pub actors: &'r ActorList,
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
    /// The traffic of a snapshot.
    pub fn of(snapshot: &Snapshot<'_>) -> Traffic {
        let actors = snapshot.actors;
        let mut traffic = Traffic {
            tick: snapshot.tick,
            time_secs: snapshot.sim_nanos as f64 * 1e-9,
            period_secs: (snapshot.period_nanos as f64 * 1e-9).clamp(1e-4, 1.0),
            ..Traffic::default()
        };
        for record in snapshot.records {
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
    pub(crate) fn behind(&self, me: &Mover, room_m: f64, grid: &Grid) -> Option<u32> {
        let mut ghost = me.clone();
        ghost.half_m[0] += room_m;
        ghost.centre_m[0] -= room_m;
        let is_behind = |other: &&Mover| {
            other.id != me.id && ghost.overlaps(other, 0.2) && me.ahead_m(other) < 0.0
        };
        let [x, y] = me.middle();
        let reach = me.half_m[0] + room_m + 8.0;
        grid.within([x - reach, y - reach], [x + reach, y + reach])
            .map(|idx| &self.movers[idx as usize])
            .filter(is_behind)
            .map(|other| other.id)
            .min()
    }

    /// A mover by id.
    pub fn mover(&self, id: u32) -> Option<&Mover> {
        self.movers
            .binary_search_by_key(&id, |m| m.id)
            .ok()
            .map(|idx| &self.movers[idx])
    }
}

/// Side of a cell of the grid, metres.
const CELL_M: f64 = 24.0;

/// Where the box of a mover is.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Stance {
    /// World position of its middle.
    pub middle_m: [f64; 2],
    /// Cosine and sine of its heading.
    pub along: [f64; 2],
}

/// Where movers are: the cells of a plane, folded into a table whose size goes with their number.
#[derive(Clone, Debug, Default)]
pub(crate) struct Grid {
    /// By index of the mover.
    stances: Vec<Stance>,
    /// Start of each slot's list in `entries`, and the end of the last.
    starts: Vec<u32>,
    /// Cell and mover.
    entries: Vec<([i32; 2], u32)>,
}

impl Grid {
    /// Enters the middle of every mover.
    pub fn new(movers: &[Mover]) -> Grid {
        let n_slots = (2 * movers.len()).next_power_of_two().max(16);
        let stances: Vec<Stance> = movers.iter().map(stance).collect();
        let cells: Vec<[i32; 2]> = stances.iter().map(|it| cell(it.middle_m)).collect();
        let mut starts = vec![0u32; n_slots + 1];
        for at in &cells {
            starts[slot(*at, n_slots) + 1] += 1;
        }
        for idx in 0..n_slots {
            starts[idx + 1] += starts[idx];
        }
        let mut next = starts.clone();
        let mut entries = vec![([0, 0], 0); movers.len()];
        for (idx, at) in cells.into_iter().enumerate() {
            let place = &mut next[slot(at, n_slots)];
            entries[*place as usize] = (at, idx as u32);
            *place += 1;
        }
        Grid {
            stances,
            starts,
            entries,
        }
    }

    /// Where the box of a mover is, by its index.
    pub fn stance(&self, mover: u32) -> Stance {
        self.stances[mover as usize]
    }

    /// Movers whose middle may lie between two corners, by cell and then by rising id.
    pub fn within(&self, low_m: [f64; 2], high_m: [f64; 2]) -> impl Iterator<Item = u32> + '_ {
        let (low, high) = (cell(low_m), cell(high_m));
        let n_slots = self.starts.len().saturating_sub(1);
        // No search reaches farther than 1024 cells, 700 m by 700 m.
        (low[0]..=high[0])
            .flat_map(move |x| (low[1]..=high[1]).map(move |y| [x, y]))
            .take(1024)
            .filter(move |_| n_slots > 0)
            .flat_map(move |at| {
                let idx = slot(at, n_slots);
                let list = self.starts[idx] as usize..self.starts[idx + 1] as usize;
                self.entries[list]
                    .iter()
                    .filter(move |(of, _)| *of == at)
                    .map(|(_, mover)| *mover)
            })
    }
}

fn stance(mover: &Mover) -> Stance {
    let (sin, cos) = mover.yaw_rad.sin_cos();
    let [x, y] = mover.centre_m;
    Stance {
        middle_m: [
            mover.position_m[0] + cos * x - sin * y,
            mover.position_m[1] + sin * x + cos * y,
        ],
        along: [cos, sin],
    }
}

fn cell(point_m: [f64; 2]) -> [i32; 2] {
    point_m.map(|x| (x / CELL_M).floor() as i32)
}

fn slot([x, y]: [i32; 2], n_slots: usize) -> usize {
    let mixed = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77);
    (mixed ^ mixed >> 15) as usize & (n_slots - 1)
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
        number: record.id
            - actors
                .actors
                .first()
                .map_or(0, |first| first.id.min(record.id)),
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
        lamps: part.map_or(0, |p| p.lamps),
        limit_mps: part.map_or(0.0, |p| f64::from(p.speed_limit_mps)),
        is_hero: info.is_some_and(|i| matches!(i.role.as_str(), "hero" | "ego_vehicle")),
        lies: record
            .walker()
            .is_some_and(|walker| walker.flags & WalkerPart::DOWN != 0),
    }
}
