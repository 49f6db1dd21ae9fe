//! What `control/world` asks of the daemon itself; the rest goes to the world.

use std::collections::BTreeMap;

use schema_bus::mono_now;
use schema_frames::{Command, CommandReply, ReplyBatch, StepMode};
use schema_types::{ActorId, Pose, Tick};

use crate::daemon::Daemon;
use crate::pace::Pace;
use crate::runtime::SensorWish;

/// Shortest and longest tick, nanoseconds: 10 kHz to 0.1 Hz.
const PERIOD_NANOS: (u64, u64) = (100_000, 10_000_000_000);
/// Shortest and longest physics sub-step, nanoseconds.
const SUBSTEP_NANOS: (u64, u64) = (100_000, 10_000_000);

/// Most ticks one cue can ask for: a day at 100 Hz; more is surely a mistake in units.
const MAX_CUE: u64 = 8_640_000;

impl Daemon {
    /// Runs everything that waits, by (client, seq), and answers.
    pub(crate) fn serve_commands(&mut self) -> anyhow::Result<()> {
        let requests = self.ports.commands.take_all()?;
        if requests.is_empty() {
            return Ok(());
        }
        for request in requests {
            let replies = match &request.batch {
                Ok(batch) => batch
                    .commands
                    .iter()
                    .map(|command| self.run_command(command))
                    .collect(),
                Err(error) => vec![refused(error)],
            };
            let answer = ReplyBatch {
                v: schema_frames::command::COMMAND_VERSION,
                epoch: self.episode.stamp.epoch.to_string(),
                tick: self.tick.0,
                replies,
            };
            if let Err(error) = self.ports.commands.reply(request, &answer) {
                tracing::warn!(%error, "an answer could not be sent");
            }
        }
        self.publish_documents()
    }

    fn run_command(&mut self, command: &Command) -> CommandReply {
        match command {
            Command::Ping => CommandReply::Pong {
                version: env!("CARGO_PKG_VERSION").into(),
            },
            Command::Step { n } => self.cue(*n),
            Command::Configure {
                mode,
                period_nanos,
                longest_substep_nanos,
            } => self.configure(*mode, *period_nanos, *longest_substep_nanos),
            Command::JoinLockstep { name } => self.join(name),
            Command::LeaveLockstep { participant } => self.leave(*participant),
            Command::ListMaps => CommandReply::Maps {
                names: self.maps.names(),
            },
            Command::StoreMap(map) => match self.maps.store(map.clone()) {
                Ok(()) => CommandReply::Done,
                Err(error) => refused(&format!("{error:#}")),
            },
            Command::LoadMap { map } => match self.load_map(map) {
                Ok(()) => CommandReply::Done,
                Err(error) => refused(&format!("{error:#}")),
            },
            Command::Counters => CommandReply::Counters {
                counters: self.counters(),
            },
            // CARLA's clients compute lane invasions themselves, and its gateway the radio.
            Command::Spawn { type_id, .. }
                if type_id.starts_with("sensor.")
                    && !simd_world::PASSIVE_SENSORS.contains(&type_id.as_str()) =>
            {
                refused(&format!(
                    "{type_id:?} is a sensor; make it with the command spawn_sensor, which says what it measures"
                ))
            }
            Command::SpawnSensor {
                type_id,
                pose,
                parent_id,
                attachment,
                interval_nanos,
                spec,
                attributes,
            } => {
                let wish = SensorWish {
                    type_id,
                    pose: Pose::from(*pose),
                    parent: parent_id.map(ActorId),
                    attachment: *attachment,
                    interval_nanos: *interval_nanos,
                    spec,
                    attributes,
                };
                self.spawn_sensor(wish)
                    .unwrap_or_else(|error| refused(&format!("{error:#}")))
            }
            Command::Destroy { actor_id } => self
                .destroy(ActorId(*actor_id))
                .unwrap_or_else(|error| refused(&format!("{error:#}"))),
            Command::SaveCheckpoint { to } => self
                .save_checkpoint(to)
                .unwrap_or_else(|error| refused(&format!("{error:#}"))),
            Command::RestoreCheckpoint { from } => self
                .restore_checkpoint(from)
                .unwrap_or_else(|error| refused(&format!("{error:#}"))),
            Command::Reset => self
                .reset()
                .unwrap_or_else(|error| refused(&format!("{error:#}"))),
            Command::CastRays { rays, all } => self
                .cast_rays(rays, *all)
                .unwrap_or_else(|error| refused(&format!("{error:#}"))),
            Command::DrawDebug { shapes } => match self.debug.draw(shapes) {
                Ok(()) => CommandReply::Done,
                Err(error) => refused(&format!("{error:#}")),
            },
            Command::ClearDebug => {
                self.debug.clear();
                CommandReply::Done
            }
            Command::Spawn { .. }
            | Command::SetPose { .. }
            | Command::SetVelocity { .. }
            | Command::ControlVehicle { .. }
            | Command::ControlWalker { .. }
            | Command::LeadWalker { .. }
            | Command::Skeleton { .. }
            | Command::Physics { .. }
            | Command::SetLamps { .. }
            | Command::SetDoors { .. }
            | Command::SetTrafficLight { .. }
            | Command::FreezeTrafficLights { .. }
            | Command::SetTrafficLightTime { .. }
            | Command::ResetTrafficLights { .. }
            | Command::LightBoxes { .. }
            | Command::SetWeather { .. }
            | Command::SetWeatherEffects { .. }
            | Command::Scenery
            | Command::ShowObjects { .. }
            | Command::ShowLayers { .. }
            | Command::SetSceneryLamps { .. }
            | Command::SetLampCycle { .. } => {
                self.ports.documents.touch_info();
                self.world.apply(command)
            }
        }
    }

    /// An actor and what is attached to it go; sensors among them end.
    fn destroy(&mut self, actor: ActorId) -> anyhow::Result<CommandReply> {
        let gone = self.world.destroy(actor)?;
        self.sensors.remove(|sensor| gone.contains(&sensor.actor))?;
        Ok(CommandReply::Done)
    }

    fn cue(&mut self, n: u64) -> CommandReply {
        if self.gate.mode() != StepMode::Stepped {
            return refused(
                "step needs stepped mode; send {\"do\":\"configure\",\"mode\":\"stepped\"} first",
            );
        }
        if !(1..=MAX_CUE).contains(&n) {
            return refused(&format!("n is {n}, but must be 1 to {MAX_CUE}"));
        }
        if std::mem::take(&mut self.running_alone) {
            tracing::info!(tick = self.tick.0, "a client steps again");
        }
        self.last_client_nanos = mono_now().0;
        CommandReply::Stepping {
            last_tick: self.gate.cue(n, self.tick.0),
        }
    }

    fn configure(
        &mut self,
        mode: Option<StepMode>,
        period_nanos: Option<u64>,
        longest_substep_nanos: Option<u64>,
    ) -> CommandReply {
        let limits = [
            ("period_nanos", period_nanos, PERIOD_NANOS),
            (
                "longest_substep_nanos",
                longest_substep_nanos,
                SUBSTEP_NANOS,
            ),
        ];
        for (name, given, (least, most)) in limits {
            if let Some(nanos) = given.filter(|nanos| !(least..=most).contains(nanos)) {
                return refused(&format!("{name} is {nanos}, but must be {least} to {most}"));
            }
        }
        if let Some(period_nanos) = period_nanos {
            self.clock.set_period(self.tick, period_nanos);
        }
        if let Some(nanos) = longest_substep_nanos {
            self.world.set_longest_substep(nanos as f64 * 1e-9);
        }
        if let Some(mode) = mode {
            self.gate.set_mode(mode, self.tick.0);
            self.running_alone = false;
            self.last_client_nanos = mono_now().0;
        }
        self.pace = Pace::new(mono_now().0, self.clock.period_nanos());
        self.ports.documents.touch_info();
        CommandReply::Done
    }

    fn join(&mut self, name: &str) -> CommandReply {
        if name.is_empty() || name.len() > 64 {
            return refused(&format!(
                "name is {name:?}, but must have 1 to 64 characters"
            ));
        }
        let Tick(last_tick) = self.tick;
        let participant = self.gate.join(name.to_owned(), last_tick);
        tracing::info!(
            name,
            participant,
            first_tick = last_tick + 1,
            "joined the lockstep"
        );
        self.ports.documents.touch_info();
        CommandReply::Joined {
            participant,
            first_tick: last_tick + 1,
        }
    }

    fn leave(&mut self, participant: u32) -> CommandReply {
        match self.gate.leave(participant) {
            Some(left) => {
                tracing::info!(name = left.name, participant, "left the lockstep");
                self.ports.documents.touch_info();
                CommandReply::Done
            }
            None => refused(&format!(
                "participant is {participant}, but nobody joined under that number"
            )),
        }
    }

    /// Counters by name; everything a test or a person needs to see that work was, or was not,
    /// done.
    fn counters(&self) -> BTreeMap<String, u64> {
        let gpu = self.sensors.gpu().counters().counts();
        let mut counters = BTreeMap::from([
            ("ticks".to_owned(), self.tick.0),
            ("late_ticks".to_owned(), self.pace.n_late()),
            ("ticks_given_up".to_owned(), self.pace.n_given_up()),
            ("controls_refused".to_owned(), self.n_controls_refused),
            ("gpu_passes".to_owned(), gpu.passes),
            ("gpu_draws".to_owned(), gpu.draws),
            ("gpu_triangles".to_owned(), gpu.triangles),
            ("gpu_copies".to_owned(), gpu.copies),
            ("gpu_submissions".to_owned(), gpu.submissions),
            ("lidar_turns".to_owned(), self.sensors.n_lidar_turns()),
        ]);
        for topic in self
            .sensors
            .sensors
            .iter()
            .flat_map(|sensor| &sensor.topics)
        {
            counters.insert(format!("sent {}", topic.name), topic.n_sent);
            counters.insert(format!("dropped {}", topic.name), topic.n_dropped);
            if topic.n_overflowed > 0 {
                counters.insert(
                    format!("events_left_out {}", topic.name),
                    topic.n_overflowed,
                );
            }
        }
        counters
    }
}

/// A refusal with its sentence.
fn refused(error: &str) -> CommandReply {
    CommandReply::Refused {
        error: error.to_owned(),
    }
}
