//! Rays and debug drawing through the stock CARLA client.

use schema_frames::Command;
use test_e2e::carla::{Stage, run_script, start_gateway};
use test_e2e::{ask, join_bus, reader, start_daemon, step};
use test_kit::Sandbox;

const LAUNCH: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
mode = "stepped"
vehicles = 0
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [0.6, 0.0, 1.6]
"#;

#[test]
fn rays_meet_roads_and_cars_where_geometry_says() {
    let stage = Stage::new("carlarays", &LAUNCH.replace("mode = \"stepped\"\n", ""));
    stage.run("carla_queries.py", &[], &["ground", "car", "shapes"]);
    stage.end();
}

#[test]
fn drawn_shapes_are_seen_in_colour_and_nowhere_else() {
    let sandbox = Sandbox::new("carladraw");
    let daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let bus = join_bus(&sandbox, "test");
    let mut client = bus.command_client("test").unwrap();
    let mut topics = ["rgb", "depth", "semantic", "instance"]
        .map(|modality| reader(&bus, &format!("ego/front/{modality}")));
    let mut tick = |client: &mut schema_bus::CommandClient| {
        step(client, 1);
        topics.each_mut().map(|topic| {
            topic
                .latest()
                .unwrap()
                .expect("every tick has a frame")
                .to_vec()
        })
    };
    // The car settles first: what differs afterwards is the drawing.
    for _ in 0..60 {
        tick(&mut client);
    }
    let before = tick(&mut client);
    let (gateway, port, _) = start_gateway(&sandbox);
    run_script(
        &sandbox,
        "carla_queries.py",
        &[&port.to_string(), "draw"],
        &["drawing"],
    );
    let magenta = |frame: &[u8]| {
        frame
            .chunks(4)
            .filter(|pixel| *pixel == [255, 0, 255, 255])
            .count()
    };
    let with = tick(&mut client);
    assert_eq!(magenta(&before[0]), 0);
    // f is 48 px at 96 px and 90°: the line of 6 m by 0.5 m lies 7.4 m ahead of the camera, 39 by 3
    // pixels of it.
    assert!(magenta(&with[0]) > 39 * 3, "{} pixels", magenta(&with[0]));
    // A standing car still moves by micrometres, so a few pixels on edges may change; the drawing
    // covers hundreds.
    let depth = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
    let is_other_depth = |(a, b): &(&[u8], &[u8])| {
        a != b && (depth(a) - depth(b)).abs() > 0.01 * depth(a).min(depth(b))
    };
    let n_depths = before[1]
        .chunks(4)
        .zip(with[1].chunks(4))
        .filter(is_other_depth)
        .count();
    let n_classes = before[2]
        .iter()
        .zip(&with[2])
        .filter(|(a, b)| a != b)
        .count();
    let n_instances = before[3]
        .chunks(4)
        .zip(with[3].chunks(4))
        .filter(|(a, b)| a != b)
        .count();
    assert!(
        n_depths.max(n_classes).max(n_instances) < 20,
        "{n_depths} depths, {n_classes} classes, {n_instances} instances changed"
    );
    // The point lived for a second; the rest stays until it is cleared.
    let mut after = with;
    for _ in 0..25 {
        after = tick(&mut client);
    }
    assert!(magenta(&after[0]) > 100);
    assert_eq!(
        ask(
            &mut client,
            Command::ClearDebug {
                what: Default::default()
            }
        ),
        schema_frames::CommandReply::Done
    );
    assert_eq!(magenta(&tick(&mut client)[0]), 0);
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
}
