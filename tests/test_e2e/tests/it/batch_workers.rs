//! Batches that render workers make: the same bytes whoever renders, all images of a frame by one
//! process, and no tick lost when one comes, goes or is killed.

use std::collections::BTreeMap;

use schema_bus::{Bus, CommandClient, FrameReader};
use schema_frames::{Command, CommandReply, FrameHeader};
use test_e2e::workers::{assert_same, joined_worker, worker};
use test_e2e::{ask, assert_nothing_left, counter, join_bus, reader, start_daemon};
use test_kit::client::{cue, join_lockstep, step, wait_workers};
use test_kit::{Process, Sandbox, eventually};

/// Two rigs with a batch across them for each of their two cameras, and one camera in none. The
/// spectator, which is a camera to workers too, weighs less than a batch.
const RIG: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
mode = "stepped"
vehicles = 3
[spectator]
width_px = 32
height_px = 32
[rig.chaser]
vehicle = 1
[sensor.front]
kind = "camera"
rig = ["ego", "chaser"]
modalities = ["rgb", "depth", "flow", "dvs"]
rate_hz = 20
width_px = 40
height_px = 24
optics.exposure.mode = "histogram"
mount.position_m = [0.6, 0.0, 1.6]
[sensor.rear]
kind = "camera"
rig = ["ego", "chaser"]
modalities = ["rgb", "depth", "flow"]
rate_hz = 10
width_px = 64
height_px = 32
mount.position_m = [-1.5, 0.0, 1.6]
mount.rpy_deg = [0.0, 0.0, 180.0]
[sensor.up]
kind = "camera"
rate_hz = 20
width_px = 48
height_px = 48
mount.position_m = [0.0, 0.0, 2.0]
[batch.fronts]
cameras = ["chaser/front", "ego/front"]
modalities = ["rgb", "depth", "flow"]
[batch.rears]
cameras = ["*/rear"]
modalities = ["rgb", "flow"]
"#;

/// Topics of batches, and the cameras whose images they have.
const BATCHES: [(&str, [&str; 2]); 5] = [
    ("batch/fronts/rgb", ["chaser/front/rgb", "ego/front/rgb"]),
    (
        "batch/fronts/depth",
        ["chaser/front/depth", "ego/front/depth"],
    ),
    ("batch/fronts/flow", ["chaser/front/flow", "ego/front/flow"]),
    ("batch/rears/rgb", ["ego/rear/rgb", "chaser/rear/rgb"]),
    ("batch/rears/flow", ["ego/rear/flow", "chaser/rear/flow"]),
];

/// Header bytes and payload of the frames of a tick, by topic.
type Frames = BTreeMap<String, (Vec<u8>, Vec<u8>)>;

/// Readers of batches, and of the cameras' own topics or of batches alone.
struct Readers(Vec<FrameReader>);

impl Readers {
    fn of_batches(bus: &Bus) -> Readers {
        Readers(
            BATCHES
                .iter()
                .map(|(topic, _)| reader(bus, topic))
                .collect(),
        )
    }

    fn of_all(bus: &Bus) -> Readers {
        let own = BATCHES.iter().flat_map(|(_, own)| own);
        let own = own.map(|topic| reader(bus, topic));
        Readers(Readers::of_batches(bus).0.into_iter().chain(own).collect())
    }

    /// Takes the frames of a tick, one for each topic that is due.
    fn see(&mut self, tick: u64) -> Frames {
        let mut frames = Frames::new();
        for reader in &mut self.0 {
            let topic = reader.topic().to_owned();
            if topic.contains("rear") && tick.is_multiple_of(2) {
                continue;
            }
            let frame = eventually(&format!("{topic} at tick {tick}"), || {
                reader.next().unwrap()
            });
            assert_eq!(frame.header().tick, tick, "{topic}");
            let bytes = (frame.header().hashed_bytes().to_vec(), frame.to_vec());
            frames.insert(topic, bytes);
        }
        frames
    }

    /// The process that writes a topic.
    fn writer(&self, topic: &str) -> Option<u32> {
        let reader = self.0.iter().find(|it| it.topic() == topic);
        let writer = reader.expect("it is read").writer();
        writer.and_then(|origin| origin.pid)
    }

    fn assert_none_lost(&self) {
        for reader in &self.0 {
            let counts = reader.counts();
            assert_eq!((counts.lost, counts.refused), (0, 0), "{}", reader.topic());
        }
    }
}

/// Each batch has the images of its cameras' own topics, one after the other.
fn assert_whole(frames: &Frames) {
    for (topic, own) in BATCHES {
        let Some((_, whole)) = frames.get(topic) else {
            continue;
        };
        let images: Vec<u8> = own.iter().flat_map(|own| frames[*own].1.clone()).collect();
        assert!(*whole == images, "{topic} is not {own:?}");
    }
}

/// Runs ticks, and sees all of their frames.
fn run_ticks(
    client: &mut CommandClient,
    readers: &mut Readers,
    ticks: std::ops::RangeInclusive<u64>,
) {
    for tick in ticks {
        assert_eq!(cue(client), tick);
        assert_whole(&readers.see(tick));
    }
}

/// Frames of the first ticks of a run.
fn run(name: &str, n_workers: usize, args: &[&str], all: bool) -> Vec<Frames> {
    let sandbox = Sandbox::new(name);
    let n = n_workers.to_string();
    let args = [&["--await-workers", &n], args].concat();
    let daemon = start_daemon(&sandbox, RIG, &args);
    let workers: Vec<Process> = (0..n_workers)
        .map(|idx| worker(&sandbox, &format!("w{idx}")))
        .collect();
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = match all {
        true => Readers::of_all(&bus),
        false => Readers::of_batches(&bus),
    };
    let mut ticks = Vec::new();
    for tick in 1..=6 {
        assert_eq!(cue(&mut client), tick);
        ticks.push(readers.see(tick));
    }
    if all {
        ticks.iter().for_each(assert_whole);
    }
    // Each batch is made by one process, and two workers have one each.
    let mut pids: Vec<u32> = ["batch/fronts/rgb", "batch/rears/rgb"]
        .iter()
        .map(|topic| readers.writer(topic).expect("it has a writer"))
        .collect();
    pids.sort_unstable();
    pids.dedup();
    let mut by_workers: Vec<u32> = workers.iter().map(|worker| worker.pid()).collect();
    by_workers.sort_unstable();
    match n_workers {
        0 => assert_eq!(pids, [daemon.pid()]),
        _ => assert_eq!(pids, by_workers),
    }
    let moved = if n_workers > 0 { 2 } else { 0 };
    assert_eq!(counter(&mut client, "batches_moved"), moved);
    readers.assert_none_lost();
    drop((readers, client, bus));
    for worker in workers {
        worker.stop().expect_code(0);
    }
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
    ticks
}

#[test]
fn bytes_of_batches_do_not_depend_on_who_renders() {
    let alone = run("bw-alone", 0, &[], true);
    assert_same(&alone, &run("bw-one", 1, &["--no-gpu"], true));
    assert_same(&alone, &run("bw-two", 2, &["--no-gpu"], true));
    assert_same(&alone, &run("bw-gpu", 2, &[], true));
}

/// The simulator counts the readers of batches, and asks workers for the images of cameras that
/// nobody reads by themselves.
#[test]
fn a_worker_makes_batches_whose_cameras_nobody_reads() {
    let alone = run("bw-batch", 0, &[], false);
    assert_same(&alone, &run("bw-batch-two", 2, &["--no-gpu"], false));
}

#[test]
fn a_killed_workers_batch_moves_and_costs_no_tick() {
    let sandbox = Sandbox::new("bw-kill");
    let daemon = start_daemon(&sandbox, RIG, &["--no-gpu", "--await-workers", "2"]);
    let (one, two) = (worker(&sandbox, "one"), worker(&sandbox, "two"));
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = Readers::of_all(&bus);
    run_ticks(&mut client, &mut readers, 1..=4);
    assert_eq!(counter(&mut client, "batches_moved"), 2);
    // In the middle of a tick, as likely as not.
    cue(&mut client);
    one.kill9();
    assert_whole(&readers.see(5));
    run_ticks(&mut client, &mut readers, 6..=7);
    assert_eq!(counter(&mut client, "batches_moved"), 3);
    // One that comes gets one of them.
    let three = joined_worker(&sandbox, "three");
    wait_workers(&mut client, 2);
    run_ticks(&mut client, &mut readers, 8..=10);
    assert_eq!(counter(&mut client, "batches_moved"), 4);
    cue(&mut client);
    two.kill9();
    assert_whole(&readers.see(11));
    run_ticks(&mut client, &mut readers, 12..=13);
    assert_eq!(readers.writer("batch/fronts/rgb"), Some(three.pid()));
    assert_eq!(readers.writer("batch/rears/flow"), Some(three.pid()));
    assert_eq!(counter(&mut client, "batches_moved"), 5);
    readers.assert_none_lost();
    drop((readers, client, bus));
    three.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_simulator_that_draws_gives_its_batches_away_and_takes_them_back() {
    let sandbox = Sandbox::new("bw-own");
    let daemon = start_daemon(&sandbox, RIG, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = Readers::of_all(&bus);
    let topic = "batch/fronts/depth";
    let mut tick = 0;
    for killed in [true, false] {
        run_ticks(&mut client, &mut readers, tick + 1..=tick + 2);
        assert_eq!(readers.writer(topic), Some(daemon.pid()));
        let one = joined_worker(&sandbox, "one");
        wait_workers(&mut client, 1);
        run_ticks(&mut client, &mut readers, tick + 3..=tick + 4);
        assert_eq!(readers.writer(topic), Some(one.pid()));
        cue(&mut client);
        match killed {
            true => drop(one.kill9()),
            false => drop(one.stop().expect_code(0)),
        }
        tick += 5;
        assert_whole(&readers.see(tick));
        wait_workers(&mut client, 0);
    }
    run_ticks(&mut client, &mut readers, tick + 1..=tick + 2);
    assert_eq!(readers.writer(topic), Some(daemon.pid()));
    assert_eq!(counter(&mut client, "batches_moved"), 8);
    readers.assert_none_lost();
    drop((readers, client, bus));
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// In lockstep, a tick begins when the batches of the last one are there.
#[test]
fn lockstep_goes_on_without_the_killed_worker_of_a_batch() {
    let sandbox = Sandbox::new("bw-lockstep");
    let rig = RIG.replace("mode = \"stepped\"\n", "");
    let args = ["--no-gpu", "--await-workers", "2", "--await-lockstep", "1"];
    let daemon = start_daemon(&sandbox, &rig, &args);
    let (one, two) = (worker(&sandbox, "one"), worker(&sandbox, "two"));
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut readers = Readers::of_batches(&bus);
    let acks = bus.ack_writer("reader").unwrap();
    let participant = join_lockstep(&mut client, "reader");
    let mut one = Some(one);
    for tick in 1..=8 {
        if tick == 4 {
            one.take().expect("killed once").kill9();
        }
        assert!(readers.see(tick).len() >= 3);
        let epoch = readers.0[0].epoch().expect("a frame came");
        acks.send(participant, epoch, tick).unwrap();
    }
    assert_eq!(readers.writer("batch/rears/rgb"), Some(two.pid()));
    readers.assert_none_lost();
    ask(&mut client, Command::LeaveLockstep { participant });
    drop((readers, acks, client, bus));
    two.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_batch_waits_for_a_worker_where_nobody_draws_and_lacks_what_has_ended() {
    let sandbox = Sandbox::new("bw-none");
    let mut daemon = start_daemon(&sandbox, RIG, &["--no-gpu"]);
    daemon.wait_line("the cameras have no frames");
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut fronts = reader(&bus, "batch/fronts/rgb");
    let mut up = reader(&bus, "ego/front/rgb");
    assert_eq!(step(&mut client, 2), 2);
    assert!(fronts.next().unwrap().is_none());
    let mut one = joined_worker(&sandbox, "one");
    wait_workers(&mut client, 1);
    cue(&mut client);
    let frame = eventually("a frame", || fronts.next().unwrap());
    let header = frame.header();
    assert_eq!((header.tick, header.seq, header.n_images), (3, 3, 2));
    assert_eq!(header.flags & FrameHeader::FIRST, FrameHeader::FIRST);
    drop(frame);
    let frame = eventually("a frame", || up.next().unwrap());
    let actor_id = frame.header().sensor_id;
    drop(frame);
    assert_eq!(counter(&mut client, "dropped_by_workers"), 0);
    assert_eq!(
        ask(&mut client, Command::Destroy { actor_id }),
        CommandReply::Done
    );
    step(&mut client, 2);
    one.wait_line("makes no image in this tick");
    eventually("what the worker says of it", || {
        (counter(&mut client, "dropped_by_workers") == 2).then_some(())
    });
    assert!(
        fronts.next().unwrap().is_none(),
        "no frame without its image"
    );
    drop((fronts, up, client, bus));
    one.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
