//! Batches across processes: the images of several cameras in one frame, in shared memory and on the
//! GPU (whose memory is mapped here), compared with the cameras' own topics byte for byte.

use crate::common;

use common::{child, on_gpu, take};
use consumer_gpu::GpuTopic;
use schema_bus::{Bus, CommandClient, FrameReader, names};
use schema_frames::{Command, CommandReply, FrameHeader, Modality, WorldInfo};
use test_kit::client::{ask, assert_nothing_left, counter, document, join_bus, reader, step};
use test_kit::programs::start_daemon;
use test_kit::{Ended, Sandbox, eventually};

const MODALITIES: [Modality; 6] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];

/// Cameras on two rigs, of which all but one fire in every second tick; two batches in other orders
/// than that of the sensors.
const RIG: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
mode = "stepped"
vehicles = 3
[rig.chaser]
vehicle = 1
[sensor.front]
kind = "camera"
rig = ["ego", "chaser"]
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals", "dvs"]
rate_hz = 10
width_px = 40
height_px = 24
optics.exposure.mode = "histogram"
mount.position_m = [0.6, 0.0, 1.6]
[sensor.rear]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals"]
rate_hz = 10
width_px = 40
height_px = 24
fov_deg = 60.0
mount.position_m = [-1.5, 0.0, 1.6]
mount.rpy_deg = [0.0, 0.0, 180.0]
[sensor.other]
kind = "camera"
rate_hz = 20
width_px = 64
height_px = 48
[sensor.roof]
kind = "imu"
rate_hz = 20
[batch.fleet]
cameras = ["ego/rear", "*/front"]
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals"]
[batch.pair]
cameras = ["chaser/front", "ego/rear"]
"#;

const FLEET: [&str; 3] = ["ego/rear", "ego/front", "chaser/front"];
const PAIR: [&str; 2] = ["chaser/front", "ego/rear"];
const IMAGE_PX: usize = 40 * 24;

fn free_running() -> String {
    RIG.replace("mode = \"stepped\"\n", "")
}

/// Readers of a batch and of its cameras' own topics.
struct Batch {
    cameras: Vec<FrameReader>,
    host: FrameReader,
    gpu: GpuTopic,
    modality: Modality,
}

impl Batch {
    fn open(bus: &Bus, name: &str, cameras: &[&str], modality: Modality) -> Batch {
        let topic = format!("batch/{name}/{}", modality.name());
        let own = |camera: &&str| reader(bus, &format!("{camera}/{}", modality.name()));
        Batch {
            cameras: cameras.iter().map(own).collect(),
            host: reader(bus, &topic),
            gpu: on_gpu(bus, &topic),
            modality,
        }
    }

    /// Takes the frames of a tick and compares them.
    fn compare(&mut self, bus: &Bus, tick: u64) {
        let name = self.host.topic().to_owned();
        let host = eventually(&name, || self.host.next().unwrap());
        let gpu = eventually(&name, || take(&mut self.gpu, bus));
        let header = host.header();
        assert_eq!(header.tick, tick, "{name}");
        assert_eq!(
            (header.n_images as usize, header.width, header.height),
            (self.cameras.len(), 40, 24 * self.cameras.len() as u32)
        );
        assert_eq!(header.hashed_bytes(), gpu.header().hashed_bytes(), "{name}");
        assert_eq!(gpu.header().payload_place, FrameHeader::ON_GPU);
        assert_eq!(gpu.header().cpu_copies, 0);
        assert!(*host == gpu.to_bytes().unwrap()[..], "{name} at {tick}");
        let image_bytes = IMAGE_PX * self.modality.element_bytes();
        let mut is_first = false;
        for (index, own) in self.cameras.iter_mut().enumerate() {
            let camera = own.topic().to_owned();
            let own = eventually(&camera, || own.next().unwrap());
            let of_own = own.header();
            assert_eq!(
                (of_own.tick, of_own.seq, of_own.sim_nanos, of_own.epoch),
                (header.tick, header.seq, header.sim_nanos, header.epoch),
                "{camera}"
            );
            assert_eq!(of_own.window_nanos, header.window_nanos, "{camera}");
            is_first |= of_own.flags & FrameHeader::FIRST != 0;
            assert_eq!((of_own.n_images, own.len()), (0, image_bytes));
            let range = header.image_range(index as u32);
            assert_eq!(range, index * image_bytes..(index + 1) * image_bytes);
            assert!(
                host[range] == own[..],
                "image {index} of {name} is not that of {camera} at tick {tick}"
            );
        }
        assert_eq!(header.flags & FrameHeader::FIRST != 0, is_first, "{name}");
    }
}

#[test]
fn images_are_those_of_the_cameras_own_topics_in_shared_memory_and_on_the_gpu() {
    for extra in [&[][..], &["--one-queue"][..], &["--staged"][..]] {
        let sandbox = Sandbox::new("batches");
        let daemon = start_daemon(&sandbox, RIG, extra);
        let bus = join_bus(&sandbox, "test");
        let mut client = bus.command_client("test").unwrap();
        let fleet = MODALITIES.map(|it| Batch::open(&bus, "fleet", &FLEET, it));
        let pair = Batch::open(&bus, "pair", &PAIR, Modality::Rgb);
        let mut batches: Vec<Batch> = fleet.into_iter().chain([pair]).collect();
        for tick in 1..=7 {
            assert_eq!(step(&mut client, 1), tick);
            if tick % 2 == 1 {
                batches.iter_mut().for_each(|it| it.compare(&bus, tick));
            }
        }
        for batch in &mut batches {
            assert!(batch.host.next().unwrap().is_none());
            assert_eq!((batch.host.counts().lost, batch.gpu.counts().lost), (0, 0));
        }
        drop((batches, client, bus));
        daemon.stop().expect_code(0);
        assert_nothing_left(&sandbox);
    }
}

#[test]
fn a_batch_alone_is_drawn_once_and_only_where_it_is_read() {
    let sandbox = Sandbox::new("batch-alone");
    let _daemon = start_daemon(&sandbox, RIG, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let topic = "batch/fleet/depth";
    let mut copies = {
        let mut last = counter(&mut client, "gpu_copies");
        // Every second tick has images.
        move |client: &mut CommandClient| {
            step(client, 2);
            let now = counter(client, "gpu_copies");
            now - std::mem::replace(&mut last, now)
        }
    };
    assert_eq!(copies(&mut client), 0);
    let mut host = reader(&bus, topic);
    assert_eq!(copies(&mut client), 3, "to shared memory alone");
    let first = eventually("a frame", || host.next().unwrap());
    assert!(first.iter().any(|byte| *byte != 0));
    let mut gpu = on_gpu(&bus, topic);
    assert_eq!(copies(&mut client), 6, "to both");
    drop((first, host));
    assert_eq!(copies(&mut client), 3, "to the GPU alone");
    assert_eq!(counter(&mut client, "dropped batch/fleet/depth"), 0);
    while let Some(frame) = take(&mut gpu, &bus) {
        assert_eq!(frame.n_bytes(), 3 * IMAGE_PX * 4);
    }
    // An own topic beside it is one copy more, and not one drawing more.
    let passes = |client: &mut CommandClient| counter(client, "gpu_passes");
    let before = passes(&mut client);
    copies(&mut client);
    let alone = passes(&mut client) - before;
    let _own = reader(&bus, "ego/rear/depth");
    let before = passes(&mut client);
    assert_eq!(copies(&mut client), 4);
    assert_eq!(passes(&mut client) - before, alone);
    drop((gpu, _own));
    assert_eq!(copies(&mut client), 0);
}

#[test]
fn readers_of_a_batch_may_be_killed() {
    let sandbox = Sandbox::new("batch-kills");
    let daemon = start_daemon(&sandbox, &free_running(), &[]);
    let bus = join_bus(&sandbox, "test");
    let (mut gpu, mut host) = (
        on_gpu(&bus, "batch/fleet/rgb"),
        reader(&bus, "batch/fleet/rgb"),
    );
    for _ in 0..8 {
        let mut child = child(&sandbox, "read_batch", &[]);
        child.wait_line("read tick");
        child.kill9();
        bus.clean_dead_nodes();
        while take(&mut gpu, &bus).is_some() || host.next().unwrap().is_some() {}
        let there = eventually("a frame after the kill", || take(&mut gpu, &bus));
        let here = eventually("a frame after the kill", || host.next().unwrap());
        assert_eq!(
            (there.n_bytes(), here.len()),
            (3 * IMAGE_PX * 4, 3 * IMAGE_PX * 4)
        );
    }
    assert_eq!((gpu.counts().refused, host.counts().refused), (0, 0));
    drop((gpu, host, bus));
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_frame_that_lacks_an_image_is_left_out_and_counted() {
    let sandbox = Sandbox::new("batch-gap");
    let mut daemon = start_daemon(&sandbox, RIG, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let info: WorldInfo = document(&bus, names::WORLD_INFO).json().unwrap();
    let [fleet, pair] = &info.batches[..] else {
        panic!("{:?}", info.batches);
    };
    let names_of = |cameras: &[schema_frames::BatchCamera]| -> Vec<String> {
        cameras.iter().map(|camera| camera.name.clone()).collect()
    };
    assert_eq!((&*fleet.name, &*pair.name), ("fleet", "pair"));
    assert_eq!(names_of(&fleet.cameras), FLEET);
    assert_eq!(names_of(&pair.cameras), PAIR);
    assert_eq!(fleet.topics.len(), 6);
    assert_eq!(pair.topics[0].topic, "batch/pair/rgb");
    let mut host = reader(&bus, "batch/fleet/rgb");
    let mut pair = reader(&bus, "batch/pair/rgb");
    let mut own = reader(&bus, "ego/front/rgb");
    step(&mut client, 1);
    assert!(eventually("a frame", || host.next().unwrap()).header().seq == 1);
    let of_own = eventually("a frame", || own.next().unwrap());
    let front = &fleet.cameras[1];
    assert_eq!(front.sensor_id, of_own.header().sensor_id);
    assert_eq!(front.intrinsics_px, of_own.header().intrinsics_px);
    let mut snapshots = bus.snapshot_reader().unwrap();
    step(&mut client, 1);
    let snapshot = eventually("a snapshot", || snapshots.latest().unwrap());
    let has = |id: u32| snapshot.records().iter().any(|it| it.id == id);
    assert!(fleet.cameras.iter().all(|camera| has(camera.sensor_id)));
    let dropped = |client: &mut CommandClient| counter(client, "dropped batch/fleet/rgb");
    assert_eq!(dropped(&mut client), 0);
    let actor_id = front.sensor_id;
    assert_eq!(
        ask(&mut client, Command::Destroy { actor_id }),
        CommandReply::Done
    );
    // Ticks 3 and 5 have images.
    step(&mut client, 4);
    assert_eq!(dropped(&mut client), 2);
    assert!(host.next().unwrap().is_none(), "no frame without its image");
    daemon.wait_line("makes no image in this tick");
    // The other batch has all of its images.
    let seqs: Vec<u64> = std::iter::from_fn(|| pair.next().unwrap())
        .map(|frame| frame.header().seq)
        .collect();
    assert_eq!(seqs, [2, 3], "the newest two that waited");
}

/// Sentences of a simulator that does not start.
fn refusal(launch: &str, extra: &[&str]) -> Ended {
    let sandbox = Sandbox::new("batch-refused");
    let file = sandbox.write("launch.toml", launch);
    let file = file.to_str().unwrap();
    let mut arguments = vec!["--launch", file, "--domain", sandbox.domain()];
    arguments.extend(extra);
    sandbox.spawn("simd", &arguments).wait().expect_code(2)
}

#[test]
fn batches_that_cannot_be_are_refused_before_anything_starts() {
    let wrong = RIG.replace("cameras = [\"chaser/front\"", "cameras = [\"chaser/frnt\"");
    let wrong = refusal(&wrong, &[]);
    assert!(
        wrong.says("no camera of this launch is called so, did you mean \"chaser/front\"?"),
        "{:?}",
        wrong.lines
    );
    let places: String = ["rgb", "depth", "instance"]
        .map(|it| {
            format!("[topic.\"batch/big/{it}\"]\nreaders = 32\nbuffer = 256\nborrowed = 256\n")
        })
        .concat();
    let large = format!(
        "version = 1\n[scenario]\nmap = \"Town10HD\"\n[sensor.big]\nkind = \"camera\"\nmodalities = [\"rgb\", \"depth\", \"instance\"]\nwidth_px = 4096\nheight_px = 4096\n[topic.\"ego/big/rgb\"]\nreaders = 1\n[batch.big]\ncameras = [\"ego/big\"]\nmodalities = [\"rgb\", \"depth\", \"instance\"]\n{places}"
    );
    let large = refusal(&large, &[]);
    assert!(large.says("of shared memory"), "{:?}", large.lines);
}
