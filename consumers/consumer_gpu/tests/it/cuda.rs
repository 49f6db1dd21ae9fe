//! The way through CUDA, with a driver for tests in the place of NVIDIA's (`fake_cuda.c`): imports,
//! what is released when, the way over page-locked memory, and sentences.

use crate::common;

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use common::{BATCH, CARD_TOPIC, DEPTH_TOPIC, child, fake_driver, gpu_rig};
use schema_bus::{
    Bus, FramePublisher, FrameTopic, GpuDevice, GpuServer, Notifier, SharedMemory, names,
};
use schema_frames::{FrameHeader, GPU_PLACE_BYTES, GpuAnswer, GpuPlace, Modality};
use test_kit::client::{join_bus, step};
use test_kit::programs::start_daemon;
use test_kit::{Sandbox, eventually};

/// Runs a child beside a simulator; `uuid` is what the driver says, `None` for the simulator's own.
fn run(name: &str, test: &str, uuid: Option<&str>, env: &[(&str, &str)]) -> (Sandbox, String) {
    let sandbox = Sandbox::new(name);
    let driver = fake_driver(&sandbox);
    let free = format!("{}{BATCH}", gpu_rig()).replace("mode = \"stepped\"\n", "");
    let _daemon = start_daemon(&sandbox, &free, &[]);
    let bus = join_bus(&sandbox, "test");
    let own = bus.gpu_offer(DEPTH_TOPIC).unwrap().device_uuid;
    let own: String = own.iter().map(|byte| format!("{byte:02x}")).collect();
    let log = sandbox.path("cuda.log");
    let done = sandbox.path("done");
    let mut all = vec![
        ("LD_LIBRARY_PATH", driver.to_str().unwrap()),
        ("FAKE_CUDA_UUID", uuid.unwrap_or(&own)),
        ("FAKE_CUDA_LOG", log.to_str().unwrap()),
    ];
    for (key, value) in env {
        let value = if *value == "DONE" {
            done.to_str().unwrap()
        } else {
            value
        };
        all.push((*key, value));
    }
    child(&sandbox, test, &all).wait().expect_code(0);
    let noted = std::fs::read_to_string(&log).unwrap_or_default();
    (sandbox, noted)
}

#[test]
fn frames_are_imported_once_and_have_the_bytes_of_shared_memory() {
    let (_sandbox, noted) = run("cuda-same", "compare", None, &[]);
    let n = |what: &str| noted.lines().filter(|line| line.starts_with(what)).count();
    assert_eq!((n("import"), n("destroy")), (1, 1), "{noted}");
    assert!(n("record") >= 5 && n("upload") == 0, "{noted}");
}

#[test]
fn a_batch_is_imported_once_for_all_of_its_images() {
    let (_sandbox, noted) = run("cuda-batch", "compare_batch", None, &[]);
    let n = |what: &str| noted.lines().filter(|line| line.starts_with(what)).count();
    assert_eq!(
        (n("import"), n("destroy"), n("upload")),
        (1, 1, 0),
        "{noted}"
    );
}

#[test]
fn slots_go_back_only_after_the_work_that_was_queued_before() {
    let env = [("FAKE_CUDA_DONE", "DONE")];
    let (sandbox, noted) = run("cuda-queued", "drop_early", None, &env);
    assert!(sandbox.path("done").exists(), "{noted}");
}

#[test]
fn another_gpu_gets_its_frames_over_page_locked_memory() {
    let other = "00112233445566778899aabbccddeeff";
    let env = [(
        "WANTED",
        "the simulator draws on a software adapter, and CUDA computes on a device for tests",
    )];
    let (_sandbox, noted) = run("cuda-other", "upload_frames", Some(other), &env);
    let n = |what: &str| noted.lines().filter(|line| line.starts_with(what)).count();
    assert!(n("upload 24576") >= 10 && n("import") == 0, "{noted}");
    assert!(n("alloc") <= 4, "memory is used again: {noted}");
}

#[test]
fn without_cuda_there_is_a_sentence() {
    let sandbox = Sandbox::new("cuda-none");
    let _daemon = start_daemon(&sandbox, &gpu_rig(), &[]);
    // A driver that is no library hides one that the machine may have.
    let folder = sandbox.path("none");
    std::fs::create_dir_all(&folder).unwrap();
    let bus = join_bus(&sandbox, "test");
    step(&mut bus.command_client("test").unwrap(), 1);
    if Path::new("/dev/nvidia0").exists() {
        return;
    }
    let env = [("LD_LIBRARY_PATH", folder.to_str().unwrap())];
    child(&sandbox, "lack_cuda", &env).wait().expect_code(0);
}

/// A process that writes a topic, and keeps it on a GPU of some UUID, or on none.
struct Scribe {
    host: FramePublisher,
    wake: Notifier,
    on_gpu: Option<Kept>,
}

struct Kept {
    publisher: FramePublisher,
    wake: Notifier,
    memory: SharedMemory,
    file: File,
    slots: Vec<usize>,
    _offer: schema_bus::GpuTopic,
    _server: GpuServer,
}

fn host_topic() -> FrameTopic {
    FrameTopic::new(Modality::Semantic, 64)
}

impl Scribe {
    fn new(bus: &Bus, memory: &Path, uuid: Option<[u8; 16]>) -> Scribe {
        let kept = |device_uuid| {
            let server = bus.gpu_server(GpuDevice {
                device_uuid,
                ..GpuDevice::default()
            });
            let server = server.unwrap();
            let spec = FrameTopic::on_gpu(2);
            let name = names::gpu_topic(CARD_TOPIC);
            let publisher = bus.frame_publisher(&name, spec).unwrap();
            publisher.segment().unwrap();
            let n_bytes = (256 * spec.n_slots()) as u64;
            let file = File::options()
                .read(true)
                .write(true)
                .create(true)
                .truncate(true)
                .open(memory)
                .unwrap();
            file.set_len(n_bytes + 4096).unwrap();
            let descriptor = file.try_clone().unwrap().into();
            let shared = server.share(descriptor, n_bytes, GpuAnswer::VULKAN);
            Kept {
                publisher,
                wake: bus.notifier(&name).unwrap(),
                memory: shared.unwrap(),
                file,
                slots: Vec::new(),
                _offer: server.offer(CARD_TOPIC, spec),
                _server: server,
            }
        };
        Scribe {
            host: bus.frame_publisher(CARD_TOPIC, host_topic()).unwrap(),
            wake: bus.notifier(CARD_TOPIC).unwrap(),
            on_gpu: uuid.map(kept),
        }
    }

    fn write(&mut self, tick: u64) {
        let mut header = FrameHeader {
            tick,
            seq: tick,
            epoch: 5,
            ..FrameHeader::new(Modality::Semantic)
        };
        header.set_image(8, 8);
        if let Some(kept) = &mut self.on_gpu
            && kept.publisher.n_readers() > 0
        {
            let mut loan = kept.publisher.loan(GPU_PLACE_BYTES).unwrap();
            let offset = loan.offset_in_segment().unwrap();
            let known = kept.slots.iter().position(|known| *known == offset);
            let slot = known.unwrap_or_else(|| {
                kept.slots.push(offset);
                kept.slots.len() - 1
            });
            let begin = 256 * slot as u64;
            kept.file
                .write_all_at(&[tick as u8; 64], 4096 + begin)
                .unwrap();
            let place = GpuPlace {
                producer: kept.memory.producer(),
                generation: kept.memory.generation(),
                offset_bytes: begin,
                memory_bytes: kept.memory.n_bytes(),
                capacity_bytes: 256,
                pid: std::process::id(),
                slot: slot as u32,
                reserved: [0; 16],
            };
            loan.put_on_gpu(&header, &place);
            loan.send().unwrap();
            kept.wake.notify();
        }
        if self.host.n_readers() > 0 {
            let mut loan = self.host.loan(64).unwrap();
            loan.payload_mut().fill(tick as u8);
            *loan.header_mut() = header;
            loan.send().unwrap();
            self.wake.notify();
        }
    }
}

/// Writers on the reader's GPU, on another one and on none take turns: the reader goes on with the
/// frames of each, and says which way they come.
#[test]
fn a_reader_follows_its_topic_to_other_gpus_and_back() {
    let sandbox = Sandbox::new("cuda-follow");
    let driver = fake_driver(&sandbox);
    let bus = join_bus(&sandbox, "writer");
    // As a simulator does that has the topic written by others.
    let _service = bus.frame_service(CARD_TOPIC, host_topic()).unwrap();
    let own = [7; 16];
    let digits = "07".repeat(16);
    let log = sandbox.path("cuda.log");
    let env = [
        ("LD_LIBRARY_PATH", driver.to_str().unwrap()),
        ("FAKE_CUDA_UUID", digits.as_str()),
        ("FAKE_CUDA_LOG", log.to_str().unwrap()),
    ];
    let mut reads: Option<test_kit::Process> = None;
    let mut tick = 0;
    let turns = [
        (Some(own), "stays"),
        (Some([9; 16]), "its writer is on GPU 0909"),
        (Some(own), "stays"),
        (None, "no process of this domain keeps it on a GPU"),
        (Some(own), "stays"),
        (Some([8; 16]), "its writer is on GPU 0808"),
        (None, "no process of this domain keeps it on a GPU"),
    ];
    for (turn, (uuid, said)) in turns.into_iter().enumerate() {
        let mut scribe = Scribe::new(&bus, &sandbox.path(&format!("memory{turn}")), uuid);
        let reads = reads.get_or_insert_with(|| {
            let mut reads = child(&sandbox, "follow", &env);
            reads.wait_line("open");
            reads
        });
        let first = tick + 1;
        eventually(&format!("frames that are {said:?} in turn {turn}"), || {
            assert!(reads.is_running(), "{:?}", reads.lines());
            tick += 1;
            scribe.write(tick);
            let of_turn = |line: &String| {
                let rest = line.strip_prefix("tick ")?;
                let (tick, way) = rest.split_once(' ')?;
                (tick.parse::<u64>().ok()? >= first && way.contains(said)).then_some(())
            };
            (reads.lines().iter().filter_map(of_turn).count() >= 3).then_some(())
        });
    }
    let ended = reads.expect("it reads").kill9();
    // Who goes from one way to another loses a few frames at most, and gets none twice.
    let n_read = ended
        .lines
        .iter()
        .filter(|line| line.starts_with("tick "))
        .count();
    assert!(n_read > 20, "{n_read} of {tick}");
    let noted = std::fs::read_to_string(&log).unwrap();
    let n = |what: &str| noted.lines().filter(|line| line.starts_with(what)).count();
    assert_eq!(n("import"), 3, "{noted}");
}
