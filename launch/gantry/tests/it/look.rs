//! `gantry topic`, `top --once` and `graph` against real publishers: looking starts nothing, figures
//! are those of the writers, every type is shown, bad input gets a sentence.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use schema_bus::{Bus, BusOptions, FrameTopic, ResultTopic, mono_now};
use schema_frames::{
    About, Box2d, BytesSchema, ElementType, InputRecord, Modality, ResultType, Scalar,
};
use serde_json::Value;
use test_kit::sandbox::binary_path;
use test_kit::{Process, Sandbox, eventually};

fn join(sandbox: &Sandbox, program: &str) -> Bus {
    let options = BusOptions {
        iceoryx_root: Some(sandbox.iceoryx_root()),
        prefix: Some(sandbox.prefix().to_owned()),
    };
    Bus::open_with(sandbox.domain(), program, &options).unwrap()
}

/// The publisher of test cards: frames on every modality, but only where somebody reads.
fn test_card(sandbox: &Sandbox) -> Process {
    let card = binary_path("examples/test_card");
    let args = [sandbox.domain(), "100000"];
    let mut card = sandbox.spawn_program("test_card", &card, &args, &[]);
    card.wait_line("test card on");
    card
}

/// Runs `gantry` with these words to its end and returns its lines.
fn gantry(sandbox: &Sandbox, words: &[&str], code: i32) -> Vec<String> {
    let words = [words, &["--domain", sandbox.domain()]].concat();
    sandbox
        .spawn("gantry", &words)
        .wait()
        .expect_code(code)
        .lines
}

/// The line of JSON among the lines. Its place among sentences on the other stream is chance.
fn json_of(sandbox: &Sandbox, words: &[&str]) -> Value {
    let lines = gantry(sandbox, words, 0);
    let json = lines
        .iter()
        .find(|line| line.starts_with('{'))
        .unwrap_or_else(|| panic!("{words:?} printed no JSON: {lines:?}"));
    serde_json::from_str(json).unwrap_or_else(|error| panic!("{error} in {lines:?}"))
}

fn top(sandbox: &Sandbox, more: &[&str]) -> Value {
    json_of(
        sandbox,
        &[&["top", "--once", "--json", "--every", "500ms"], more].concat(),
    )
}

fn row<'a>(view: &'a Value, topic: &str) -> &'a Value {
    let rows = view["topics"].as_array().unwrap();
    rows.iter()
        .find(|row| row["topic"] == topic)
        .unwrap_or_else(|| panic!("no {topic} in {view}"))
}

/// Calls `work` again and again in a thread until dropped.
struct Repeat {
    ended: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Repeat {
    fn every(period: Duration, mut work: impl FnMut(u64) + Send + 'static) -> Repeat {
        let ended = Arc::new(AtomicBool::new(false));
        let theirs = ended.clone();
        let thread = std::thread::spawn(move || {
            for turn in 1.. {
                if theirs.load(Ordering::Acquire) {
                    break;
                }
                work(turn);
                std::thread::sleep(period);
            }
        });
        Repeat {
            ended,
            thread: Some(thread),
        }
    }
}

impl Drop for Repeat {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[test]
fn looking_starts_no_sensor_and_takes_no_place() {
    let sandbox = Sandbox::new("look");
    let card = test_card(&sandbox);
    let view = top(&sandbox, &[]);
    let rgb = row(&view, "ego/card/rgb");
    assert_eq!(
        (&rgb["readers"], &rgb["seq"]),
        (&0.into(), &Value::Null),
        "{rgb}"
    );
    let snapshot = row(&view, "world/snapshot");
    assert_eq!(snapshot["readers"], 0);
    let rate = snapshot["rate_hz"].as_f64().unwrap();
    assert!(rate > 0.0, "{snapshot}");
    assert!(snapshot["age_nanos"].as_u64().is_some());
    let process = &view["processes"][0];
    assert_eq!(
        (&process["name"], &process["pid"]),
        (&"test_card".into(), &card.pid().into())
    );
    assert!(process["resident_bytes"].as_u64().unwrap() > 1 << 20);
    assert_eq!(view["processes"].as_array().unwrap().len(), 1, "{view}");

    // With a reader the card begins to send, and the newest frame is seen without another one.
    let bus = join(&sandbox, "reader");
    let mut reader = bus.frame_reader("ego/card/rgb").unwrap();
    let before = eventually("a frame", || reader.latest().unwrap())
        .header()
        .seq;
    let view = top(&sandbox, &["--filter", "card/rgb"]);
    let rgb = row(&view, "ego/card/rgb");
    let after = eventually("another frame", || reader.latest().unwrap())
        .header()
        .seq;
    let seq = rgb["seq"].as_u64().unwrap();
    assert!(before <= seq && seq <= after, "{before} {seq} {after}");
    assert_eq!(rgb["readers"], 1);
    assert_eq!(rgb["read_by"][0]["name"], "reader");
    assert_eq!(rgb["written_by"][0]["pid"], card.pid());
    assert_eq!(rgb["payload_bytes"], 64 * 48 * 4);
    assert!(rgb["measured"].is_null());
    assert_eq!(
        view["topics"].as_array().unwrap().len(),
        1,
        "the filter holds"
    );
    // The plain screen has the same rows.
    let lines = gantry(&sandbox, &["top", "--once", "--every", "200ms"], 0);
    assert!(
        lines
            .iter()
            .any(|line| line.contains("ego/card/rgb") && line.contains("1/8")),
        "{lines:?}"
    );
    let lines = gantry(&sandbox, &["topic", "top", "--once", "--every", "200ms"], 0);
    assert!(
        !lines.iter().any(|line| line.contains("Processes")),
        "{lines:?}"
    );
}

#[test]
fn a_measured_topic_tells_losses_and_the_last_place_is_left() {
    let sandbox = Sandbox::new("measure");
    let bus = join(&sandbox, "writer");
    let two = FrameTopic {
        max_readers: 2,
        ..FrameTopic::new(Modality::Imu, 72)
    };
    let imu = bus.frame_publisher("ego/imu/imu", two).unwrap();
    let one = bus.frame_publisher("ego/last/imu", two).unwrap();
    let _reader = bus.frame_reader("ego/last/imu").unwrap();
    let lines = gantry(&sandbox, &["top", "--once", "--measure", "ego/last/imu"], 2);
    assert!(
        lines[0].contains("has 1 of 2 readers; top leaves the last place to others"),
        "{lines:?}"
    );
    assert_eq!(one.n_readers(), 1);
    // Every third number is sent: two are lost before each sample but the first.
    let sending = Repeat::every(Duration::from_millis(5), move |turn| {
        let mut loan = imu.loan(72).unwrap();
        let header = loan.header_mut();
        header.set_image(1, 1);
        (header.seq, header.epoch) = (turn * 3, 5);
        loan.send().unwrap();
    });
    let measured = eventually("a measurement", || {
        let view = top(&sandbox, &["--measure", "ego/imu/imu"]);
        let measured = row(&view, "ego/imu/imu")["measured"].clone();
        (measured["samples"].as_u64() >= Some(2)).then_some(measured)
    });
    let (samples, lost) = (
        measured["samples"].as_u64().unwrap(),
        measured["lost"].as_u64().unwrap(),
    );
    assert!(lost >= 2 * (samples - 1), "{measured}");
    assert!(measured["delay_nanos_p50"].as_u64().is_some(), "{measured}");
    assert_eq!(measured["fault"], "");
    let hz = json_of(
        &sandbox,
        &[
            "topic",
            "hz",
            "ego/imu/imu",
            "--window",
            "500ms",
            "--once",
            "--json",
        ],
    );
    assert!(
        hz["lost"].as_u64() >= Some(2 * (hz["samples"].as_u64().unwrap().max(1) - 1)),
        "{hz}"
    );
    let bw = json_of(
        &sandbox,
        &[
            "topic",
            "bw",
            "ego/imu/imu",
            "--window",
            "500ms",
            "--once",
            "--json",
        ],
    );
    assert_eq!(bw["sample_bytes_max"], 72, "{bw}");
    assert_eq!(bw["bytes"], bw["samples"].as_u64().unwrap() * 72);
    drop(sending);
}

#[test]
fn results_are_listed_measured_and_printed_with_their_inputs() {
    let sandbox = Sandbox::new("results");
    let bus = join(&sandbox, "detector");
    let mut spec = ResultTopic::new(ResultType::Boxes2d);
    spec.about = About {
        classes: vec!["person".into(), "dog".into()],
        note: "made up".into(),
        ..About::default()
    };
    let boxes = bus.result_publisher("people/boxes", &spec).unwrap();
    let tensor = bus
        .result_publisher("net/scores", &ResultTopic::new(ResultType::Tensor))
        .unwrap();
    let scalars = bus
        .result_publisher("car/figures", &ResultTopic::new(ResultType::Scalars))
        .unwrap();
    let text = bus
        .result_publisher("car/words", &ResultTopic::new(ResultType::Text))
        .unwrap();
    let mut spec = ResultTopic::new(ResultType::Bytes);
    spec.about.schema = Some(BytesSchema {
        name: "lab.Thing".into(),
        message_encoding: "cbor".into(),
        ..BytesSchema::default()
    });
    let bytes = bus.result_publisher("car/bytes", &spec).unwrap();
    let _sending = Repeat::every(Duration::from_millis(5), move |turn| {
        let mut loan = boxes.loan(32).unwrap();
        let mut input = InputRecord::new("ego/front/rgb");
        (input.tick, input.seq) = (turn, turn);
        input.published_mono_nanos = mono_now().0 - 7_000_000;
        loan.add_input(input);
        let found = Box2d {
            min_px: [1.5, 2.0],
            max_px: [30.0, 40.0],
            score: 0.75,
            class: 1,
            id: 9,
            reserved: 0,
        };
        loan.write(&[found]).unwrap();
        loan.send().unwrap();
        let mut loan = tensor.loan(16).unwrap();
        loan.set_tensor(ElementType::F32, &[2, 2]).unwrap();
        loan.write(&[1.0f32, 2.0, 3.0, -4.0]).unwrap();
        loan.send().unwrap();
        let mut loan = scalars.loan(64).unwrap();
        loan.write(&[Scalar::new("speed_mps", 3.5)]).unwrap();
        loan.send().unwrap();
        for (publisher, payload) in [(&text, &b"good day"[..]), (&bytes, &[1, 2, 3, 255][..])] {
            let mut loan = publisher.loan(payload.len()).unwrap();
            loan.write(payload).unwrap();
            loan.send().unwrap();
        }
    });
    let lines = gantry(&sandbox, &["topic", "list"], 0);
    let listed = |topic: &str, words: &[&str]| {
        let line = lines.iter().find(|line| line.starts_with(topic)).unwrap();
        words
            .iter()
            .for_each(|word| assert!(line.contains(word), "{word} in {line}"));
    };
    listed("people/boxes ", &["boxes2d", "results", "detector"]);
    listed("net/scores ", &["tensor"]);
    let info = json_of(&sandbox, &["topic", "info", "people/boxes", "--json"]);
    assert_eq!(info["type"], "boxes2d");
    assert_eq!(info["about"]["classes"][1], "dog");
    let lines = gantry(&sandbox, &["topic", "info", "car/bytes"], 0).join("\n");
    assert!(
        lines.contains("lab.Thing (cbor") && lines.contains("writers        1 of"),
        "{lines}"
    );

    let echo = |topic: &str| json_of(&sandbox, &["topic", "echo", topic, "--once", "--json"]);
    let found = echo("people/boxes");
    assert_eq!(found["boxes"][0]["class"], "dog");
    assert_eq!(
        (&found["boxes"][0]["score"], &found["n_boxes"]),
        (&0.75.into(), &1.into())
    );
    assert_eq!(found["boxes"][0]["min_px"], serde_json::json!([1.5, 2]));
    assert_eq!(found["inputs"][0]["topic"], "ego/front/rgb");
    assert!(found["inputs"][0]["latency_nanos"].as_u64().unwrap() >= 7_000_000);
    let found = echo("net/scores");
    assert_eq!(
        (&found["dtype"], &found["shape"]),
        (&"f32".into(), &serde_json::json!([2, 2]))
    );
    assert_eq!(
        [&found["min"], &found["mean"], &found["max"]],
        [&(-4.0).into(), &0.5.into(), &Value::from(3.0)]
    );
    assert_eq!(echo("car/figures")["scalars"]["speed_mps"], 3.5);
    assert_eq!(echo("car/words")["text"], "good day");
    let found = echo("car/bytes");
    assert_eq!(
        (&found["bytes"], &found["first_bytes"]),
        (&4.into(), &"010203ff".into())
    );
    assert_eq!(
        (&found["message"], &found["message_encoding"]),
        (&"lab.Thing".into(), &"cbor".into())
    );
    let lines = gantry(&sandbox, &["topic", "echo", "people/boxes", "--once"], 0).join("\n");
    assert!(
        lines.contains("class: dog") && lines.contains("score: 0.75"),
        "{lines}"
    );

    let delay = json_of(
        &sandbox,
        &[
            "topic",
            "delay",
            "people/boxes",
            "--window",
            "500ms",
            "--once",
            "--json",
        ],
    );
    assert!(delay["delay_nanos_p50"].as_u64().is_some(), "{delay}");
    assert_eq!(delay["inputs"][0]["input"], "ego/front/rgb");
    assert!(
        delay["inputs"][0]["latency_nanos_min"].as_u64().unwrap() >= 6_990_000,
        "{delay}"
    );
    let view = top(&sandbox, &[]);
    let row = row(&view, "people/boxes");
    assert!(row["rate_hz"].as_f64().unwrap() > 0.0, "{row}");
    assert_eq!(
        (&row["kind"], &row["type"], &row["readers"]),
        (&"results".into(), &"boxes2d".into(), &0.into())
    );
}

#[test]
fn the_graph_names_processes_topics_and_arrows_in_every_form() {
    let sandbox = Sandbox::new("graph");
    let card = test_card(&sandbox);
    let bus = join(&sandbox, "pilot");
    let _reader = bus.frame_reader("ego/card/lidar").unwrap();
    let _client = bus.command_client("pilot").unwrap();
    let value = json_of(&sandbox, &["graph", "--json"]);
    let arrows = value["arrows"].as_array().unwrap();
    let has = |from: Value, to: Value| {
        arrows
            .iter()
            .any(|arrow| arrow["from"] == from && arrow["to"] == to)
    };
    let pilot = std::process::id();
    assert!(has(card.pid().into(), "ego/card/lidar".into()), "{value}");
    assert!(has("ego/card/lidar".into(), pilot.into()), "{value}");
    assert!(
        has(pilot.into(), "control/world".into()) && has("control/world".into(), card.pid().into())
    );
    assert!(!has("ego/card/rgb".into(), pilot.into()));
    let lines = gantry(&sandbox, &["graph"], 0).join("\n");
    assert!(
        lines.contains(&format!("→ pilot ({pilot})")) && lines.contains("reads  control/world"),
        "{lines}"
    );

    gantry(
        &sandbox,
        &["graph", "--svg", "all.svg", "--all", "--dot", "g.dot"],
        0,
    );
    let text = std::fs::read_to_string(sandbox.path("all.svg")).unwrap();
    let document = roxmltree::Document::parse(&text).unwrap();
    let texts: Vec<&str> = document
        .descendants()
        .filter_map(|node| node.text())
        .collect();
    for name in [
        "test_card",
        "pilot",
        "ego/card/lidar",
        "ego/card/rgb",
        "control/world · requests",
    ] {
        assert!(texts.contains(&name), "{name} in {texts:?}");
    }
    let n_paths = document.descendants().filter(|node| {
        node.attribute("class")
            .is_some_and(|class| ["data", "documents", "control"].contains(&class))
    });
    assert_eq!(n_paths.count(), arrows.len(), "an arrow for every end");
    let dot = std::fs::read_to_string(sandbox.path("g.dot")).unwrap();
    assert_eq!(dot.matches(" -> ").count(), arrows.len());
    // Topics with the same ends share a box unless all are asked for.
    let small = gantry(&sandbox, &["graph", "--dot", "-"], 0).join("\n");
    assert!(small.matches(" -> ").count() < arrows.len(), "{small}");
    let lines = gantry(&sandbox, &["graph", "--filter", "lidar"], 0).join("\n");
    assert!(
        lines.contains("ego/card/lidar") && !lines.contains("ego/card/rgb"),
        "{lines}"
    );
}

#[test]
fn bad_input_and_an_empty_domain_get_a_sentence() {
    let sandbox = Sandbox::new("sentences");
    for words in [
        &["topic", "list"][..],
        &["top", "--once", "--every", "100ms"],
        &["graph"],
    ] {
        let lines = gantry(&sandbox, words, 0);
        let sentence = format!("nothing is published on domain {:?}", sandbox.domain());
        assert!(
            lines.len() == 1 && lines[0].starts_with(&sentence),
            "{words:?}: {lines:?}"
        );
    }
    let view = top(&sandbox, &[]);
    assert_eq!(
        (&view["topics"], &view["world"]),
        (&Value::Array(vec![]), &Value::Null)
    );
    let refused = |words: &[&str], code: i32, sentence: &str| {
        let lines = gantry(&sandbox, words, code).join("\n");
        assert!(lines.contains(sentence), "{words:?}: {lines}");
    };
    refused(&["top"], 2, "stdout is no terminal");
    refused(&["topic", "top"], 2, "stdout is no terminal");
    refused(&["top", "--every", "1ms"], 2, "must be 100ms to 1h");
    refused(
        &["top", "--once", "--measure", "ego/front/rgb"],
        2,
        "there is no topic \"ego/front/rgb\"",
    );
    refused(&["topic", "info", "ego/front/rgb"], 2, "there is no topic");
    refused(
        &["topic", "hz", "ego/front/rgb"],
        1,
        "nothing runs on domain",
    );
    refused(
        &["topic", "hz", "a", "--once", "--count", "2"],
        2,
        "cannot be used with",
    );
    refused(
        &["graph", "--svg", "no/such/folder/x.svg"],
        1,
        "cannot write no/such/folder/x.svg",
    );
    let _card = test_card(&sandbox);
    refused(
        &["topic", "delay", "world/info", "--window", "200ms"],
        2,
        "have no time of publishing",
    );
    refused(
        &["topic", "echo", "control/world"],
        2,
        "which only the two ends of a request see",
    );
    refused(&["graph", "--filter", "zebra"], 0, "no topic of domain");
}

#[test]
fn the_doctor_names_what_is_wrong_with_the_command_that_mends_it() {
    let sandbox = Sandbox::new("doctor");
    let line = format!(
        "ulimit -n 300; ulimit -f 204800; exec {} doctor --json --domain {}",
        binary_path("gantry").display(),
        sandbox.domain()
    );
    let env = [
        ("VK_DRIVER_FILES", "/no/such/driver.json"),
        ("DISPLAY", ":7731"),
        ("WAYLAND_DISPLAY", ""),
        ("XDG_DATA_HOME", "/dev/null/data"),
    ];
    let ended = sandbox
        .spawn_program("sh", std::path::Path::new("/bin/sh"), &["-c", &line], &env)
        .wait()
        .expect_code(1);
    let findings: Vec<Value> = ended
        .lines
        .iter()
        .filter(|line| line.starts_with('{'))
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    for (what, grade, fix) in [
        ("vulkan drivers", "fail", "unset VK_DRIVER_FILES"),
        ("open files", "warn", "prlimit"),
        ("file size", "warn", "ulimit -f unlimited"),
        ("display", "warn", "unset DISPLAY"),
        ("data folder", "fail", "--data FOLDER"),
    ] {
        let finding = findings
            .iter()
            .find(|finding| finding["what"] == what)
            .unwrap_or_else(|| panic!("nothing about {what}: {findings:?}"));
        assert_eq!(finding["grade"], grade, "{finding}");
        assert!(finding["fix"].as_str().unwrap().contains(fix), "{finding}");
    }
}
