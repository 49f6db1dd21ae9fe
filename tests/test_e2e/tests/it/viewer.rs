//! `gantry-view` beside a real daemon: a saved file and what rerun draws of it without a display, a
//! picture of the window, a program that logs into the same view; and the page of `gantry-desk`.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use schema_frames::{Command, CommandReply};
use schema_types::Class;
use test_e2e::carla::empty_town;
use test_e2e::{
    SMALL_RIG, ask, assert_nothing_left, join_bus, python_package, reader, spawn_consumer,
    start_daemon, venv_program,
};
use test_kit::sandbox::repository;
use test_kit::{Process, Sandbox, eventually};

/// An RGB image.
struct Picture {
    width: usize,
    pixels: Vec<[u8; 3]>,
}

impl Picture {
    fn read(path: &Path) -> Option<Picture> {
        let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).ok()?));
        let mut reader = decoder.read_info().ok()?;
        let mut bytes = vec![0; reader.output_buffer_size()?];
        let info = reader.next_frame(&mut bytes).ok()?;
        let n = info.color_type.samples();
        let pixels = bytes[..info.buffer_size()]
            .chunks_exact(n)
            .map(|p| [p[0], p[1], p[2]])
            .collect();
        Some(Picture {
            width: info.width as usize,
            pixels,
        })
    }

    fn height(&self) -> usize {
        self.pixels.len() / self.width
    }

    /// The pixels of a part, given as shares of the whole image's width and height.
    fn part(&self, x: Range<f64>, y: Range<f64>) -> Vec<[u8; 3]> {
        let scaled = |range: Range<f64>, n: usize| {
            (range.start * n as f64) as usize..(range.end * n as f64) as usize
        };
        let (columns, rows) = (scaled(x, self.width), scaled(y, self.height()));
        rows.flat_map(|row| {
            self.pixels[row * self.width..][columns.clone()]
                .iter()
                .copied()
        })
        .collect()
    }

    /// The view in a row and column of the grid of cameras, without its title and the rim.
    fn view(&self, row: usize, column: usize) -> Vec<[u8; 3]> {
        // The cameras have 1.35 of 2.35 parts of the width in three columns, and 3 of 4.3 parts of
        // the height in three rows.
        let (width, height) = (1.35 / 2.35 / 3.0, (1.0 - 0.04) * 3.0 / 4.3 / 3.0);
        let (left, top) = (column as f64 * width, 0.04 + row as f64 * height);
        self.part(
            left + 0.02..left + width - 0.02,
            top + 0.05..top + height - 0.01,
        )
    }
}

/// Counts the pixels of about this colour.
fn count(pixels: &[[u8; 3]], rgb: [u8; 3]) -> usize {
    pixels
        .iter()
        .filter(|pixel| (0..3).all(|i| pixel[i].abs_diff(rgb[i]) <= 3))
        .count()
}

/// Different colours, coarsely.
fn n_colours(pixels: &[[u8; 3]]) -> usize {
    pixels
        .iter()
        .map(|pixel| pixel.map(|channel| channel >> 3))
        .collect::<BTreeSet<_>>()
        .len()
}

/// Views a running daemon and traffic into `drive.rrd` until the file has `n_bytes`, then asks the
/// viewer to end.
fn view(sandbox: &Sandbox, n_bytes: u64) -> (Process, Process) {
    let daemon = start_daemon(sandbox, SMALL_RIG, &[]);
    let mut driver = spawn_consumer(sandbox, "gantry-drive", &[]);
    // Flow and events need something that moves.
    driver.wait_line("driving");
    let viewer = spawn_consumer(sandbox, "gantry-view", &["--save", "drive.rrd"]);
    let file = sandbox.path("drive.rrd");
    eventually("the file grows", || {
        std::fs::metadata(&file)
            .is_ok_and(|file| file.len() > n_bytes)
            .then_some(())
    });
    let ended = viewer.stop().expect_code(0);
    assert!(ended.says("frames of 11 topics"), "{:?}", ended.lines);
    (daemon, driver)
}

fn rerun(sandbox: &Sandbox, args: &[&str]) -> Vec<String> {
    let env = [("DO_NOT_TRACK", "1"), ("RUST_LOG", "warn")];
    sandbox
        .spawn_program("rerun", &venv_program("rerun"), args, &env)
        .wait()
        .expect_code(0)
        .lines
}

/// The picture `shot.png` of a recording. Rerun draws after some time, whether it has read the
/// recording by then or not: one that it has read shows the road in the view of classes.
fn drawn(sandbox: &Sandbox, shot: &[&str]) -> Picture {
    let road = Class::ROADS.info().expect("named").rgb;
    let path = sandbox.path("shot.png");
    let mut tries = (0..6).map(|_| {
        // One that was drawn too early.
        let _ = std::fs::remove_file(&path);
        rerun(sandbox, shot);
        Picture::read(&path).expect("a readable picture")
    });
    tries
        .find(|picture| count(&picture.view(0, 2), road) > 0)
        .expect("rerun reads the recording before it draws")
}

#[test]
fn the_saved_file_is_whole_and_rerun_draws_every_view_of_it() {
    let sandbox = Sandbox::new("view");
    let (daemon, driver) = view(&sandbox, 2_000_000);
    driver.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
    // The file has no index; rerun reads it whole, and makes one that has.
    let indexed = ["rrd", "optimize", "drive.rrd", "-o", "indexed.rrd"];
    rerun(&sandbox, &indexed);
    rerun(&sandbox, &["rrd", "verify", "indexed.rrd"]);
    let shot = [
        "--headless",
        "--port",
        "auto",
        "--bind",
        "127.0.0.1",
        "--window-size",
        "1280x720",
        "--screenshot-to",
        "shot.png",
        // In the indexed file layouts lie in an order of chance, and rerun takes the last one.
        "drive.rrd",
    ];
    let picture = drawn(&sandbox, &shot);
    if let Some(folder) = std::env::var_os("GANTRY_KEEP") {
        std::fs::copy(
            sandbox.path("shot.png"),
            Path::new(&folder).join("viewer.png"),
        )
        .expect("folder to keep pictures in");
    }
    let [rgb, depth, semantic] = [0, 1, 2].map(|column| picture.view(0, column));
    let [instance, flow, dvs] = [0, 1, 2].map(|column| picture.view(1, column));
    let normals = picture.view(2, 0);
    let classes = [
        Class::ROADS,
        Class::SIDEWALKS,
        Class::BUILDINGS,
        Class::VEGETATION,
        Class::SKY,
        Class::CAR,
    ];
    let shares = classes.map(|class| {
        count(&semantic, class.info().expect("named").rgb) as f64 / semantic.len() as f64
    });
    assert!(shares[0] > 0.05, "the road has its colour: {shares:?}");
    assert!(
        shares.iter().filter(|share| **share > 0.005).count() >= 4,
        "{classes:?} have {shares:?} of the view"
    );
    let found = [
        ("rgb", &rgb, 60),
        ("depth", &depth, 30),
        ("instance", &instance, 6),
        ("flow", &flow, 6),
        ("dvs", &dvs, 3),
        ("normals", &normals, 3),
    ];
    for (name, pixels, least) in found {
        assert!(
            n_colours(pixels) >= least,
            "the view of {name} has only {} colours",
            n_colours(pixels)
        );
    }
    // Messages of rerun may cover the upper half.
    let world = picture.part(0.6..0.98, 0.55..0.95);
    assert!(
        n_colours(&world) >= 12,
        "map, cloud and boxes stand in the world: {} colours",
        n_colours(&world)
    );
    let plots = picture.part(0.0..0.57, 0.75..0.95);
    assert!(
        n_colours(&plots) >= 6,
        "curves are drawn: {} colours",
        n_colours(&plots)
    );
}

/// The memory of such a topic is made for its first reader: until then it has no writer.
#[test]
fn a_camera_that_nobody_reads_yet_is_viewed_and_recorded() {
    for (program, words, said) in [
        ("gantry-view", ["--save", "late.rrd"], "frames of 1 topics"),
        ("gantry-record", ["--out", "late.mcap"], "late.mcap"),
    ] {
        let sandbox = Sandbox::new("late-camera");
        let daemon = start_daemon(&sandbox, &empty_town("Town02"), &[]);
        let bus = join_bus(&sandbox, "test");
        let mut client = bus.command_client("test").unwrap();
        let spawn = Command::SpawnSensor {
            type_id: "sensor.camera.view".into(),
            pose: schema_types::Pose::from_xyz_yaw(0.0, 0.0, 20.0, 0.3).into(),
            parent_id: None,
            attachment: Default::default(),
            interval_nanos: 0,
            spec: serde_json::from_str(
                r#"{"kind": "camera", "width_px": 64, "height_px": 48, "modalities": ["rgb"]}"#,
            )
            .unwrap(),
            attributes: Default::default(),
        };
        let CommandReply::Spawned { topics, .. } = ask(&mut client, spawn) else {
            panic!("the camera was refused")
        };
        let topic = |name: &str| {
            let all = bus.topics().unwrap();
            all.into_iter().find(|topic| topic.name == name).unwrap()
        };
        assert_eq!((topics.len(), topic(&topics[0]).publishers), (1, 0));
        let reads = spawn_consumer(&sandbox, program, &words);
        eventually("it is read, and so written", || {
            let topic = topic(&topics[0]);
            (topic.publishers == 1 && topic.subscribers == 1).then_some(())
        });
        let mut own = reader(&bus, &topics[0]);
        let mut seq = || eventually("a frame", || own.latest().unwrap()).header().seq;
        let first = seq();
        eventually("forty frames", || (seq() > first + 40).then_some(()));
        let ended = reads.stop();
        // A recorder that the machine left waiting says what it lost, and ends with 3.
        let is_fine = ended.code() == 0 || (ended.code() == 3 && program == "gantry-record");
        assert!(is_fine && ended.says(said), "{:?}", ended.lines);
        drop((client, own, bus));
        daemon.stop().expect_code(0);
        assert_nothing_left(&sandbox);
    }
}

#[test]
fn a_picture_of_the_window_needs_no_display() {
    let sandbox = Sandbox::new("view-shot");
    let missing = spawn_consumer(&sandbox, "gantry-view", &["--blueprint", "no.rbl", "--web"]);
    assert!(missing.wait().expect_code(2).says("no.rbl is no file"));
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let words = [
        "--screenshot",
        "shot.png",
        "--size",
        "800x600",
        "--topics",
        "ego/*/rgb",
        "*/gnss",
    ];
    let ended = spawn_consumer(&sandbox, "gantry-view", &words).wait_longer(SHOT_LIMIT);
    let ended = ended.expect_code(0);
    assert!(ended.says("frames of 2 topics"), "{:?}", ended.lines);
    let picture = Picture::read(&sandbox.path("shot.png")).expect("a readable picture");
    // Two pixels for each point of the window.
    assert_eq!((picture.width, picture.height()), (1600, 1200));
    // One image takes the left side above the curves; the world is on the right.
    let image = picture.part(0.02..0.55, 0.15..0.65);
    assert!(n_colours(&image) >= 40, "{} colours", n_colours(&image));
    let again = spawn_consumer(&sandbox, "gantry-view", &["--screenshot", "shot.png"]);
    assert!(again.wait().expect_code(2).says("shot.png exists already"));
    let left: Vec<_> = std::fs::read_dir(sandbox.path("."))
        .unwrap()
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.ends_with(".rrd"))
        .collect();
    assert!(left.is_empty(), "{left:?}");
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// How long drawing a window without a GPU may take.
const SHOT_LIMIT: std::time::Duration = std::time::Duration::from_secs(150);

/// The program below the wheel's wrapper, which hands no signal on.
fn rerun_itself() -> std::path::PathBuf {
    let libraries = venv_program("rerun").parent().unwrap().join("../lib");
    let pythons = std::fs::read_dir(libraries).expect("a virtual environment");
    let mut programs = pythons.filter_map(|python| {
        let program = "site-packages/rerun_sdk/rerun_cli/rerun";
        Some(python.ok()?.path().join(program)).filter(|path| path.is_file())
    });
    programs.next().expect("the package rerun-sdk")
}

/// A stand-in for the viewer's window keeps what it is sent in a file.
#[test]
fn a_program_logs_into_the_recording_that_the_viewer_shows() {
    let sandbox = Sandbox::new("view-join");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let port = test_e2e::carla::free_port().to_string();
    let env = [("DO_NOT_TRACK", "1"), ("RUST_LOG", "warn")];
    let keep = [
        "--port",
        &port,
        "--bind",
        "127.0.0.1",
        "--save",
        "joined.rrd",
    ];
    let window = sandbox.spawn_program("rerun", &rerun_itself(), &keep, &env);
    eventually("the window listens", || {
        std::net::TcpStream::connect(format!("127.0.0.1:{port}")).ok()
    });
    let url = format!("rerun+http://127.0.0.1:{port}/proxy");
    let viewer = spawn_consumer(&sandbox, "gantry-view", &["--connect", &url]);
    let (script, package) = (
        repository().join("tests/test_e2e/python/join_view.py"),
        python_package(),
    );
    let args = [script.to_str().unwrap(), sandbox.domain()];
    let env = [
        ("PYTHONPATH", package.to_str().unwrap()),
        ("PYTHONDONTWRITEBYTECODE", "1"),
        ("DO_NOT_TRACK", "1"),
    ];
    let joined = sandbox.spawn_program("python", &venv_program("python"), &args, &env);
    assert!(joined.wait().expect_code(0).says("joined"));
    viewer.stop().expect_code(0);
    // Its end makes the file whole.
    window.stop();
    let printed = rerun(&sandbox, &["rrd", "print", "joined.rrd"]);
    let has = |entity: &str| printed.iter().any(|line| line.contains(entity));
    assert!(has("/world/ego/front/rgb/mine") && has("/world/actors"));
    let own = format!("\"{}-", sandbox.domain());
    let recordings: BTreeSet<&str> = printed
        .iter()
        .map(|line| line.trim())
        .filter(|line| line.starts_with(&own))
        .collect();
    assert_eq!(recordings.len(), 1, "{recordings:?}");
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn the_desk_rules_time_weather_and_vehicles_for_who_knows_its_address() {
    let sandbox = Sandbox::new("desk");
    let launch = format!(
        "{}[spectator]\nwidth_px = 96\nheight_px = 64\n",
        empty_town("Town02")
    );
    let daemon = start_daemon(&sandbox, &launch, &[]);
    let mut desk = spawn_consumer(&sandbox, "gantry-desk", &["--no-open"]);
    let line = desk.wait_line("open http://127.0.0.1:");
    let page = line
        .split_whitespace()
        .last()
        .expect("an address")
        .to_owned();
    let script = repository().join("tests/test_e2e/python/desk.py");
    let args = [script.to_str().unwrap(), &page];
    let asked = sandbox.spawn_program("python", &venv_program("python"), &args, &[]);
    let ended = asked.wait_longer(SHOT_LIMIT).expect_code(0);
    for theme in ["door", "time", "weather", "vehicle"] {
        assert!(ended.says(&format!("{theme} passed")), "{:?}", ended.lines);
    }
    let taken = page.split([':', '/']).nth(4).expect("a port").to_owned();
    let second = spawn_consumer(&sandbox, "gantry-desk", &["--no-open", "--port", &taken]);
    assert!(
        second
            .wait()
            .expect_code(2)
            .says("name another with --port")
    );
    desk.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
