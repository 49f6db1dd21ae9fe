//! Streams through the stock client: many listeners, slow ones, and cameras without rendering.

use schema_bus::Bus;
use test_e2e::carla::{empty_town, start_gateway, start_script};
use test_e2e::{assert_nothing_left, counter, join_bus, start_daemon};
use test_kit::{Sandbox, eventually};

/// Whether no camera topic has a reader.
fn nobody_looks(bus: &Bus) -> Option<()> {
    let pictures = ["rgb", "depth", "semantic"];
    let is_read = |name: &str, subscribers: usize| {
        subscribers > 0
            && pictures
                .iter()
                .any(|kind| name.ends_with(&format!("/{kind}")))
    };
    let topics = bus.topics().ok()?;
    (!topics
        .iter()
        .any(|topic| is_read(&topic.name, topic.subscribers)))
    .then_some(())
}

#[test]
fn listeners_share_readers_and_dark_cameras_cost_nothing() {
    let sandbox = Sandbox::new("carlastreams");
    let daemon = start_daemon(&sandbox, &empty_town("Town10HD"), &[]);
    let (gateway, port, stream_port) = start_gateway(&sandbox);
    let (port, stream_port, file) = (
        port.to_string(),
        stream_port.to_string(),
        sandbox.path("dark"),
    );
    let args = [
        port.as_str(),
        &stream_port,
        sandbox.domain(),
        file.to_str().expect("paths are UTF-8"),
    ];
    let mut script = start_script(&sandbox, "carla_streams.py", &args);
    script.wait_line("all is dark now");
    let bus = join_bus(&sandbox, "witness");
    let mut client = bus
        .command_client("witness")
        .unwrap_or_else(|error| panic!("{error}"));
    eventually("nobody reads a camera", || nobody_looks(&bus));
    let (before, from) = (
        counter(&mut client, "gpu_submissions"),
        counter(&mut client, "ticks"),
    );
    eventually("20 more ticks are done", || {
        (counter(&mut client, "ticks") >= from + 20).then_some(())
    });
    assert_eq!(
        counter(&mut client, "gpu_submissions"),
        before,
        "the GPU does nothing for cameras that stay dark"
    );
    drop((client, bus));
    sandbox.write("dark", "");
    let ended = script.wait().expect_code(0);
    for theme in ["many", "palette", "buffers", "dark", "slow"] {
        assert!(
            ended.says(&format!("{theme} passed")),
            "{theme} is missing:\n{}",
            ended.lines.join("\n")
        );
    }
    let said = gateway.stop().expect_code(0);
    let waits = said
        .lines
        .iter()
        .filter(|line| line.contains("does not take its sensor's messages"))
        .count();
    assert_eq!(
        waits,
        1,
        "of 30 steps one waits for the listener that takes nothing:\n{}",
        said.lines.join("\n")
    );
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}
