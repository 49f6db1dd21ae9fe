//! Traffic lights: the stages of each junction's controllers, and which light a vehicle stands at.
//!
//! The default times are CARLA's: a controller is green for 10 s, yellow for 3 s, then all are red
//! for 2 s, then the junction's next controller is green. Each controller's three times can be set.
//! Time is counted in whole nanoseconds, so a stage ends in exactly the tick that completes it.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use nalgebra::Isometry3;
use schema_frames::LightState;
use schema_roads::{RoadMap, SignalKind};
use schema_types::ActorId;
use serde::{Deserialize, Serialize};

use crate::errors::LightError;

use super::box_grid::BoxGrid;
use super::stop_box::{STOP_BOX_HALF_WIDTH_RATIO, STOP_BOX_UPSTREAM_M, StopBox, stop_box};

/// Lengths of the stages green, yellow, all red.
const STAGE_NANOS: [u64; 3] = [10_000_000_000, 3_000_000_000, 2_000_000_000];
/// Shortest and longest stage that can be set, seconds.
const STAGE_SECS: (f64, f64) = (0.01, 1e5);

/// One traffic light.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct TrafficLight {
    pub actor: ActorId,
    #[serde(with = "crate::serde_forms::shared")]
    pub signal_id: Arc<str>,
    pub state: LightState,
    pub in_state_nanos: u64,
    /// Index of its group.
    pub group: usize,
    /// Index within its group.
    pub pole_idx: u32,
    /// Boxes before its stop lines; their x axis points along the lane.
    #[serde(with = "crate::serde_forms::shared")]
    boxes: Arc<[StopBox]>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Stage {
    Green,
    Yellow,
    AllRed,
}

/// One controller: lights that switch together, and for how long.
#[derive(Clone, Serialize, Deserialize)]
struct Turn {
    #[serde(with = "crate::serde_forms::shared")]
    lights: Arc<[usize]>,
    /// Lengths of the stages green, yellow, all red.
    stage_nanos: [u64; 3],
}

/// The controllers of one junction, which take turns.
#[derive(Clone, Serialize, Deserialize)]
struct Group {
    turns: Vec<Turn>,
    turn: usize,
    stage: Stage,
    in_stage_nanos: u64,
}

/// Light and number of every box, and where the boxes are.
type BoxesByPlace = (Vec<(usize, usize)>, BoxGrid);

/// All lights of a map.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct TrafficLights {
    pub lights: Vec<TrafficLight>,
    pub frozen: bool,
    groups: Vec<Group>,
    /// Boxes of all lights by place, made when they are first looked for.
    #[serde(skip)]
    near: OnceLock<Arc<BoxesByPlace>>,
}

/// What a checkpoint says of a light or a junction, and no map has.
#[derive(Debug)]
pub(crate) struct WrongLight {
    pub what: String,
    pub value: String,
    pub allowed: String,
}

impl TrafficLights {
    /// Checks lights that were read from a checkpoint against those of the same map, whose places
    /// they take over; `actors` are the lights' actors in their order, and no light has been in its
    /// state for longer than `max_nanos`.
    ///
    /// # Errors
    /// The first value that cannot be.
    pub fn check(
        &mut self,
        of_map: &TrafficLights,
        actors: &[ActorId],
        max_nanos: u64,
    ) -> Result<(), WrongLight> {
        let refuse = |what: String, value: String, allowed: String| {
            Err(WrongLight {
                what,
                value,
                allowed,
            })
        };
        let counts = [
            ("traffic lights", self.lights.len(), of_map.lights.len()),
            (
                "junctions with lights",
                self.groups.len(),
                of_map.groups.len(),
            ),
            ("actors of lights", actors.len(), of_map.lights.len()),
        ];
        for (of, found, needed) in counts {
            if found != needed {
                let what = format!("the number of {of}");
                return refuse(what, found.to_string(), format!("{needed}, as on the map"));
            }
        }
        let lights = self.lights.iter_mut().zip(&of_map.lights).zip(actors);
        for ((light, expected), actor) in lights {
            if light.actor != *actor || light.signal_id != expected.signal_id {
                let what = "the actor of a traffic light".to_owned();
                let allowed = format!("{actor}, for signal {:?}", expected.signal_id);
                return refuse(what, light.actor.to_string(), allowed);
            }
            if light.in_state_nanos > max_nanos {
                let what = format!("the time that light {actor} has been in its state");
                let value = format!("{} ns", light.in_state_nanos);
                return refuse(what, value, format!("at most {max_nanos} ns"));
            }
            (light.group, light.pole_idx) = (expected.group, expected.pole_idx);
            light.boxes.clone_from(&expected.boxes);
        }
        let longest_nanos = (STAGE_SECS.1 * 1e9) as u64;
        for (group, expected) in self.groups.iter_mut().zip(&of_map.groups) {
            if group.turns.len() != expected.turns.len() || group.turn >= group.turns.len() {
                let what = "the turn of a junction's lights".to_owned();
                let value = format!("{} of {}", group.turn, group.turns.len());
                let allowed = format!("one of the {} of the map", expected.turns.len());
                return refuse(what, value, allowed);
            }
            let lengths = group.turns.iter().flat_map(|turn| turn.stage_nanos);
            let mut times = lengths.chain([group.in_stage_nanos.max(1)]);
            if let Some(nanos) = times.find(|nanos| !(1..=longest_nanos).contains(nanos)) {
                let what = "the length of a stage of traffic lights".to_owned();
                let allowed = format!("1 to {longest_nanos} ns");
                return refuse(what, format!("{nanos} ns"), allowed);
            }
            for (turn, expected) in group.turns.iter_mut().zip(&expected.turns) {
                turn.lights.clone_from(&expected.lights);
            }
        }
        Ok(())
    }

    /// The lights of the map's signals; `next_actor` gives each its id. Every group begins with its
    /// first controller green.
    pub fn new(roads: &RoadMap, mut next_actor: impl FnMut() -> ActorId) -> TrafficLights {
        let mut all = TrafficLights::default();
        for signal in roads
            .signals()
            .iter()
            .filter(|signal| signal.kind == SignalKind::TrafficLight)
        {
            let boxes = signal
                .stops
                .iter()
                .filter_map(|stop| {
                    stop_box(
                        roads,
                        stop.stop,
                        STOP_BOX_UPSTREAM_M,
                        STOP_BOX_HALF_WIDTH_RATIO,
                    )
                })
                .collect();
            all.lights.push(TrafficLight {
                actor: next_actor(),
                signal_id: signal.id.as_str().into(),
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

    /// Makes the groups of [`RoadMap::light_groups`].
    fn group(&mut self, roads: &RoadMap) {
        let is_light = |idx: &usize| roads.signals()[*idx].kind == SignalKind::TrafficLight;
        let number_of: BTreeMap<usize, usize> = (0..roads.signals().len())
            .filter(is_light)
            .enumerate()
            .map(|(light, signal)| (signal, light))
            .collect();
        for group in roads.light_groups() {
            let group_idx = self.groups.len();
            let mut pole_idx = 0;
            let mut turns = Vec::new();
            for signals in group.turns {
                let lights: Arc<[usize]> = signals.iter().map(|signal| number_of[signal]).collect();
                for light in lights.iter() {
                    self.lights[*light].group = group_idx;
                    self.lights[*light].pole_idx = pole_idx;
                    pole_idx = u32::saturating_add(pole_idx, 1);
                }
                turns.push(Turn {
                    lights,
                    stage_nanos: STAGE_NANOS,
                });
            }
            self.groups.push(Group {
                turns,
                turn: 0,
                stage: Stage::Green,
                in_stage_nanos: 0,
            });
        }
    }

    /// Advances the stages.
    pub fn step(&mut self, dt_nanos: u64) {
        if self.frozen {
            return;
        }
        self.lights
            .iter_mut()
            .for_each(|light| light.in_state_nanos = light.in_state_nanos.saturating_add(dt_nanos));
        for idx in 0..self.groups.len() {
            let group = &mut self.groups[idx];
            group.in_stage_nanos = group.in_stage_nanos.saturating_add(dt_nanos);
            while let group = &mut self.groups[idx]
                && let Some(left) = group.in_stage_nanos.checked_sub(group.stage_nanos())
            {
                group.in_stage_nanos = left;
                group.advance();
                self.show_stage(idx);
            }
        }
    }

    /// Sets each light of a group to its state in the group's stage.
    fn show_stage(&mut self, group_idx: usize) {
        let group = &self.groups[group_idx];
        for (turn, Turn { lights, .. }) in group.turns.iter().enumerate() {
            let state = match group.stage {
                Stage::Green if turn == group.turn => LightState::Green,
                Stage::Yellow if turn == group.turn => LightState::Yellow,
                _ => LightState::Red,
            };
            for i in lights.iter() {
                let light = &mut self.lights[*i];
                if light.state != state {
                    light.state = state;
                    light.in_state_nanos = group.in_stage_nanos;
                }
            }
        }
    }

    /// Restarts a group: the first controller green, all elapsed times 0. The controllers keep
    /// their set times.
    pub fn reset_group(&mut self, group_idx: usize) {
        let group = &mut self.groups[group_idx];
        (group.turn, group.stage, group.in_stage_nanos) = (0, Stage::Green, 0);
        self.show_stage(group_idx);
        self.lights
            .iter_mut()
            .filter(|light| light.group == group_idx)
            .for_each(|light| light.in_state_nanos = 0);
    }

    /// Restarts every group.
    pub fn reset_all(&mut self) {
        (0..self.groups.len()).for_each(|group| self.reset_group(group));
    }

    /// Sets for how long a light's controller shows a state. A running stage takes the new length
    /// at once.
    ///
    /// # Errors
    /// What is wrong with the state or the time.
    pub fn set_time(
        &mut self,
        actor: ActorId,
        state: LightState,
        secs: f64,
    ) -> Result<(), LightError> {
        let stage = match state {
            LightState::Green => 0,
            LightState::Yellow => 1,
            LightState::Red => 2,
            other => {
                return Err(LightError::UntimedState(other.name()));
            }
        };
        if !(STAGE_SECS.0..=STAGE_SECS.1).contains(&secs) {
            let (low, high) = STAGE_SECS;
            return Err(LightError::Secs { secs, low, high });
        }
        let idx = self.idx_of(actor).ok_or(LightError::NotALight(actor))?;
        let group = &mut self.groups[self.lights[idx].group];
        if let Some(turn) = group
            .turns
            .iter_mut()
            .find(|turn| turn.lights.contains(&idx))
        {
            turn.stage_nanos[stage] = (secs * 1e9).round() as u64;
        }
        Ok(())
    }

    fn idx_of(&self, actor: ActorId) -> Option<usize> {
        // Actors are made in the order of the lights, with rising ids.
        self.lights
            .binary_search_by_key(&actor, |light| light.actor)
            .ok()
    }

    /// Gives one light a state; its group's timers go on. Returns whether there is such a light.
    pub fn set_state(&mut self, actor: ActorId, state: LightState) -> bool {
        if let Some(idx) = self.idx_of(actor) {
            let light = &mut self.lights[idx];
            light.state = state;
            light.in_state_nanos = 0;
            return true;
        }
        false
    }

    /// Whether the actors of its lights are those of `other`.
    pub fn has_actors_of(&self, other: &TrafficLights) -> bool {
        let actor = |light: &TrafficLight| light.actor;
        (self.lights.iter().map(actor)).eq(other.lights.iter().map(actor))
    }

    /// The light with this actor id.
    pub fn get(&self, actor: ActorId) -> Option<&TrafficLight> {
        self.idx_of(actor).map(|idx| &self.lights[idx])
    }

    /// Stage lengths of a light's controller: green, yellow, all red, seconds.
    pub fn stage_secs(&self, light: &TrafficLight) -> [f32; 3] {
        let turns = &self.groups[light.group].turns;
        let first = |turn: &&Turn| {
            turn.lights
                .iter()
                .any(|idx| self.lights[*idx].actor == light.actor)
        };
        turns
            .iter()
            .find(first)
            .map_or(STAGE_NANOS, |turn| turn.stage_nanos)
            .map(|nanos| (nanos as f64 * 1e-9) as f32)
    }

    /// The light whose box the vehicle's body overlaps; of several, the one with the nearest box.
    pub fn light_at(
        &self,
        world_from_vehicle: &Isometry3<f64>,
        half_m: [f64; 3],
    ) -> Option<&TrafficLight> {
        let at = world_from_vehicle.translation.vector;
        let near = self.near.get_or_init(|| Arc::new(self.boxes_by_place()));
        let (owners, grid) = &**near;
        let mut best: Option<(f64, &TrafficLight)> = None;
        for number in grid.near(&at) {
            let (light, stop_box) = owners[number];
            let light = &self.lights[light];
            let stop_box = &light.boxes[stop_box];
            let distance = (stop_box.world_from_box.translation.vector - at).norm_squared();
            if best.is_none_or(|(nearest, _)| distance < nearest)
                && stop_box.overlaps(world_from_vehicle, half_m)
            {
                best = Some((distance, light));
            }
        }
        best.map(|(_, light)| light)
    }

    /// Light and number of every box, and where the boxes are.
    fn boxes_by_place(&self) -> BoxesByPlace {
        let owners: Vec<(usize, usize)> = (0..self.lights.len())
            .flat_map(|light| (0..self.lights[light].boxes.len()).map(move |b| (light, b)))
            .collect();
        let middles = owners.iter().map(|(light, b)| {
            self.lights[*light].boxes[*b]
                .world_from_box
                .translation
                .vector
        });
        let grid = BoxGrid::new(middles);
        (owners, grid)
    }
}

impl Group {
    fn stage_nanos(&self) -> u64 {
        self.turns[self.turn].stage_nanos[self.stage as usize]
    }

    fn advance(&mut self) {
        self.stage = match self.stage {
            Stage::Green => Stage::Yellow,
            Stage::Yellow => Stage::AllRed,
            Stage::AllRed => {
                self.turn = self.turn.saturating_add(1);
                if self.turn >= self.turns.len() {
                    self.turn = 0;
                }
                Stage::Green
            }
        };
    }
}
