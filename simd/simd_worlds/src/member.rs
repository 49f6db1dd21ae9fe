//! One world with its task: it begins, takes a step, and says what it sees and what that was worth.

use std::sync::Arc;

use nalgebra::Vector3;
use schema_frames::VehicleControl;
use schema_types::noise::{Noise, mix};
use schema_types::{Class, Pose};
use simd_world::World;

use crate::actors::{Script, Seen};
use crate::course::{Course, STARTS_M};
use crate::route::{Foot, Route, heading, turned, wrap};
use crate::task::Rules;

/// Names of the actions: steering (1 is to the left as far as it goes), and pedals (1 full
/// throttle, −1 full brake). Values beyond −1 and 1 count as these.
pub const ACTION_NAMES: [&str; 2] = ["steer", "accelerate"];
/// Names of the state's columns. Distances and speeds are divided by the number in the name; the
/// obstacle's columns are 0 where there is none.
pub const STATE_NAMES: [&str; 18] = [
    "offset / half lane",
    "sin heading",
    "cos heading",
    "speed / 30 m/s",
    "limit / 30 m/s",
    "yaw rate / 1 rad/s",
    "last steer",
    "last accelerate",
    "way at 5 m: left / 5 m",
    "way at 10 m: left / 10 m",
    "way at 20 m: left / 20 m",
    "way at 30 m: left / 30 m",
    "way at 40 m: left / 40 m",
    "obstacle there",
    "obstacle: gap / 100 m",
    "obstacle: offset / half lane",
    "obstacle: speed along the lane / 30 m/s",
    "obstacle: speed to the left / 5 m/s",
];
/// Names of the figures of a step.
pub const INFO_NAMES: [&str; 6] = [
    "contact",
    "off_lane",
    "needless_stop",
    "safe_stop",
    "impact_mps",
    "progress_m",
];
const AHEAD_M: [f64; 5] = [5.0, 10.0, 20.0, 30.0, 40.0];
/// Slower is a standstill, m/s.
const STANDS_MPS: f64 = 0.3;
/// Random stream of starts.
const STARTS: u64 = 0x7374_6172;

/// Where the ego is.
#[derive(Clone, Copy)]
struct Ego {
    foot: Foot,
    seen: Seen,
    /// Angle to the lane, radians.
    angle_rad: f64,
    speed_mps: f64,
    yaw_radps: f64,
}

/// What came of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Outcome {
    pub reward: f32,
    pub terminated: bool,
    pub truncated: bool,
    pub info: [f32; INFO_NAMES.len()],
}

/// One world with its task.
pub(crate) struct Member {
    pub world: World,
    course: Arc<Course>,
    /// Seed of the first episode after a reset by the user.
    base_seed: u64,
    /// Episodes since then.
    pub episode: u32,
    route_idx: usize,
    near: usize,
    start_way_m: f64,
    start_mps: f64,
    script: Script,
    n_steps: u32,
    last_action: [f32; 2],
    last_mps: f64,
    last_mps2: Option<f64>,
    pub state: [f32; STATE_NAMES.len()],
    pub final_state: [f32; STATE_NAMES.len()],
    pub has_final: bool,
    pub outcome: Outcome,
    pub has_begun: bool,
    pub has_ended: bool,
}

impl Member {
    pub fn new(course: &Arc<Course>) -> Member {
        Member {
            world: course.resting.clone(),
            course: course.clone(),
            base_seed: 0,
            episode: 0,
            route_idx: 0,
            near: 0,
            start_way_m: 0.0,
            start_mps: 0.0,
            script: Script::Nobody,
            n_steps: 0,
            last_action: [0.0; 2],
            last_mps: 0.0,
            last_mps2: None,
            state: [0.0; STATE_NAMES.len()],
            final_state: [0.0; STATE_NAMES.len()],
            has_final: false,
            outcome: Outcome::default(),
            has_begun: false,
            has_ended: false,
        }
    }

    /// Begins the episode of a seed.
    pub fn reset(&mut self, seed: u64) {
        (self.base_seed, self.episode) = (seed, 0);
        self.outcome = Outcome::default();
        self.has_final = false;
        self.begin(seed);
    }

    /// Stays as it is while others begin anew: nothing comes of that.
    pub fn pass_over(&mut self) {
        let info = self.outcome.info;
        self.outcome = Outcome {
            info,
            ..Default::default()
        };
        self.has_final = false;
    }

    /// Begins the next episode, whose seed follows from the last reset's.
    pub fn begin_next(&mut self) {
        self.episode += 1;
        self.begin(mix(self.base_seed ^ mix(u64::from(self.episode))));
    }

    fn begin(&mut self, seed: u64) {
        let course = self.course.clone();
        let lot = Noise::new(seed, STARTS, 0);
        let task = &course.task;
        let kind = match &task.rules {
            Rules::LaneKeeping(_) => 0,
            Rules::EmergencyBrake(rules) => {
                let share = lot.uniform(0);
                let with_person = rules.lead_share + rules.person_share;
                usize::from(share < with_person)
                    + usize::from(share >= rules.lead_share && share < with_person)
            }
        };
        let prepared = &course.prepared[kind];
        self.world
            .restore(&prepared.checkpoint)
            .expect("the checkpoint is of this world's own map, and it has no sensors");
        self.route_idx = (lot.bits(1) % course.routes.len() as u64) as usize;
        let route = &course.routes[self.route_idx];
        let way_m = STARTS_M * lot.uniform(2);
        let either = |n| 2.0 * lot.uniform(n) - 1.0;
        let offset_m = either(3) * task.start.offset_ratio * route.foot_at(way_m).half_width_m;
        let place = turned(
            route.pose(way_m, offset_m),
            either(4) * task.start.heading_rad,
        );
        let [slow_mps, fast_mps] = task.start.speed_mps;
        let speed_mps = slow_mps + (fast_mps - slow_mps) * lot.uniform(5);
        let velocity_mps = place.rotation * Vector3::new(speed_mps, 0.0, 0.0);
        let there = "the actor was made when the course was prepared, and its place is finite";
        self.world
            .set_pose(course.ego, Pose::from(place))
            .expect(there);
        self.world
            .set_velocity(course.ego, velocity_mps.into())
            .expect(there);
        let control = VehicleControl::default();
        self.world.set_control(course.ego, control).expect(there);
        let script = Noise::new(seed, STARTS, 1);
        self.script = Script::begin(
            prepared.other,
            &mut self.world,
            route,
            way_m,
            speed_mps,
            script,
        )
        .expect(there);
        self.near = route.before(way_m);
        (self.start_way_m, self.start_mps) = (way_m, speed_mps);
        (self.n_steps, self.last_action, self.last_mps) = (0, [0.0; 2], speed_mps);
        self.last_mps2 = None;
        (self.has_begun, self.has_ended) = (true, false);
        let ego = self.ego(route);
        self.observe(route, &ego);
    }

    /// Takes a step; `action` was checked.
    pub fn step(&mut self, action: [f32; 2]) {
        let course = self.course.clone();
        let route = &course.routes[self.route_idx];
        let task = &course.task;
        let step_secs = task.step_secs();
        let [steer_ratio, pedal] = action.map(|x| x.clamp(-1.0, 1.0));
        self.last_action = [steer_ratio, pedal];
        let control = VehicleControl {
            throttle_ratio: pedal.max(0.0),
            brake_ratio: (-pedal).max(0.0),
            steer_ratio,
            ..VehicleControl::default()
        };
        let there = "the actor was made when the course was prepared, and its place is finite";
        let before = self.ego(route);
        let obstacle_before = self.script.seen(&self.world, route);
        self.world.set_control(course.ego, control).expect(there);
        self.script
            .step(&mut self.world, route, &before.seen, step_secs)
            .expect(there);
        self.world.step(u64::from(task.tick_ms) * 1_000_000);
        self.n_steps += 1;
        let ego = self.ego(route);
        self.near = ego.foot.idx;
        self.outcome = self.judge(&before, &ego, obstacle_before);
        self.has_ended = self.outcome.terminated || self.outcome.truncated;
        self.observe(route, &ego);
    }

    fn judge(&mut self, before: &Ego, ego: &Ego, obstacle_before: Option<Seen>) -> Outcome {
        let course = self.course.clone();
        let task = &course.task;
        let step_secs = task.step_secs();
        let obstacle = self
            .script
            .seen(&self.world, &course.routes[self.route_idx]);
        let ground = [
            Class::ROADS,
            Class::SIDEWALKS,
            Class::GROUND,
            Class::TERRAIN,
            Class::UNLABELED,
        ];
        let contact = self.world.collisions().iter().any(|contact| {
            contact.actor == course.ego
                && (contact.other.is_some() || !ground.contains(&contact.other_class))
        });
        let off_lane = ego.foot.offset_m.abs() > ego.foot.half_width_m || ego.angle_rad.cos() < 0.0;
        let mps2 = (ego.speed_mps - self.last_mps) / step_secs;
        // The first step has no acceleration before it.
        let jerk_mps3 = self.last_mps2.map_or(0.0, |last| (mps2 - last) / step_secs);
        (self.last_mps, self.last_mps2) = (ego.speed_mps, Some(mps2));
        let impact_mps = match contact {
            true => {
                let away_mps = obstacle_before.map_or(0.0, |seen| seen.velocity_mps[0]);
                (before.seen.velocity_mps[0] - away_mps).max(0.0)
            }
            false => 0.0,
        };
        let (mut needless, mut safe) = (false, false);
        let reward = match &task.rules {
            Rules::LaneKeeping(_) if contact || off_lane => 0.0,
            Rules::LaneKeeping(rules) => {
                let share = ego.seen.velocity_mps[0] / ego.foot.limit_mps;
                let offset = ego.foot.offset_m / ego.foot.half_width_m;
                1.0 - (1.0 - share).abs() - rules.offset_weight * offset * offset
            }
            Rules::EmergencyBrake(rules) => {
                let stands = ego.speed_mps < STANDS_MPS;
                let near = obstacle
                    .is_some_and(|seen| (0.0..rules.needless_gap_m).contains(&gap_m(ego, &seen)));
                (safe, needless) = (stands && near && !contact, stands && !near && !contact);
                let ratio = (ego.speed_mps / self.start_mps).clamp(0.0, 1.0);
                match () {
                    () if contact => -(impact_mps / self.start_mps).powi(2),
                    () if off_lane || needless => -rules.needless_penalty,
                    () if safe => 0.0,
                    () => {
                        step_secs
                            * (rules.progress_weight * ratio - rules.jerk_weight * jerk_mps3.abs())
                    }
                }
            }
        };
        let terminated = contact || off_lane || needless || safe;
        let route_left_m = course.routes[self.route_idx].length_m() - ego.foot.way_m;
        let is_over = self.n_steps >= task.limit_steps || route_left_m < AHEAD_M[4];
        let flag = |on: bool| f32::from(u8::from(on));
        Outcome {
            reward: reward as f32,
            terminated,
            truncated: is_over && !terminated,
            info: [
                flag(contact),
                flag(off_lane),
                flag(needless),
                flag(safe),
                impact_mps as f32,
                (ego.foot.way_m - self.start_way_m) as f32,
            ],
        }
    }

    fn ego(&self, route: &Route) -> Ego {
        let record = self.world.record(self.course.ego);
        let record = record.expect("the ego was made when the course was prepared");
        let pose = record.world_from_actor.isometry();
        let velocity_mps = Vector3::from(record.velocity_in_world_mps);
        let at_m = pose.translation.vector;
        let foot = route.foot(&at_m, self.near);
        Ego {
            foot,
            seen: Seen::of(
                route,
                &at_m,
                self.near,
                &velocity_mps,
                f64::from(record.half_box_m[0]),
            ),
            angle_rad: wrap(heading(&pose) - foot.heading_rad),
            speed_mps: velocity_mps.norm(),
            yaw_radps: record.angular_velocity_in_world_radps[2],
        }
    }

    fn observe(&mut self, route: &Route, ego: &Ego) {
        let record = self.world.record(self.course.ego);
        let record = record.expect("the ego was made when the course was prepared");
        let world_from_ego = record.world_from_actor.isometry();
        let half_m = ego.foot.half_width_m;
        let mut state = [0.0; STATE_NAMES.len()];
        state[..8].copy_from_slice(&[
            ego.foot.offset_m / half_m,
            ego.angle_rad.sin(),
            ego.angle_rad.cos(),
            ego.speed_mps / 30.0,
            ego.foot.limit_mps / 30.0,
            ego.yaw_radps,
            f64::from(self.last_action[0]),
            f64::from(self.last_action[1]),
        ]);
        for (column, ahead_m) in state[8..13].iter_mut().zip(AHEAD_M) {
            let there = route.pose(ego.foot.way_m + ahead_m, 0.0).translation.vector;
            let in_ego = world_from_ego.inverse_transform_point(&there.into());
            *column = in_ego.y / ahead_m;
        }
        if let Some(seen) = self.script.seen(&self.world, route) {
            state[13..].copy_from_slice(&[
                1.0,
                gap_m(ego, &seen) / 100.0,
                seen.offset_m / half_m,
                seen.velocity_mps[0] / 30.0,
                seen.velocity_mps[1] / 5.0,
            ]);
        }
        self.state = state.map(|x| x as f32);
    }

    /// Becomes the future of another member; its own seeds for later episodes stay.
    pub fn become_fork(&mut self, of: &Member, checkpoint: &simd_world::Checkpoint) {
        self.world
            .restore(checkpoint)
            .expect("all members have the same map and no sensors");
        let Member {
            world: _,
            course: _,
            base_seed: _,
            episode: _,
            route_idx,
            near,
            start_way_m,
            start_mps,
            script,
            n_steps,
            last_action,
            last_mps,
            last_mps2,
            state,
            final_state,
            has_final,
            outcome,
            has_begun,
            has_ended,
        } = of;
        self.route_idx = *route_idx;
        self.near = *near;
        (self.start_way_m, self.start_mps) = (*start_way_m, *start_mps);
        self.script = *script;
        self.n_steps = *n_steps;
        (self.last_action, self.last_mps, self.last_mps2) = (*last_action, *last_mps, *last_mps2);
        (self.state, self.final_state, self.has_final) = (*state, *final_state, *has_final);
        self.outcome = *outcome;
        (self.has_begun, self.has_ended) = (*has_begun, *has_ended);
    }
}

/// Free way between the ego and what is ahead, metres; negative once they overlap along the lane.
fn gap_m(ego: &Ego, seen: &Seen) -> f64 {
    seen.way_m - ego.seen.way_m - seen.half_length_m - ego.seen.half_length_m
}
