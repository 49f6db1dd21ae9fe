//! Sensors made by a command while the world runs.

use std::collections::BTreeMap;
use std::rc::Rc;

use anyhow::{Context as _, bail, ensure};
use schema_bus::names;
use schema_frames::{Attachment, CommandReply};
use schema_types::{ActorId, Pose};
use sensor_core::schedule::Schedule;
use sensor_spec::SensorSpec;

use crate::cli::LidarsOnArg;
use crate::daemon::Daemon;
use crate::rig::{Rig, Sensor, SensorPlace, TopicOptions, noise_stream};

/// Sensors that may exist at a time: each is a handful of files and services.
const MAX_SENSORS: usize = 512;

/// What a command asks for.
pub struct SensorWish<'a> {
    /// Catalogue id to be listed under.
    pub type_id: &'a str,
    /// World pose, or pose on the parent.
    pub pose: Pose,
    /// What it rides on.
    pub parent: Option<ActorId>,
    /// How it follows it.
    pub attachment: Attachment,
    /// Time between firings; 0 is every tick.
    pub interval_nanos: u64,
    /// Keys of a launch file's sensor.
    pub spec: &'a serde_json::Map<String, serde_json::Value>,
    /// Kept for `world/actors`.
    pub attributes: &'a BTreeMap<String, String>,
}

impl Daemon {
    /// Makes the actor and its topics. The topics have no memory until somebody reads them.
    pub(crate) fn spawn_sensor(&mut self, wish: SensorWish<'_>) -> anyhow::Result<CommandReply> {
        ensure!(
            self.sensors.sensors.len() < MAX_SENSORS,
            "there are {MAX_SENSORS} sensors already, which is the most; destroy one first"
        );
        let spec = self.read_spec(wish.spec)?;
        let actor = self
            .world
            .spawn(wish.type_id, wish.pose, wish.parent, "", wish.attributes)?;
        let made = self
            .world
            .set_attachment(actor, wish.attachment)
            .map_err(anyhow::Error::from);
        match made.and_then(|()| self.open_sensor(&wish, spec, actor)) {
            Ok(topics) => Ok(CommandReply::Spawned {
                actor_id: actor.0,
                topics,
            }),
            Err(error) => {
                self.world
                    .destroy(actor)
                    .context("the sensor's actor could not be taken back")?;
                Err(error)
            }
        }
    }

    fn open_sensor(
        &mut self,
        wish: &SensorWish<'_>,
        spec: SensorSpec,
        actor: ActorId,
    ) -> anyhow::Result<Vec<String>> {
        let name = wish
            .parent
            .map_or("free".to_owned(), |parent| format!("actor_{parent}"));
        let rig = match self
            .sensors
            .sensors
            .iter()
            .find(|sensor| sensor.rig.name == name)
        {
            Some(sensor) => sensor.rig.clone(),
            None => Rc::new(Rig {
                wake: self.bus.notifier(&names::rig_tick(&name))?,
                name,
            }),
        };
        let pose = self
            .world
            .record(actor)
            .map(|record| record.world_from_actor)
            .unwrap_or_default();
        let keys =
            serde_json::to_vec(&spec).context("the sensor's specification cannot be written")?;
        let stream = noise_stream(&[&keys, bytemuck::bytes_of(&pose)]);
        let place = SensorPlace {
            rig,
            place: None,
            name: format!("s{actor}"),
            actor,
            stream,
        };
        let options = TopicOptions {
            frames_in_flight: self.args.frames_in_flight,
            staged: self.args.staged,
            lidars_on_gpu: self.args.lidars_on == Some(LidarsOnArg::Gpu),
            seed: self.launch.scenario.seed,
            on_demand: true,
            period_nanos: self.clock.period_nanos(),
        };
        let schedule = Schedule::new(self.clock.time_of(self.tick), wish.interval_nanos);
        let sensor = Sensor::open(
            &self.bus,
            self.sensors.gpu(),
            place,
            spec,
            schedule,
            &options,
        )?;
        self.world.set_topics(actor, sensor.topic_infos())?;
        let topics = sensor
            .topics
            .iter()
            .map(|topic| topic.name.clone())
            .collect();
        self.sensors.add(sensor, &self.episode.assets);
        Ok(topics)
    }

    /// The specification as a launch file would have it. Its rate is the command's business and its
    /// mount the pose's.
    fn read_spec(
        &self,
        keys: &serde_json::Map<String, serde_json::Value>,
    ) -> anyhow::Result<SensorSpec> {
        for foreign in ["mount", "rate_hz"] {
            if keys.contains_key(foreign) {
                bail!(
                    "the specification has {foreign:?}, which the command says itself (pose, interval_nanos); leave it out"
                );
            }
        }
        let tick_hz = 1e9 / self.clock.period_nanos() as f64;
        let mut keys = keys.clone();
        let kind = keys
            .get("kind")
            .and_then(|kind| kind.as_str())
            .unwrap_or("");
        if SensorSpec::default_of(kind).is_some_and(|spec| spec.rate_hz().is_some()) {
            keys.insert("rate_hz".into(), tick_hz.into());
        }
        let spec: SensorSpec = serde_json::from_value(keys.into())
            .context("the sensor's specification cannot be read")?;
        if let Err(errors) = spec.check(tick_hz) {
            let sentences: Vec<String> = errors.iter().map(ToString::to_string).collect();
            bail!(
                "the sensor's specification cannot be used: {}",
                sentences.join("; ")
            );
        }
        Ok(spec)
    }
}
