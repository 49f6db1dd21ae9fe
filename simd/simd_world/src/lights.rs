//! Traffic lights: stages of the controllers of a junction, and which vehicle stands before which light.
//!
//! CARLA's timing: a controller is green 10 s, yellow 3 s, then all are red 2 s, then the junction's next controller is green.
//! Time is whole nanoseconds, so a stage ends in exactly the tick that completes it.

use nalgebra::{Isometry3, Vector3};
use schema_frames::LightState;
use schema_roads::SignalKind;
use schema_roads::{LanePosition, RoadMap};
use schema_types::ActorId;

const GREEN_NANOS: u64 = 10_000_000_000;
const YELLOW_NANOS: u64 = 3_000_000_000;
const ALL_RED_NANOS: u64 = 2_000_000_000;
/// Half length of the box before a stop line, and how far upstream its middle lies, metres.
const STOP_BOX_HALF_M: f64 = 1.5;
const STOP_BOX_UPSTREAM_M: f64 = 3.0;

/// One light.
pub(crate) struct Light {
    pub actor: ActorId,
    pub signal_id: String,
    pub state: LightState,
    pub in_state_nanos: u64,
    /// Index of its group.
    pub group: usize,
    /// Index within its group.
    pub pole_idx: u32,
    /// Boxes before its stop lines: x along the lane.
    boxes: Vec<StopBox>,
}

struct StopBox {
    world_from_box: Isometry3<f64>,
    half_m: [f64; 2],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Green,
    Yellow,
    AllRed,
}

/// Controllers of one junction that take turns.
struct Group {
    /// Lights per controller.
    turns: Vec<Vec<usize>>,
    turn: usize,
    stage: Stage,
    in_stage_nanos: u64,
}

/// All lights of a map.
#[derive(Default)]
pub(crate) struct Lights {
    pub lights: Vec<Light>,
    pub frozen: bool,
    groups: Vec<Group>,
}

impl Lights {
    /// Lights of the map's signals; `next_actor` gives each an id. Every group begins with its first controller green.
    pub fn new(roads: &RoadMap, mut next_actor: impl FnMut() -> ActorId) -> Lights {
        let mut all = Lights::default();
        for signal in roads.signals().iter().filter(|signal| signal.kind == SignalKind::TrafficLight) {
            let boxes = signal.stops.iter().filter_map(|stop| stop_box(roads, stop.stop)).collect();
            all.lights.push(Light {
                actor: next_actor(),
                signal_id: signal.id.clone(),
                state: LightState::Red,
                in_state_nanos: 0,
                group: 0,
                pole_idx: 0,
                boxes,
            });
        }
        all.group(roads);
        for group in 0..all.groups.len() {
            all.show_stage(group);
        }
        all
    }

    /// One group per junction, one turn per controller; lights without a controller take a turn of their own.
    fn group(&mut self, roads: &RoadMap) {
        let mut turns: Vec<(Option<u32>, u32, Vec<usize>)> = Vec::new();
        let mut taken = vec![false; self.lights.len()];
        for controller in roads.controllers() {
            let of_controller: Vec<usize> =
                (0..self.lights.len()).filter(|i| !taken[*i] && controller.signals.contains(&self.lights[*i].signal_id)).collect();
            if of_controller.is_empty() {
                continue;
            }
            of_controller.iter().for_each(|i| taken[*i] = true);
            turns.push((controller.junction, controller.sequence, of_controller));
        }
        for i in (0..self.lights.len()).filter(|i| !taken[*i]) {
            let junction = roads.signals().iter().find(|signal| signal.id == self.lights[i].signal_id).and_then(|signal| signal.junction);
            turns.push((junction, u32::MAX, vec![i]));
        }
        turns.sort_by_key(|(junction, sequence, _)| (*junction, *sequence));
        let mut last_junction = None;
        for (junction, _, lights) in turns {
            if junction.is_none() || junction != last_junction {
                self.groups.push(Group { turns: Vec::new(), turn: 0, stage: Stage::Green, in_stage_nanos: 0 });
            }
            last_junction = junction;
            let group_idx = self.groups.len() - 1;
            let group = &mut self.groups[group_idx];
            let first_pole_idx = group.turns.iter().map(Vec::len).sum::<usize>() as u32;
            for (pole_idx, light) in (first_pole_idx..).zip(&lights) {
                self.lights[*light].group = group_idx;
                self.lights[*light].pole_idx = pole_idx;
            }
            group.turns.push(lights);
        }
    }

    /// Lets time pass.
    pub fn step(&mut self, dt_nanos: u64) {
        if self.frozen {
            return;
        }
        self.lights.iter_mut().for_each(|light| light.in_state_nanos += dt_nanos);
        for idx in 0..self.groups.len() {
            self.groups[idx].in_stage_nanos += dt_nanos;
            while self.groups[idx].in_stage_nanos >= self.groups[idx].stage_nanos() {
                let group = &mut self.groups[idx];
                group.in_stage_nanos -= group.stage_nanos();
                group.advance();
                self.show_stage(idx);
            }
        }
    }

    /// Every light of the group shows its part of the stage.
    fn show_stage(&mut self, group_idx: usize) {
        let group = &self.groups[group_idx];
        for (turn, lights) in group.turns.iter().enumerate() {
            let state = match group.stage {
                Stage::Green if turn == group.turn => LightState::Green,
                Stage::Yellow if turn == group.turn => LightState::Yellow,
                _ => LightState::Red,
            };
            for i in lights {
                let light = &mut self.lights[*i];
                if light.state != state {
                    light.state = state;
                    light.in_state_nanos = group.in_stage_nanos;
                }
            }
        }
    }

    /// Gives one light a state; its group's timers run on. False if there is no such light.
    pub fn set_state(&mut self, actor: ActorId, state: LightState) -> bool {
        let light = self.lights.iter_mut().find(|light| light.actor == actor);
        if let Some(light) = light {
            light.state = state;
            light.in_state_nanos = 0;
            return true;
        }
        false
    }

    /// The light with this actor id.
    pub fn get(&self, actor: ActorId) -> Option<&Light> {
        self.lights.iter().find(|light| light.actor == actor)
    }

    /// Stage lengths in force: green, yellow, all red, seconds.
    pub fn stage_secs(&self) -> [f32; 3] {
        [GREEN_NANOS, YELLOW_NANOS, ALL_RED_NANOS].map(|nanos| nanos as f32 * 1e-9)
    }

    /// The light in whose box the vehicle's body stands, nearest box first.
    pub fn light_at(&self, world_from_vehicle: &Isometry3<f64>, half_m: [f64; 3]) -> Option<&Light> {
        let reach_m = half_m[0].hypot(half_m[1]) + 4.0;
        let at = world_from_vehicle.translation.vector;
        let near = |b: &StopBox| (b.world_from_box.translation.vector - at).norm_squared() < reach_m * reach_m;
        let mut best: Option<(f64, &Light)> = None;
        for light in &self.lights {
            for stop_box in light.boxes.iter().filter(|b| near(b)) {
                let distance = (stop_box.world_from_box.translation.vector - at).norm_squared();
                if best.is_none_or(|(nearest, _)| distance < nearest) && stop_box.overlaps(world_from_vehicle, half_m) {
                    best = Some((distance, light));
                }
            }
        }
        best.map(|(_, light)| light)
    }
}

impl Group {
    fn stage_nanos(&self) -> u64 {
        match self.stage {
            Stage::Green => GREEN_NANOS,
            Stage::Yellow => YELLOW_NANOS,
            Stage::AllRed => ALL_RED_NANOS,
        }
    }

    fn advance(&mut self) {
        self.stage = match self.stage {
            Stage::Green => Stage::Yellow,
            Stage::Yellow => Stage::AllRed,
            Stage::AllRed => {
                self.turn = (self.turn + 1) % self.turns.len();
                Stage::Green
            }
        };
    }
}

impl StopBox {
    /// Separating axes of two upright boxes in the plane, and at most 2 m apart in height. The vehicle must drive the lane's way.
    fn overlaps(&self, world_from_vehicle: &Isometry3<f64>, half_m: [f64; 3]) -> bool {
        let box_from_vehicle = self.world_from_box.inv_mul(world_from_vehicle);
        let along = box_from_vehicle * Vector3::x();
        let aside = box_from_vehicle * Vector3::y();
        let offset = box_from_vehicle.translation.vector;
        if offset.z.abs() > 2.0 || along.x < 0.0 {
            return false;
        }
        let reach = |axis: [f64; 2], half: [f64; 2], x: Vector3<f64>, y: Vector3<f64>| {
            half[0] * (axis[0] * x.x + axis[1] * x.y).abs() + half[1] * (axis[0] * y.x + axis[1] * y.y).abs()
        };
        [[1.0, 0.0], [0.0, 1.0], [along.x, along.y], [aside.x, aside.y]].iter().all(|axis| {
            let apart = (axis[0] * offset.x + axis[1] * offset.y).abs();
            apart <= reach(*axis, self.half_m, Vector3::x(), Vector3::y()) + reach(*axis, [half_m[0], half_m[1]], along, aside)
        })
    }
}

fn stop_box(roads: &RoadMap, stop: LanePosition) -> Option<StopBox> {
    let middle = LanePosition { s_m: (stop.s_m - STOP_BOX_UPSTREAM_M).max(0.0), offset_m: 0.0, ..stop };
    let world_from_box = roads.pose(middle)?;
    Some(StopBox { world_from_box, half_m: [STOP_BOX_HALF_M, 0.25 * roads.width_m(middle)] })
}
