//! How people stroll: from place to place over the pavements, across crosswalks when the traffic has
//! red or leaves a gap, and round the vehicles that stand in the way.
//!
//! Whoever leads people says where they and the vehicles are, which lights are red, and how lots are
//! drawn. The same answers give the same steps.

use std::f64::consts::TAU;

use nalgebra::{Vector2, Vector3};
use schema_types::Pose;
use schema_types::noise::Noise;

use super::detour::{self, Obstacle, Step as Detour};
use super::mesh::Ground;
use super::pavements::{Pavements, REACH_M};

/// A vehicle slower than this counts as standing, m/s.
pub const STANDS_MPS: f64 = 0.3;
/// A corner of the way counts as reached from this far, metres.
const ARRIVED_M: f64 = 0.35;
/// A person that gets no nearer for this long chooses another way, seconds.
const PATIENCE_SECS: f64 = 4.0;
/// A vehicle that could be there within this time keeps people from stepping on a crosswalk that no
/// light guards, seconds.
const CROSSWALK_GAP_SECS: f64 = 4.0;
/// The same for a carriageway away from crosswalks, seconds.
const ROAD_GAP_SECS: f64 = 6.0;
/// The same for a crosswalk whose traffic has red, seconds.
const RED_GAP_SECS: f64 = 1.0;
/// People ignore vehicles farther away than this, metres between the middles.
const SEES_M: f64 = 12.0;
/// A vehicle whose middle is this much higher or lower is on another level, metres.
const LEVEL_M: f64 = 4.0;
/// Ways that are drawn before a person stays without one until the next step.
const WAYS_DRAWN: usize = 8;
/// Height above the pavement at which a new person appears, metres; it then stands on the ground.
const DROP_M: f64 = 0.2;

/// A vehicle as people on foot see it.
#[derive(Clone, Copy, Debug)]
pub struct SeenVehicle {
    /// Middle, world, metres.
    pub middle_m: Vector3<f64>,
    /// Velocity, world, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Half its length, metres.
    pub half_length_m: f64,
    /// Its outline; `None` for a vehicle that cannot be touched, which nobody walks round.
    pub obstacle: Option<Obstacle>,
}

/// What all people on foot see at one moment.
#[derive(Clone, Copy)]
pub struct StrollView<'s> {
    /// Where they walk.
    pub ground: &'s Pavements,
    /// All vehicles.
    pub vehicles: &'s [SeenVehicle],
    /// Whether the light with this OpenDRIVE id shows red; true where there is no such light.
    pub is_red: &'s dyn Fn(&str) -> bool,
}

/// A person about to take a step.
#[derive(Clone, Copy, Debug)]
pub struct OnFoot {
    /// Place of its feet, or of its middle, world, metres.
    pub at_m: [f64; 3],
    /// Radius of its body, metres.
    pub radius_m: f64,
    /// Whether it crosses carriageways anywhere and not on crosswalks alone.
    pub crosses_anywhere: bool,
}

/// The way of one person, and how far it has come.
#[derive(Clone, Debug, PartialEq)]
pub struct Stroll {
    /// Corners of the way, and the face that each leads into (`u32::MAX` for the end).
    pub path: Vec<([f64; 2], u32)>,
    /// The corner that is next.
    pub next: usize,
    /// Counts the ways that were drawn, from the number that [`Stroll::new`] was given.
    pub n_ways: u64,
    /// For how long it has not come nearer to its next corner, seconds.
    pub stuck_secs: f64,
    /// The nearest that it has been to that corner, metres.
    pub nearest_m: f64,
}

impl Stroll {
    /// No way yet; ways are counted from `n_ways`, by which people draw different lots.
    pub fn new(n_ways: u64) -> Stroll {
        Stroll {
            path: Vec::new(),
            next: 0,
            n_ways,
            stuck_secs: 0.0,
            nearest_m: f64::MAX,
        }
    }

    fn pass_corner(&mut self) {
        self.next += 1;
        self.nearest_m = f64::MAX;
    }
}

/// The next step of a person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StrollStep {
    /// Stand.
    Stand,
    /// Straight on to this corner of the way, world, metres.
    Ahead(Vector2<f64>),
    /// Round a vehicle, by this place, world, metres.
    Around(Vector2<f64>),
}

impl StrollView<'_> {
    /// The next step of a person after `dt_secs`. `lot` draws a number from 0 to 1 for the way with
    /// this number.
    pub fn step(
        &self,
        me: &OnFoot,
        stroll: &mut Stroll,
        dt_secs: f64,
        lot: impl Fn(u64) -> f64,
    ) -> StrollStep {
        let at = me.at_m;
        if stroll.next >= stroll.path.len() || stroll.stuck_secs > PATIENCE_SECS {
            self.choose(me, stroll, lot);
        }
        let away = |corner: &[f64; 2]| (corner[0] - at[0]).hypot(corner[1] - at[1]);
        while let Some((corner, into)) = stroll.path.get(stroll.next) {
            if away(corner) >= ARRIVED_M {
                break;
            }
            if !self.may_enter(at, *into as usize) {
                return StrollStep::Stand;
            }
            stroll.pass_corner();
        }
        let Some(&(corner, into)) = stroll.path.get(stroll.next) else {
            return StrollStep::Stand;
        };
        let left_m = away(&corner);
        if left_m < stroll.nearest_m - 0.05 {
            (stroll.nearest_m, stroll.stuck_secs) = (left_m, 0.0);
        } else {
            stroll.stuck_secs += dt_secs;
        }
        let near = self.obstacles_near(at);
        let is_walkable = |place: Vector2<f64>| self.is_walkable(place, at[2]);
        let (here, to) = (Vector2::new(at[0], at[1]), Vector2::from(corner));
        match detour::step(here, to, me.radius_m, &near, &is_walkable) {
            Detour::Ahead => StrollStep::Ahead(to),
            Detour::Via(place) => StrollStep::Around(place),
            Detour::Wait => StrollStep::Stand,
            Detour::Taken => {
                let beyond = stroll.path.get(stroll.next + 1);
                let leads_on = beyond.is_none_or(|(beyond, _)| {
                    detour::is_on_ground(here, Vector2::from(*beyond), &is_walkable)
                });
                if leads_on && self.may_enter(at, into as usize) {
                    stroll.pass_corner();
                }
                StrollStep::Stand
            }
        }
    }

    /// Whether there is ground to walk on at a place, on the level of `height_m`.
    pub fn is_walkable(&self, place_m: Vector2<f64>, height_m: f64) -> bool {
        self.ground
            .face_at([place_m.x, place_m.y, height_m])
            .is_some()
    }

    fn obstacles_near(&self, at: [f64; 3]) -> Vec<Obstacle> {
        let is_near = |middle: &Vector3<f64>| {
            let (x, y, z) = (middle.x - at[0], middle.y - at[1], middle.z - at[2]);
            x * x + y * y < SEES_M * SEES_M && z.abs() < LEVEL_M
        };
        self.vehicles
            .iter()
            .filter_map(|vehicle| vehicle.obstacle.filter(|_| is_near(&vehicle.middle_m)))
            .collect()
    }

    /// Chooses a new way to a place within reach; leaves the person without a way if none is found.
    fn choose(&self, me: &OnFoot, stroll: &mut Stroll, lot: impl Fn(u64) -> f64) {
        *stroll = Stroll::new(stroll.n_ways);
        let at = me.at_m;
        let Some(from) = self.ground.face_near(at) else {
            return;
        };
        for _ in 0..WAYS_DRAWN {
            stroll.n_ways += 1;
            let Some(to) = self.ground.place(lot(stroll.n_ways)) else {
                return;
            };
            let [x, y, _] = self.ground.middles_m[to];
            if to == from || (x - at[0]).hypot(y - at[1]) > REACH_M {
                continue;
            }
            if let Some(way) = self.ground.way(from, to, me.crosses_anywhere) {
                stroll.path = self.ground.corners(&way, [at[0], at[1]]);
                return;
            }
        }
    }

    /// Whether a person may step into a face: onto a crosswalk while the traffic over it has red or,
    /// where there are no lights, a gap; onto a carriageway in a longer gap.
    fn may_enter(&self, at: [f64; 3], into: usize) -> bool {
        let ground_of = |face: usize| self.ground.mesh.faces.get(face).map(|face| face.ground);
        let is_open =
            |ground: Option<Ground>| matches!(ground, Some(Ground::Crosswalk | Ground::Road));
        let here = self.ground.face_at(at).and_then(ground_of);
        let to = ground_of(into);
        if !is_open(to) || is_open(here) {
            return true;
        }
        let guards = self.ground.guards.get(&into).map_or(&[][..], Vec::as_slice);
        if !guards.iter().all(|id| (self.is_red)(id)) {
            return false;
        }
        let gap_secs = match to {
            _ if !guards.is_empty() => RED_GAP_SECS,
            Some(Ground::Road) => ROAD_GAP_SECS,
            _ => CROSSWALK_GAP_SECS,
        };
        let [x, y, _] = self.ground.middles_m[into];
        let place = Vector3::new(x, y, at[2]);
        !self.vehicles.iter().any(|vehicle| {
            let (velocity, between) = (vehicle.velocity_mps, place - vehicle.middle_m);
            let reach_m = vehicle.half_length_m + 2.0 + velocity.norm() * gap_secs;
            between.xy().norm() < reach_m
                && velocity.norm() > STANDS_MPS
                && (velocity.dot(&between) > 0.0 || between.xy().norm() < 6.0)
        })
    }
}

/// Somebody who could appear: which kind of person, and where.
#[derive(Clone, Copy, Debug)]
pub struct Newcomer {
    /// Index of its kind.
    pub kind: usize,
    /// Pose of the middle of its body in the world.
    pub pose: Pose,
}

/// Draws a place on the pavements and one of `n_kinds` kinds of people, whose half heights in metres
/// `half_height_m` tells; `None` if the map has no pavement or there is no kind.
pub fn draw_newcomer(
    ground: &Pavements,
    draw: Noise,
    n_kinds: usize,
    half_height_m: impl Fn(usize) -> f64,
) -> Option<Newcomer> {
    let face = ground.place(draw.uniform(0))?;
    let kind = draw.bits(1).checked_rem(n_kinds as u64)? as usize;
    let [x, y, z] = ground.middles_m[face];
    let yaw_rad = TAU * draw.uniform(2);
    Some(Newcomer {
        kind,
        pose: Pose::from_xyz_yaw(x, y, z + half_height_m(kind) + DROP_M, yaw_rad),
    })
}

/// How fast a person walks whose kind usually walks at `usual_mps`: up to 15 % slower or faster, by
/// a lot from 0 to 1.
pub fn draw_speed_mps(usual_mps: f64, lot: f64) -> f64 {
    usual_mps * (0.85 + 0.3 * lot)
}
