//! Writers and readers of results on a GPU.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use consumer_gpu::{Body, Device, GpuPublisher, GpuResults, ResultOnGpu};
use schema_bus::{Bus, BusError, FrameTopic, GpuPlaces, ResultTopic};
use schema_frames::{ElementType, Modality, PixelFormat, ResultHeader, ResultType};
use test_kit::eventually;

use crate::common::{RESULT_SHAPE, RESULT_TOPIC, n_bytes, pattern};

fn spec() -> ResultTopic {
    ResultTopic::new(ResultType::Tensor)
}

fn publisher(bus: &Bus) -> GpuPublisher {
    let opened = GpuPublisher::open(
        bus,
        RESULT_TOPIC,
        &spec(),
        GpuPlaces::default(),
        0,
        Device::Cuda,
    );
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
        match GpuResults::open(bus, RESULT_TOPIC, Device::Cuda) {
            Ok(opened) => Some(opened),
            Err(error) if error.to_string().contains("there is no topic") => None,
            Err(error) => panic!("{error}"),
        }
    });
    assert_eq!(opened.fallback(), None);
    opened
}

/// Publishes until it is killed: the tick counts on.
pub fn publish(bus: &Bus) {
    let features = publisher(bus);
    let first: u64 = std::env::var("FIRST_TICK").map_or(1, |text| text.parse().unwrap());
    println!("publishing");
    for tick in first.. {
        send(&features, tick, &RESULT_SHAPE);
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Reads until it is killed, and says what it has read.
pub fn read_results(bus: &Bus) {
    let mut features = readers(bus);
    loop {
        let result = features.wait(bus, Duration::from_secs(120)).unwrap();
        let result = result.expect("results come");
        assert!(is_whole(&result), "tick {}", result.header().tick);
        assert_eq!(result.header().shape(), RESULT_SHAPE);
        assert_eq!(result.header().payload_place, ResultHeader::ON_GPU);
        println!("read tick {}", result.header().tick);
        // Held until the next one: it is killed with a slot in its hands.
    }
}

/// Holds as many results as a reader may while the writer goes on.
pub fn hold(bus: &Bus) {
    let mut features = readers(bus);
    let mut held = Vec::new();
    while held.len() < 3 {
        held.extend(features.wait(bus, Duration::from_secs(60)).unwrap());
    }
    let full = eventually("one too many", || features.next(bus).err());
    assert!(full.to_string().contains("already holds 3"), "{full}");
    let newest = held[2].header().tick;
    // The writer goes on for a while, in other slots.
    let mut host = bus.result_reader(RESULT_TOPIC).unwrap();
    eventually("later results", || {
        let found = host.latest().unwrap()?;
        (found.header().tick > newest + 60).then_some(())
    });
    let addresses: BTreeSet<u64> = held.iter().map(ResultOnGpu::address).collect();
    assert!(held.iter().all(is_whole) && addresses.len() == 3);
    held.clear();
    let next = features.wait(bus, Duration::from_secs(60)).unwrap();
    assert!(is_whole(&next.unwrap()));
}

/// Publishes longer and longer bodies, a few of each length; once more after a line on its input.
pub fn grow(bus: &Bus) {
    let features = publisher(bus);
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

/// Reads until the last result of [`grow`].
pub fn read_all(bus: &Bus) {
    let mut features = readers(bus);
    let mut lengths = BTreeSet::new();
    let limit = Instant::now() + Duration::from_secs(120);
    loop {
        assert!(Instant::now() < limit, "the last result does not come");
        if let Some(result) = features.next(bus).unwrap() {
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

/// Fills loans in place, and asks for more than there are.
pub fn lend(bus: &Bus) {
    let features = publisher(bus);
    println!("publishing");
    let until = Instant::now() + Duration::from_secs(120);
    while features.n_readers() < 2 && Instant::now() < until {
        std::thread::sleep(Duration::from_millis(2));
    }
    for tick in 1..=30 {
        let body = pattern(tick, n_bytes(&RESULT_SHAPE));
        let loan = features.loan(body.len()).unwrap();
        // SAFETY: a slot of this driver's memory, as long as was asked for.
        unsafe {
            std::ptr::copy_nonoverlapping(body.as_ptr(), loan.address() as *mut u8, body.len());
        }
        let mut draft = features.draft();
        draft
            .header_mut()
            .set_tensor(ElementType::F32, &RESULT_SHAPE)
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
        .set_tensor(ElementType::F32, &RESULT_SHAPE)
        .unwrap();
    for loan in loans {
        let long = features.send_loan(loan, draft.clone()).unwrap_err();
        assert!(long.to_string().contains("10 were loaned"), "{long}");
    }
    send(&features, 1000, &RESULT_SHAPE);
    std::thread::sleep(Duration::from_millis(500));
}

/// Reads until the last result of [`lend`].
pub fn read_whole(bus: &Bus) {
    let mut features = readers(bus);
    loop {
        let result = features.wait(bus, Duration::from_secs(120)).unwrap();
        let result = result.expect("results come");
        assert!(is_whole(&result));
        if result.header().tick == 1000 {
            break;
        }
    }
}

/// A frame, a result that answers it on the GPU, and a result that answers that one.
pub fn chain(bus: &Bus) {
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
        bus,
        "net/depth",
        &spec,
        GpuPlaces::default(),
        4096,
        Device::Cuda,
    );
    let depth = depth.unwrap();
    assert_eq!(depth.n_device_bytes(), 2 << 20, "made beforehand");
    let mut seen = GpuResults::open(bus, "net/depth", Device::Cuda).unwrap();
    let mut beside = bus.result_reader("net/depth").unwrap();
    let mut draft = depth.draft();
    draft.answers(&image);
    draft.header_mut().set_image(4, 2, PixelFormat::Depth);
    let body = pattern(1, 32);
    // SAFETY: the body is this process's own.
    assert_eq!(unsafe { depth.send(draft, Body::Host(&body)) }.unwrap(), 2);
    let found = seen.wait(bus, Duration::from_secs(60)).unwrap().unwrap();
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

/// Reads results that are uploaded for the reason in `WANTED`.
pub fn upload_results(bus: &Bus) {
    let mut features = GpuResults::open(bus, RESULT_TOPIC, Device::Cuda).unwrap();
    let why = features.fallback().expect("it is uploaded").to_owned();
    let wanted = std::env::var("WANTED").unwrap();
    assert!(why.contains(&wanted), "{why}");
    for _ in 0..10 {
        let result = features.wait(bus, Duration::from_secs(60)).unwrap();
        assert!(is_whole(&result.unwrap()));
    }
}

/// Publishes in shared memory alone until it is killed.
pub fn publish_on_host(bus: &Bus) {
    let features = bus.result_publisher(RESULT_TOPIC, &spec()).unwrap();
    println!("publishing");
    for tick in 1.. {
        let body = pattern(tick, n_bytes(&RESULT_SHAPE));
        let mut loan = features.loan(body.len()).unwrap();
        loan.set_tensor(ElementType::F32, &RESULT_SHAPE).unwrap();
        loan.header_mut().tick = tick;
        loan.body_mut().copy_from_slice(&body);
        loan.send().unwrap();
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Publishes on a GPU that has little room.
pub fn lack_room(bus: &Bus) {
    let at_once = GpuPublisher::open(
        bus,
        RESULT_TOPIC,
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
    let features = publisher(bus);
    let _reader = readers(bus);
    assert_eq!(send(&features, 1, &RESULT_SHAPE), 1);
    let long = features.loan(100 << 20).unwrap_err().to_string();
    assert!(long.contains("no room on the GPU"), "{long}");
    assert_eq!(send(&features, 2, &RESULT_SHAPE), 1);
}

/// Asks for what cannot be.
pub fn be_refused(bus: &Bus) {
    let open = |topic: &str, kind, device| {
        let spec = ResultTopic::new(kind);
        let opened = GpuPublisher::open(bus, topic, &spec, GpuPlaces::default(), 0, device);
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
    let _first = publisher(bus);
    let taken = open(RESULT_TOPIC, tensor, Device::Cuda);
    assert!(taken.contains("a topic has one writer"), "{taken}");
    // Results that are no arrays cannot be uploaded either.
    let spec = ResultTopic::new(ResultType::Text);
    let _log = bus.result_publisher("log", &spec).unwrap();
    let text = GpuResults::open(bus, "log", Device::Cuda).unwrap_err();
    assert!(text.to_string().contains("of type text"), "{text}");
    // A reader of shared memory does not meet places on the GPU.
    let gpu = bus.result_reader("detector/features/gpu");
    assert!(gpu.is_ok(), "the service is there");
    let wrong = bus.frame_reader(RESULT_TOPIC).unwrap_err();
    assert!(matches!(wrong, BusError::OtherKind { .. }), "{wrong}");
}
