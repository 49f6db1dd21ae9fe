//! The processes of a chain, started and watched by `gantry up` in a domain of their own, and the
//! world as it is when every trial begins.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use launch_cli::wrong_usage;
use launch_run::{Launched, Note, Watch, Watched as _};
use launch_spec::{FileText, Launch, RestartPolicy};
use schema_bus::{Bus, CommandClient, ControlWriter, names};
use schema_frames::command::CheckpointPlace;
use schema_frames::{
    ActorKind, ActorList, Catalogue, Command, CommandBatch, CommandReply, VehicleControlRecord,
};
use schema_types::Pose;

use super::observer::{Log, OWN_WRITER, Observer};
use super::scene::{Light, Road, light_ahead};
use super::steering::{Course, control};
use super::suite::{Drive, Kind, Suite};

/// Name of the truth camera in the launch file.
const CAMERA: &str = "reaction_truth";
/// Name of the checkpoint that every trial begins with.
const CHECKPOINT: &str = "reaction";
/// Longest wait for the simulator to have built its town.
const START: Duration = Duration::from_secs(300);
/// Longest wait for an answer of the simulator.
pub const ANSWER: Duration = Duration::from_secs(20);
/// Simulated time in which engines and programs come into their stride, seconds.
const RUN_UP_SECS: f64 = 2.0;
/// Longest wait for a tick of a simulator that runs, wall clock.
pub const STILL: Duration = Duration::from_secs(20);

/// The launch file of a run, checked.
#[derive(Clone, Debug)]
pub struct Chain {
    launch: toml::Table,
    /// `ego/reaction_truth`, below which the truth camera publishes.
    pub camera_topic: String,
    /// Length of a tick, simulated seconds.
    pub tick_secs: f64,
}

impl Chain {
    /// Reads the launch files of a suite and adds the truth camera, restarts, and the program of
    /// `-- CMD…` if there is one.
    ///
    /// # Errors
    /// [`wrong_usage`] for what is wrong with them.
    pub fn read(suite: &Suite, command: &[String]) -> anyhow::Result<Chain> {
        let mut read = |path: &Path| FileText::read(path);
        let launch = Launch::load(&suite.launch, &[], &mut read)
            .map_err(|errors| wrong_usage(errors.to_string()))?;
        let all: toml::Table = launch
            .to_toml_with_defaults()
            .parse()
            .context("the launch file cannot be read back")?;
        let mut overlay = suite.overlay.clone();
        let tick_hz = overlay
            .get("scenario")
            .and_then(|scenario| scenario.get("tick_hz"))
            .and_then(|hz| hz.as_float().or(hz.as_integer().map(|hz| hz as f64)))
            .unwrap_or(launch.scenario.tick_hz);
        let sensor = all
            .get("sensor")
            .and_then(|sensors| sensors.get(&suite.truth.sensor))
            .or_else(|| overlay.get("sensor")?.get(&suite.truth.sensor))
            .ok_or_else(|| {
                let names: Vec<&str> = launch.sensors.keys().map(String::as_str).collect();
                wrong_usage(format!(
                    "truth.sensor is {:?}, but the launch files have only {}",
                    suite.truth.sensor,
                    names.join(", ")
                ))
            })?;
        let mut camera = toml::Table::new();
        let modalities: &[&str] = match suite.truth.min_luma {
            0 => &["instance"],
            _ => &["instance", "rgb"],
        };
        let mut set = |key: &str, value: toml::Value| drop(camera.insert(key.to_owned(), value));
        set("kind", "camera".into());
        set("modalities", modalities.to_vec().into());
        set("rate_hz", tick_hz.into());
        set("width_px", i64::from(suite.truth.width_px).into());
        set("height_px", i64::from(suite.truth.height_px).into());
        set("fov_deg", suite.truth.fov_deg.into());
        if let Some(mount) = sensor.get("mount") {
            set("mount", mount.clone());
        }
        overlay.insert("version".into(), 1.into());
        section(&mut overlay, "sensor")?.insert(CAMERA.into(), camera.into());
        section(&mut overlay, "scenario")?.insert("mode".into(), "free_running".into());
        let processes = section(&mut overlay, "process")?;
        if !command.is_empty() {
            let mut program = toml::Table::new();
            program.insert("cmd".into(), command.to_vec().into());
            let here = std::env::current_dir().context("there is no working folder")?;
            program.insert("cwd".into(), here.to_string_lossy().into_owned().into());
            program.insert("after".into(), vec!["simd"].into());
            processes.insert("program".into(), program.into());
        }
        // A program that crashes must not end trials that run for hours.
        let never = |it: &&launch_spec::Process| {
            !it.is_daemon() && it.restart.policy == RestartPolicy::Never
        };
        let mut restarted: Vec<String> = launch
            .processes
            .iter()
            .filter(never)
            .map(|it| it.name.clone())
            .collect();
        restarted.extend(
            processes
                .keys()
                .filter(|name| launch.process(name).is_none())
                .cloned(),
        );
        for name in restarted {
            let process = section(processes, &name)?;
            if !process.contains_key("restart") {
                let restart = toml::toml! { policy = "always" delay = "200ms" factor = 1.0 max = 100000 window = "60s" };
                process.insert("restart".into(), restart.into());
            }
        }
        if !launch.processes.iter().any(|it| it.is_simulator()) {
            return Err(wrong_usage(
                "the launch files of the suite start no simulator; they need a process with cmd = [\"simd\"]",
            ));
        }
        let mut included = Vec::new();
        for file in &suite.launch {
            included.push(std::path::absolute(file)?.to_string_lossy().into_owned());
        }
        overlay.insert("include".into(), included.into());
        Ok(Chain {
            launch: overlay,
            camera_topic: format!("ego/{CAMERA}"),
            tick_secs: 1.0 / tick_hz,
        })
    }
}

/// The table `key` of a launch file, made if it is missing.
fn section<'t>(table: &'t mut toml::Table, key: &str) -> anyhow::Result<&'t mut toml::Table> {
    table
        .entry(key)
        .or_insert_with(|| toml::Table::new().into())
        .as_table_mut()
        .ok_or_else(|| wrong_usage(format!("overlay: {key} must be a table")))
}

/// A chain that runs, with the world as every trial finds it.
#[derive(Debug)]
pub struct Session {
    // Ports go before the processes.
    /// What is watched.
    pub observer: Observer,
    client: CommandClient,
    writer: ControlWriter,
    /// The bus.
    pub bus: Bus,
    up: Launched,
    /// The road.
    pub road: Road,
    /// The ego vehicle.
    pub ego: u32,
    /// What can be spawned.
    pub catalogue: Catalogue,
    /// The light ahead, if the suite needs one.
    pub light: Option<Light>,
}

impl Session {
    /// Starts the processes, waits for them, brings the ego up to speed, and saves the checkpoint.
    /// `stop` is asked several times a second.
    ///
    /// # Errors
    /// If anything does not come up, with what was said last.
    pub fn start(
        chain: &Chain,
        suite: &Suite,
        folder: &Path,
        domain: &str,
        stop: &dyn Fn() -> bool,
    ) -> anyhow::Result<Session> {
        let mut up = Launched::start(domain, &chain.launch, folder)?;
        let bus = Bus::open(domain, "gantry-bench")?;
        let mut watch = Watch {
            watched: &mut up,
            stop,
        };
        watch.until(START, "the simulator did not start", &mut || {
            Ok(bus.exists(names::WORLD_SNAPSHOT) && bus.daemon_alive()?)
        })?;
        let observer = Observer::open(&bus, suite, &chain.camera_topic)?;
        let mut session = Session {
            client: bus.command_client("reaction")?,
            writer: bus.control_writer(OWN_WRITER)?,
            road: Road {
                world_from_road: nalgebra::Isometry3::identity(),
            },
            ego: 0,
            catalogue: Catalogue::default(),
            light: None,
            observer,
            up,
            bus,
        };
        session.catalogue = session.document(names::WORLD_CATALOGUE, stop)?;
        session.await_programs(suite, stop)?;
        session.set_up(suite, stop)?;
        Ok(session)
    }

    /// A document of the simulator.
    fn document<T: serde::de::DeserializeOwned>(
        &mut self,
        name: &str,
        stop: &dyn Fn() -> bool,
    ) -> anyhow::Result<T> {
        let document = Watch {
            watched: &mut self.up,
            stop,
        }
        .document(&self.bus, name, START)?;
        document
            .json()
            .with_context(|| format!("cannot read {name}"))
    }

    /// Waits until every topic that is watched has a living writer.
    ///
    /// # Errors
    /// A sentence with those that have none.
    pub fn await_programs(&mut self, suite: &Suite, stop: &dyn Fn() -> bool) -> anyhow::Result<()> {
        let within = Duration::from_secs_f64(suite.ready_s);
        let start = Instant::now();
        loop {
            self.bus.clean_dead_nodes();
            let silent = self.observer.silent(&self.bus)?;
            if silent.is_empty() {
                return Ok(());
            }
            self.up.must_run()?;
            if stop() {
                bail!("stopped");
            }
            if start.elapsed() > within {
                bail!(
                    "nobody publishes {} after {} s; is a program of the chain missing, or does it publish under another name?",
                    silent.join(", "),
                    suite.ready_s
                );
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Finds ego, road and light, drives for a moment, and saves the checkpoint.
    fn set_up(&mut self, suite: &Suite, stop: &dyn Fn() -> bool) -> anyhow::Result<()> {
        let actors: ActorList = self.document(names::WORLD_ACTORS, stop)?;
        let ego = actors.actors.iter().find(|it| it.role == "ego_vehicle");
        self.ego = ego
            .context("the world has no ego vehicle; the launch file says [ego] type_id = \"none\"")?
            .id;
        let mut log = Log::default();
        log.cast.ego = self.ego;
        self.until(suite, &mut log, stop, &mut |_, log| {
            log.newest().is_some_and(|(_, tick)| tick.ego.is_some())
        })?;
        let ego = log
            .newest()
            .and_then(|(_, tick)| tick.ego)
            .context("the ego vanished")?;
        self.road = Road::ahead_of(&ego);
        if suite.n_trials(Kind::LightTurnsRed) > 0 {
            let world = self.bus.snapshot_reader()?;
            self.light = Some(self.find_light(world, &actors, stop)?);
        }
        let start: Pose = self.road.at(0.0, 0.0, 0.0, 0.0).into();
        let speed = Command::SetVelocity {
            actor_id: self.ego,
            velocity_in_world_mps: self.road.velocity(suite.speed_mps),
        };
        self.ask(vec![speed.clone()])?;
        let from = log.newest().map_or(0, |(_, tick)| tick.sim_nanos);
        self.until(suite, &mut log, stop, &mut |session, log| {
            session.cruise(suite, log);
            let now = log.newest().map_or(0, |(_, tick)| tick.sim_nanos);
            now.saturating_sub(from) as f64 * 1e-9 >= RUN_UP_SECS
        })?;
        self.ask(vec![
            Command::SetPose {
                actor_id: self.ego,
                pose: start.into(),
            },
            speed,
            Command::SaveCheckpoint {
                to: CheckpointPlace::Name(CHECKPOINT.into()),
            },
        ])?;
        Ok(())
    }

    fn find_light(
        &mut self,
        mut world: schema_bus::SnapshotReader,
        actors: &ActorList,
        stop: &dyn Fn() -> bool,
    ) -> anyhow::Result<Light> {
        let mut records = Vec::new();
        let mut watch = Watch {
            watched: &mut self.up,
            stop,
        };
        watch.until(STILL, "no snapshot came", &mut || {
            if let Some(snapshot) = world.latest()? {
                records = snapshot.records().to_vec();
            }
            Ok(!records.is_empty())
        })?;
        let lights: Vec<_> = records
            .iter()
            .filter(|it| it.kind == ActorKind::TrafficLight as u16)
            .filter_map(|it| Some((actors.actors.iter().find(|info| info.id == it.id)?, it)))
            .collect();
        light_ahead(&self.road, &lights).ok_or_else(|| {
            wrong_usage(
                "no traffic light holds on the lane ahead of the ego's spawn point; choose another one, or leave out [kind.light_turns_red]",
            )
        })
    }

    /// The commands that bring the world back to the checkpoint.
    pub fn back(&self) -> Command {
        Command::RestoreCheckpoint {
            from: CheckpointPlace::Name(CHECKPOINT.into()),
        }
    }

    /// Sends commands; returns the last finished tick and the replies.
    ///
    /// # Errors
    /// If the simulator does not answer, or refuses one.
    pub fn ask(&mut self, commands: Vec<Command>) -> anyhow::Result<(u64, Vec<CommandReply>)> {
        let answer = self.client.request(&CommandBatch::new(commands), ANSWER)?;
        for reply in &answer.replies {
            if let CommandReply::Refused { error } = reply {
                bail!(Refused(error.clone()));
            }
        }
        Ok((answer.tick, answer.replies))
    }

    /// Writes controls for the next tick.
    pub fn steer(&mut self, log: &Log, courses: &[(u32, Course)]) {
        let Some((tick, at)) = log.newest() else {
            return;
        };
        let records: Vec<VehicleControlRecord> = courses
            .iter()
            .filter_map(|(id, course)| {
                let car = [at.ego, at.subject]
                    .into_iter()
                    .flatten()
                    .find(|it| it.id == *id)?;
                Some(VehicleControlRecord::new(
                    *id,
                    control(&self.road, &car, course),
                ))
            })
            .collect();
        if !records.is_empty()
            && let Err(error) = self.writer.send(tick, &records)
        {
            tracing::debug!(%error, "a control was not sent");
        }
    }

    fn cruise(&mut self, suite: &Suite, log: &Log) {
        if suite.drive == Drive::Cruise {
            let course = Course {
                y_m: 0.0,
                speed_mps: suite.speed_mps,
                brake_ratio: None,
            };
            self.steer(log, &[(self.ego, course)]);
        }
    }

    /// Looks at the bus until `done`, which is asked once for every new tick.
    ///
    /// # Errors
    /// If the processes end, or no tick comes for a long time.
    pub fn until(
        &mut self,
        suite: &Suite,
        log: &mut Log,
        stop: &dyn Fn() -> bool,
        done: &mut dyn FnMut(&mut Session, &Log) -> bool,
    ) -> anyhow::Result<()> {
        let mut newest = log.newest().map(|(tick, _)| tick);
        let (mut last, mut checked) = (Instant::now(), Instant::now());
        loop {
            self.observer.rest_and_look(&self.bus, suite, log)?;
            let now = log.newest().map(|(tick, _)| tick);
            if now != newest {
                (newest, last) = (now, Instant::now());
                if done(self, log) {
                    return Ok(());
                }
            }
            if checked.elapsed() > Duration::from_millis(50) {
                checked = Instant::now();
                self.up.must_run()?;
                if stop() {
                    bail!("stopped");
                }
                if last.elapsed() > STILL {
                    bail!("no tick came for {} s", STILL.as_secs());
                }
            }
        }
    }

    /// Sentences about processes that ended since the last call.
    ///
    /// # Errors
    /// If the launcher's notes cannot be read.
    pub fn deaths(&mut self) -> anyhow::Result<Vec<String>> {
        let notes = self.up.look()?;
        Ok(notes
            .into_iter()
            .filter_map(|note| match note {
                Note::Ended { process, how } => Some(format!("{process} ended with {how}")),
                Note::Started { .. } | Note::Restarting { .. } | Note::GaveUp { .. } => None,
            })
            .collect())
    }
}

/// A command that the simulator refused; the session goes on.
#[derive(Debug)]
pub struct Refused(pub String);

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the simulator refused: {}", self.0)
    }
}

impl std::error::Error for Refused {}
