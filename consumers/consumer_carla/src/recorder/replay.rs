//! Replays a recording: spawns the actors that are missing and moves all of them, tick by tick, to
//! their recorded poses.

use std::collections::{BTreeMap, BTreeSet};

use consumer_kit::WorldAt;
use launch_cli::logging::cut;
use schema_frames::document::PoseText;
use schema_frames::{
    Attachment, Command, CommandReply, LightState, PhysicsAction, VehicleControl,
    VehicleControlRecord, WalkerControl,
};
use schema_types::Pose;

use crate::recorder::counterparts::{Counterparts, is_played, is_sensor};
use crate::recorder::file::Recording;
use crate::recorder::frame::{Born, Frame, Pedals};
use crate::recorder::motion::{between, is_somewhere, is_upright, lead};
use crate::recorder::playback::Playback;
use crate::recorder::read_error::ReadError;
use crate::recorder::replay_changes::{bring_about, hold, let_go};
use crate::spawn::spawn_command;
use crate::state::commander::Commander;
use crate::state::known_world::Known;
use crate::wire::axes::{self, Transform};
use crate::wire::fields::Wrong;
use crate::wire::structures::LAMPS;

/// Above this factor poses are not interpolated, as in CARLA.
const MAX_SMOOTH_FACTOR: f64 = 2.0;
/// Frames of CARLA's files may have the same time; they count as this far apart, seconds.
const SHORTEST_SECS: f64 = 1e-9;
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
    playback: Playback,
    wish: Wish,
    /// Settings, which may change while the replay runs.
    pub settings: Settings,
    /// Recorded ids and the ids of the same actors in this run.
    ids: BTreeMap<u32, u32>,
    /// Recorded ids of heroes.
    heroes: BTreeSet<u32>,
    /// Recorded ids of actors that cannot be spawned.
    unknown: BTreeSet<u32>,
    /// Recorded ids of two-wheelers.
    two_wheelers: BTreeSet<u32>,
    /// Recorded ids of actors that the replay has attached to others.
    attached: BTreeSet<u32>,
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
    n_made: usize,
}

impl Replay {
    /// Prepares a replay: finds out which recorded actors exist already. Also returns CARLA's text
    /// about the replay, and sentences about what cannot be replayed.
    ///
    /// # Errors
    /// If the file was changed meanwhile and is no recording any more.
    pub fn begin(
        recording: Recording,
        wish: Wish,
        settings: Settings,
        known: &Known,
    ) -> Result<(Replay, String), ReadError> {
        let total_secs = recording.duration_secs;
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
        let found = Counterparts::find(&recording.cast, known);
        let mut text = format!(
            "Total time recorded: {total_secs:.3}\nReplaying from {at_secs:.3} s - {end_secs:.3} s ({:.3} s) at {:.1}x\n{}",
            end_secs - at_secs,
            settings.time_factor,
            found.missing
        );
        if recording.is_cut {
            text.push_str("The file ends within a frame, which is left out\n");
        }
        let spectator = known
            .actors
            .values()
            .find(|actor| actor.kind == "spectator")
            .map(|actor| actor.id);
        let replay = Replay {
            playback: Playback::begin(recording.reader)?,
            wish,
            settings,
            ids: found.ids,
            heroes: found.heroes,
            unknown: found.unknown,
            two_wheelers: found.two_wheelers,
            attached: BTreeSet::new(),
            made: Vec::new(),
            held: BTreeSet::new(),
            led: BTreeSet::new(),
            posed: BTreeSet::new(),
            lights: found.lights,
            spectator,
            recorded_spectator: found.spectator,
            at_secs,
            end_secs,
            n_made: 0,
        };
        Ok((replay, text))
    }

    /// Moves everything to its pose at the replay's current time and advances that time by a tick.
    /// Returns false once the end was shown.
    pub fn step(&mut self, snapshot: &WorldAt, commander: &Commander) -> bool {
        loop {
            match self.playback.reach(self.at_secs) {
                Ok(Some(frame)) => self.run_events(&frame, commander),
                Ok(None) => break,
                Err(error) => {
                    tracing::warn!(%error, "the replay ends here: its file has changed");
                    return false;
                }
            }
        }
        let (Some(frame), next) = self.playback.around() else {
            return false;
        };
        let smooth = self.settings.time_factor <= MAX_SMOOTH_FACTOR;
        let next = next.filter(|_| smooth);
        self.put_actors(&frame, next.as_deref(), snapshot, commander);
        self.put_lights(&frame, snapshot, commander);
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
        let is_wanted = |born: &Born| {
            let type_id = born.description.type_id.as_str();
            is_played(type_id) || self.wish.with_sensors && is_sensor(type_id)
        };
        let is_missing = |id: u32| {
            !(self.ids.contains_key(&id) || self.unknown.contains(&id) || self.is_ignored(id))
        };
        let missing = frame
            .born
            .iter()
            .filter(|born| is_wanted(born) && is_missing(born.id));
        // Attached actors need the ids of those that they are attached to.
        let (free, carried): (Vec<&Born>, Vec<&Born>) = missing.partition(|born| born.parent == 0);
        self.make(&free, frame, commander);
        self.make(&carried, frame, commander);
        for id in &frame.gone {
            self.attached.remove(id);
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
        bring_about(&frame.changes, now_of, &self.two_wheelers, commander);
    }

    /// Spawns recorded actors with one request: high above their places, or attached to their
    /// parents.
    fn make(&mut self, all: &[&Born], frame: &Frame, commander: &Commander) {
        let mut asked: Vec<&Born> = Vec::new();
        let mut commands = Vec::new();
        for born in all {
            match self.spawning(born, frame) {
                Ok(command) => {
                    commands.extend(command);
                    asked.resize(commands.len(), *born);
                }
                Err(error) => not_made(born, &error.to_string()),
            }
        }
        if commands.is_empty() {
            return;
        }
        let replies = match commander.ask(commands) {
            Ok(answer) => answer.replies,
            Err(error) => {
                return tracing::warn!(%error, n_actors = asked.len(), "the replay goes on without actors");
            }
        };
        for (born, reply) in asked.into_iter().zip(replies) {
            match reply {
                CommandReply::Spawned { actor_id, .. } => {
                    self.ids.insert(born.id, actor_id);
                    self.made.push(actor_id);
                    if born.parent != 0 {
                        self.attached.insert(born.id);
                    }
                }
                CommandReply::Refused { error } => not_made(born, &error),
                other => tracing::warn!(?other, "no answer to a spawn of the replay"),
            }
        }
    }

    /// The command that spawns a recorded actor; `None` if what it is attached to is not there, or
    /// its place is none.
    fn spawning(&mut self, born: &Born, frame: &Frame) -> Result<Option<Command>, Wrong> {
        let (mut at, mut parent) = (born.at, None);
        if !is_somewhere(&at) {
            return Ok(None);
        }
        if born.parent != 0 {
            let (Some(now), Some(carrier)) = (self.ids.get(&born.parent), frame.place(born.parent))
            else {
                return Ok(None);
            };
            if !born.on_parent {
                at = axes::transform(&Pose::from(
                    axes::pose(carrier).isometry().inverse() * axes::pose(&born.at).isometry(),
                ));
            }
            parent = Some(*now);
        } else if is_played(&born.description.type_id) {
            at.location_m[2] += MAKE_ABOVE_M + MAKE_APART_M * (self.n_made % 500) as f64;
            self.n_made += 1;
        }
        spawn_command(&born.description, &at, parent, Attachment::Rigid).map(Some)
    }

    fn put_actors(
        &mut self,
        frame: &Frame,
        next: Option<&Frame>,
        snapshot: &WorldAt,
        commander: &Commander,
    ) {
        let share = next.map_or(0.0, |next| {
            let length_secs = (next.elapsed_secs - frame.elapsed_secs).max(SHORTEST_SECS);
            ((self.at_secs - frame.elapsed_secs) / length_secs).clamp(0.0, 1.0)
        });
        let place = |id: &u32| {
            let now = frame.poses.get(id)?;
            let then = next.and_then(|next| next.poses.get(id)).unwrap_or(now);
            // A damaged file may have poses that are no numbers.
            Some(between(now, then, share)).filter(is_somewhere)
        };
        let mut controls = Vec::new();
        for (id, now) in self.ids.clone() {
            if self.is_ignored(id) {
                self.release(now, commander);
                continue;
            }
            if self.attached.contains(&id) {
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

fn not_made(born: &Born, error: &str) {
    tracing::warn!(
        type_id = %cut(&born.description.type_id),
        error = %cut(error),
        "the replay goes on without an actor"
    );
}
