//! A simulator in a sandbox for tests of users' programs: it steps, runs programs, and hands out
//! frames, results and snapshots.

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;
use schema_bus::{
    Bus, CommandClient, Document, Frame, FrameReader, ResultReader, ResultSample, Snapshot,
};
use schema_frames::{ActorKind, ActorRecord, Command, CommandReply};
use schema_types::Pose;

use crate::client;
use crate::patience::eventually;
use crate::process::Process;
use crate::sandbox::{Sandbox, find_program};

/// What a [`Simulator`] runs: a launch file with changes. The world stands still between the steps
/// of the test unless `scenario.mode` is set otherwise.
#[derive(Clone, Debug)]
pub struct Setup {
    launch: PathBuf,
    text: Option<String>,
    sets: Vec<String>,
    words: Vec<String>,
    programs: Option<PathBuf>,
}

impl Setup {
    /// The scenario and the sensors of a launch file; its processes are not started.
    pub fn file(launch: impl Into<PathBuf>) -> Setup {
        Setup {
            launch: launch.into(),
            text: None,
            sets: vec!["scenario.mode=\"stepped\"".into()],
            words: Vec::new(),
            programs: None,
        }
    }

    /// The same with the text of a launch file.
    pub fn text(launch: impl Into<String>) -> Setup {
        Setup {
            text: Some(launch.into()),
            ..Setup::file("launch.toml")
        }
    }

    /// Changes a value of the launch file, in TOML: `sensor.front.width_px=160`.
    pub fn set(mut self, assignment: impl Into<String>) -> Setup {
        self.sets.push(assignment.into());
        self
    }

    /// Another word on `simd`'s command line.
    pub fn word(mut self, word: impl Into<String>) -> Setup {
        self.words.push(word.into());
        self
    }

    /// Folder of Gantry's programs, see [`find_program`] for where they are looked for without it.
    pub fn programs(mut self, folder: impl Into<PathBuf>) -> Setup {
        self.programs = Some(folder.into());
        self
    }
}

/// A running simulator on a bus of its own, with the test as a client.
///
/// Every function waits for what it returns, and panics with the output of the simulator if it ends.
#[derive(Debug)]
pub struct Simulator {
    // Before `bus`: ports go before their node.
    commands: CommandClient,
    bus: Bus,
    daemon: Process,
    sandbox: Sandbox,
}

impl Simulator {
    /// Starts `simd`, and waits until the world is there.
    ///
    /// # Panics
    /// If there is no `simd` or it ends, with its output.
    pub fn start(setup: Setup) -> Simulator {
        let sandbox = Sandbox::new("simulator");
        let launch = match &setup.text {
            Some(text) => sandbox.write("launch.toml", text),
            None => std::path::absolute(&setup.launch).expect("the path is not empty"),
        };
        let launch = launch.to_str().expect("paths of launch files are text");
        let mut words = vec!["--launch", launch, "--domain", sandbox.domain()];
        for assignment in &setup.sets {
            words.extend(["--set", assignment]);
        }
        words.extend(setup.words.iter().map(String::as_str));
        let simd = find_program("simd", setup.programs.as_deref());
        let mut daemon = sandbox.spawn_program("simd", &simd, &words, &[]);
        daemon.wait_line("ready");
        let bus = client::join_bus(&sandbox, "test");
        let commands = bus
            .command_client("test")
            .unwrap_or_else(|error| panic!("{error}"));
        Simulator {
            commands,
            bus,
            daemon,
            sandbox,
        }
    }

    /// The domain, which programs that [`Simulator::run`] starts have in `GANTRY_DOMAIN`.
    pub fn domain(&self) -> &str {
        self.sandbox.domain()
    }

    /// The test's own place on the bus, for other ports.
    pub fn bus(&self) -> &Bus {
        &self.bus
    }

    /// The sandbox.
    pub fn sandbox(&self) -> &Sandbox {
        &self.sandbox
    }

    /// The process of the simulator.
    pub fn daemon(&mut self) -> &mut Process {
        &mut self.daemon
    }

    /// Runs a program on the simulator's bus, in the sandbox's folder.
    pub fn run(&self, program: impl AsRef<Path>, args: &[&str]) -> Process {
        self.start_program(program.as_ref(), args, |name, program, args, env| {
            self.sandbox.spawn_program(name, program, args, env)
        })
    }

    /// As [`Simulator::run`], in a folder of links to all that is in `folder`, see
    /// [`Sandbox::links_to`].
    pub fn run_in(&self, folder: &Path, program: impl AsRef<Path>, args: &[&str]) -> Process {
        let place = self.sandbox.links_to(folder);
        self.start_program(program.as_ref(), args, |name, program, args, env| {
            self.sandbox.spawn_at(&place, name, program, args, env)
        })
    }

    fn start_program(
        &self,
        program: &Path,
        args: &[&str],
        start: impl FnOnce(&str, &Path, &[&str], &[(&str, &str)]) -> Process,
    ) -> Process {
        let name = program.file_name().unwrap_or(program.as_os_str());
        let env = [("GANTRY_DOMAIN", self.sandbox.domain())];
        start(&name.to_string_lossy(), program, args, &env)
    }

    /// Sends a command, and returns its answer.
    pub fn ask(&mut self, command: Command) -> CommandReply {
        client::ask(&mut self.commands, command)
    }

    /// Lets `n` ticks pass, and returns the number of the last when everything of it was sent.
    pub fn step(&mut self, n: u64) -> u64 {
        client::step(&mut self.commands, n)
    }

    /// Waits for a topic of frames, and opens it. Open it before the step whose frame is wanted: a
    /// sensor without readers does not fire.
    pub fn frames(&mut self, topic: &str) -> FrameReader {
        let what = format!("topic {topic} appears");
        self.wait_for(&what, |bus| bus.frame_reader(topic).ok())
    }

    /// Waits for a topic of results, and opens it.
    pub fn results(&mut self, topic: &str) -> ResultReader {
        let what = format!("topic {topic} appears");
        self.wait_for(&what, |bus| bus.result_reader(topic).ok())
    }

    /// Waits until a topic has `n` readers, for example the test and a program that it started.
    pub fn wait_readers(&mut self, topic: &str, n: usize) {
        self.wait_for(&format!("{topic} has {n} readers"), |bus| {
            let topics = bus.topics().ok()?;
            let found = topics.iter().find(|found| found.name == topic)?;
            (found.subscribers >= n).then_some(())
        });
    }

    /// Waits for the frame of `tick`, past those before it.
    ///
    /// # Panics
    /// If a later one comes: the sensor does not fire at every tick, or the frame was lost.
    pub fn frame_of(&mut self, reader: &mut FrameReader, tick: u64) -> Frame {
        let what = format!("the frame of tick {tick} on {}", reader.topic());
        self.wait_for(&what, |_| {
            let frame = reader.next().unwrap_or_else(|error| panic!("{error}"))?;
            not_later(frame.header().tick, tick, frame.topic()).then_some(frame)
        })
    }

    /// Waits for the result of `tick`, past those before it.
    ///
    /// # Panics
    /// If a later one comes.
    pub fn result_of(&mut self, reader: &mut ResultReader, tick: u64) -> ResultSample {
        let what = format!("the result of tick {tick} on {}", reader.topic());
        self.wait_for(&what, |_| {
            let result = reader.next().unwrap_or_else(|error| panic!("{error}"))?;
            not_later(result.header().tick, tick, result.topic()).then_some(result)
        })
    }

    /// The world after the last tick.
    pub fn snapshot(&mut self) -> Snapshot {
        let done = client::counter(&mut self.commands, "ticks");
        // A new reader is sent the newest one, whatever was taken before.
        let mut reader = self.wait_for("world/snapshot appears", |bus| bus.snapshot_reader().ok());
        self.wait_for("the newest snapshot", |_| {
            let newest = reader.latest().unwrap_or_else(|error| panic!("{error}"));
            newest.filter(|it| it.header().tick >= done)
        })
    }

    /// Waits for a document, for example `world/info`.
    pub fn document(&self, name: &str) -> Document {
        client::document(&self.bus, name)
    }

    /// The ego vehicle, which is spawned before all others.
    pub fn ego(&mut self) -> ActorRecord {
        let snapshot = self.snapshot();
        let is_vehicle = |it: &&ActorRecord| it.kind == ActorKind::Vehicle as u16;
        let ego = snapshot.records().iter().find(is_vehicle).copied();
        ego.expect("the launch file has an ego vehicle")
    }

    /// Spawns an actor of a catalogue's type at `position_m` (x forward, y left, z up) from the ego
    /// vehicle, turned as it is, and returns its id.
    ///
    /// # Panics
    /// With the simulator's sentence if it refuses.
    pub fn spawn_near_ego(&mut self, type_id: &str, position_m: [f64; 3]) -> u32 {
        let [x, y, z] = position_m;
        let ego = self.ego().world_from_actor.isometry();
        let pose = Pose::from(ego * Isometry3::translation(x, y, z));
        let spawn = Command::Spawn {
            type_id: type_id.into(),
            pose: pose.into(),
            parent_id: None,
            role: String::new(),
            attributes: Default::default(),
        };
        match self.ask(spawn) {
            CommandReply::Spawned { actor_id, .. } => actor_id,
            other => panic!("{type_id} cannot be spawned: {other:?}"),
        }
    }

    /// Ends the simulator, and asserts that it and the programs left nothing in shared memory. Drop
    /// the readers and what they gave before.
    ///
    /// # Panics
    /// If the simulator's exit code is not 0, or with the names of the files that are left.
    pub fn finish(self) {
        let Simulator {
            commands,
            bus,
            daemon,
            sandbox,
        } = self;
        drop(commands);
        drop(bus);
        daemon.stop().expect_code(0);
        client::assert_nothing_left(&sandbox);
    }

    /// As [`eventually`], until the simulator ends.
    fn wait_for<T>(&mut self, what: &str, mut look: impl FnMut(&Bus) -> Option<T>) -> T {
        let Simulator { bus, daemon, .. } = self;
        eventually(what, || {
            let found = look(bus);
            assert!(
                found.is_some() || daemon.is_running(),
                "the simulator ended before {what}; its output:\n{}",
                daemon.lines().join("\n")
            );
            found
        })
    }
}

/// Whether something of tick `got` is what `wanted` is; it must not be later.
fn not_later(got: u64, wanted: u64, topic: &str) -> bool {
    assert!(
        got <= wanted,
        "{topic} has nothing of tick {wanted}, the next is of tick {got}; open it before the step"
    );
    got == wanted
}
