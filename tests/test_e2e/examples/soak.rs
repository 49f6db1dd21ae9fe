//! Runs everything for an hour while clients, sensors, maps, weather and recordings come and go, and
//! watches what the processes keep.
//!
//! `cargo run --release -p test_e2e --example soak -- [--minutes M] [--json FILE]` (default 60;
//! `./gantry soak` runs it). The simulator, its gateway, the driver, a render worker, a bridge, another
//! one on a machine of its own, and two viewers (one into a file, one into a web page) stay for the
//! whole time. Beside them visitors of a stock client make weather, cars and sensors, and every third
//! is killed where it stands; now and then one loads another map. Recordings, readers here and on the
//! other machine, and a second worker begin and end with each visit, and are killed with every third.
//! Between two visits the long-lived processes are counted: memory of their own, descriptors, threads,
//! and files in shared memory. It fails if the last quarter keeps more than the second did, beyond an
//! allowance for memory; descriptors, threads and files are compared at their least, since guests of a
//! moment ago have some, too.

use std::os::unix::process::ExitStatusExt as _;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use launch_cli::bench::{self, BenchResult, clap};
use launch_cli::values::number;
use nix::libc::{SIGABRT, SIGSEGV};
use test_e2e::carla::{free_port, start_gateway, start_script};
use test_e2e::kept::Kept;
use test_e2e::recording::sequences;
use test_e2e::{assert_nothing_left, join_bus, spawn_consumer, start_daemon};
use test_kit::{PATIENCE, Process, Sandbox, eventually};

const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 10
vehicles = 4
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth", "instance"]
rate_hz = 5
width_px = 64
height_px = 48
mount.position_m = [0.6, 0.0, 1.6]
[sensor.roof]
kind = "lidar"
rate_hz = 5
channels = 4
columns = 90
mount.position_m = [0.0, 0.0, 2.0]
[sensor.imu]
kind = "imu"
rate_hz = 10
"#;
/// Between visits the world is always this one, so that equal worlds are compared.
const HOME: &str = "Town10HD";
/// What is read on the other machine: images, so that they are rendered, and sent there.
const FAR_TOPIC: &str = "ego/front/rgb";
const ELSEWHERE: [&str; 3] = ["Town01", "Town02", "Town03"];
/// Visits between two journeys to another map.
const VISITS_AT_HOME: u64 = 4;
/// How much more memory of its own a process may have in the last quarter than in the second:
/// freed memory that the allocator keeps moves by such steps.
const MAX_GROWTH_KIB: u64 = 16 << 10;
/// Descriptors and threads that come and go with a look round the bus.
const FEW: u64 = 8;
/// Of so many clients one may crash by itself.
const CRASHES_ONE_IN: u64 = 20;
/// The rerun viewer is another project's program, told to keep 64 MB of data and its own besides.
const WEB_MEMORY: &str = "64MB";

struct Look {
    minutes: f64,
    visits: u64,
    kept: Vec<Kept>,
    files: usize,
}

/// Runs everything while clients, sensors and maps come and go
#[derive(Debug, clap::Args)]
struct Args {
    /// Length, more than 0
    #[arg(long, value_name = "M", default_value_t = 60.0, value_parser = number("number of minutes", 0.01..=100_000.0))]
    minutes: f64,
}

fn main() -> ExitCode {
    bench::run("soak", |args: &Args, result| {
        soak(args.minutes, result);
        Ok(())
    })
}

fn soak(minutes: f64, result: &mut BenchResult) {
    let (sandbox, far) = (Sandbox::new("soak"), Sandbox::new("soak-far"));
    let daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let (gateway, port, _) = start_gateway(&sandbox);
    let driver = spawn_consumer(&sandbox, "gantry-drive", &[]);
    let saving = spawn_consumer(
        &sandbox,
        "gantry-view",
        &["--save", "soak.rrd", "--max-hz", "4"],
    );
    let mut web = spawn_consumer(
        &sandbox,
        "gantry-view",
        &["--web", "--max-hz", "4", "--memory-limit", WEB_MEMORY],
    );
    web.wait_line("open http");
    let mut worker = spawn_consumer(&sandbox, "gantry-render", &["--name", "staying"]);
    worker.wait_line("joined");
    let link = format!("tcp/127.0.0.1:{}", free_port());
    let mut bridge = spawn_consumer(&sandbox, "gantry-bridge", &["--listen", &link]);
    bridge.wait_line("ready");
    let mut far_bridge = spawn_consumer(&far, "gantry-bridge", &["--connect", &link]);
    far_bridge.wait_line("its world appears here");
    let bus = join_bus(&far, "soak");
    eventually("topics cross the bridges", || {
        let topics = bus.topics().ok()?;
        let is_there = topics.iter().any(|topic| topic.name == FAR_TOPIC);
        is_there.then_some(())
    });
    drop(bus);
    let mut staying = vec![
        ("simd", daemon),
        ("gantry-carla", gateway),
        ("gantry-drive", driver),
        ("gantry-view --save", saving),
        ("gantry-view --web", web),
        ("gantry-render", worker),
        ("gantry-bridge", bridge),
        ("gantry-bridge --connect", far_bridge),
    ];
    let (started, mut looks, mut visits, mut crashes) = (Instant::now(), Vec::new(), 0, 0);
    let port = port.to_string();
    while started.elapsed().as_secs_f64() < minutes * 60.0 {
        visits += 1;
        crashes += u64::from(!visit(&sandbox, &far, &port, visits));
        assert!(
            crashes <= 1 + visits / CRASHES_ONE_IN,
            "{crashes} of {visits} clients crashed"
        );
        if visits % VISITS_AT_HOME != 0 {
            continue;
        }
        let away = ELSEWHERE[(visits / VISITS_AT_HOME) as usize % ELSEWHERE.len()];
        journey(&sandbox, &port, visits, away);
        journey(&sandbox, &port, visits, HOME);
        // What was killed is cleaned up within a few ticks.
        std::thread::sleep(Duration::from_secs(3));
        let ended = |(_, process): &mut (_, Process)| !process.is_running();
        if let Some(idx) = staying.iter_mut().position(ended) {
            let (name, process) = staying.swap_remove(idx);
            let ended = process.wait();
            panic!(
                "{name} has ended ({}):\n{}",
                ended.status,
                ended.lines.join("\n")
            );
        }
        let kept = staying
            .iter()
            .map(|(_, process)| Kept::of(process.pid()).expect("it was alive just now"));
        let look = Look {
            minutes: started.elapsed().as_secs_f64() / 60.0,
            visits,
            kept: kept.collect(),
            files: sandbox.leftovers().len() + far.leftovers().len(),
        };
        println!(
            "{:.1} min, {} visits, {} files in shared memory: {:?}",
            look.minutes, look.visits, look.files, look.kept
        );
        looks.push(look);
        write(&looks, &staying, result);
    }
    let grown = growth(&looks, &staying);
    for (name, process) in staying {
        let ended = process.stop();
        assert_eq!(ended.status.code(), Some(0), "{name}: {:#?}", ended.lines);
    }
    assert_nothing_left(&sandbox);
    assert_nothing_left(&far);
    assert!(grown.is_empty(), "{}", grown.join("\n"));
    println!(
        "{visits} visits in {minutes} minutes, {crashes} of which ended in a crash of the stock client: nothing grew"
    );
}

/// A client comes with a recorder and a reader beside it, and goes or is killed. Returns whether it
/// did; the stock client's own library sometimes ends in a segmentation fault.
fn visit(sandbox: &Sandbox, far: &Sandbox, port: &str, number: u64) -> bool {
    let file = format!("visit{number}.mcap");
    let recorder = spawn_consumer(sandbox, "gantry-record", &["--out", &file]);
    let reader = spawn_consumer(sandbox, "gantry", &["topic", "hz", "ego/imu/imu"]);
    let mut far_reader = spawn_consumer(far, "gantry", &["topic", "hz", FAR_TOPIC]);
    let mut second = spawn_consumer(sandbox, "gantry-render", &["--name", "second"]);
    second.wait_line("joined");
    let crossed = far_reader.lines().len();
    eventually("frames cross the bridges", || {
        assert!(far_reader.is_running(), "{:#?}", far_reader.lines());
        (far_reader.lines().len() > crossed).then_some(())
    });
    let seed = number.to_string();
    let is_killed = number.is_multiple_of(3);
    let more: &[&str] = if is_killed { &["hang"] } else { &[] };
    let args = [&[port, &seed, "-"], more].concat();
    let mut client = start_script(sandbox, "soak_client.py", &args);
    let has_crashed = eventually("the client sees its sensors, or ends", || {
        let sees = client.lines().iter().any(|line| line == "seen");
        (sees || !client.is_running()).then_some(!sees)
    });
    if has_crashed {
        let ended = client.wait();
        println!("visit {number}: the client {}", ended.status);
        let is_own = matches!(ended.status.signal(), Some(SIGSEGV | SIGABRT));
        assert!(is_own, "{}: {:#?}", ended.status, ended.lines);
        for guest in [reader, far_reader, second] {
            guest.stop().expect_code(0);
        }
    } else if is_killed {
        client.kill9();
        for mut guest in [reader, far_reader, second] {
            assert!(guest.is_running());
            guest.kill9();
        }
    } else {
        let ended = client.wait_longer(PATIENCE).expect_code(0);
        assert!(ended.says("visit passed"), "{:#?}", ended.lines);
        for guest in [reader, far_reader, second] {
            guest.stop().expect_code(0);
        }
    }
    // A recorder on a busy machine may lose frames and say so.
    let code = recorder.stop().code();
    assert!([0, 3].contains(&code), "the recorder ended with {code}");
    let file = sandbox.path(&file);
    assert!(sequences(&file).contains_key("/world/snapshot"));
    std::fs::remove_file(file).expect("own files can be removed");
    !has_crashed
}

/// A client loads a map.
fn journey(sandbox: &Sandbox, port: &str, number: u64, map: &str) {
    let seed = number.to_string();
    let client = start_script(sandbox, "soak_client.py", &[port, &seed, map]);
    client.wait_longer(PATIENCE * 3).expect_code(0);
}

/// The most that was kept in the second quarter and in the last one, by what `of` looks at.
fn quarters(looks: &[Look], of: impl Fn(&Look) -> u64) -> (u64, u64) {
    let most = |looks: &[Look]| looks.iter().map(&of).max().unwrap_or_default();
    let (second, last) = second_and_last(looks);
    (most(second), most(last))
}

/// The same, the least. A viewer keeps the ports of guests for a while, so what it has open moves
/// with how many came just before; what is kept for good is there at its quietest, too.
fn least(looks: &[Look], of: impl Fn(&Look) -> u64) -> (u64, u64) {
    let least = |looks: &[Look]| looks.iter().map(&of).min().unwrap_or_default();
    let (second, last) = second_and_last(looks);
    (least(second), least(last))
}

fn second_and_last(looks: &[Look]) -> (&[Look], &[Look]) {
    let n = looks.len();
    (
        &looks[n / 4..(n / 2).max(n / 4 + 1)],
        &looks[n - (n / 4).max(1)..],
    )
}

/// What the last quarter keeps beyond the second quarter, one sentence each.
fn growth(looks: &[Look], staying: &[(&str, Process)]) -> Vec<String> {
    if looks.len() < 8 {
        println!("{} looks are too few to compare; run longer", looks.len());
        return Vec::new();
    }
    let mut sentences = Vec::new();
    let mut compare = |what: String, allowance: u64, (was, is): (u64, u64)| {
        if is > was + allowance {
            sentences.push(format!("{what} grew from {was} to {is}"));
        }
    };
    for (idx, (name, _)) in staying.iter().enumerate() {
        let own = quarters(looks, |look| look.kept[idx].own_kib);
        compare(format!("{name}: own memory, KiB,"), MAX_GROWTH_KIB, own);
        let descriptors = least(looks, |look| look.kept[idx].descriptors as u64);
        compare(format!("{name}: descriptors"), FEW, descriptors);
        let threads = least(looks, |look| look.kept[idx].threads as u64);
        compare(format!("{name}: threads"), FEW, threads);
    }
    let files = least(looks, |look| look.files as u64);
    compare("files in shared memory".into(), 5 * FEW, files);
    sentences
}

/// Writes what was seen so far, so that a soak that is broken off has its figures.
fn write(looks: &[Look], staying: &[(&str, Process)], result: &mut BenchResult) {
    result.clear();
    let last = looks.last().expect("there was a look");
    let files = quarters(looks, |look| look.files as u64);
    for (idx, (name, _)) in staying.iter().enumerate() {
        let own = quarters(looks, |look| look.kept[idx].own_kib);
        let descriptors = quarters(looks, |look| look.kept[idx].descriptors as u64);
        let threads = quarters(looks, |look| look.kept[idx].threads as u64);
        let figures = [
            ("minutes", last.minutes.round()),
            ("visits", last.visits as f64),
            ("own_before_kib", own.0 as f64),
            ("own_after_kib", own.1 as f64),
            ("descriptors_before", descriptors.0 as f64),
            ("descriptors_after", descriptors.1 as f64),
            ("threads_before", threads.0 as f64),
            ("threads_after", threads.1 as f64),
            // Of all of them.
            ("files_before", files.0 as f64),
            ("files_after", files.1 as f64),
        ];
        result.row(name, &figures);
    }
    let written = result.write();
    written.unwrap_or_else(|error| panic!("{error:#}"));
}
