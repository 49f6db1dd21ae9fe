//! `gantry-bridge` between two network namespaces whose wire loses packets: late, but whole and in
//! order. Where namespaces are not allowed it says NOT TESTED.

use std::time::Duration;

use nix::sys::signal::Signal;
use schema_bus::FrameReader;
use schema_frames::{Command, CommandReply};
use test_e2e::{
    SMALL_RIG, ask, assert_nothing_left, join_bus, not_tested, reader, start_daemon, step,
    wait_readers,
};
use test_kit::sandbox::{binary_path, repository};
use test_kit::{Process, Sandbox, eventually};

/// Packets that are lost, in either direction.
const SHARE: &str = "0.08";
const SEED: &str = "20261129";
const ENDPOINT: &str = "tcp/198.51.100.1:7447";
const TOPICS: [&str; 2] = ["ego/front/rgb", "ego/imu/imu"];

/// Two namespaces and their wire.
struct Wire {
    process: Process,
    /// Processes in the namespaces.
    spaces: [u32; 2],
}

impl Wire {
    /// `None` where the kernel does not allow it.
    fn lay(sandbox: &Sandbox) -> Option<Wire> {
        let script = repository().join("tests/test_e2e/python/lossy_link.py");
        let script = script.to_str().expect("paths are UTF-8").to_owned();
        let namespaces: &[&str] = match nix::unistd::geteuid().is_root() {
            true => &["--net"],
            false => &["--user", "--map-root-user", "--net"],
        };
        let args = [namespaces, &["python3", &script, SHARE, SEED]].concat();
        let mut process = sandbox.spawn_program("wire", "unshare".as_ref(), &args, &[]);
        let said = eventually("the wire is laid, or not allowed", || {
            let lines = process.lines();
            let said = lines
                .into_iter()
                .find(|line| line.starts_with("ready ") || line.starts_with("not allowed"));
            said.or_else(|| (!process.is_running()).then(|| "unshare is not allowed".to_owned()))
        });
        let spaces: Vec<u32> = said
            .strip_prefix("ready ")
            .into_iter()
            .flat_map(|pids| pids.split(' '))
            .map(|pid| pid.parse().expect("a process id"))
            .collect();
        let Ok(spaces) = spaces.try_into() else {
            not_tested("bridges over a wire that loses packets", &said);
            return None;
        };
        Some(Wire { process, spaces })
    }

    /// Starts a bridge in one of the namespaces.
    fn bridge(&self, space: usize, sandbox: &Sandbox, how: &str) -> Process {
        let pid = self.spaces[space];
        let net = format!("--net=/proc/{pid}/ns/net");
        let user = format!("--user=/proc/{pid}/ns/user");
        let program = binary_path("gantry-bridge");
        let bridge = [
            program.to_str().expect("paths are UTF-8"),
            how,
            ENDPOINT,
            "--domain",
            sandbox.domain(),
        ];
        let into: &[&str] = match nix::unistd::geteuid().is_root() {
            true => &[&net],
            false => &[&user, "--preserve-credentials", &net],
        };
        let args = [into, &bridge].concat();
        let mut bridge = sandbox.spawn_program("bridge", "nsenter".as_ref(), &args, &[]);
        bridge.wait_line("ready");
        bridge
    }

    /// Takes it away; the packets that were carried and lost.
    fn end(self) -> [u64; 2] {
        let ended = self.process.stop().expect_code(0);
        let last = ended.lines.iter().find(|line| line.starts_with("carried "));
        let words: Vec<&str> = last.expect("its count").split(' ').collect();
        [1, 3].map(|idx| words[idx].parse().expect("a count"))
    }
}

fn stepped() -> String {
    SMALL_RIG.replace("tick_hz = 20", "tick_hz = 20\nmode = \"stepped\"")
}

/// Tick and bytes of the next frame.
fn next(frames: &mut FrameReader) -> (u64, Vec<u8>) {
    let topic = frames.topic().to_owned();
    let frame = eventually(&format!("a frame of {topic}"), || frames.next().unwrap());
    (frame.header().tick, frame.to_vec())
}

/// Commands and frames cross in order and whole while one packet in twelve is lost. When no packet
/// comes through any more, and nobody says so, the bridges give each other up, and find each other
/// again.
#[test]
fn lost_packets_lose_no_frame_and_a_dead_wire_comes_back() {
    let (near, far) = (Sandbox::new("lossy-near"), Sandbox::new("lossy-far"));
    let Some(wire) = Wire::lay(&near) else { return };
    let daemon = start_daemon(&near, &stepped(), &[]);
    let near_bridge = wire.bridge(0, &near, "--listen");
    let mut far_bridge = wire.bridge(1, &far, "--connect");
    far_bridge.wait_line("its world appears here");
    let (near_bus, far_bus) = (join_bus(&near, "test"), join_bus(&far, "test"));
    let mut client = far_bus.command_client("far-test").unwrap();
    eventually("commands cross", || {
        matches!(ask(&mut client, Command::Ping), CommandReply::Pong { .. }).then_some(())
    });
    let mut near_frames = TOPICS.map(|topic| reader(&near_bus, topic));
    let mut far_frames = TOPICS.map(|topic| reader(&far_bus, topic));
    for topic in TOPICS {
        wait_readers(&near_bus, topic, 2);
    }
    for tick in 1..=25u64 {
        assert_eq!(step(&mut client, 1), tick);
        for (near, far) in near_frames.iter_mut().zip(&mut far_frames) {
            let frame = next(near);
            assert_eq!(frame.0, tick);
            assert!(next(far) == frame, "{} at tick {tick}", near.topic());
        }
    }
    for frames in &far_frames {
        assert_eq!(frames.counts().lost, 0, "{}", frames.topic());
    }

    wire.process.signal(Signal::SIGUSR1);
    far_bridge.wait_line("another bridge is gone");
    wire.process.signal(Signal::SIGUSR2);
    let mut near_client = near_bus.command_client("near-test").unwrap();
    eventually("frames after the silence", || {
        step(&mut near_client, 1);
        std::thread::sleep(Duration::from_millis(50));
        let frame = far_frames[0].latest().unwrap()?;
        (frame.header().tick > 25).then_some(())
    });
    drop((
        near_frames,
        far_frames,
        client,
        near_client,
        near_bus,
        far_bus,
    ));
    far_bridge.stop().expect_code(0);
    near_bridge.stop().expect_code(0);
    let [carried, lost] = wire.end();
    assert!(
        carried > 200 && lost > 20,
        "{carried} packets came, {lost} did not"
    );
    daemon.stop().expect_code(0);
    for sandbox in [&near, &far] {
        assert_nothing_left(sandbox);
    }
}
