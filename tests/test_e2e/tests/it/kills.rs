//! `kill -9` with every consumer running: the surviving processes go on, a restarted process carries
//! on, and nothing is left in shared memory.

use nix::sys::signal::Signal;
use schema_frames::ActorKind;
use test_e2e::recording::{gapless, sequences};
use test_e2e::{
    SMALL_RIG, SMALL_RIG_TOPICS, assert_nothing_left, counter, join_bus, python_package, reader,
    spawn_consumer, start_daemon, venv_program, wait_readers,
};
use test_kit::{Process, Sandbox, eventually};

const DRIVING: &str = "driving vehicles=5";

fn wait_size(sandbox: &Sandbox, file: &str, n_bytes: u64) {
    eventually(&format!("{file} has {n_bytes} bytes"), || {
        std::fs::metadata(sandbox.path(file))
            .is_ok_and(|file| file.len() >= n_bytes)
            .then_some(())
    });
}

fn wait_growth(sandbox: &Sandbox, file: &str) {
    let size = std::fs::metadata(sandbox.path(file)).map_or(0, |file| file.len());
    wait_size(sandbox, file, size + 1);
}

fn record(sandbox: &Sandbox, file: &str) -> Process {
    let recorder = spawn_consumer(
        sandbox,
        "gantry-record",
        &["--out", file, "--compression", "none"],
    );
    // The map is some 2 MB of it, then frames follow.
    wait_size(sandbox, &format!("{file}.part"), 6_000_000);
    recorder
}

fn view(sandbox: &Sandbox, file: &str) -> Process {
    let viewer = spawn_consumer(sandbox, "gantry-view", &["--save", file]);
    wait_size(sandbox, file, 500_000);
    viewer
}

fn drive(sandbox: &Sandbox) -> Process {
    let mut driver = spawn_consumer(sandbox, "gantry-drive", &[]);
    driver.wait_line(DRIVING);
    driver
}

/// Waits until a vehicle of this run, or of one after `epoch`, moves under control.
fn wait_driven(sandbox: &Sandbox, after_epoch: Option<u64>) -> u64 {
    let bus = join_bus(sandbox, "looking");
    let mut snapshots = eventually("snapshots", || bus.snapshot_reader().ok());
    eventually("a vehicle is driven", || {
        let snapshot = snapshots
            .latest()
            .unwrap()
            .filter(|snapshot| Some(snapshot.header().epoch) != after_epoch)?;
        let is_driven = |record: &schema_frames::ActorRecord| {
            record.kind() == Some(ActorKind::Vehicle) && record.speed_mps() > 1.0
        };
        snapshot
            .records()
            .iter()
            .any(is_driven)
            .then_some(snapshot.header().epoch)
    })
}

#[test]
fn each_consumer_may_be_killed_and_come_back() {
    let sandbox = Sandbox::new("kills");
    let mut daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let viewer = view(&sandbox, "a.rrd");
    let recorder = record(&sandbox, "a.mcap");
    let driver = drive(&sandbox);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut go_on = |what: &str| {
        let before = counter(&mut client, "sent ego/front/rgb");
        eventually(&format!("frames after {what} was killed"), || {
            (counter(&mut client, "sent ego/front/rgb") > before + 10).then_some(())
        });
    };

    viewer.kill9();
    go_on("the viewer");
    wait_growth(&sandbox, "a.mcap.part");
    let viewer = view(&sandbox, "b.rrd");

    recorder.kill9();
    go_on("the recorder");
    wait_growth(&sandbox, "b.rrd");
    let recorder = record(&sandbox, "b.mcap");

    driver.kill9();
    go_on("the driver");
    wait_growth(&sandbox, "b.mcap.part");
    let driver = drive(&sandbox);
    wait_driven(&sandbox, None);

    for process in [viewer, driver] {
        process.stop().expect_code(0);
    }
    // A recorder on a busy machine may lose frames and say so; what matters here is that it
    // finishes its file.
    assert!([0, 3].contains(&recorder.stop().code()));
    sequences(&sandbox.path("b.mcap"));
    assert!(daemon.is_running());
    drop((client, bus));
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn all_consumers_carry_on_by_themselves_after_the_simulator_was_killed() {
    let sandbox = Sandbox::new("resume");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let viewer = view(&sandbox, "drive.rrd");
    let recorder = record(&sandbox, "drive.mcap");
    let driver = drive(&sandbox);
    let epoch = wait_driven(&sandbox, None);
    daemon.kill9();

    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    assert_ne!(wait_driven(&sandbox, Some(epoch)), epoch);
    wait_size(&sandbox, "drive.2.mcap.part", 6_000_000);
    wait_size(&sandbox, "drive.2.rrd", 500_000);
    assert!(
        driver
            .lines()
            .iter()
            .filter(|line| line.contains(DRIVING))
            .count()
            >= 2
    );
    for process in [viewer, driver] {
        process.stop().expect_code(0);
    }
    let code = recorder.stop().code();
    assert!([0, 3].contains(&code));
    let (first, second) = (
        sequences(&sandbox.path("drive.mcap")),
        sequences(&sandbox.path("drive.2.mcap")),
    );
    for topic in SMALL_RIG_TOPICS {
        let channel = format!("/{topic}/gantry");
        assert!(
            first.contains_key(&channel) && second.contains_key(&channel),
            "{topic} is recorded before and after"
        );
    }
    // On a busy machine it may lose some, and says so by its code.
    assert!(
        code == 3 || gapless(&second, "/world/snapshot").0 <= 5,
        "the new run is recorded from its start"
    );
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// A reader that holds as many frames as it may is killed; its place and its frames become free
/// again. This is done more often than the topic has places for readers.
#[test]
fn readers_killed_while_they_hold_frames_give_their_places_back() {
    let sandbox = Sandbox::new("holders");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let code = format!(
        "import gantry, time\nwith gantry.open('ego/front/depth', domain={:?}) as topic:\n    held = [topic.next(timeout=60) for _ in range(3)]\n    print('holding', len(held), flush=True)\n    time.sleep(1e6)",
        sandbox.domain()
    );
    let source = python_package();
    let env = [
        ("PYTHONPATH", source.to_str().unwrap()),
        ("PYTHONDONTWRITEBYTECODE", "1"),
    ];
    let bus = join_bus(&sandbox, "test");
    let mut survivor = reader(&bus, "ego/front/depth");
    for _ in 0..3 {
        let start =
            |_| sandbox.spawn_program("holder", &venv_program("python"), &["-c", &code], &env);
        let mut holders: Vec<Process> = (0..4).map(start).collect();
        holders
            .iter_mut()
            .for_each(|holder| drop(holder.wait_line("holding 3")));
        wait_readers(&bus, "ego/front/depth", 5);
        for holder in holders {
            holder.signal(Signal::SIGKILL);
            holder.wait();
        }
        let seq = eventually("a frame", || survivor.latest().unwrap())
            .header()
            .seq;
        eventually("ten frames more", || {
            survivor
                .latest()
                .unwrap()
                .filter(|frame| frame.header().seq > seq + 10)
        });
    }
    let mut client = bus.command_client("test").unwrap();
    assert_eq!(
        counter(&mut client, "dropped ego/front/depth"),
        0,
        "the daemon never lacked a slot"
    );
    drop((survivor, client, bus));
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
