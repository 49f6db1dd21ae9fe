//! `gantry up` with processes that take part in lockstep: the first tick waits for all of them,
//! restarts join again, and who never joins ends the run with a sentence.

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use schema_bus::{Bus, SnapshotReader, names};
use schema_frames::WorldInfo;
use test_e2e::processes::{python_package, venv_program};
use test_e2e::{assert_nothing_left, document, join_bus, step};
use test_kit::sandbox::binary_path;
use test_kit::{Process, Sandbox, eventually};

/// A town with one car, its simulator as fast as it can go, and nobody who drives.
const WORLD: &str = "version = 1
[process.simd]
cmd = [\"simd\", \"--unpaced\"]
required = true
ready = { service = \"world/snapshot\" }
";

fn up(sandbox: &Sandbox, processes: &str, more: &[&str]) -> Process {
    sandbox.up(&format!("{WORLD}{processes}"), more)
}

/// A driver that takes part under the name of its process, once the file `NAME.go` is there.
fn late_driver(name: &str) -> String {
    let driver = binary_path("gantry-drive");
    format!(
        "[process.{name}]\ncmd = [\"sh\", \"-c\", \"while [ ! -e {name}.go ]; do sleep 0.01; done; exec {} --lockstep={name}\"]\nlockstep = true\n",
        driver.display()
    )
}

fn snapshots(bus: &Bus) -> SnapshotReader {
    eventually("snapshots appear", || bus.snapshot_reader().ok())
}

/// Tick of the newest snapshot that came since the last call.
fn newest(reader: &mut SnapshotReader) -> Option<u64> {
    let snapshot = reader.latest().unwrap_or_else(|error| panic!("{error}"))?;
    Some(snapshot.header().tick)
}

fn wait_tick(reader: &mut SnapshotReader, tick: u64) {
    eventually(&format!("tick {tick}"), || {
        newest(reader).filter(|now| *now >= tick)
    });
}

/// Those who take part now.
fn participants(bus: &Bus) -> Vec<String> {
    let info: WorldInfo = document(bus, names::WORLD_INFO).json().unwrap();
    info.lockstep
}

#[test]
fn the_first_tick_waits_for_all_who_take_part() {
    let sandbox = Sandbox::new("first-tick");
    // A driver of ours needs neither flag nor name.
    let early =
        "[process.early]\ncmd = [\"gantry-drive\", \"--vehicles\", \"ego\"]\nlockstep = true\n";
    let mut gantry = up(&sandbox, &format!("{early}{}", late_driver("late")), &[]);
    gantry.wait_line("early is ready after");
    let bus = join_bus(&sandbox, "test");
    assert_eq!(participants(&bus), ["early"]);
    let mut reader = snapshots(&bus);
    wait_tick(&mut reader, 0);
    // Time for hundreds of ticks, were it not for the one that is missing.
    std::thread::sleep(std::time::Duration::from_millis(500));
    assert_eq!(newest(&mut reader), None, "nothing was sent after tick 0");
    sandbox.write("late.go", "");
    gantry.wait_line("late is ready after");
    gantry.wait_line("all 3 processes are up");
    wait_tick(&mut reader, 20);
    drop((reader, bus));
    gantry.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn who_never_joins_ends_the_run_with_a_sentence() {
    let sandbox = Sandbox::new("never-joins");
    let idle = "[process.planner]\ncmd = [\"sleep\", \"100000\"]\nlockstep = true\nready = { within = \"1s\" }\n";
    let ended = up(&sandbox, idle, &[]).wait().expect_code(1);
    assert!(
        ended.says("process planner did not join lockstep as \"planner\" within 1 s, and the first tick waits for it; taking part: nobody"),
        "{:#?}",
        ended.lines
    );
    assert_nothing_left(&sandbox);
}

#[test]
fn who_ends_before_the_first_tick_ends_the_run_with_a_sentence() {
    let sandbox = Sandbox::new("dies-early");
    // One has never joined. The other has, and ends while the first tick waits for a third.
    let dead = "[process.planner]\ncmd = [\"sh\", \"-c\", \"exit 0\"]\nlockstep = true\n";
    let ended = up(&sandbox, dead, &[]).wait().expect_code(1);
    let sentence =
        "planner ended before the first tick, which waits until it has joined lockstep; stopping";
    assert!(ended.says(sentence), "{:#?}", ended.lines);
    let mut gantry = up(
        &sandbox,
        &format!("{}{}", late_driver("planner"), late_driver("third")),
        &[],
    );
    sandbox.write("planner.go", "");
    gantry.wait_line("planner is ready after");
    kill(pid_of(&gantry, "planner"), Signal::SIGKILL).unwrap();
    let ended = gantry.wait().expect_code(1);
    assert!(ended.says(sentence), "{:#?}", ended.lines);
    assert_nothing_left(&sandbox);
}

/// The process that the launcher started last under this name.
fn pid_of(gantry: &Process, name: &str) -> Pid {
    let start = format!("started {name} (pid ");
    let lines = gantry.lines();
    let pid = lines
        .iter()
        .rev()
        .find_map(|line| line.split(&start).nth(1)?.strip_suffix(')'));
    Pid::from_raw(
        pid.expect("the launcher says whom it starts")
            .parse()
            .unwrap(),
    )
}

#[test]
fn a_restart_before_the_first_tick_is_awaited_again() {
    let sandbox = Sandbox::new("restart-early");
    let restart = "restart = { policy = \"on-failure\", delay = \"1ms\" }\n";
    let mut gantry = up(
        &sandbox,
        &format!(
            "{}{restart}{}",
            late_driver("planner"),
            late_driver("third")
        ),
        &[],
    );
    sandbox.write("planner.go", "");
    gantry.wait_line("planner is ready after");
    let bus = join_bus(&sandbox, "test");
    let mut reader = snapshots(&bus);
    wait_tick(&mut reader, 0);
    std::fs::remove_file(sandbox.path("planner.go")).unwrap();
    kill(pid_of(&gantry, "planner"), Signal::SIGKILL).unwrap();
    eventually("nobody is left", || {
        participants(&bus).is_empty().then_some(())
    });
    // The place of the one that was killed does not count for the third.
    sandbox.write("third.go", "");
    gantry.wait_line("third is ready after");
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert_eq!(newest(&mut reader), None, "the first tick waits for both");
    sandbox.write("planner.go", "");
    gantry.wait_line("all 3 processes are up");
    wait_tick(&mut reader, 20);
    drop((reader, bus));
    gantry.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_restart_while_the_world_runs_frees_it_and_joins_again() {
    let sandbox = Sandbox::new("restart-late");
    let driver = "[process.driver]\ncmd = [\"gantry-drive\"]\nlockstep = true\nrestart = { policy = \"on-failure\", delay = \"200ms\" }\n";
    let mut gantry = up(&sandbox, driver, &[]);
    gantry.wait_line("all 2 processes are up");
    let bus = join_bus(&sandbox, "test");
    let mut reader = snapshots(&bus);
    wait_tick(&mut reader, 10);
    kill(pid_of(&gantry, "driver"), Signal::SIGKILL).unwrap();
    gantry.wait_line("restarting driver in 200 ms");
    eventually("it is ready again", || {
        let ready = |line: &&String| line.contains("driver is ready after");
        (gantry.lines().iter().filter(ready).count() == 2).then_some(())
    });
    eventually("the world waits for it again", || {
        (participants(&bus) == ["driver"]).then_some(())
    });
    let now = eventually("a tick", || newest(&mut reader));
    wait_tick(&mut reader, now + 10);
    drop((reader, bus));
    gantry.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_simulator_that_is_restarted_waits_for_those_who_run() {
    let sandbox = Sandbox::new("restart-simd");
    let driver = "[process.driver]\ncmd = [\"gantry-drive\"]\nlockstep = true\n";
    let restart = WORLD.replace(
        "required = true",
        "restart = { policy = \"on-failure\", delay = \"1ms\" }",
    );
    let file = sandbox.write("test.toml", &format!("{restart}{driver}"));
    let words = [
        "up",
        file.to_str().unwrap(),
        "--data",
        "data",
        "--domain",
        sandbox.domain(),
    ];
    let mut gantry = sandbox.spawn("gantry", &words);
    gantry.wait_line("all 2 processes are up");
    kill(pid_of(&gantry, "simd"), Signal::SIGKILL).unwrap();
    eventually("the driver has joined the second simulator", || {
        let ready = |line: &&String| line.contains("driver is ready after");
        (gantry.lines().iter().filter(ready).count() == 2).then_some(())
    });
    let bus = join_bus(&sandbox, "test");
    let mut reader = snapshots(&bus);
    wait_tick(&mut reader, 10);
    drop((reader, bus));
    gantry.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// Goal: what `docs/reference/launch-files.md` says of a program of a user holds for one in Python: folder,
/// environment, settings, domain, lockstep from the first tick on, and its restart.
#[test]
fn a_python_program_steps_with_the_world_from_its_first_tick() {
    let sandbox = Sandbox::new("python-steps");
    sandbox.write(
        "planner.py",
        "import json, os, sys\n\
         import gantry\n\
         settings = json.loads(sys.argv[-1])\n\
         with gantry.lockstep(settings['name']) as steps:\n\
         \x20   for n, tick in enumerate(steps):\n\
         \x20       if n < 3 or n == settings['n']:\n\
         \x20           print('at tick', tick, flush=True)\n\
         \x20       if n == settings['n'] and not os.path.exists('died'):\n\
         \x20           open('died', 'w').close()\n\
         \x20           os._exit(9)\n",
    );
    let planner = format!(
        "[process.planner]\ncmd = [{:?}, \"planner.py\"]\ncwd = \".\"\nenv = {{ PYTHONPATH = {:?} }}\nlockstep = true\n\
         restart = {{ policy = \"on-failure\", delay = \"1ms\" }}\nparams = {{ name = \"${{name}}\", n = 20 }}\n",
        venv_program("python").display().to_string(),
        python_package().display().to_string(),
    );
    let mut gantry = up(&sandbox, &planner, &[]);
    for tick in [1, 2, 3, 21] {
        gantry.wait_line(&format!("planner │ at tick {tick}"));
    }
    gantry.wait_line("planner ended with exit code 9");
    gantry.wait_line("restarting planner in 1 ms");
    // It joins again and goes on where the world is.
    eventually("a second start steps as far", || {
        let steps = |line: &&String| line.contains("planner │ at tick");
        (gantry.lines().iter().filter(steps).count() == 8).then_some(())
    });
    gantry.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// Without the launcher, too, and with the same words for the same mistake.
#[test]
fn the_simulator_itself_reads_files_with_what_they_include() {
    let sandbox = Sandbox::new("include");
    sandbox.write(
        "base.toml",
        "version = 1\n[scenario]\nmap = \"Town01\"\nseed = 4\n",
    );
    sandbox.write(
        "top.toml",
        "version = 1\ninclude = [\"base.toml\"]\n[ego]\ntype_id = \"none\"\n",
    );
    let export = |words: &[&str], file: &str| {
        let words = [words, &["--export-map", file]].concat();
        sandbox.spawn("simd", &words).wait().expect_code(0);
        std::fs::read_to_string(sandbox.path(file)).unwrap()
    };
    let included = export(&["--launch", "top.toml"], "a.xodr");
    let direct = export(
        &["--set", "scenario.map=Town01", "--set", "scenario.seed=4"],
        "b.xodr",
    );
    assert!(included.len() > 10_000 && included == direct);
    sandbox.write("top.toml", "version = 1\ninclude = [\"top.toml\"]\n");
    let ended = sandbox
        .spawn("simd", &["--launch", "top.toml", "--export-map", "c.xodr"])
        .wait()
        .expect_code(2);
    assert!(
        ended.says(
            "include goes in a circle: top.toml → top.toml; take one of them out at top.toml:2:11"
        ),
        "{:#?}",
        ended.lines
    );
}

/// Readers' places of a sensor's topic are those of the launch file, and so is its memory.
#[test]
fn the_simulator_gives_topics_the_places_that_the_file_says() {
    let sandbox = Sandbox::new("places");
    let camera = "[scenario]\nmode = \"stepped\"\n[sensor.front]\nkind = \"camera\"\nwidth_px = 64\nheight_px = 48\n\
        [topic.\"ego/front/rgb\"]\nreaders = 2\nbuffer = 5\nborrowed = 1\n";
    let mut gantry = up(&sandbox, camera, &[]);
    gantry.wait_line("all 1 processes are up");
    let bus = join_bus(&sandbox, "test");
    let topics = bus.topics().unwrap();
    let rgb = topics
        .iter()
        .find(|topic| topic.name == "ego/front/rgb")
        .unwrap();
    assert_eq!(rgb.max_subscribers, 2);
    let mut reader = bus.frame_reader("ego/front/rgb").unwrap();
    let _second = bus.frame_reader("ego/front/rgb").unwrap();
    let error = bus.frame_reader("ego/front/rgb").unwrap_err().to_string();
    assert!(error.contains('2'), "{error}");
    // Of eight frames the last five wait for a reader that sleeps, and it may hold one.
    let mut client = bus.command_client("test").unwrap();
    step(&mut client, 8);
    let waiting = std::iter::from_fn(|| reader.next().unwrap());
    let seqs: Vec<u64> = waiting.map(|frame| frame.header().seq).collect();
    assert_eq!(seqs, [4, 5, 6, 7, 8]);
    step(&mut client, 2);
    let held = reader.next().unwrap().expect("a frame");
    let error = reader.next().unwrap_err().to_string();
    assert!(error.contains('1'), "{error}");
    drop((held, reader, _second, client, bus));
    gantry.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
