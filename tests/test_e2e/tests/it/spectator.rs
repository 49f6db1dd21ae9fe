//! The spectator: rendered only for readers, moved by commands, alone in showing texts, flown in a
//! terminal, and shown in rerun.

use std::io::{Read as _, Write as _};
use std::process::{Child, ChildStdin, Command as Program, Stdio};
use std::sync::{Arc, Mutex};

use schema_bus::names::SPECTATOR_RGB;
use schema_bus::{CommandClient, Frame, FrameReader};
use schema_frames::document::PoseText;
use schema_frames::{
    ActorKind, Command, CommandReply, DebugDraw, DebugKind, DebugShape, FrameHeader,
};
use schema_types::Pose;
use test_e2e::carla::{run_script, start_gateway};
use test_e2e::{ask, join_bus, reader, start_daemon, step, venv_program};
use test_kit::sandbox::{binary_path, repository};
use test_kit::{Sandbox, Setup, Simulator, eventually};

/// A spectator and a camera of equal lens in the middle of a town that stands still.
const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town02"
seed = 7
mode = "stepped"
[spectator]
width_px = 96
height_px = 64
[rig.post]
pose = { position_m = [0.0, 0.0, 300.0], rpy_deg = [0.0, 30.0, 90.0] }
[sensor.view]
rig = "post"
kind = "camera"
modalities = ["rgb"]
rate_hz = 20
width_px = 96
height_px = 64
"#;

const MAGENTA: [u8; 4] = [255, 0, 255, 255];

fn painted(frame: &[u8]) -> usize {
    frame.chunks(4).filter(|pixel| *pixel == MAGENTA).count()
}

fn shape(draw: DebugDraw, on_screen: bool) -> DebugShape {
    DebugShape {
        draw,
        color_rgb: [255, 0, 255],
        life_nanos: None,
        on_screen,
    }
}

fn set_pose(actor_id: u32, pose: impl Into<PoseText>) -> Command {
    Command::SetPose {
        actor_id,
        pose: pose.into(),
    }
}

/// The spectator's id and pose in the newest snapshot.
fn spectator(simulator: &mut Simulator) -> (u32, Pose) {
    let snapshot = simulator.snapshot();
    let is_it = |record: &&schema_frames::ActorRecord| record.kind() == Some(ActorKind::Spectator);
    let record = snapshot.records().iter().find(is_it).unwrap();
    (record.id, record.world_from_actor)
}

fn counter(simulator: &mut Simulator, name: &str) -> u64 {
    match simulator.ask(Command::Counters) {
        CommandReply::Counters { counters } => counters[name],
        other => panic!("{other:?}"),
    }
}

/// The next frame that waits or comes.
fn next(reader: &mut FrameReader) -> Frame {
    eventually("a frame of the spectator", || reader.next().unwrap())
}

#[test]
fn it_is_rendered_for_readers_only_where_it_was_put() {
    let mut simulator = Simulator::start(Setup::text(LAUNCH));
    let (id, _) = spectator(&mut simulator);
    simulator.step(5);
    assert_eq!(counter(&mut simulator, &format!("sent {SPECTATOR_RGB}")), 0);
    assert_eq!(counter(&mut simulator, "gpu_submissions"), 0);
    let mut images = simulator.frames(SPECTATOR_RGB);
    let tick = simulator.step(1);
    let first = simulator.frame_of(&mut images, tick);
    let (_, pose) = spectator(&mut simulator);
    assert_eq!(first.header().world_from_sensor, pose);
    assert_eq!(first.header().sensor_id, id);
    assert_eq!([first.header().width, first.header().height], [96, 64]);
    let before = first.to_vec();
    drop(first);
    let down = Pose {
        rotation_xyzw: [0.0, 0.5f64.sqrt(), 0.0, 0.5f64.sqrt()],
        ..pose
    };
    assert_eq!(simulator.ask(set_pose(id, down)), CommandReply::Done);
    let tick = simulator.step(1);
    let moved = simulator.frame_of(&mut images, tick);
    assert_eq!(moved.header().world_from_sensor, down);
    assert_ne!(before, moved.to_vec(), "it looks down now");
    drop((moved, images));
    simulator.step(1);
    let sent = counter(&mut simulator, &format!("sent {SPECTATOR_RGB}"));
    simulator.step(3);
    let later = counter(&mut simulator, &format!("sent {SPECTATOR_RGB}"));
    assert_eq!(sent, later, "nobody reads any more");
    simulator.finish();
}

#[test]
fn texts_and_shapes_on_the_screen_are_in_its_image_alone() {
    let mut simulator = Simulator::start(Setup::text(LAUNCH));
    let mut camera = simulator.frames("post/view/rgb");
    let mut images = simulator.frames(SPECTATOR_RGB);
    let tick = simulator.step(1);
    let at = simulator
        .frame_of(&mut camera, tick)
        .header()
        .world_from_sensor;
    let (id, _) = spectator(&mut simulator);
    drop(simulator.frame_of(&mut images, tick));
    simulator.ask(set_pose(id, at));
    // Both show one view now, at the same place with the same lens.
    let mut look = |simulator: &mut Simulator| {
        let tick = simulator.step(1);
        let ordinary = simulator.frame_of(&mut camera, tick);
        let spectator = simulator.frame_of(&mut images, tick);
        [ordinary.to_vec(), spectator.to_vec()]
    };
    look(&mut simulator);
    let [ordinary, same] = look(&mut simulator);
    assert!(ordinary == same, "two cameras of one pose and lens");
    let ahead = |x: f64, y: f64, z: f64| -> [f64; 3] {
        (at.isometry() * nalgebra::Point3::new(x, y, z))
            .coords
            .into()
    };
    let draws = |draw: DebugDraw, on_screen: bool| Command::DrawDebug {
        shapes: vec![shape(draw, on_screen)],
    };
    let line = |from: [f64; 3], to: [f64; 3]| DebugDraw::Line {
        from_m: from,
        to_m: to,
        width_m: 2.0,
    };
    // f is 48 px: in the world 2 m are 9.6 px at 10 m; on the screen 2 are 2 px at any distance.
    let (left, right) = (ahead(10.0, 5.0, 0.0), ahead(10.0, -5.0, 0.0));
    simulator.ask(draws(line(left, right), false));
    let [ordinary, spectator_image] = look(&mut simulator);
    assert_eq!(ordinary, spectator_image);
    assert!(
        (400..=528).contains(&painted(&ordinary)),
        "{}",
        painted(&ordinary)
    );
    let clear = |what| Command::ClearDebug { what };
    simulator.ask(clear(DebugKind::All));
    simulator.ask(draws(line(left, right), true));
    let [ordinary, image] = look(&mut simulator);
    assert_eq!([painted(&ordinary), painted(&image)], [0, 48 * 2]);
    simulator.ask(clear(DebugKind::Shapes));
    let text = DebugDraw::Text {
        at_m: ahead(5.0, 2.0, 1.0),
        text: "Gantry".into(),
        shadow: true,
    };
    simulator.ask(draws(text, false));
    let [ordinary, image] = look(&mut simulator);
    assert_eq!(painted(&ordinary), 0);
    // Six letters of 8 by 8 dots, of which a third or so is set.
    assert!((60..=250).contains(&painted(&image)), "{}", painted(&image));
    let rows: Vec<usize> = (0..64)
        .filter(|y| painted(&image[y * 96 * 4..(y + 1) * 96 * 4]) > 0)
        .collect();
    // 1 m up at 5 m is 9.6 px above the middle: from row 22 on, eight rows.
    assert!(rows[0] >= 22 && *rows.last().unwrap() < 30, "{rows:?}");
    simulator.ask(clear(DebugKind::Texts));
    let [_, image] = look(&mut simulator);
    assert_eq!(painted(&image), 0);
    drop((camera, images));
    simulator.finish();
}

#[test]
fn while_the_world_stands_still_moves_and_drawing_are_seen() {
    let mut simulator = Simulator::start(Setup::text(LAUNCH));
    let mut camera = simulator.frames("post/view/rgb");
    let mut images = simulator.frames(SPECTATOR_RGB);
    let tick = simulator.step(2);
    let before = simulator.frame_of(&mut images, tick).header().seq;
    let (id, pose) = spectator(&mut simulator);
    let mut higher = pose;
    higher.translation_m[2] += 10.0;
    simulator.ask(set_pose(id, higher));
    let again = next(&mut images);
    assert_eq!(
        (again.header().tick, again.header().seq),
        (tick, before + 1)
    );
    assert_eq!(again.header().world_from_sensor, higher);
    // A shape for one tick is seen at once, and by the sensors of the next tick all the same.
    let at = simulator
        .frame_of(&mut camera, tick)
        .header()
        .world_from_sensor;
    let ahead: [f64; 3] = (at.isometry() * nalgebra::Point3::new(10.0, 0.0, 0.0))
        .coords
        .into();
    simulator.ask(set_pose(id, at));
    assert_eq!(painted(&next(&mut images)), 0);
    let point = DebugDraw::Point {
        at_m: ahead,
        size_m: 2.0,
    };
    let one_tick = DebugShape {
        life_nanos: Some(0),
        ..shape(point, false)
    };
    simulator.ask(Command::DrawDebug {
        shapes: vec![one_tick],
    });
    assert!(painted(&next(&mut images)) > 50);
    let tick = simulator.step(1);
    assert!(painted(&simulator.frame_of(&mut camera, tick)) > 50);
    let tick = simulator.step(1);
    assert_eq!(painted(&simulator.frame_of(&mut camera, tick)), 0);
    drop((again, camera, images));
    simulator.finish();
}

#[test]
fn its_topic_lives_on_in_the_next_episode_and_hashes_leave_it_out() {
    let mut simulator = Simulator::start(Setup::text(LAUNCH));
    let mut images = simulator.frames(SPECTATOR_RGB);
    let tick = simulator.step(1);
    let first = *simulator.frame_of(&mut images, tick).header();
    let load = Command::LoadMap {
        map: "Town02".into(),
    };
    assert_eq!(simulator.ask(load), CommandReply::Done);
    let tick = simulator.step(1);
    let second: FrameHeader = *simulator.frame_of(&mut images, tick).header();
    let (id, pose) = spectator(&mut simulator);
    assert_eq!((second.episode, second.sensor_id), (first.episode + 1, id));
    assert_eq!(second.world_from_sensor, pose);
    drop(images);
    simulator.finish();
    let sandbox = Sandbox::new("spectatorhash");
    let daemon = start_daemon(
        &sandbox,
        LAUNCH,
        &[
            "--hash",
            "--ticks",
            "3",
            "--set",
            "scenario.mode=free_running",
        ],
    );
    let ended = daemon.wait().expect_code(0);
    assert!(ended.says("post/view/rgb") && !ended.says(SPECTATOR_RGB));
}

#[test]
fn telemetry_is_shown_for_vehicles() {
    let mut simulator = Simulator::start(Setup::text(LAUNCH));
    let ego = simulator.ego().id;
    let (id, pose) = spectator(&mut simulator);
    let mut images = simulator.frames(SPECTATOR_RGB);
    // At night under the ground nothing is white.
    let mut below = pose;
    below.translation_m[2] = -50.0;
    simulator.ask(set_pose(id, below));
    let mut whites = |simulator: &mut Simulator| {
        let tick = simulator.step(1);
        let frame = simulator.frame_of(&mut images, tick);
        frame
            .chunks(4)
            .filter(|pixel| pixel[..3] == [255; 3])
            .count()
    };
    assert_eq!(whites(&mut simulator), 0);
    let show = |actor_id, shown| Command::ShowTelemetry { actor_id, shown };
    simulator.ask(show(ego, true));
    assert!(whites(&mut simulator) > 300);
    simulator.ask(show(ego, false));
    assert_eq!(whites(&mut simulator), 0);
    match simulator.ask(show(id, true)) {
        CommandReply::Refused { error } => assert!(error.contains("no vehicle"), "{error}"),
        other => panic!("{other:?}"),
    }
    drop(images);
    simulator.finish();
}

#[test]
fn a_client_of_carla_moves_it_and_writes_into_it() {
    let sandbox = Sandbox::new("carlaspectator");
    let daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut images = reader(&bus, SPECTATOR_RGB);
    let mut camera = reader(&bus, "post/view/rgb");
    step(&mut client, 2);
    let (gateway, port, _) = start_gateway(&sandbox);
    run_script(
        &sandbox,
        "carla_spectator.py",
        &[&port.to_string()],
        &["drawn"],
    );
    let latest = |client: &mut CommandClient, images: &mut FrameReader| {
        let tick = step(client, 1);
        eventually("the frame of the tick", || {
            let frame = images.latest().unwrap()?;
            (frame.header().tick == tick).then(|| frame.to_vec())
        })
    };
    // The text, and the line on the screen; none is in the camera that hangs at the same place.
    assert!(painted(&latest(&mut client, &mut images)) > 100);
    assert_eq!(painted(&camera.latest().unwrap().unwrap()), 0);
    run_script(
        &sandbox,
        "carla_spectator.py",
        &[&port.to_string(), "clear"],
        &["cleared"],
    );
    // Both have been carried out, although they have no answers: the script's last call has one.
    assert_eq!(painted(&latest(&mut client, &mut images)), 0);
    let mut numbers = |client: &mut CommandClient, args: &[&str], said: &str| {
        let port = port.to_string();
        let args = [&[port.as_str()], args].concat();
        run_script(&sandbox, "carla_spectator.py", &args, &[said]);
        let white = |pixel: &&[u8]| pixel[..3] == [255; 3];
        let picture = latest(client, &mut images);
        picture.chunks(4).filter(white).count()
    };
    // Of a vehicle; in letters of 8 by 8 dots they are hundreds of pixels.
    assert!(numbers(&mut client, &["telemetry"], "shown") > 300);
    assert_eq!(numbers(&mut client, &["batch", "hidden"], "hidden"), 0);
    assert!(numbers(&mut client, &["batch", "shown"], "shown") > 300);
    assert_eq!(
        ask(&mut client, Command::Ping),
        CommandReply::Pong {
            version: env!("CARGO_PKG_VERSION").into()
        }
    );
    drop((images, camera));
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
}

/// A program in a terminal of its own: what it shows, and its keys.
struct InTerminal {
    child: Child,
    keys: ChildStdin,
    shown: Arc<Mutex<String>>,
}

impl InTerminal {
    /// Starts one of Gantry's programs in a terminal of 80 columns and 24 rows.
    fn start(sandbox: &Sandbox, binary: &str, args: &[&str]) -> InTerminal {
        let script = repository().join("tests/test_e2e/python/in_terminal.py");
        let mut child = Program::new(venv_program("python"))
            .arg(script)
            .args(["80", "24"])
            .arg(binary_path(binary))
            .args(args)
            .current_dir(sandbox.dir())
            .env("TERM", "xterm-256color")
            .env("COLORTERM", "truecolor")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the environment's Python");
        let keys = child.stdin.take().expect("it is piped");
        let mut output = child.stdout.take().expect("it is piped");
        let shown = Arc::new(Mutex::new(String::new()));
        let theirs = shown.clone();
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(n @ 1..) = output.read(&mut bytes) {
                let text = String::from_utf8_lossy(&bytes[..n]);
                theirs.lock().expect("nobody panics").push_str(&text);
            }
        });
        InTerminal { child, keys, shown }
    }

    fn says(&self, text: &str) -> bool {
        self.shown.lock().expect("nobody panics").contains(text)
    }

    fn hit(&mut self, keys: &str) {
        self.keys
            .write_all(keys.as_bytes())
            .expect("the terminal is there");
    }

    /// Waits for a text on the screen.
    fn wait_for(&mut self, text: &str) {
        eventually(text, || self.says(text).then_some(()));
    }
}

impl Drop for InTerminal {
    /// A program that is left without a terminal ends.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn it_is_flown_in_a_terminal_which_is_given_back() {
    let setup = Setup::text(LAUNCH).set("scenario.mode=\"free_running\"");
    let mut simulator = Simulator::start(setup);
    let (_, before) = spectator(&mut simulator);
    let fly = ["--fly=terminal", "--domain", simulator.domain()];
    let mut viewer = InTerminal::start(simulator.sandbox(), "gantry-view", &fly);
    viewer.wait_for("▀");
    viewer.wait_for("free");
    // A key of a terminal that does not tell when it goes up counts as held for a while.
    eventually("the spectator has risen", || {
        viewer.hit("q");
        let (_, now) = spectator(&mut simulator);
        (now.translation_m[2] > before.translation_m[2] + 2.0).then_some(())
    });
    viewer.hit("n");
    viewer.wait_for("behind vehicle.");
    viewer.hit("t");
    viewer.wait_for("above vehicle.");
    viewer.hit("x");
    viewer.wait_for("images shown");
    viewer.wait_for("ended with 0, terminal as before");
    simulator.finish();
}

/// Signals that end it give the terminal back, too: Ctrl-C is a key in raw mode.
#[test]
fn ctrl_c_ends_a_flight_and_gives_the_terminal_back() {
    let simulator = Simulator::start(Setup::text(LAUNCH));
    let fly = ["--fly=terminal", "--domain", simulator.domain()];
    let mut viewer = InTerminal::start(simulator.sandbox(), "gantry-view", &fly);
    viewer.wait_for("free");
    viewer.hit("\u{3}");
    viewer.wait_for("ended with 0, terminal as before");
    simulator.finish();
}

#[test]
fn without_a_display_and_a_terminal_a_sentence_says_what_to_do() {
    let sandbox = Sandbox::new("flynowhere");
    let viewer = sandbox.spawn(
        "gantry-view",
        &["--fly=terminal", "--domain", sandbox.domain()],
    );
    let ended = viewer.wait().expect_code(2);
    assert!(ended.says("needs a display"));
    let viewer = sandbox.spawn_program(
        "gantry-view",
        &binary_path("gantry-view"),
        &["--fly=window", "--domain", sandbox.domain()],
        &[("DISPLAY", ":4711")],
    );
    assert!(viewer.wait().expect_code(2).says("--fly=terminal"));
}

/// Only with the option, and only while it is shown.
#[test]
fn rerun_shows_it_if_asked_to() {
    let setup = Setup::text(LAUNCH).set("scenario.mode=\"free_running\"");
    let mut simulator = Simulator::start(setup);
    let save = |simulator: &mut Simulator, file: &str, more: &[&str]| {
        let domain = simulator.domain().to_owned();
        let words = [&["--save", file, "--domain", &domain], more].concat();
        let viewer = simulator.sandbox().spawn("gantry-view", &words);
        // A viewer opens one topic after the other, and shows what it has taken by its end.
        let of_spectator = format!("sent {SPECTATOR_RGB}");
        let mut shown = vec![("post/view/rgb", "sent post/view/rgb")];
        if !more.is_empty() {
            shown.push((SPECTATOR_RGB, &of_spectator));
        }
        for (topic, sent) in shown {
            simulator.wait_readers(topic, 1);
            let before = counter(simulator, sent);
            eventually("some images", || {
                (counter(simulator, sent) > before + 20).then_some(())
            });
        }
        let sent = counter(simulator, &of_spectator);
        (viewer.stop().expect_code(0), sent)
    };
    let (ended, sent) = save(&mut simulator, "without.rrd", &[]);
    assert!(ended.says("frames of 1 topics"), "{:?}", ended.lines);
    assert_eq!(sent, 0);
    let (ended, sent) = save(&mut simulator, "with.rrd", &["--spectator"]);
    assert!(ended.says("frames of 2 topics"), "{:?}", ended.lines);
    assert!(sent > 0);
    let file = std::fs::read(simulator.sandbox().path("with.rrd")).unwrap();
    let name = b"/world/spectator/rgb";
    assert!(file.windows(name.len()).any(|bytes| bytes == name));
    simulator.finish();
}
