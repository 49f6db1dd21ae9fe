//! Replays a recording: spawns the actors that are missing and moves all of them, tick by tick, to
//! their recorded poses.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use consumer_kit::WorldAt;
use schema_frames::document::PoseText;
use schema_frames::{
    Attachment, Command, CommandReply, LightState, PhysicsAction, VehicleControl,
    VehicleControlRecord, WalkerControl,
};
use schema_types::Pose;

use crate::recorder::file::{Born, Frame, Pedals, Recording};
use crate::recorder::replay_changes::{bring_about, hold, let_go};
use crate::spawn::spawn_command;
use crate::state::commander::Commander;
use crate::state::known_world::Known;
use crate::wire::axes::{self, Transform};
use crate::wire::sensor_kinds;
use crate::wire::structures::LAMPS;

/// Above this factor poses are not interpolated, as in CARLA.
const MAX_SMOOTH_FACTOR: f64 = 2.0;
/// Actors are spawned this far above their place, one above the other, and moved there afterwards:
/// other actors may still stand in the way at the place itself.
const MAKE_ABOVE_M: f64 = 200.0;
const MAKE_APART_M: f64 = 6.0;

/// Settings of replays, which clients change by separate calls.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Recorded seconds per simulated second.
    pub time_factor: f64,
    /// Whether recorded heroes are left out.
    pub ignore_hero: bool,
    /// Whether the spectator stays where it is.
    pub ignore_spectator: bool,
}

/// The arguments of `replay_file`.
#[derive(Clone, Copy, Debug)]
pub struct Wish {
    /// First second; counted from the end if negative.
    pub start_secs: f64,
    /// Length in seconds; 0 means up to the end.
    pub duration_secs: f64,
    /// Recorded id of the actor that the spectator follows; 0 for none.
    pub follow: u32,
    /// The spectator's pose relative to the actor that it follows.
    pub offset: Transform,
    /// Whether recorded sensors are spawned, too.
    pub with_sensors: bool,
}

/// A running replay.
#[derive(Debug)]
pub struct Replay {
    recording: Arc<Recording>,
    wish: Wish,
    /// Settings, which may change while the replay runs.
    pub settings: Settings,
    /// Recorded ids and the ids of the same actors in this run.
    ids: BTreeMap<u32, u32>,
    /// Recorded ids of heroes.
    heroes: BTreeSet<u32>,
    /// Ids (of this run) of actors that the replay spawned, in that order.
    made: Vec<u32>,
    /// Vehicles whose physics the replay has switched off.
    held: BTreeSet<u32>,
    /// Walkers that the replay leads.
    led: BTreeSet<u32>,
    /// Walkers that the replay shows with recorded bones.
    posed: BTreeSet<u32>,
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
    ["vehicle.", "walker.", "static.prop."]
        .iter()
        .any(|family| type_id.starts_with(family))
}

/// Whether this type is a sensor that the gateway can spawn.
fn is_sensor(type_id: &str) -> bool {
    sensor_kinds::kind(type_id).is_some() || sensor_kinds::CLIENT_SIDE.contains(&type_id)
}

impl Replay {
    /// Prepares a replay: finds out which recorded actors exist already. Also returns CARLA's text
    /// about the replay.
    pub fn begin(
        recording: Recording,
        wish: Wish,
        settings: Settings,
        known: &Known,
    ) -> (Replay, String) {
        let total_secs = recording.duration_secs();
        let from = if wish.start_secs < 0.0 {
            total_secs + wish.start_secs
        } else {
            wish.start_secs
        };
        let at_secs = from.clamp(0.0, total_secs);
        let end_secs = if wish.duration_secs > 0.0 {
            (at_secs + wish.duration_secs).min(total_secs)
        } else {
            total_secs
        };
        let factor = settings.time_factor;
        let text = format!(
            "Total time recorded: {total_secs:.3}\nReplaying from {at_secs:.3} s - {end_secs:.3} s ({:.3} s) at {factor:.1}x\n",
            end_secs - at_secs
        );
        let mut ids = BTreeMap::new();
        let mut lights = BTreeMap::new();
        let (mut recorded_spectator, mut heroes) = (None, BTreeSet::new());
        let snapshot = known.snapshot.clone();
        for (id, description) in recording.names() {
            if description.attribute("role_name") == Some("hero") {
                heroes.insert(id);
            }
            if is_played(&description.type_id)
                && known
                    .actors
                    .get(&id)
                    .is_some_and(|actor| actor.type_id == description.type_id)
            {
                ids.insert(id, id);
            } else if description.type_id == "spectator" {
                recorded_spectator = Some(id);
            } else if let Some(signal) = description.attribute("opendrive_id") {
                let of_signal =
                    |part: schema_frames::TrafficLightPart| part.opendrive_id() == signal;
                let now = snapshot
                    .iter()
                    .flat_map(|at| &at.records)
                    .find(|record| record.traffic_light().is_some_and(of_signal));
                lights.extend(now.map(|record| (id, record.id)));
            }
        }
        let spectator = known
            .actors
            .values()
            .find(|actor| actor.kind == "spectator")
            .map(|actor| actor.id);
        let replay = Replay {
            recording: Arc::new(recording),
            wish,
            settings,
            ids,
            heroes,
            made: Vec::new(),
            held: BTreeSet::new(),
            led: BTreeSet::new(),
            posed: BTreeSet::new(),
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

    /// Moves everything to its pose at the replay's current time and advances that time by a tick.
    /// Returns false once the end was shown.
    pub fn step(&mut self, snapshot: &WorldAt, commander: &Commander) -> bool {
        let recording = self.recording.clone();
        let frame_idx = recording
            .frames
            .partition_point(|frame| frame.elapsed_secs <= self.at_secs)
            .saturating_sub(1);
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

    fn is_ignored(&self, recorded: u32) -> bool {
        self.settings.ignore_hero && self.heroes.contains(&recorded)
    }

    /// Spawns actors that appear in a frame, destroys those that disappear, and applies changes.
    fn run_events(&mut self, frame: &Frame, commander: &Commander) {
        for born in &frame.born {
            let type_id = born.description.type_id.as_str();
            let is_wanted = is_played(type_id) || self.wish.with_sensors && is_sensor(type_id);
            if is_wanted && !self.ids.contains_key(&born.id) && !self.is_ignored(born.id) {
                self.make(born, frame, commander);
            }
        }
        for id in &frame.gone {
            if let Some(now) = self.ids.remove(id)
                && let Some(at) = self.made.iter().position(|made| *made == now)
            {
                self.made.remove(at);
                self.held.remove(&now);
                self.led.remove(&now);
                self.posed.remove(&now);
                commander.tell(Command::Destroy { actor_id: now });
            }
        }
        let now_of = |id: u32| self.ids.get(&id).copied().filter(|_| !self.is_ignored(id));
        bring_about(&frame.changes, now_of, commander);
    }

    /// Spawns a recorded actor: high above its place, or attached to its parent.
    fn make(&mut self, born: &Born, frame: &Frame, commander: &Commander) {
        let (mut at, mut parent) = (born.at, None);
        if born.parent != 0 {
            let (Some(now), Some(carrier)) =
                (self.ids.get(&born.parent), frame.poses.get(&born.parent))
            else {
                return;
            };
            at = axes::transform(&Pose::from(
                axes::pose(carrier).isometry().inverse() * axes::pose(&born.at).isometry(),
            ));
            parent = Some(*now);
        } else if is_played(&born.description.type_id) {
            at.location_m[2] += MAKE_ABOVE_M + MAKE_APART_M * (self.n_made % 500) as f64;
            self.n_made += 1;
        }
        let spawn = || -> anyhow::Result<CommandReply> {
            let command = spawn_command(&born.description, &at, parent, Attachment::Rigid)?;
            Ok(commander.ask_one(command)?.0)
        };
        match spawn() {
            Ok(CommandReply::Spawned { actor_id, .. }) => {
                self.ids.insert(born.id, actor_id);
                self.made.push(actor_id);
            }
            Ok(other) => tracing::warn!(?other, "no answer to a spawn of the replay"),
            Err(error) => tracing::warn!(
                type_id = born.description.type_id,
                %error,
                "the replay goes on without an actor"
            ),
        }
    }

    fn put_actors(
        &mut self,
        frame: &Frame,
        next: Option<&Frame>,
        snapshot: &WorldAt,
        commander: &Commander,
    ) {
        let share = next.map_or(0.0, |next| {
            (self.at_secs - frame.elapsed_secs) / (next.elapsed_secs - frame.elapsed_secs)
        });
        let share = share.clamp(0.0, 1.0);
        let place = |id: &u32| {
            let now = frame.poses.get(id)?;
            let then = next.and_then(|next| next.poses.get(id)).unwrap_or(now);
            Some(between(now, then, share))
        };
        let mut controls = Vec::new();
        for (id, now) in self.ids.clone() {
            if self.is_ignored(id) {
                self.release(now, commander);
                continue;
            }
            let Some(at) = place(&id) else { continue };
            if let Some(bones) = frame.changes.bones.get(&id) {
                self.posed.insert(now);
                hold(now, bones, commander);
            }
            if let Some(gait_mps) = frame.gaits.get(&id).filter(|_| is_upright(&at)) {
                self.led.insert(now);
                commander.tell(lead(now, &at, f64::from(*gait_mps)));
                continue;
            }
            if let Some(pedals) = frame.pedals.get(&id) {
                if self.held.insert(now) {
                    simulate(now, false, commander);
                }
                controls.push(VehicleControlRecord::new(now, control(pedals).clamped()));
                put_lamps(now, frame.lamps.get(&id), snapshot, commander);
            }
            commander.tell(Command::SetPose {
                actor_id: now,
                pose: axes::pose(&at).into(),
            });
        }
        if !controls.is_empty() {
            commander.control(controls);
        }
        let place = |id: &u32| place(id).map(|at| axes::pose(&at));
        let followed = Some(self.wish.follow)
            .filter(|id| *id != 0)
            .and_then(|id| place(&id))
            .map(|pose| self.beside(&pose));
        let recorded = || {
            self.recorded_spectator
                .filter(|_| !self.settings.ignore_spectator)
                .and_then(|id| place(&id))
                .map(PoseText::from)
        };
        if let (Some(spectator), Some(pose)) = (self.spectator, followed.or_else(recorded)) {
            commander.tell(Command::SetPose {
                actor_id: spectator,
                pose,
            });
        }
    }

    fn put_lights(&self, frame: &Frame, snapshot: &WorldAt, commander: &Commander) {
        let is_frozen = |id: u32| {
            snapshot
                .actor(id)
                .and_then(|record| record.traffic_light())
                .is_some_and(|part| part.flags & 1 != 0)
        };
        if self.lights.values().any(|id| !is_frozen(*id)) {
            commander.tell(Command::FreezeTrafficLights { frozen: true });
        }
        for (id, now) in &self.lights {
            let Some(light) = frame.lights.get(id) else {
                continue;
            };
            let shown = snapshot
                .actor(*now)
                .and_then(|record| record.traffic_light())
                .map(|part| part.state);
            if shown != Some(u32::from(light.state)) {
                let state = LightState::from_code(u32::from(light.state))
                    .name()
                    .to_owned();
                commander.tell(Command::SetTrafficLight {
                    actor_id: *now,
                    state,
                });
            }
        }
    }

    /// The spectator's pose beside the actor that it follows.
    fn beside(&self, followed: &Pose) -> PoseText {
        Pose::from(followed.isometry() * axes::pose(&self.wish.offset).isometry()).into()
    }

    /// Switches a vehicle's physics on again.
    fn release(&mut self, now: u32, commander: &Commander) {
        if self.held.remove(&now) {
            simulate(now, true, commander);
        }
    }

    /// Ends the replay: physics is switched on again and walkers stop. Unless `keep_actors`, actors
    /// that the replay spawned are destroyed.
    pub fn end(mut self, commander: &Commander, keep_actors: bool) {
        if !keep_actors {
            // Attached actors were spawned after their parents, so they are destroyed first.
            for now in std::mem::take(&mut self.made).into_iter().rev() {
                self.held.remove(&now);
                self.led.remove(&now);
                self.posed.remove(&now);
                commander.tell(Command::Destroy { actor_id: now });
            }
        }
        for actor_id in std::mem::take(&mut self.posed) {
            let_go(actor_id, commander);
        }
        for actor_id in std::mem::take(&mut self.led) {
            let control = WalkerControl {
                direction: [1.0, 0.0, 0.0],
                speed_mps: 0.0,
                jump: false,
            };
            commander.tell(Command::ControlWalker { actor_id, control });
        }
        for now in std::mem::take(&mut self.held) {
            simulate(now, true, commander);
        }
        if !self.lights.is_empty() {
            commander.tell(Command::FreezeTrafficLights { frozen: false });
        }
    }
}

/// Switches a vehicle's physics. Without physics, a vehicle's velocity follows from how it is
/// moved, and it starts with that velocity when physics is switched on again.
fn simulate(actor_id: u32, enabled: bool, commander: &Commander) {
    commander.tell(Command::Physics {
        actor_id,
        action: PhysicsAction::SetSimulated { enabled },
    });
}

fn put_lamps(actor_id: u32, lamps: Option<&u32>, snapshot: &WorldAt, commander: &Commander) {
    let shown = snapshot
        .actor(actor_id)
        .and_then(|record| record.vehicle())
        .map(|part| part.lamps);
    if let Some(lamps) = lamps.filter(|lamps| shown != Some(**lamps)) {
        commander.tell(Command::SetLamps {
            actor_id,
            lamps: lamps & LAMPS,
        });
    }
}

fn control(pedals: &Pedals) -> VehicleControl {
    VehicleControl {
        throttle_ratio: pedals.throttle,
        steer_ratio: axes::steer(pedals.steer),
        brake_ratio: pedals.brake,
        hand_brake: pedals.hand_brake,
        reverse: pedals.gear < 0,
        manual_gear_shift: false,
        gear: pedals.gear.clamp(-1, 20) as i8,
    }
}

/// Whether a walker stands: then it is led to its place. One that lies was knocked over.
fn is_upright(at: &Transform) -> bool {
    const TILT_DEG: f64 = 1.0;
    let [pitch, _, roll] = at.rotation_deg;
    pitch.abs() < TILT_DEG && roll.abs() < TILT_DEG
}

fn lead(actor_id: u32, at: &Transform, speed_mps: f64) -> Command {
    Command::LeadWalker {
        actor_id,
        ground_point_m: axes::mirror(at.location_m),
        yaw_rad: axes::pose(at).yaw_rad(),
        speed_mps,
    }
}

/// Interpolates two poses: along a straight line, and turning the short way round.
fn between(a: &Transform, b: &Transform, share: f64) -> Transform {
    let turn = |a: f64, b: f64| {
        let by = (b - a + 180.0).rem_euclid(360.0) - 180.0;
        a + by * share
    };
    Transform {
        location_m: std::array::from_fn(|i| {
            a.location_m[i] + (b.location_m[i] - a.location_m[i]) * share
        }),
        rotation_deg: std::array::from_fn(|i| turn(a.rotation_deg[i], b.rotation_deg[i])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halfway_is_halfway_the_short_way_round() {
        let at = |x: f64, yaw: f64| Transform {
            location_m: [x, 0.0, 1.0],
            rotation_deg: [0.0, yaw, 0.0],
        };
        let half = between(&at(1.0, 170.0), &at(3.0, -170.0), 0.5);
        assert_eq!(half.location_m, [2.0, 0.0, 1.0]);
        assert!((half.rotation_deg[1] - 180.0).abs() < 1e-9);
        assert_eq!(between(&at(1.0, 5.0), &at(3.0, 9.0), 0.0), at(1.0, 5.0));
    }
}
