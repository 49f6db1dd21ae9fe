//! Readers of frames on a GPU.

use std::time::Duration;

use consumer_gpu::{Device, GpuTopic};
use schema_bus::Bus;
use test_kit::client::reader;
use test_kit::eventually;

use crate::common::{CARD_TOPIC, DEPTH_TOPIC, take};

/// Reads frames until it is killed.
pub fn read_frames(bus: &Bus) {
    let mut topic = GpuTopic::open(bus, "ego/front/rgb", Device::Mapped).unwrap();
    loop {
        let frame = topic.wait(bus, Duration::from_secs(60)).unwrap();
        let frame = frame.expect("frames come");
        println!("read tick {}", frame.header().tick);
        // Held until the next one: it is killed with a slot in its hands.
    }
}

/// Reads batches until it is killed, with frames in its hands.
pub fn read_batch(bus: &Bus) {
    let mut gpu = GpuTopic::open(bus, "batch/fleet/rgb", Device::Mapped).unwrap();
    let mut host = bus.frame_reader("batch/fleet/rgb").unwrap();
    let mut held = Vec::new();
    loop {
        let frame = gpu.wait(bus, Duration::from_secs(60)).unwrap();
        let frame = frame.expect("frames come");
        println!("read tick {}", frame.header().tick);
        held = vec![(frame, host.latest().unwrap(), held.pop().map(drop))];
    }
}

/// Compares frames that it imports with those of shared memory.
pub fn compare(bus: &Bus) {
    let mut host = reader(bus, DEPTH_TOPIC);
    let mut gpu = GpuTopic::open(bus, DEPTH_TOPIC, Device::Cuda).unwrap();
    assert_eq!((gpu.fallback(), gpu.device()), (None, Some(0)));
    let mut n_compared = 0;
    while n_compared < 5 {
        let Some(frame) = gpu.wait(bus, Duration::from_secs(60)).unwrap() else {
            panic!("no frame came");
        };
        let same = eventually("the same tick", || {
            let found = host.next().unwrap()?;
            (found.header().tick >= frame.header().tick).then_some(found)
        });
        if same.header().tick == frame.header().tick {
            assert!(*same == frame.to_bytes().unwrap()[..]);
            n_compared += 1;
        }
    }
}

/// Compares batches that it imports with those of shared memory.
pub fn compare_batch(bus: &Bus) {
    let topic = "batch/pair/depth";
    let mut host = reader(bus, topic);
    let mut gpu = GpuTopic::open(bus, topic, Device::Cuda).unwrap();
    let mut n_compared = 0;
    while n_compared < 3 {
        let frame = gpu.wait(bus, Duration::from_secs(60)).unwrap().unwrap();
        let header = frame.header();
        assert_eq!(
            (header.n_images, header.height, header.image_height()),
            (2, 128, 64)
        );
        let bytes = frame.to_bytes().unwrap();
        assert_eq!(bytes.len(), 2 * 96 * 64 * 4);
        let same = eventually("the same tick", || {
            let found = host.next().unwrap()?;
            (found.header().tick >= header.tick).then_some(found)
        });
        if same.header().tick == header.tick {
            assert!(*same == bytes[..]);
            n_compared += 1;
        }
    }
}

/// Drops frames before the device is done with the work that was queued on them.
pub fn drop_early(bus: &Bus) {
    let mut gpu = GpuTopic::open(bus, DEPTH_TOPIC, Device::Cuda).unwrap();
    for _ in 0..3 {
        drop(eventually("a frame", || take(&mut gpu, bus)));
    }
    let done = std::env::var("FAKE_CUDA_DONE").unwrap();
    let log = std::env::var("FAKE_CUDA_LOG").unwrap();
    let waits = std::thread::spawn(move || {
        // The fourth frame waits for the device; only then is it said to be done.
        eventually("a wait", || {
            let noted = std::fs::read_to_string(&log).ok()?;
            noted.lines().any(|line| line == "wait").then_some(())
        });
        std::fs::write(done, "").unwrap();
    });
    eventually("a fourth frame", || take(&mut gpu, bus));
    waits.join().unwrap();
}

/// Reads frames of another GPU, which are uploaded for the reason in `WANTED`.
pub fn upload_frames(bus: &Bus) {
    let mut gpu = GpuTopic::open(bus, DEPTH_TOPIC, Device::Cuda).unwrap();
    let why = gpu.fallback().expect("another GPU").to_owned();
    let wanted = std::env::var("WANTED").unwrap();
    assert!(why.contains(&wanted), "{why}");
    for _ in 0..10 {
        let frame = gpu.wait(bus, Duration::from_secs(60)).unwrap().unwrap();
        assert_eq!(frame.to_bytes().unwrap().len(), 96 * 64 * 4);
    }
    let asked = GpuTopic::open(bus, DEPTH_TOPIC, Device::CudaNumber(3)).unwrap_err();
    assert!(
        asked.to_string().contains("CUDA has no device 3"),
        "{asked}"
    );
}

/// Asks for CUDA where there is none.
pub fn lack_cuda(bus: &Bus) {
    let error = GpuTopic::open(bus, DEPTH_TOPIC, Device::Cuda)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("CUDA cannot be used here") && error.contains("leave the device out"),
        "{error}"
    );
}

/// Reads the topic of cards until it is killed, and says which way each frame came.
pub fn follow(bus: &Bus) {
    let mut gpu = GpuTopic::open(bus, CARD_TOPIC, Device::Cuda).unwrap();
    println!("open");
    let mut last_tick = 0;
    loop {
        let frame = gpu.wait(bus, Duration::from_secs(60)).unwrap();
        let frame = frame.expect("frames come");
        let tick = frame.header().tick;
        assert!(tick > last_tick, "{tick} after {last_tick}");
        last_tick = tick;
        assert_eq!(frame.to_bytes().unwrap(), [tick as u8; 64]);
        assert_eq!(frame.device(), Some(0));
        println!("tick {tick} {}", gpu.fallback().unwrap_or("stays"));
    }
}
