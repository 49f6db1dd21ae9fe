//! Calls about the session: version, settings, ticking, maps, blueprints.

use std::time::Duration;

use schema_bus::mono_now;
use schema_frames::{Command, CommandReply, StepMode};

use crate::gateway::Gateway;
use crate::list;
use crate::rpc::call::{Call, Calls};
use crate::rpc::maps::{LAYERED, carla_map, is_layered, own_map};
use crate::state::blueprints;
use crate::state::commander::answer::CommandError;
use crate::state::settings::Settings;
use crate::wire::axes;
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, CARLA_VERSION, Failure, Outcome};
use crate::wire::streams::is_world;
use crate::wire::structures;

/// Longest wait for documents that the simulator publishes after it has answered.
const SETTLE: Duration = Duration::from_secs(5);

pub(crate) const CALLS: Calls = &[
    ("version", |_, _| Ok(Answer::Value(CARLA_VERSION.into()))),
    ("get_episode_info", |gateway, call| {
        episode_info(gateway, call.connection)
    }),
    ("get_sensor_token", |gateway, call| {
        let stream = call.u32()?;
        if !is_world(stream) {
            gateway.feeds.expect(stream, call.connection);
        }
        Ok(Answer::Value(gateway.token(stream)))
    }),
    ("get_episode_settings", |gateway, _| get_settings(gateway)),
    ("set_episode_settings", set_settings),
    ("tick_cue", |gateway, call| {
        tick_cue(gateway, call.connection)
    }),
    ("load_new_episode", load),
    ("get_map_info", |gateway, _| map_info(gateway)),
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

/// A client that has just loaded a world is told the episode that it left, as CARLA's server does,
/// which answers before its map has changed: the first snapshot then shows another episode, and by
/// that the client notices that its Traffic Managers need the new map.
fn episode_info(gateway: &Gateway, connection: u64) -> Outcome {
    gateway.info()?;
    let left = gateway.feeds.world_stream().take_left(connection);
    let id = left.or_else(|| gateway.world.known().episode_id());
    let id = id.ok_or_else(|| {
        Failure::Refused("world/info carries an epoch that is no number".to_owned())
    })?;
    Ok(Answer::Value(list![id, gateway.world_token(connection)]))
}

fn get_settings(gateway: &Gateway) -> Outcome {
    let info = gateway.info()?;
    let settings = gateway.settings.lock().clone();
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

fn set_settings(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let info = gateway.info()?;
    let mut given = call.fields("the settings")?;
    let (synchronous, no_rendering, delta) = (
        given.bool()?,
        given.bool()?,
        given.optional_f64()?.filter(|secs| *secs > 0.0),
    );
    let own_period_nanos = gateway
        .settings
        .lock()
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
    let (_, tick) = configure(
        gateway,
        mode,
        period_nanos,
        settings.longest_substep_nanos(),
    )?;
    for sentence in settings.differences(period_nanos) {
        tracing::warn!("{sentence}");
    }
    gateway.feeds.set_no_rendering(no_rendering);
    *gateway.settings.lock() = settings;
    Ok(Answer::Value(tick.into()))
}

fn configure(
    gateway: &Gateway,
    mode: StepMode,
    period_nanos: u64,
    longest_substep_nanos: u64,
) -> Result<(CommandReply, u64), CommandError> {
    let done = gateway.commander.ask_one(Command::Configure {
        mode: Some(mode),
        period_nanos: Some(period_nanos),
        longest_substep_nanos: Some(longest_substep_nanos),
    })?;
    // `world/info` follows later, but a client that asks at once must see the new settings.
    gateway.world.change(|known| {
        if let Some(info) = &mut known.info {
            (info.mode, info.period_nanos) = (mode, period_nanos);
        }
    });
    Ok(done)
}

pub(crate) fn tick_cue(gateway: &Gateway, connection: u64) -> Outcome {
    gateway.drives(connection);
    if gateway.info()?.mode == StepMode::FreeRunning {
        return Ok(Answer::Value((gateway.world.tick() + 1).into()));
    }
    // The simulator answers a step once the previous tick is fully published. A reader holds two
    // ticks before it loses one, so it is enough to wait for readers here.
    let mut last_step_nanos = gateway.last_step_nanos.lock();
    gateway.feeds.settle(*last_step_nanos, connection);
    let stepped = gateway.commander.ask_one(Command::Step { n: 1 });
    *last_step_nanos = mono_now().0;
    drop(last_step_nanos);
    match stepped {
        Ok((CommandReply::Stepping { last_tick }, _)) => Ok(Answer::Value(last_tick.into())),
        // The world may have begun to run by itself, and `world/info` said so too late.
        Err(refused @ CommandError::Refused(_)) => {
            let runs = gateway.world.wait_for(SETTLE, |known| {
                let info = known.info.as_ref()?;
                (info.mode == StepMode::FreeRunning).then_some(())
            });
            runs.ok_or(refused)?;
            Ok(Answer::Value((gateway.world.tick() + 1).into()))
        }
        Err(other) => Err(other.into()),
        Ok((other, _)) => Err(Failure::Refused(format!(
            "{other:?} is no answer to a step"
        ))),
    }
}

/// Loads a map. The client closes its world stream afterwards and crashes if it handles a snapshot
/// at that moment, so its stream is silenced first.
fn load(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let streams = gateway.feeds.world_stream();
    let retired = streams.retire(call.connection);
    let left = gateway.world.known().episode_id();
    let loaded = load_map(gateway, call);
    if let (Some(left), Ok(_)) = (left, &loaded) {
        streams.note_left(call.connection, left);
    }
    match (retired, &loaded) {
        (Some(old), Err(_)) => streams.restore(call.connection, old),
        (Some(old), Ok(_)) => old.leave(),
        (None, _) => {}
    }
    loaded
}

fn load_map(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (asked, reset_settings, layers) = (call.text()?, call.bool()?, call.u16()?);
    let info = gateway.info()?;
    let map = if asked.is_empty() {
        info.map.as_str()
    } else {
        own_map(asked)
    };
    let loaded = gateway.commander.ask_one(Command::LoadMap {
        map: map.to_owned(),
    });
    loaded.map_err(|error| format!("Map '{asked}' not found ({error})"))?;
    if !asked.is_empty() {
        *gateway.layered_map.lock() = is_layered(asked).then(|| map.to_owned());
    }
    // The new episode's first `world/info` still has the old mode: if it came after the settings are
    // reset below, it would be taken for the new one.
    if !gateway.world.knows_episode_after(info.episode, SETTLE) {
        let sentence = "the simulator loaded the map and published no new episode";
        return Err(Failure::Refused(sentence.to_owned()));
    }
    if reset_settings {
        let period_nanos = gateway
            .settings
            .lock()
            .own_period_nanos
            .unwrap_or(info.period_nanos);
        let settings = Settings {
            own_period_nanos: Some(period_nanos),
            ..Settings::default()
        };
        configure(
            gateway,
            StepMode::FreeRunning,
            period_nanos,
            settings.longest_substep_nanos(),
        )?;
        *gateway.settings.lock() = settings;
        gateway.feeds.set_no_rendering(false);
    }
    if layers != u16::MAX {
        gateway.commander.ask_one(Command::ShowLayers {
            layers: !layers,
            shown: false,
        })?;
    }
    Ok(Answer::Void)
}

fn map_info(gateway: &Gateway) -> Outcome {
    let info = gateway.info()?;
    let points = gateway.world.known().spawn_points.clone();
    let points: Vec<Value> = points
        .points
        .iter()
        .map(|pose| structures::transform(&axes::transform(&(*pose).into())))
        .collect();
    let mut name = carla_map(&info.map);
    if gateway.layered_map.lock().as_ref() == Some(&info.map) {
        name.push_str(LAYERED);
    }
    Ok(Answer::Value(list![name, points]))
}
