//! Programs in C++ beside a simulator.

use schema_bus::ResultReader;
use schema_frames::{Box2d, PathPoint, ResultType};
use test_kit::sandbox::repository;
use test_kit::{Setup, Simulator};

use crate::compiler::program;

const LAUNCH: &str = r#"
version = 1

[scenario]
map = "Town10HD"
tick_hz = 20

[ego]
spawn_point = 0

[sensor.front]
kind = "camera"
modalities = ["semantic"]
rate_hz = 20
width_px = 160
height_px = 90
"#;

/// FNV-1a, 64 bits.
fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

#[test]
fn a_program_in_cpp_sees_the_bytes_that_rust_sees_and_answers_them_in_lockstep() {
    let source = repository().join("consumers/consumer_c/tests/programs/answers.cpp");
    let sanitized = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
    let answers = program(&source, &sanitized);
    let mut simulator = Simulator::start(Setup::text(LAUNCH));
    let mut camera = simulator.frames("ego/front/semantic");
    let mut process = simulator.run(&answers, &[]);
    process.wait_line("joined");
    let mut boxes: ResultReader = simulator.results("answers/boxes");
    let mut images = simulator.results("answers/image");
    let mut expected = Vec::new();
    let mut places = Vec::new();
    for _ in 0..5 {
        let tick = simulator.step(1);
        let frame = simulator.frame_of(&mut camera, tick);
        let ego = simulator.ego();
        let x_m = ego.world_from_actor.translation_m[0];
        places.push(x_m);
        expected.push(format!(
            "tick {tick} hash {:016x} 160x90 at {x_m:.3}",
            hash(&frame)
        ));

        let found = simulator.result_of(&mut boxes, tick);
        let input = &found.inputs()[0];
        assert_eq!(
            (input.topic(), input.tick, input.seq),
            ("ego/front/semantic".into(), tick, frame.header().seq)
        );
        assert_eq!(
            found.header().world_from_space,
            frame.header().world_from_sensor
        );
        let first = Box2d {
            min_px: [1.0, 2.0],
            max_px: [3.5, 4.5],
            score: 0.75,
            class: 0,
            id: tick as u32,
            reserved: 0,
        };
        let second = Box2d {
            min_px: [0.0, 0.0],
            max_px: [160.0, 90.0],
            score: 0.5,
            id: 7,
            ..first
        };
        assert_eq!(found.records::<Box2d>(), Some(&[first, second][..]));

        let image = simulator.result_of(&mut images, tick);
        assert_eq!(image.kind(), ResultType::Image);
        assert_eq!(hash(&image), hash(&frame), "the image is the frame");
    }
    process.wait_line("done");
    let said: Vec<String> = process
        .lines()
        .iter()
        .filter(|line| line.starts_with("tick "))
        .cloned()
        .collect();
    assert_eq!(said, expected);
    assert!(
        (places[4] - places[0]).abs() > 1e-4,
        "its throttle moves the car: {places:?}"
    );
    drop((camera, boxes, images));
    process.wait().expect_code(0);
    simulator.finish();
}

#[test]
fn the_lane_keeper_of_the_examples_keeps_its_lane() {
    let example = repository().join("examples/lane_keeper");
    let keeper = program(&example.join("keeper.cpp"), &["-Wno-conversion"]);
    let mut simulator = Simulator::start(Setup::file(example.join("launch.toml")));
    let mut process = simulator.run(&keeper, &[r#"{"ticks": 25, "speed_mps": 10.0}"#]);
    let mut lane = simulator.results("keeper/lane");
    // What waits in a reader ends with its writer.
    let mut newest = None;
    while process.is_running() {
        simulator.step(1);
        newest = lane.latest().unwrap().or(newest);
    }
    process.wait_line("m driven, 0 lines crossed");
    let newest = newest.expect("it published its lane");
    let points = newest.records::<PathPoint>().unwrap();
    assert_eq!(points[0].pose.translation_m[0], 5.0);
    assert!(points[0].pose.translation_m[1].abs() < 1.0, "{points:?}");
    drop((newest, lane));
    process.wait().expect_code(0);
    simulator.finish();
}
