//! Runs the bench as users do: real processes on real shared memory; its figures are read from its
//! JSON.

use std::time::{Duration, Instant};

use schema_bus::{Bus, BusOptions, FramePublisher, FrameTopic};
use schema_frames::Modality;
use serde_json::Value;
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
    let options = BusOptions {
        iceoryx_root: Some(sandbox.iceoryx_root()),
        prefix: Some(sandbox.prefix().to_owned()),
    };
    let bus = Bus::open_with(sandbox.domain(), "camera", &options).expect("a private bus");
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
    let (mut tick, mut next) = (0, Instant::now());
    while process.is_running() {
        tick += 1;
        camera.send(tick);
        event.notify();
        next += Duration::from_millis(10);
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
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
