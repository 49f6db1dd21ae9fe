//! The processes of an episode: how each begins, and how it shows that it is getting on.

use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::time::Duration;

use nix::sys::signal::Signal;
use schema_bus::{Bus, BusOptions, CommandClient};
use schema_frames::{Command, CommandReply};
use test_kit::client::{ask, counter, join_bus};
use test_kit::sandbox::binary_path;
use test_kit::{Process, Sandbox, eventually};

use super::table::Role;
use crate::carla::start_script;
use crate::processes::{python_package, venv_program};

/// A rig that costs little to render, in a town that is made in a second.
pub const RIG: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
vehicles = 2
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth"]
rate_hz = 20
width_px = 32
height_px = 24
mount.position_m = [0.6, 0.0, 1.6]
[sensor.rear]
kind = "camera"
modalities = ["rgb"]
rate_hz = 20
width_px = 32
height_px = 24
mount.position_m = [-1.5, 0.0, 1.6]
mount.rpy_deg = [0.0, 0.0, 180.0]
[sensor.imu]
kind = "imu"
rate_hz = 20
"#;

/// Those that stay for a whole episode, in the order in which they begin.
pub const COMPANY: [Role; 12] = [
    Role::Daemon,
    Role::Gateway,
    Role::Driver,
    Role::Viewer,
    Role::Recorder,
    Role::Reader,
    Role::Node,
    Role::Participant,
    Role::Worker,
    Role::Bridge,
    Role::FarBridge,
    Role::FarReader,
];

/// How far a process had got.
#[derive(Clone, Copy, Debug)]
pub enum Mark {
    /// Bytes of its files.
    Bytes(u64),
    /// Lines that it printed.
    Lines(usize),
    /// It is asked each time, or others are.
    Asked,
}

/// The processes of an episode.
#[derive(Debug)]
pub struct Cast {
    // Processes end before their folder is removed.
    processes: BTreeMap<Role, Process>,
    /// Where they run.
    pub sandbox: Sandbox,
    port: u16,
    bridge_port: u16,
    loader: Option<(CommandClient, Bus)>,
    n_files: u32,
    n_maps: usize,
}

impl Drop for Cast {
    /// Prints what everybody said last, if something did not hold.
    fn drop(&mut self) {
        if std::thread::panicking() {
            for (role, process) in &self.processes {
                let lines = process.lines();
                let last = &lines[lines.len().saturating_sub(6)..];
                println!("  {role:?} said last:\n    {}", last.join("\n    "));
            }
        }
    }
}

impl Cast {
    /// Nobody yet.
    pub fn new(name: &str) -> Cast {
        let sandbox = Sandbox::new(name);
        sandbox.write("launch.toml", RIG);
        std::fs::create_dir(sandbox.path("tmp")).expect("a fresh sandbox");
        Cast {
            processes: BTreeMap::new(),
            sandbox,
            port: steady_port(),
            bridge_port: steady_port(),
            loader: None,
            n_files: 0,
            n_maps: 0,
        }
    }

    /// Starts a process without waiting for anything.
    pub fn spawn(&mut self, role: Role) -> Process {
        self.n_files += 1;
        let number = self.n_files;
        let domain = self.sandbox.domain().to_owned();
        let own = |words: &[&str]| -> Vec<String> {
            let all = [words, &["--domain", &domain]].concat();
            all.into_iter().map(str::to_owned).collect()
        };
        let binary = |name: &str| binary_path(name);
        let far = |words: &[&str]| -> Vec<String> {
            let words = words.iter().map(|word| (*word).to_owned());
            words
                .chain(["--domain".into(), format!("{domain}b")])
                .collect()
        };
        let port = self.port.to_string();
        let link = format!("tcp/127.0.0.1:{}", self.bridge_port);
        let (program, args) = match role {
            Role::Daemon => (binary("simd"), own(&["--launch", "launch.toml"])),
            Role::Gateway => (
                binary("gantry-carla"),
                own(&["--port", &port, "--data", "data"]),
            ),
            Role::Driver => (binary("gantry-drive"), own(&[])),
            Role::Viewer => (
                binary("gantry-view"),
                own(&["--save", &format!("view{number}.rrd"), "--max-hz", "5"]),
            ),
            Role::Recorder => (
                binary("gantry-record"),
                own(&["--out", &format!("record{number}.mcap")]),
            ),
            Role::Reader => (binary("gantry"), own(&["topic", "hz", "ego/imu/imu"])),
            Role::Worker => (binary("gantry-render"), own(&["--name", "worker"])),
            Role::Bridge => (binary("gantry-bridge"), own(&["--listen", &link])),
            Role::FarBridge => (binary("gantry-bridge"), far(&["--connect", &link])),
            Role::FarReader => (binary("gantry"), far(&["topic", "hz", "ego/imu/imu"])),
            Role::Participant => (
                binary("examples/misbehave"),
                vec![domain.clone(), "lockstep".into()],
            ),
            Role::Publisher => (
                binary("examples/misbehave"),
                vec![domain.clone(), "die-in-loan".into(), "own/boxes".into()],
            ),
            Role::Node => (
                venv_program("python"),
                vec!["-c".into(), NODE.into(), domain.clone()],
            ),
            Role::Replay => (
                binary("gantry-replay"),
                ["replay.mcap", "--domain", &format!("{domain}r"), "--loop"]
                    .map(str::to_owned)
                    .to_vec(),
            ),
            Role::Client => {
                let seed = number.to_string();
                return start_script(
                    &self.sandbox,
                    "soak_client.py",
                    &[&port, &seed, "-", "hang"],
                );
            }
        };
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        let (tmp, package) = (self.sandbox.path("tmp"), python_package());
        let text = |path: &Path| path.to_str().expect("paths are UTF-8").to_owned();
        let (tmp, package) = (text(&tmp), text(&package));
        let env = [
            ("TMPDIR", tmp.as_str()),
            ("XDG_RUNTIME_DIR", tmp.as_str()),
            ("PYTHONPATH", package.as_str()),
            ("PYTHONDONTWRITEBYTECODE", "1"),
            ("PYTHONUNBUFFERED", "1"),
        ];
        self.sandbox
            .spawn_program(&format!("{role:?}"), &program, &args, &env)
    }

    /// Starts one of the company and waits until it is at work.
    pub fn begin(&mut self, role: Role) {
        if role == Role::FarReader {
            self.topics_cross();
        }
        let mut process = self.spawn(role);
        match role {
            Role::Daemon => drop(process.wait_line("ready")),
            Role::Gateway => drop(process.wait_line("listening on")),
            Role::Driver => drop(process.wait_line("driving vehicles=")),
            Role::Participant => drop(process.wait_line("at work")),
            Role::Worker => drop(process.wait_line("joined")),
            Role::Bridge | Role::FarBridge => drop(process.wait_line("ready")),
            _ => {}
        }
        self.processes.insert(role, process);
        self.gets_on(role);
    }

    /// Takes a process out, to strike it.
    ///
    /// # Panics
    /// If it is not there.
    pub fn take(&mut self, role: Role) -> Process {
        let found = self.processes.remove(&role);
        found.unwrap_or_else(|| panic!("{role:?} is not on the stage"))
    }

    /// Puts a process back.
    pub fn put(&mut self, role: Role, process: Process) {
        self.processes.insert(role, process);
    }

    /// The processes that are on the stage.
    pub fn processes(&mut self) -> impl Iterator<Item = (Role, &mut Process)> {
        self.processes.iter_mut().map(|(role, p)| (*role, p))
    }

    /// Waits until a process has got on with its work since this call.
    ///
    /// # Panics
    /// If it has ended, or does not get on.
    pub fn gets_on(&mut self, role: Role) {
        let mark = self.mark(role);
        self.got_on_since(role, mark);
    }

    /// How far a process has got with its work.
    pub fn mark(&self, role: Role) -> Mark {
        match role {
            Role::Viewer => Mark::Bytes(self.bytes_of("view")),
            Role::Recorder => Mark::Bytes(self.bytes_of("record")),
            Role::Daemon | Role::Participant | Role::Gateway | Role::Driver | Role::Worker => {
                Mark::Asked
            }
            // What crosses is read there.
            Role::Bridge | Role::FarBridge => self.lines_of(Role::FarReader),
            _ => self.lines_of(role),
        }
    }

    /// Lines that a process has printed; nothing to be compared if it has not begun.
    fn lines_of(&self, role: Role) -> Mark {
        let process = self.processes.get(&role);
        process.map_or(Mark::Asked, |process| Mark::Lines(process.lines().len()))
    }

    /// Waits until a process has got on with its work since it was marked.
    ///
    /// # Panics
    /// If it has ended, or does not get on.
    pub fn got_on_since(&mut self, role: Role, mark: Mark) {
        let what = format!("{role:?} gets on");
        match (role, mark) {
            (Role::Daemon | Role::Participant, _) => self.ticks_go_on(),
            (Role::Gateway, _) => self.gateway_answers(),
            (Role::Driver, _) => self.vehicles_are_driven(),
            (Role::Worker, _) => self.worker_renders(),
            (Role::Bridge | Role::FarBridge, Mark::Lines(before)) => {
                let reader = &self.processes[&Role::FarReader];
                eventually(&what, || (reader.lines().len() > before).then_some(()));
            }
            (_, Mark::Bytes(before)) => {
                let stem = if role == Role::Viewer {
                    "view"
                } else {
                    "record"
                };
                eventually(&what, || (self.bytes_of(stem) > before).then_some(()));
            }
            (_, Mark::Lines(before)) => {
                let process = &self.processes[&role];
                eventually(&what, || (process.lines().len() > before).then_some(()));
            }
            (_, Mark::Asked) => {}
        }
        self.is_alive(role);
    }

    fn is_alive(&mut self, role: Role) {
        if let Some(process) = self.processes.get_mut(&role) {
            assert!(
                process.is_running(),
                "{role:?} has ended although nobody struck it:\n{}",
                process.lines().join("\n")
            );
        }
    }

    /// Waits until the topic of the reader behind the bridges is there.
    fn topics_cross(&self) {
        let options = BusOptions {
            iceoryx_root: Some(self.sandbox.iceoryx_root()),
            prefix: Some(self.sandbox.prefix().to_owned()),
        };
        let domain = format!("{}b", self.sandbox.domain());
        let bus = Bus::open_with(&domain, "laboratory", &options);
        let bus = bus.unwrap_or_else(|error| panic!("{error}"));
        eventually("topics cross the bridges", || {
            let topics = bus.topics().ok()?;
            let is_there = topics.iter().any(|topic| topic.name == "ego/imu/imu");
            is_there.then_some(())
        });
    }

    fn ticks_go_on(&mut self) {
        self.counter_rises("ticks");
    }

    fn worker_renders(&mut self) {
        self.counter_rises("sent_by_workers");
    }

    /// Asks with a client of its own each time: one that was opened while a killed daemon was cleaned
    /// up may be the last of that daemon's.
    fn counter_rises(&mut self, name: &str) {
        let bus = join_bus(&self.sandbox, "laboratory");
        let mut first = None;
        eventually(&format!("{name} rises"), || {
            let mut client = bus.command_client("laboratory").ok()?;
            let batch = schema_frames::CommandBatch::new(vec![Command::Counters]);
            let answer = client.request(&batch, Duration::from_secs(10)).ok()?;
            let CommandReply::Counters { counters } = answer.replies.first()? else {
                panic!("{answer:?}")
            };
            let now = counters[name];
            (now > *first.get_or_insert(now) + 2).then_some(())
        });
    }

    fn gateway_answers(&mut self) {
        let port = self.port;
        eventually("the gateway answers", || {
            let mut connection = TcpStream::connect(("127.0.0.1", port)).ok()?;
            let limit = Some(Duration::from_secs(10));
            connection.set_read_timeout(limit).ok()?;
            connection
                .write_all(b"\x94\x00\x01\xa7version\x91\x91\xc2")
                .ok()?;
            let mut answer = [0; 14];
            connection.read_exact(&mut answer).ok()?;
            answer.ends_with(b"0.9.16").then_some(())
        });
    }

    /// The bytes of all files whose names begin so; a new run of the simulator is a new file.
    fn bytes_of(&self, stem: &str) -> u64 {
        let entries = std::fs::read_dir(self.sandbox.dir()).expect("the sandbox is there");
        let ours = entries
            .flatten()
            .filter(|entry| entry.file_name().to_string_lossy().starts_with(stem));
        ours.filter_map(|entry| entry.metadata().ok())
            .map(|file| file.len())
            .sum()
    }

    fn vehicles_are_driven(&mut self) {
        let bus = join_bus(&self.sandbox, "laboratory");
        let mut snapshots = eventually("snapshots", || bus.snapshot_reader().ok());
        eventually("a vehicle is driven", || {
            let snapshot = snapshots.latest().ok()??;
            let is_driven = |record: &schema_frames::ActorRecord| {
                record
                    .vehicle()
                    .is_some_and(|part| part.throttle_ratio > 0.0 || part.brake_ratio > 0.0)
            };
            snapshot.records().iter().any(is_driven).then_some(())
        });
    }

    /// Asks for another map and does not wait for it.
    pub fn load_map(&mut self) {
        self.n_maps += 1;
        self.loader = None;
        let bus = join_bus(&self.sandbox, "loader");
        let Ok(mut client) = bus.command_client("loader") else {
            return;
        };
        let map = ["Town10HD", "Town01"][self.n_maps % 2].into();
        let load = Command::LoadMap { map };
        let batch = schema_frames::CommandBatch::new(vec![load]);
        let _ = client.request(&batch, Duration::from_millis(1));
        // Stays until the next load, so that the answer finds who asked.
        self.loader = Some((client, bus));
    }

    /// Waits until no tick begins any more.
    pub fn world_waits(&mut self) {
        let bus = join_bus(&self.sandbox, "laboratory");
        let mut client = bus.command_client("laboratory").expect("a daemon");
        let ticks = |client: &mut _| counter(client, "ticks");
        eventually("the world waits", || {
            let before = ticks(&mut client);
            std::thread::sleep(Duration::from_millis(150));
            (ticks(&mut client) == before).then_some(())
        });
        assert!(matches!(
            ask(&mut client, Command::Ping),
            CommandReply::Pong { .. }
        ));
    }

    /// Leaves the bus.
    pub fn leave(&mut self) {
        self.loader = None;
    }

    /// Signals one of those on the stage.
    pub fn signal(&self, role: Role, signal: Signal) {
        self.processes[&role].signal(signal);
    }
}

/// A free port whose next one is free as well. It is below those that the kernel gives to
/// connections, so that nobody takes it while the gateway begins anew.
fn steady_port() -> u16 {
    let is_free = |port| TcpListener::bind(("127.0.0.1", port)).is_ok();
    let found = (0..1000).map(|_| 2 * fastrand::u16(10_000..16_000));
    let mut found = found.filter(|port| is_free(*port) && is_free(port + 1));
    found.next().expect("some of the ports are free")
}

/// Prints a line for every tenth frame.
const NODE: &str = "import gantry, sys
with gantry.open('ego/imu/imu', domain=sys.argv[1]) as topic:
    n = 0
    while True:
        frame = topic.next(timeout=600)
        n += 1
        if n % 5 == 0:
            print(frame.seq, flush=True)
";
