//! Plays a recording back: actors are made anew where they are missing and put, tick by tick, where they were.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use consumer_kit::WorldAt;
use schema_frames::document::PoseText;
use schema_frames::{Command, CommandReply, LightState, VehicleControl, VehicleControlRecord};
use schema_types::Pose;

use super::Settings;
use super::file::{Frame, Recording};
use crate::axes::{self, Transform};
use crate::blueprints;
use crate::commander::Commander;
use crate::fields::Description;
use crate::world::Known;

/// Above this factor poses are not interpolated, as in CARLA.
const MAX_SMOOTH_FACTOR: f64 = 2.0;
/// Actors are made this far above their place, one above the other, and put there afterwards: below, something may still be in the way.
const MAKE_ABOVE_M: f64 = 200.0;
const MAKE_APART_M: f64 = 6.0;

/// What `replay_file` asks for.
#[derive(Clone, Copy, Debug)]
pub struct Wish {
    /// First second; counted from the end if negative.
    pub start_secs: f64,
    /// Seconds; 0 is up to the end.
    pub duration_secs: f64,
    /// Recorded id of the actor that the spectator follows; 0 is nobody.
    pub follow: u32,
    /// Where the spectator is on the actor that it follows.
    pub offset: Transform,
}

/// A replay that runs.
#[derive(Debug)]
pub struct Replay {
    recording: Arc<Recording>,
    wish: Wish,
    /// Settings, which calls change while it runs.
    pub settings: Settings,
    /// Ids then and now.
    ids: BTreeMap<u32, u32>,
    made: BTreeSet<u32>,
    lights: BTreeMap<u32, u32>,
    spectator: Option<u32>,
    recorded_spectator: Option<u32>,
    at_secs: f64,
    end_secs: f64,
    next_event: usize,
    n_made: usize,
}

/// Whether a replay moves actors of this type.
fn is_played(type_id: &str) -> bool {
    ["vehicle.", "walker.", "static.prop."].iter().any(|family| type_id.starts_with(family))
}

impl Replay {
    /// Makes ready: the actors that are there at the first second. Returns what CARLA says about it.
    pub fn begin(recording: Recording, wish: Wish, settings: Settings, known: &Known) -> (Replay, String) {
        let total_secs = recording.duration_secs();
        let from = if wish.start_secs < 0.0 { total_secs + wish.start_secs } else { wish.start_secs };
        let at_secs = from.clamp(0.0, total_secs);
        let end_secs = if wish.duration_secs > 0.0 { (at_secs + wish.duration_secs).min(total_secs) } else { total_secs };
        let factor = settings.time_factor;
        let text = format!(
            "Total time recorded: {total_secs:.3}\nReplaying from {at_secs:.3} s - {end_secs:.3} s ({:.3} s) at {factor:.1}x\n",
            end_secs - at_secs
        );
        let mut ids = BTreeMap::new();
        let mut lights = BTreeMap::new();
        let mut recorded_spectator = None;
        let snapshot = known.snapshot.clone();
        for (id, description) in recording.names() {
            if is_played(&description.type_id) && known.actors.get(&id).is_some_and(|actor| actor.type_id == description.type_id) {
                ids.insert(id, id);
            } else if description.type_id == "spectator" {
                recorded_spectator = Some(id);
            } else if let Some(signal) = description.attribute("opendrive_id") {
                let of_signal = |part: schema_frames::TrafficLightPart| part.opendrive_id() == signal;
                let now = snapshot.iter().flat_map(|at| &at.records).find(|record| record.traffic_light().is_some_and(of_signal));
                lights.extend(now.map(|record| (id, record.id)));
            }
        }
        let spectator = known.actors.values().find(|actor| actor.kind == "spectator").map(|actor| actor.id);
        let replay = Replay {
            recording: Arc::new(recording),
            wish,
            settings,
            ids,
            made: BTreeSet::new(),
            lights,
            spectator,
            recorded_spectator,
            at_secs,
            end_secs,
            next_event: 0,
            n_made: 0,
        };
        (replay, text)
    }

    /// Puts everything where it was at the replay's time and moves that on. False once the end was shown.
    pub fn step(&mut self, snapshot: &WorldAt, commander: &Commander) -> bool {
        let recording = self.recording.clone();
        let frame_idx = recording.frames.partition_point(|frame| frame.elapsed_secs <= self.at_secs).saturating_sub(1);
        for idx in self.next_event..=frame_idx {
            self.run_events(&recording.frames[idx], commander);
        }
        self.next_event = self.next_event.max(frame_idx + 1);
        let frame = &recording.frames[frame_idx];
        let smooth = self.settings.time_factor <= MAX_SMOOTH_FACTOR;
        let next = recording.frames.get(frame_idx + 1).filter(|_| smooth);
        self.put_actors(frame, next, snapshot, commander);
        self.put_lights(frame, snapshot, commander);
        let is_end = self.at_secs >= self.end_secs;
        let tick_secs = snapshot.header.period_nanos as f64 * 1e-9;
        self.at_secs = (self.at_secs + tick_secs * self.settings.time_factor).min(self.end_secs);
        !is_end
    }

    /// Who comes and who goes.
    fn run_events(&mut self, frame: &Frame, commander: &Commander) {
        for born in frame.born.iter().filter(|born| is_played(&born.description.type_id)) {
            if self.ids.contains_key(&born.id) {
                continue;
            }
            if self.settings.ignore_hero && born.description.attribute("role_name") == Some("hero") {
                continue;
            }
            let mut at = born.at;
            at.location_m[2] += MAKE_ABOVE_M + MAKE_APART_M * (self.n_made % 500) as f64;
            self.n_made += 1;
            match commander.ask_one(spawn(&born.description, &at)) {
                Ok((CommandReply::Spawned { actor_id, .. }, _)) => {
                    self.ids.insert(born.id, actor_id);
                    self.made.insert(actor_id);
                    simulate(actor_id, false, commander);
                }
                Ok((other, _)) => tracing::warn!(?other, "no answer to a spawn of the replay"),
                Err(error) => tracing::warn!(type_id = born.description.type_id, error, "the replay goes on without an actor"),
            }
        }
        for id in &frame.gone {
            if let Some(now) = self.ids.remove(id)
                && self.made.remove(&now)
            {
                commander.tell(Command::Destroy { actor_id: now });
            }
        }
    }

    fn put_actors(&mut self, frame: &Frame, next: Option<&Frame>, snapshot: &WorldAt, commander: &Commander) {
        let share = next.map_or(0.0, |next| (self.at_secs - frame.elapsed_secs) / (next.elapsed_secs - frame.elapsed_secs));
        let share = share.clamp(0.0, 1.0);
        let place = |id: &u32| {
            let now = frame.poses.get(id)?;
            let then = next.and_then(|next| next.poses.get(id)).unwrap_or(now);
            Some(axes::pose(&between(now, then, share)))
        };
        let mut controls = Vec::new();
        for (id, now) in &self.ids {
            let Some(pose) = place(id) else { continue };
            if !self.made.contains(now) && snapshot.actor(*now).is_some() {
                simulate(*now, false, commander);
            }
            commander.tell(Command::SetPose { actor_id: *now, pose: pose.into() });
            if let Some(pedals) = frame.pedals.get(id) {
                let control = VehicleControl {
                    throttle_ratio: pedals.throttle,
                    steer_ratio: axes::steer(pedals.steer),
                    brake_ratio: pedals.brake,
                    hand_brake: pedals.hand_brake,
                    reverse: pedals.gear < 0,
                    manual_gear_shift: false,
                    gear: pedals.gear.clamp(-1, 20) as i8,
                };
                controls.push(VehicleControlRecord::new(*now, control.clamped()));
            }
        }
        if !controls.is_empty() {
            commander.control(controls);
        }
        let followed = Some(self.wish.follow).filter(|id| *id != 0).and_then(|id| place(&id)).map(|pose| self.beside(&pose));
        let recorded = || self.recorded_spectator.filter(|_| !self.settings.ignore_spectator).and_then(|id| place(&id)).map(PoseText::from);
        if let (Some(spectator), Some(pose)) = (self.spectator, followed.or_else(recorded)) {
            commander.tell(Command::SetPose { actor_id: spectator, pose });
        }
    }

    fn put_lights(&self, frame: &Frame, snapshot: &WorldAt, commander: &Commander) {
        let is_frozen = |id: u32| snapshot.actor(id).and_then(|record| record.traffic_light()).is_some_and(|part| part.flags & 1 != 0);
        if self.lights.values().any(|id| !is_frozen(*id)) {
            commander.tell(Command::FreezeTrafficLights { frozen: true });
        }
        for (id, now) in &self.lights {
            let Some((state, _)) = frame.lights.get(id) else { continue };
            let shown = snapshot.actor(*now).and_then(|record| record.traffic_light()).map(|part| part.state);
            if shown != Some(u32::from(*state)) {
                let state = LightState::from_code(u32::from(*state)).name().to_owned();
                commander.tell(Command::SetTrafficLight { actor_id: *now, state });
            }
        }
    }

    /// Where the spectator is beside the actor that it follows.
    fn beside(&self, followed: &Pose) -> PoseText {
        Pose::from(followed.isometry() * axes::pose(&self.wish.offset).isometry()).into()
    }

    /// Gives everyone back to the engine, or takes the replay's own actors away.
    pub fn end(&self, commander: &Commander, keep_actors: bool) {
        for now in self.ids.values() {
            if !keep_actors && self.made.contains(now) {
                commander.tell(Command::Destroy { actor_id: *now });
            } else {
                simulate(*now, true, commander);
            }
        }
        if !self.lights.is_empty() {
            commander.tell(Command::FreezeTrafficLights { frozen: false });
        }
    }
}

fn spawn(description: &Description, at: &Transform) -> Command {
    Command::Spawn {
        type_id: description.type_id.clone(),
        pose: axes::pose(at).into(),
        parent_id: None,
        role: description.attribute("role_name").unwrap_or_default().to_owned(),
        attributes: blueprints::settable(description),
    }
}

/// Whether the engine moves an actor.
fn simulate(actor_id: u32, enabled: bool, commander: &Commander) {
    if !enabled {
        commander.tell(Command::SetVelocity { actor_id, velocity_in_world_mps: [0.0; 3] });
    }
}

/// Between two places: straight, and turned the short way round.
fn between(a: &Transform, b: &Transform, share: f64) -> Transform {
    let turn = |a: f64, b: f64| {
        let by = (b - a + 180.0).rem_euclid(360.0) - 180.0;
        a + by * share
    };
    Transform {
        location_m: std::array::from_fn(|i| a.location_m[i] + (b.location_m[i] - a.location_m[i]) * share),
        rotation_deg: std::array::from_fn(|i| turn(a.rotation_deg[i], b.rotation_deg[i])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halfway_is_halfway_the_short_way_round() {
        let at = |x: f64, yaw: f64| Transform { location_m: [x, 0.0, 1.0], rotation_deg: [0.0, yaw, 0.0] };
        let half = between(&at(1.0, 170.0), &at(3.0, -170.0), 0.5);
        assert_eq!(half.location_m, [2.0, 0.0, 1.0]);
        assert!((half.rotation_deg[1] - 180.0).abs() < 1e-9);
        assert_eq!(between(&at(1.0, 5.0), &at(3.0, 9.0), 0.0), at(1.0, 5.0));
    }
}
