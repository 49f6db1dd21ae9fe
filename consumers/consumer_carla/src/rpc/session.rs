//! Calls about the session: version, settings, ticking, maps, blueprints.

use std::time::Duration;

use schema_bus::mono_now;
use schema_frames::{Command, CommandReply, StepMode, WorldInfo};

use crate::axes;
use crate::blueprints;
use crate::gateway::{Answer, CARLA_VERSION, Failure, Gateway, Outcome, lock};
use crate::list;
use crate::msgpack::Value;
use crate::rpc::maps::{carla_map, own_map};
use crate::rpc::{Call, Calls};
use crate::shapes;
use crate::stream::is_world;

/// Longest wait for what the simulator publishes after it answered.
const SETTLE: Duration = Duration::from_secs(5);

/// Longest and shortest physics sub-step of the simulator, seconds; the longest is CARLA's default
/// too.
const SUBSTEP_SECS: (f64, f64) = (1e-4, 0.01);

/// What CARLA's settings have beside the mode and the length of a tick.
#[derive(Clone, Debug)]
pub struct Settings {
    no_rendering: bool,
    /// Whether a client fixed the length of a tick; Gantry's is always fixed.
    fixed: bool,
    /// Length of a tick before the first client fixed another, to go back to.
    own_period_nanos: Option<u64>,
    substepping: bool,
    max_substep_secs: f64,
    max_substeps: i32,
    max_culling_distance_m: f32,
    deterministic_ragdolls: bool,
    tile_stream_distance_m: f32,
    actor_active_distance_m: f32,
    spectator_as_ego: bool,
}

impl Settings {
    /// Physics' longest sub-step. CARLA's physics does one step per tick without sub-steps and
    /// falls behind where they are too few for a
    /// tick; here a tick is always done whole, in as many sub-steps as that takes.
    fn longest_substep_nanos(&self) -> u64 {
        let (least, most) = SUBSTEP_SECS;
        let asked = if self.substepping {
            self.max_substep_secs
        } else {
            most
        };
        // What is no length at all asks for none.
        let taken = if asked > 0.0 {
            asked.clamp(least, most)
        } else {
            most
        };
        (taken * 1e9).round() as u64
    }

    /// What is done otherwise than these settings ask for; a sentence each.
    fn differences(&self, period_nanos: u64) -> Vec<String> {
        let mut sentences = Vec::new();
        if !self.substepping {
            return sentences;
        }
        let (given, (least, most)) = (self.max_substep_secs, SUBSTEP_SECS);
        if !(least..=most).contains(&given) {
            let taken = self.longest_substep_nanos() as f64 * 1e-9;
            sentences.push(format!(
                "max_substep_delta_time is {given} s; {taken} s is taken: give {least} to {most}"
            ));
        }
        let (tick_secs, reach_secs) = (
            period_nanos as f64 * 1e-9,
            given * f64::from(self.max_substeps),
        );
        if tick_secs > reach_secs + 1e-9 {
            let n = self.max_substeps;
            sentences.push(format!(
                "a tick of {tick_secs} s is longer than max_substeps ({n}) × max_substep_delta_time ({given} s); more sub-steps are done"
            ));
        }
        sentences
    }
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            no_rendering: false,
            fixed: false,
            own_period_nanos: None,
            substepping: true,
            max_substep_secs: 0.01,
            max_substeps: 10,
            max_culling_distance_m: 0.0,
            deterministic_ragdolls: true,
            tile_stream_distance_m: 3000.0,
            actor_active_distance_m: 2000.0,
            spectator_as_ego: true,
        }
    }
}

pub(crate) const CALLS: Calls = &[
    ("version", |_, _| Ok(Answer::Value(CARLA_VERSION.into()))),
    ("get_episode_info", |gateway, call| {
        gateway.episode_info(call.connection)
    }),
    ("get_sensor_token", |gateway, call| {
        let stream = call.u32()?;
        if !is_world(stream) {
            gateway.feeds.expect(stream);
        }
        Ok(Answer::Value(gateway.token(stream)))
    }),
    ("get_episode_settings", |gateway, _| gateway.get_settings()),
    ("set_episode_settings", Gateway::set_settings),
    ("tick_cue", |gateway, call| {
        gateway.tick_cue(call.connection)
    }),
    ("load_new_episode", Gateway::load),
    ("get_map_info", |gateway, _| gateway.map_info()),
    ("get_map_data", |gateway, _| {
        gateway
            .info()
            .map(|_| Answer::Value(gateway.world.known().map.as_ref().into()))
    }),
    ("get_actor_definitions", |gateway, _| {
        Ok(Answer::Value(blueprints::definitions(
            &gateway.world.known().catalogue.clone(),
        )))
    }),
];

impl Gateway {
    /// `world/info`, which may still be on its way when the gateway has just started.
    pub(crate) fn info(&self) -> Result<WorldInfo, Failure> {
        let info = self.world.wait_for(SETTLE, |known| known.info.clone());
        info.ok_or_else(|| {
            Failure::Refused(
                "no simulator runs on this domain; start one with `gantry up`".to_owned(),
            )
        })
    }

    fn episode_info(&self, connection: u64) -> Outcome {
        self.info()?;
        let id = self.world.known().episode_id();
        let id = id.ok_or_else(|| {
            Failure::Refused("world/info carries an epoch that is no number".to_owned())
        })?;
        Ok(Answer::Value(list![id, self.world_token(connection)]))
    }

    fn get_settings(&self) -> Outcome {
        let info = self.info()?;
        let settings = lock(&self.settings).clone();
        let is_stepped = info.mode == StepMode::Stepped;
        let fixed = settings.fixed || is_stepped && settings.own_period_nanos.is_none();
        let delta = if fixed {
            list![true, info.period_nanos as f64 * 1e-9]
        } else {
            list![false]
        };
        Ok(Answer::Value(list![
            is_stepped,
            settings.no_rendering,
            delta,
            settings.substepping,
            settings.max_substep_secs,
            settings.max_substeps,
            settings.max_culling_distance_m,
            settings.deterministic_ragdolls,
            settings.tile_stream_distance_m,
            settings.actor_active_distance_m,
            settings.spectator_as_ego,
        ]))
    }

    fn set_settings(&self, call: &mut Call<'_>) -> Outcome {
        let info = self.info()?;
        let mut given = call.fields("the settings")?;
        let (synchronous, no_rendering, delta) = (
            given.bool()?,
            given.bool()?,
            given.optional_f64()?.filter(|secs| *secs > 0.0),
        );
        let own_period_nanos = lock(&self.settings)
            .own_period_nanos
            .unwrap_or(info.period_nanos);
        let settings = Settings {
            no_rendering,
            fixed: delta.is_some(),
            own_period_nanos: Some(own_period_nanos),
            substepping: given.bool()?,
            max_substep_secs: given.f64()?,
            max_substeps: given.i32()?,
            max_culling_distance_m: given.f32()?,
            deterministic_ragdolls: given.bool()?,
            tile_stream_distance_m: given.f32()?,
            actor_active_distance_m: given.f32()?,
            spectator_as_ego: given.bool()?,
        };
        let period_nanos = delta.map_or(own_period_nanos, |secs| {
            (secs * 1e9).round().min(u64::MAX as f64) as u64
        });
        let mode = if synchronous {
            StepMode::Stepped
        } else {
            StepMode::FreeRunning
        };
        let (_, tick) = self.configure(mode, period_nanos, settings.longest_substep_nanos())?;
        for sentence in settings.differences(period_nanos) {
            tracing::warn!("{sentence}");
        }
        self.feeds.set_no_rendering(no_rendering);
        *lock(&self.settings) = settings;
        Ok(Answer::Value(tick.into()))
    }

    fn configure(
        &self,
        mode: StepMode,
        period_nanos: u64,
        longest_substep_nanos: u64,
    ) -> Result<(CommandReply, u64), String> {
        let done = self.commander.ask_one(Command::Configure {
            mode: Some(mode),
            period_nanos: Some(period_nanos),
            longest_substep_nanos: Some(longest_substep_nanos),
        })?;
        // The document follows; who asks at once must see it.
        self.world.change(|known| {
            if let Some(info) = &mut known.info {
                (info.mode, info.period_nanos) = (mode, period_nanos);
            }
        });
        Ok(done)
    }

    pub(crate) fn tick_cue(&self, connection: u64) -> Outcome {
        self.drives(connection);
        if self.info()?.mode == StepMode::FreeRunning {
            return Ok(Answer::Value((self.world.tick() + 1).into()));
        }
        // The simulator answers when all of the tick before is published; two ticks fit before a
        // reader loses one.
        let mut last_step_nanos = lock(&self.last_step_nanos);
        self.feeds.settle(*last_step_nanos);
        let stepped = self.commander.ask_one(Command::Step { n: 1 });
        *last_step_nanos = mono_now().0;
        match stepped? {
            (CommandReply::Stepping { last_tick }, _) => Ok(Answer::Value(last_tick.into())),
            (other, _) => Err(Failure::Refused(format!(
                "{other:?} is no answer to a step"
            ))),
        }
    }

    /// The client closes its world stream afterwards, and must not be at work on a snapshot then.
    fn load(&self, call: &mut Call<'_>) -> Outcome {
        let streams = self.feeds.streams();
        let retired = streams.retire(call.connection);
        let loaded = self.load_map(call);
        match (retired, &loaded) {
            (Some(place), Err(_)) => streams.restore(call.connection, place),
            (Some(place), Ok(_)) => place.leave(),
            (None, _) => {}
        }
        loaded
    }

    fn load_map(&self, call: &mut Call<'_>) -> Outcome {
        let (asked, reset_settings, layers) = (call.text()?, call.bool()?, call.u16()?);
        let info = self.info()?;
        let map = if asked.is_empty() {
            info.map.as_str()
        } else {
            own_map(asked)
        };
        let loaded = self.commander.ask_one(Command::LoadMap {
            map: map.to_owned(),
        });
        loaded.map_err(|error| format!("Map '{asked}' not found ({error})"))?;
        if reset_settings {
            let period_nanos = lock(&self.settings)
                .own_period_nanos
                .unwrap_or(info.period_nanos);
            let settings = Settings {
                own_period_nanos: Some(period_nanos),
                ..Settings::default()
            };
            self.configure(
                StepMode::FreeRunning,
                period_nanos,
                settings.longest_substep_nanos(),
            )?;
            *lock(&self.settings) = settings;
            self.feeds.set_no_rendering(false);
        }
        let begun = self.world.wait_for(SETTLE, |known| {
            known
                .info
                .as_ref()
                .filter(|now| now.episode > info.episode)
                .map(drop)
        });
        begun.ok_or_else(|| {
            Failure::Refused("the simulator loaded the map and published no new episode".to_owned())
        })?;
        if layers != u16::MAX {
            self.commander.ask_one(Command::ShowLayers {
                layers: !layers,
                shown: false,
            })?;
        }
        Ok(Answer::Void)
    }

    fn map_info(&self) -> Outcome {
        let info = self.info()?;
        let points = self.world.known().spawn_points.clone();
        let points: Vec<Value> = points
            .points
            .iter()
            .map(|pose| shapes::transform(&axes::transform(&(*pose).into())))
            .collect();
        Ok(Answer::Value(list![carla_map(&info.map), points]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn substeps_outside_of_what_physics_takes_are_the_nearest_inside_and_said() {
        let tick_nanos = 50_000_000;
        for (given, substepping, taken_nanos, said) in [
            (0.01, true, 10_000_000, ""),
            (
                1e-4,
                true,
                100_000,
                "a tick of 0.05 s is longer than max_substeps (499)",
            ),
            (
                1e-5,
                true,
                100_000,
                "max_substep_delta_time is 0.00001 s; 0.0001 s is taken: give 0.0001 to 0.01",
            ),
            (
                0.0,
                true,
                10_000_000,
                "max_substep_delta_time is 0 s; 0.01 s is taken",
            ),
            (
                -1.0,
                true,
                10_000_000,
                "max_substep_delta_time is -1 s; 0.01 s is taken",
            ),
            (
                f64::NAN,
                true,
                10_000_000,
                "max_substep_delta_time is NaN s; 0.01 s is taken",
            ),
            (
                0.05,
                true,
                10_000_000,
                "max_substep_delta_time is 0.05 s; 0.01 s is taken",
            ),
            (0.05, false, 10_000_000, ""),
        ] {
            let max_substeps = if given == 1e-4 { 499 } else { 1_000_000_000 };
            let settings = Settings {
                substepping,
                max_substep_secs: given,
                max_substeps,
                ..Settings::default()
            };
            assert_eq!(
                settings.longest_substep_nanos(),
                taken_nanos,
                "{given} {substepping}"
            );
            let sentences = settings.differences(tick_nanos).join("\n");
            assert!(
                if said.is_empty() {
                    sentences.is_empty()
                } else {
                    sentences.contains(said)
                },
                "{given} {substepping}: {sentences}"
            );
        }
    }
}
