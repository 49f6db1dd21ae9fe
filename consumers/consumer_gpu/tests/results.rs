//! Results of one process that another reads on the same GPU, with a driver for tests in the place
//! of NVIDIA's (`fake_cuda.c`): copies on a stream are done when the stream is waited for, and
//! readers' memory cannot be written to. Every writer and reader on the GPU is a process of its own;
//! the parent reads in shared memory, and kills.

#![expect(
    unsafe_code,
    reason = "addresses of the driver for tests are those of this process"
)]

mod common;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use common::{child, fake_driver, parents_bus};
use consumer_gpu::{Body, Device, GpuPublisher, GpuResults, ResultOnGpu};
use schema_bus::{Bus, BusError, FrameTopic, GpuPlaces, ResultTopic};
use schema_frames::{ElementType, Modality, PixelFormat, ResultHeader, ResultType};
use test_kit::client::{assert_nothing_left, join_bus};
use test_kit::{Process, Sandbox, eventually};

const TOPIC: &str = "detector/features";
const UUID: &str = "00112233445566778899aabbccddeeff";
const SHAPE: [u32; 3] = [4, 33, 8];

/// The elements of the result of a tick.
fn pattern(tick: u64, n: usize) -> Vec<u8> {
    (0..n).map(|i| (i as u64 * 7 + tick * 13) as u8).collect()
}

fn n_bytes(shape: &[u32]) -> usize {
    4 * shape.iter().product::<u32>() as usize
}

/// A sandbox with a driver, and the children in it.
struct Stage {
    sandbox: Sandbox,
    driver: PathBuf,
}

impl Stage {
    fn new(name: &str) -> Stage {
        let sandbox = Sandbox::new(name);
        let driver = fake_driver(&sandbox);
        Stage { sandbox, driver }
    }

    fn log(&self, name: &str) -> PathBuf {
        self.sandbox.path(&format!("{name}.log"))
    }

    /// Lines of a child's work that begin so.
    fn n_noted(&self, name: &str, what: &str) -> usize {
        let noted = std::fs::read_to_string(self.log(name)).unwrap_or_default();
        noted.lines().filter(|line| line.starts_with(what)).count()
    }

    fn start(&self, name: &str, env: &[(&str, &str)]) -> Process {
        let log = self.log(name);
        let mut all = vec![
            ("LD_LIBRARY_PATH", self.driver.to_str().unwrap()),
            ("FAKE_CUDA_LOG", log.to_str().unwrap()),
            ("FAKE_CUDA_UUID", UUID),
        ];
        // The last of a name counts.
        all.retain(|(key, _)| env.iter().all(|(given, _)| given != key));
        all.extend(env);
        child(&self.sandbox, name, &all)
    }
}

fn spec() -> ResultTopic {
    ResultTopic::new(ResultType::Tensor)
}

fn publisher(bus: &Bus) -> GpuPublisher {
    let opened = GpuPublisher::open(bus, TOPIC, &spec(), GpuPlaces::default(), 0, Device::Cuda);
    opened.unwrap_or_else(|error| panic!("{error}"))
}

fn send(features: &GpuPublisher, tick: u64, shape: &[u32]) -> usize {
    let mut draft = features.draft();
    draft
        .header_mut()
        .set_tensor(ElementType::F32, shape)
        .unwrap();
    draft.header_mut().tick = tick;
    let body = pattern(tick, n_bytes(shape));
    // SAFETY: this driver's device memory is this process's, and the body lives until it is sent.
    unsafe { features.send(draft, Body::Device(body.as_ptr() as u64)) }
        .unwrap_or_else(|error| panic!("{error}"))
}

/// Whether a result has the bytes of its tick.
fn is_whole(result: &ResultOnGpu) -> bool {
    result.to_bytes().unwrap() == pattern(result.header().tick, result.n_bytes())
}

fn readers(bus: &Bus) -> GpuResults {
    let opened = eventually("the topic", || {
        match GpuResults::open(bus, TOPIC, Device::Cuda) {
            Ok(opened) => Some(opened),
            Err(error) if error.to_string().contains("there is no topic") => None,
            Err(error) => panic!("{error}"),
        }
    });
    assert_eq!(opened.fallback(), None);
    opened
}

/// Publishes until it is killed: the tick counts on.
#[test]
fn child_that_publishes() {
    let Some(bus) = parents_bus() else { return };
    let features = publisher(&bus);
    let first: u64 = std::env::var("FIRST_TICK").map_or(1, |text| text.parse().unwrap());
    println!("publishing");
    for tick in first.. {
        send(&features, tick, &SHAPE);
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Reads until it is killed, and says what it has read.
#[test]
fn child_that_reads() {
    let Some(bus) = parents_bus() else { return };
    let mut features = readers(&bus);
    loop {
        let result = features.wait(&bus, Duration::from_secs(120)).unwrap();
        let result = result.expect("results come");
        assert!(is_whole(&result), "tick {}", result.header().tick);
        assert_eq!(result.header().shape(), SHAPE);
        assert_eq!(result.header().payload_place, ResultHeader::ON_GPU);
        println!("read tick {}", result.header().tick);
        // Held until the next one: it is killed with a slot in its hands.
    }
}

fn tick_of(line: &str) -> u64 {
    let tick = line.rsplit("read tick ").next().unwrap();
    tick.trim().parse().unwrap()
}

/// The next line of a reader about a tick after `tick`.
fn read_after(reader: &mut Process, tick: u64) -> u64 {
    loop {
        let found = tick_of(&reader.wait_line("read tick"));
        if found > tick {
            return found;
        }
    }
}

#[test]
fn a_result_is_read_on_the_gpu_and_beside_it_in_shared_memory() {
    let stage = Stage::new("results-same");
    let mut writer = stage.start("child_that_publishes", &[]);
    writer.wait_line("publishing");
    let mut reader = stage.start("child_that_reads", &[]);
    read_after(&mut reader, 20);
    assert!(stage.n_noted("child_that_publishes", "copy 4224") > 0);
    assert_eq!(
        stage.n_noted("child_that_publishes", "to host"),
        0,
        "nobody reads in shared memory"
    );
    assert_eq!(stage.n_noted("child_that_publishes", "create"), 1);
    assert_eq!(stage.n_noted("child_that_reads", "take over"), 1);
    let bus = join_bus(&stage.sandbox, "test");
    let mut host = bus.result_reader(TOPIC).unwrap();
    for _ in 0..20 {
        let result = eventually("a copy", || host.next().unwrap());
        let header = result.header();
        assert_eq!(
            (header.shape(), header.payload_place),
            (&SHAPE[..], ResultHeader::IN_SAMPLE)
        );
        assert!(*result == pattern(header.tick, n_bytes(&SHAPE))[..]);
    }
    assert!(stage.n_noted("child_that_publishes", "to host 4224") >= 20);
    // One topic, with a side on the GPU.
    let topics = bus.topics().unwrap();
    let [topic] = &topics[..] else {
        panic!("{topics:?}")
    };
    assert_eq!(topic.name, TOPIC);
    assert_eq!(topic.on_gpu.unwrap().subscribers, 1);
    drop(host);
    let before = read_after(&mut reader, 0);
    read_after(&mut reader, before + 10);
    writer.kill9();
    reader.kill9();
    bus.clean_dead_nodes();
    drop(bus);
    assert_nothing_left(&stage.sandbox);
}

#[test]
fn kills_of_either_side_leave_the_other_whole() {
    let stage = Stage::new("results-kills");
    let bus = join_bus(&stage.sandbox, "test");
    let mut writer = stage.start("child_that_publishes", &[]);
    writer.wait_line("publishing");
    let n_open = |pid: u32| {
        std::fs::read_dir(format!("/proc/{pid}/fd"))
            .unwrap()
            .count()
    };
    let mut reader = stage.start("child_that_reads", &[]);
    let mut tick = read_after(&mut reader, 0);
    let mut counts = Vec::new();
    for _ in 0..10 {
        // Two places: the third reader finds room because the dead one's is removed.
        let mut victim = stage.start("child_that_reads", &[]);
        victim.wait_line("read tick");
        victim.kill9();
        tick = read_after(&mut reader, tick);
        counts.push(n_open(writer.pid()));
    }
    assert!(counts.last() <= counts.first(), "{counts:?}");
    let mut epochs = BTreeSet::new();
    let mut descriptors = Vec::new();
    for turn in 1..=6u64 {
        writer.kill9();
        // The reader goes on with the next writer's memory.
        let first = (turn * 1_000_000).to_string();
        writer = stage.start("child_that_publishes", &[("FIRST_TICK", &first)]);
        writer.wait_line("publishing");
        tick = read_after(&mut reader, turn * 1_000_000);
        descriptors.push(n_open(reader.pid()));
        let folder = stage.sandbox.iceoryx_root().join("gantry-gpu");
        epochs.insert(std::fs::read_dir(folder).unwrap().count());
    }
    assert_eq!(epochs, BTreeSet::from([1]), "dead sockets are swept");
    assert!(descriptors.last() <= descriptors.first(), "{descriptors:?}");
    assert_eq!(stage.n_noted("child_that_reads", "take over"), 10 + 7);
    assert!(tick > 6_000_000);
    reader.kill9();
    writer.kill9();
    bus.clean_dead_nodes();
    drop(bus);
    assert_nothing_left(&stage.sandbox);
}

#[test]
fn child_that_holds() {
    let Some(bus) = parents_bus() else { return };
    let mut features = readers(&bus);
    let mut held = Vec::new();
    while held.len() < 3 {
        held.extend(features.wait(&bus, Duration::from_secs(60)).unwrap());
    }
    let full = eventually("one too many", || features.next(&bus).err());
    assert!(full.to_string().contains("already holds 3"), "{full}");
    let newest = held[2].header().tick;
    // The writer goes on for a while, in other slots.
    let mut host = bus.result_reader(TOPIC).unwrap();
    eventually("later results", || {
        let found = host.latest().unwrap()?;
        (found.header().tick > newest + 60).then_some(())
    });
    let addresses: BTreeSet<u64> = held.iter().map(ResultOnGpu::address).collect();
    assert!(held.iter().all(is_whole) && addresses.len() == 3);
    held.clear();
    let next = features.wait(&bus, Duration::from_secs(60)).unwrap();
    assert!(is_whole(&next.unwrap()));
}

#[test]
fn what_is_held_keeps_its_bytes_and_a_fourth_is_refused() {
    let stage = Stage::new("results-held");
    let mut writer = stage.start("child_that_publishes", &[]);
    writer.wait_line("publishing");
    stage.start("child_that_holds", &[]).wait().expect_code(0);
    writer.kill9();
}

/// Publishes longer and longer bodies, a few of each length; once more after a line on its input.
#[test]
fn child_that_grows() {
    let Some(bus) = parents_bus() else { return };
    let features = publisher(&bus);
    println!("publishing");
    let until = Instant::now() + Duration::from_secs(120);
    while features.n_readers() == 0 && Instant::now() < until {
        std::thread::sleep(Duration::from_millis(2));
    }
    for (i, rows) in [1u32, 9, 100, 4000, 100_000, 7].into_iter().enumerate() {
        for n in 0..5 {
            assert_eq!(send(&features, i as u64 * 10 + n + 1, &[rows, 8]), 1);
            std::thread::sleep(Duration::from_millis(30));
        }
    }
    // What was sent may still be read.
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(send(&features, 1000, &[1]), 1);
    println!("device bytes {}", features.n_device_bytes());
}

#[test]
fn child_that_reads_all() {
    let Some(bus) = parents_bus() else { return };
    let mut features = readers(&bus);
    let mut lengths = BTreeSet::new();
    let limit = Instant::now() + Duration::from_secs(120);
    loop {
        assert!(Instant::now() < limit, "the last result does not come");
        if let Some(result) = features.next(&bus).unwrap() {
            assert!(is_whole(&result), "tick {}", result.header().tick);
            lengths.insert(result.n_bytes());
            if result.header().tick == 1000 {
                break;
            }
        } else {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    assert!(lengths.len() >= 3, "{lengths:?}");
}

#[test]
fn longer_results_get_longer_slots() {
    let stage = Stage::new("results-grow");
    let mut writer = stage.start("child_that_grows", &[]);
    writer.wait_line("publishing");
    let reader = stage.start("child_that_reads_all", &[]);
    reader.wait().expect_code(0);
    let ended = writer.wait().expect_code(0);
    // 1, 9, 100, 4000 and 100 000 rows of 32 bytes.
    assert_eq!(stage.n_noted("child_that_grows", "create"), 5);
    assert_eq!(
        stage.n_noted("child_that_grows", "unmap"),
        5,
        "none is left"
    );
    assert!(ended.says("device bytes"));
    assert_nothing_left(&stage.sandbox);
}

#[test]
fn child_that_loans() {
    let Some(bus) = parents_bus() else { return };
    let features = publisher(&bus);
    println!("publishing");
    let until = Instant::now() + Duration::from_secs(120);
    while features.n_readers() < 2 && Instant::now() < until {
        std::thread::sleep(Duration::from_millis(2));
    }
    for tick in 1..=30 {
        let body = pattern(tick, n_bytes(&SHAPE));
        let loan = features.loan(body.len()).unwrap();
        // SAFETY: a slot of this driver's memory, as long as was asked for.
        unsafe {
            std::ptr::copy_nonoverlapping(body.as_ptr(), loan.address() as *mut u8, body.len());
        }
        let mut draft = features.draft();
        draft
            .header_mut()
            .set_tensor(ElementType::F32, &SHAPE)
            .unwrap();
        draft.header_mut().tick = tick;
        assert_eq!(features.send_loan(loan, draft).unwrap(), 2);
        std::thread::sleep(Duration::from_millis(20));
    }
    // What is given back is not sent, and a longer body than the loan is refused.
    drop(features.loan(10).unwrap());
    let loans: Vec<_> = (0..2).map(|_| features.loan(10).unwrap()).collect();
    let full = features.loan(10).unwrap_err().to_string();
    assert!(full.contains("no free slot"), "{full}");
    let mut draft = features.draft();
    draft
        .header_mut()
        .set_tensor(ElementType::F32, &SHAPE)
        .unwrap();
    for loan in loans {
        let long = features.send_loan(loan, draft.clone()).unwrap_err();
        assert!(long.to_string().contains("10 were loaned"), "{long}");
    }
    send(&features, 1000, &SHAPE);
    std::thread::sleep(Duration::from_millis(500));
}

#[test]
fn a_loan_is_filled_in_place() {
    let stage = Stage::new("results-loan");
    let mut writer = stage.start("child_that_loans", &[]);
    writer.wait_line("publishing");
    let bus = join_bus(&stage.sandbox, "test");
    let mut host = bus.result_reader(TOPIC).unwrap();
    let reader = stage.start("child_that_reads_whole", &[]);
    let last = eventually("the last copy", || {
        let found = host.next().unwrap()?;
        let tick = found.header().tick;
        assert!(*found == pattern(tick, n_bytes(&SHAPE))[..], "tick {tick}");
        (tick == 1000).then_some(found.header().seq)
    });
    assert!(last > 30);
    reader.wait().expect_code(0);
    writer.wait().expect_code(0);
    assert_eq!(stage.n_noted("child_that_loans", "copy"), 1, "of the last");
}

#[test]
fn child_that_reads_whole() {
    let Some(bus) = parents_bus() else { return };
    let mut features = readers(&bus);
    loop {
        let result = features.wait(&bus, Duration::from_secs(120)).unwrap();
        let result = result.expect("results come");
        assert!(is_whole(&result));
        if result.header().tick == 1000 {
            break;
        }
    }
}

/// A frame, a result that answers it on the GPU, and a result that answers that one.
#[test]
fn child_in_a_chain() {
    let Some(bus) = parents_bus() else { return };
    let frames = FrameTopic::new(Modality::Rgb, 16 * 8 * 4);
    let camera = bus.frame_publisher("ego/front/rgb", frames).unwrap();
    let mut images = bus.frame_reader("ego/front/rgb").unwrap();
    let mut loan = camera.loan(16 * 8 * 4).unwrap();
    let header = loan.header_mut();
    header.set_image(16, 8);
    (header.tick, header.seq, header.epoch) = (41, 5, 77);
    header.world_from_sensor.translation_m = [4.0, 5.0, 6.0];
    loan.send().unwrap();
    let image = images.next().unwrap().unwrap();

    let kind = ResultType::Depth;
    let spec = ResultTopic::new(kind);
    let depth = GpuPublisher::open(
        &bus,
        "net/depth",
        &spec,
        GpuPlaces::default(),
        4096,
        Device::Cuda,
    );
    let depth = depth.unwrap();
    assert_eq!(depth.n_device_bytes(), 2 << 20, "made beforehand");
    let mut seen = GpuResults::open(&bus, "net/depth", Device::Cuda).unwrap();
    let mut beside = bus.result_reader("net/depth").unwrap();
    let mut draft = depth.draft();
    draft.answers(&image);
    draft.header_mut().set_image(4, 2, PixelFormat::Depth);
    let body = pattern(1, 32);
    // SAFETY: the body is this process's own.
    assert_eq!(unsafe { depth.send(draft, Body::Host(&body)) }.unwrap(), 2);
    let found = seen.wait(&bus, Duration::from_secs(60)).unwrap().unwrap();
    let same = beside.next().unwrap().unwrap();
    let header = *found.header();
    assert_eq!(found.kind(), kind);
    assert_eq!((header.tick, header.epoch, header.seq), (41, 77, 1));
    assert_eq!(header.world_from_space.translation_m, [4.0, 5.0, 6.0]);
    assert_eq!(found.inputs(), same.inputs());
    assert_eq!(found.inputs()[0].topic(), "ego/front/rgb");
    let on_host = ResultHeader {
        payload_place: ResultHeader::IN_SAMPLE,
        published_mono_nanos: same.header().published_mono_nanos,
        ..header
    };
    assert_eq!(on_host, *same.header());
    assert!(found.to_bytes().unwrap() == body && *same == body[..]);

    let plan = bus
        .result_publisher("net/plan", &ResultTopic::new(ResultType::Text))
        .unwrap();
    let mut plans = bus.result_reader("net/plan").unwrap();
    let mut loan = plan.loan(0).unwrap();
    loan.answers(&found);
    loan.set_list(0, 1, 0).unwrap();
    loan.send().unwrap();
    let plan = plans.next().unwrap().unwrap();
    assert_eq!(plan.header().tick, 41);
    assert_eq!(plan.inputs()[0].topic(), "net/depth");
    assert_eq!(
        plan.header().origin_mono_nanos,
        image.header().published_mono_nanos
    );
}

#[test]
fn inputs_travel_with_results_on_the_gpu() {
    let stage = Stage::new("results-chain");
    stage.start("child_in_a_chain", &[]).wait().expect_code(0);
    assert_nothing_left(&stage.sandbox);
}

#[test]
fn child_on_another_gpu() {
    let Some(bus) = parents_bus() else { return };
    let mut features = GpuResults::open(&bus, TOPIC, Device::Cuda).unwrap();
    let why = features.fallback().expect("it is uploaded").to_owned();
    let wanted = std::env::var("WANTED").unwrap();
    assert!(why.contains(&wanted), "{why}");
    for _ in 0..10 {
        let result = features.wait(&bus, Duration::from_secs(60)).unwrap();
        assert!(is_whole(&result.unwrap()));
    }
}

#[test]
fn child_in_shared_memory() {
    let Some(bus) = parents_bus() else { return };
    let features = bus.result_publisher(TOPIC, &spec()).unwrap();
    println!("publishing");
    for tick in 1.. {
        let body = pattern(tick, n_bytes(&SHAPE));
        let mut loan = features.loan(body.len()).unwrap();
        loan.set_tensor(ElementType::F32, &SHAPE).unwrap();
        loan.header_mut().tick = tick;
        loan.body_mut().copy_from_slice(&body);
        loan.send().unwrap();
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn another_gpu_and_a_writer_without_one_are_uploaded() {
    for (writer, uuid, wanted) in [
        (
            "child_that_publishes",
            "ff112233445566778899aabbccddeeff",
            "its writer is on GPU 00112233445566778899aabbccddeeff",
        ),
        (
            "child_in_shared_memory",
            UUID,
            "no process of this domain keeps it on a GPU",
        ),
    ] {
        let stage = Stage::new("results-upload");
        let mut writer = stage.start(writer, &[]);
        writer.wait_line("publishing");
        let env = [("FAKE_CUDA_UUID", uuid), ("WANTED", wanted)];
        let reader = stage.start("child_on_another_gpu", &env);
        reader.wait().expect_code(0);
        assert!(stage.n_noted("child_on_another_gpu", "upload 4224") >= 10);
        assert_eq!(stage.n_noted("child_on_another_gpu", "take over"), 0);
        writer.kill9();
    }
}

#[test]
fn child_without_room() {
    let Some(bus) = parents_bus() else { return };
    let at_once = GpuPublisher::open(
        &bus,
        TOPIC,
        &spec(),
        GpuPlaces::default(),
        100 << 20,
        Device::Cuda,
    );
    let sentence = at_once.unwrap_err().to_string();
    assert!(
        sentence.contains("no room on the GPU for 12 results of \"detector/features\", 1200 MiB")
            && sentence.contains("100 of 1048576 MiB are free")
            && sentence.contains("fewer gpu_readers"),
        "{sentence}"
    );
    // Later, the result is lost, and a smaller one goes through.
    let features = publisher(&bus);
    let _reader = readers(&bus);
    assert_eq!(send(&features, 1, &SHAPE), 1);
    let long = features.loan(100 << 20).unwrap_err().to_string();
    assert!(long.contains("no room on the GPU"), "{long}");
    assert_eq!(send(&features, 2, &SHAPE), 1);
}

#[test]
fn child_that_asks_for_what_cannot_be() {
    let Some(bus) = parents_bus() else { return };
    let open = |topic: &str, kind, device| {
        let spec = ResultTopic::new(kind);
        let opened = GpuPublisher::open(&bus, topic, &spec, GpuPlaces::default(), 0, device);
        opened.expect_err("it is refused").to_string()
    };
    let tensor = ResultType::Tensor;
    let boxes = open("a", ResultType::Boxes2d, Device::Cuda);
    assert!(boxes.contains("boxes2d are no arrays"), "{boxes}");
    let other = open("a", tensor, Device::CudaNumber(4));
    assert!(other.contains("CUDA has no device 4"), "{other}");
    let mapped = open("a", tensor, Device::Mapped);
    assert!(mapped.contains("publish on \"cuda\""), "{mapped}");
    let reserved = open("a/gpu", tensor, Device::Cuda);
    assert!(reserved.contains("or results on a GPU"), "{reserved}");
    let _first = publisher(&bus);
    let taken = open(TOPIC, tensor, Device::Cuda);
    assert!(taken.contains("a topic has one writer"), "{taken}");
    // Results that are no arrays cannot be uploaded either.
    let spec = ResultTopic::new(ResultType::Text);
    let _log = bus.result_publisher("log", &spec).unwrap();
    let text = GpuResults::open(&bus, "log", Device::Cuda).unwrap_err();
    assert!(text.to_string().contains("of type text"), "{text}");
    // A reader of shared memory does not meet places on the GPU.
    let gpu = bus.result_reader("detector/features/gpu");
    assert!(gpu.is_ok(), "the service is there");
    let wrong = bus.frame_reader(TOPIC).unwrap_err();
    assert!(matches!(wrong, BusError::OtherKind { .. }), "{wrong}");
}

#[test]
fn what_cannot_be_is_said() {
    let stage = Stage::new("results-refused");
    let free = (100u64 << 20).to_string();
    let env = [("FAKE_CUDA_FREE", free.as_str())];
    stage
        .start("child_without_room", &env)
        .wait()
        .expect_code(0);
    let refused = stage.start("child_that_asks_for_what_cannot_be", &[]);
    refused.wait().expect_code(0);
    assert_nothing_left(&stage.sandbox);
}
