//! Runs the bench as users do: real processes on real shared memory; its figures are read from its
//! JSON.

use std::time::Duration;

use schema_bus::{FramePublisher, FrameTopic, ResultTopic};
use schema_frames::{Box2d, Modality, ResultType};
use serde_json::Value;
use test_kit::client::join_bus;
use test_kit::{Process, Sandbox};

fn bench(sandbox: &Sandbox, words: &[&str]) -> Process {
    sandbox.spawn_program(
        "gantry-bench",
        env!("CARGO_BIN_EXE_gantry-bench").as_ref(),
        words,
        &[],
    )
}

fn report(sandbox: &Sandbox) -> Value {
    let text =
        std::fs::read_to_string(sandbox.path("report.json")).expect("the report was written");
    serde_json::from_str(&text).expect("the report is JSON")
}

#[test]
fn latency_accounts_for_every_frame_on_every_way_and_leaves_nothing() {
    let sandbox = Sandbox::new("bench-latency");
    let words = [
        "latency",
        "--sizes",
        "64,100000",
        "--readers",
        "1,2",
        "--rate",
        "200",
        "--count",
        "40",
        "--json",
        "report.json",
    ];
    let ended = bench(&sandbox, &words).wait().expect_code(0);
    assert!(ended.says("shm-event") && ended.says("p99.9"));
    let report = report(&sandbox);
    let rows = report["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 2 * (1 + 2 * 3));
    for row in rows {
        let arrived =
            row["latency"]["n"].as_u64().expect("a count") + row["lost"].as_u64().expect("a count");
        assert_eq!(
            arrived,
            40 * row["n_readers"].as_u64().expect("a count").max(1),
            "{row}"
        );
        assert!(row["latency"]["p50_us"].as_f64() <= row["latency"]["max_us"].as_f64());
    }
    assert!(
        report["machine"]["kernel"]
            .as_str()
            .is_some_and(|kernel| !kernel.is_empty())
    );
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

/// A camera whose depth skips every fifth tick, and whose colour jumps over a number every tenth.
struct Camera {
    rgb: FramePublisher,
    depth: FramePublisher,
}

impl Camera {
    fn send(&self, tick: u64) {
        self.frame(&self.rgb, tick, tick + tick / 10);
        if !tick.is_multiple_of(5) {
            self.frame(&self.depth, tick, tick - tick / 5);
        }
    }

    fn frame(&self, publisher: &FramePublisher, tick: u64, seq: u64) {
        let mut loan = publisher.loan(16 * 16 * 4).expect("a slot is free");
        let header = loan.header_mut();
        header.set_image(16, 16);
        (header.tick, header.seq, header.epoch) = (tick, seq, 7);
        header.rendered_mono_nanos = schema_bus::mono_now().0;
        loan.send().expect("the frame fits");
    }
}

#[test]
fn topics_tells_rate_losses_and_complete_sets() {
    let sandbox = Sandbox::new("bench-topics");
    let bus = join_bus(&sandbox, "camera");
    let publisher = |modality: Modality| {
        let topic = format!("ego/front/{}", modality.name());
        bus.frame_publisher(&topic, FrameTopic::new(modality, 16 * 16 * 4))
            .expect("a topic")
    };
    let camera = Camera {
        rgb: publisher(Modality::Rgb),
        depth: publisher(Modality::Depth),
    };
    let event = bus.notifier("ego/tick").expect("an event");
    let words = [
        "topics",
        "--domain",
        sandbox.domain(),
        "--for",
        "2s",
        "--json",
        "report.json",
    ];
    let mut process = bench(&sandbox, &words);
    let mut tick = 0;
    while process.is_running() {
        tick += 1;
        camera.send(tick);
        event.notify();
        // Never two at once to make up for a delay: of those the reader would lose some.
        std::thread::sleep(Duration::from_millis(10));
    }
    process.wait().expect_code(3);
    let report = report(&sandbox);
    let topic = |name: &str| {
        report["topics"]
            .as_array()
            .expect("rows")
            .iter()
            .find(|t| t["topic"] == name)
            .expect("the topic")
            .clone()
    };
    let (rgb, depth, view) = (
        topic("ego/front/rgb"),
        topic("ego/front/depth"),
        &report["views"][0],
    );
    let number = |value: &Value| value.as_f64().expect("a number");
    // How many frames came depends on the machine; how they relate does not.
    let n = number(&rgb["n"]);
    assert!(n >= 10.0, "{rgb}");
    assert!(number(&rgb["lost"]) >= (n / 10.0).floor() - 1.0, "{rgb}");
    assert!(
        (number(&depth["n"]) - 0.8 * n).abs() <= 0.1 * n + 2.0,
        "{depth}"
    );
    assert_eq!(view["n_modalities"], 2);
    assert!(
        number(&view["incomplete"]) >= 1.0
            && number(&view["complete"]) > number(&view["incomplete"]),
        "{view}"
    );
    assert!(number(&rgb["rate_hz"]) > 1.0 && number(&rgb["age"]["max_us"]) > 0.0);
}

/// A detector that works 10 ms on every frame of a camera.
#[test]
fn topics_tells_rate_and_latency_of_results() {
    let sandbox = Sandbox::new("bench-results");
    let bus = join_bus(&sandbox, "detector");
    let camera = bus
        .frame_publisher("ego/front/rgb", FrameTopic::new(Modality::Rgb, 16 * 16 * 4))
        .expect("a topic");
    let mut eye = bus.frame_reader("ego/front/rgb").expect("a reader");
    let boxes = bus
        .result_publisher("detector/boxes", &ResultTopic::new(ResultType::Boxes2d))
        .expect("a topic");
    let words = [
        "topics",
        "--domain",
        sandbox.domain(),
        "--only",
        "detector",
        "--for",
        "2s",
        "--json",
        "report.json",
    ];
    let mut process = bench(&sandbox, &words);
    let mut tick = 0;
    while process.is_running() {
        tick += 1;
        let mut loan = camera.loan(16 * 16 * 4).expect("a slot is free");
        let header = loan.header_mut();
        header.set_image(16, 16);
        (header.tick, header.seq, header.epoch) = (tick, tick, 7);
        loan.send().expect("the frame fits");
        let frame = eye.next().expect("a reader").expect("the frame was sent");
        std::thread::sleep(Duration::from_millis(10));
        let mut loan = boxes.loan(64).expect("a slot is free");
        loan.write(&[Box2d {
            min_px: [1.0; 2],
            max_px: [2.0; 2],
            score: 0.5,
            class: 4,
            id: 0,
            reserved: 0,
        }])
        .expect("it fits");
        loan.answers(&frame);
        loan.send().expect("it is sent");
    }
    let ended = process.wait().expect_code(0);
    assert!(ended.says("detector/boxes"), "{:?}", ended.lines);
    let report = report(&sandbox);
    assert_eq!(report["topics"], serde_json::json!([]), "only the detector");
    let row = &report["results"][0];
    assert_eq!(
        (&row["topic"], &row["type"]),
        (&"detector/boxes".into(), &"boxes2d".into())
    );
    let number = |value: &Value| value.as_f64().expect("a number");
    assert!(
        number(&row["n"]) >= 5.0 && number(&row["rate_hz"]) > 1.0,
        "{row}"
    );
    assert!(number(&row["mebibytes_per_sec"]) > 0.0, "{row}");
    // The detector works 10 ms on each frame, so no answer is quicker, nor its way to us.
    assert!(number(&row["answering"]["p50_us"]) >= 9_900.0, "{row}");
    assert!(
        number(&row["since_frame"]["p50_us"]) >= number(&row["answering"]["p50_us"]) * 0.99,
        "{row}"
    );
}

#[test]
fn topics_of_an_empty_domain_says_what_to_do() {
    let sandbox = Sandbox::new("bench-empty");
    let ended = bench(&sandbox, &["topics", "--domain", sandbox.domain()])
        .wait()
        .expect_code(1);
    assert!(ended.says("gantry up"), "{:?}", ended.lines);
}

#[test]
fn memory_watches_the_living_and_reports_the_dead() {
    let sandbox = Sandbox::new("bench-memory");
    let own = std::process::id().to_string();
    let words = [
        "memory",
        "--pids",
        &own,
        "--for",
        "300ms",
        "--every",
        "100ms",
        "--json",
        "report.json",
    ];
    bench(&sandbox, &words).wait().expect_code(0);
    let process = report(&sandbox)["processes"][0].clone();
    assert!(
        process["lived"] == true
            && process["samples"]
                .as_array()
                .is_some_and(|samples| samples.len() >= 2),
        "{process}"
    );
    let ended = bench(&sandbox, &["memory", "--pids", "4194305", "--for", "200ms"])
        .wait()
        .expect_code(1);
    assert!(ended.says("(ended)"));
}

#[test]
fn wakes_tells_what_readers_cost_a_writer() {
    let sandbox = Sandbox::new("bench-wakes");
    let words = [
        "wakes",
        "--turns",
        "1",
        "--count",
        "20",
        "--readers",
        "0,2",
        "--json",
        "report.json",
    ];
    bench(&sandbox, &words).wait().expect_code(0);
    let report = report(&sandbox);
    let rows = report["rows"].as_array().expect("rows");
    // Two ways for each number of readers of one topic, three for the reader of a whole view.
    assert_eq!(rows.len(), 2 * 2 + 3);
    for row in rows {
        let (n_topics, n_readers) = (row["n_topics"].as_u64(), row["n_readers"].as_u64());
        assert_eq!(row["writing"]["n"], 20);
        let n_expected = 20 * n_topics.expect("a number") * n_readers.expect("a number");
        let n_seen = row["age"]["n"].as_u64().expect("a number");
        let lost = row["lost"].as_u64().expect("a number");
        assert_eq!(n_seen + lost, n_expected, "{row}");
    }
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

#[test]
fn ages_measures_quick_sensors_beside_cameras() {
    let sandbox = Sandbox::new("bench-ages");
    let bus = join_bus(&sandbox, "simulator");
    let publisher = |topic: &str, modality: Modality| {
        let spec = FrameTopic::new(modality, 16 * 16 * 4);
        bus.frame_publisher(topic, spec).expect("a topic")
    };
    let rgb = publisher("ego/front/rgb", Modality::Rgb);
    let imu = publisher("ego/imu/imu", Modality::Imu);
    let tick_event = bus.notifier("ego/tick").expect("an event");
    let imu_event = bus.notifier("ego/imu/imu").expect("an event");
    let words = [
        "ages",
        "--domain",
        sandbox.domain(),
        "--turns",
        "1",
        "--each",
        "1s",
        "--json",
        "report.json",
    ];
    let mut process = bench(&sandbox, &words);
    let mut tick = 0;
    // The picture takes ten milliseconds longer than the IMU.
    while process.is_running() {
        tick += 1;
        for publisher in [&imu, &rgb] {
            let mut loan = publisher.loan(16 * 16 * 4).expect("a slot is free");
            let header = loan.header_mut();
            if publisher.modality() == Modality::Rgb {
                header.set_image(16, 16);
            } else {
                header.set_list(1);
            }
            (header.tick, header.seq, header.epoch) = (tick, tick, 7);
            loan.send().expect("the frame fits");
            if publisher.modality() == Modality::Imu {
                imu_event.notify();
                std::thread::sleep(Duration::from_millis(10));
            }
        }
        tick_event.notify();
        std::thread::sleep(Duration::from_millis(10));
    }
    process.wait().expect_code(0);
    let report = report(&sandbox);
    let rows = report["rows"].as_array().expect("rows");
    let p50_us = |row: &serde_json::Value| row["age"]["p50_us"].as_f64().expect("a number");
    assert_eq!(rows.len(), 4);
    assert_eq!(rows[0]["wake"], "the rig's tick");
    assert!(p50_us(&rows[0]) >= 10_000.0, "it waits for the picture");
    assert!(
        p50_us(&rows[1]) < p50_us(&rows[0]),
        "and on its own event it does not"
    );
}
