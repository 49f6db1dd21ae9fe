//! Makes and ends sensors of every kind, thousands of times, and watches what the daemon keeps.
//!
//! `cargo run --release -p test_e2e --example sensor_churn -- [N] [--json FILE]` (default 10 000; `./gantry soak`
//! runs it). Every twentieth sensor is read before it ends. Prints the
//! daemon's resident memory, descriptors and files in shared memory, and fails if they grow: after
//! the first half memory may move by 12 MiB,
//! the others not at all. On a software adapter the GPU's memory is the daemon's own.

use std::process::ExitCode;

use launch_cli::bench::{self, BenchResult, anyhow, clap};
use schema_frames::{Command, CommandReply};
use schema_types::Pose;
use test_e2e::{ask, join_bus, reader, start_daemon, step};
use test_kit::Sandbox;

const LAUNCH: &str = "version = 1\n[scenario]\nmap = \"Town10HD\"\nseed = 7\ntick_hz = 20\nmode = \"stepped\"\nvehicles = 0\n";
const MAX_GROWTH_KIB: u64 = 12 << 10;

const SPECS: [(&str, &str); 9] = [
    (
        "sensor.camera.rgb",
        r#"{"kind": "camera", "width_px": 64, "height_px": 48, "modalities": ["rgb", "depth", "instance"]}"#,
    ),
    (
        "sensor.camera.dvs",
        r#"{"kind": "camera", "width_px": 64, "height_px": 48, "modalities": ["dvs"]}"#,
    ),
    (
        "sensor.lidar.ray_cast",
        r#"{"kind": "lidar", "channels": 4, "columns": 90}"#,
    ),
    (
        "sensor.lidar.ray_cast_semantic",
        r#"{"kind": "lidar", "semantic": true, "scan": "sweep", "channels": 4, "points_per_second": 4000}"#,
    ),
    ("sensor.other.radar", r#"{"kind": "radar"}"#),
    ("sensor.other.imu", r#"{"kind": "imu"}"#),
    ("sensor.other.gnss", r#"{"kind": "gnss"}"#),
    (
        "sensor.other.obstacle",
        r#"{"kind": "obstacle", "distance_m": 100, "hit_radius_m": 3}"#,
    ),
    ("sensor.other.collision", r#"{"kind": "collision"}"#),
];

#[derive(Debug)]
struct Kept {
    resident_kib: u64,
    descriptors: usize,
    files: usize,
}

fn kept(sandbox: &Sandbox, pid: u32) -> Kept {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).expect("the daemon lives");
    let resident = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))
        .expect("Linux counts resident memory");
    Kept {
        resident_kib: resident
            .trim()
            .trim_end_matches(" kB")
            .parse()
            .expect("a number of kB"),
        descriptors: std::fs::read_dir(format!("/proc/{pid}/fd"))
            .expect("own processes can be looked at")
            .count(),
        files: sandbox.leftovers().len(),
    }
}

/// Makes and ends sensors of every kind
#[derive(Debug, clap::Args)]
struct Args {
    /// Sensors
    #[arg(default_value_t = 10_000)]
    sensors: usize,
}

fn main() -> ExitCode {
    bench::run("sensor_churn", |args: &Args, result| {
        churn(args.sensors, result)
    })
}

fn churn(n: usize, result: &mut BenchResult) -> anyhow::Result<()> {
    let sandbox = Sandbox::new("sensor_churn");
    let daemon = start_daemon(&sandbox, LAUNCH, &[]);
    let bus = join_bus(&sandbox, "churn");
    let mut client = bus.command_client("churn").expect("the daemon answers");
    step(&mut client, 1);
    let warm_up = (n / 2).max(2 * SPECS.len());
    let mut before = None;
    for round in 0..n {
        let (type_id, spec) = SPECS[round % SPECS.len()];
        let wish = Command::SpawnSensor {
            type_id: type_id.into(),
            pose: Pose::from_xyz_yaw(round as f64 % 50.0, 0.0, 2.0, 0.3).into(),
            parent_id: None,
            attachment: Default::default(),
            interval_nanos: 0,
            spec: serde_json::from_str(spec).expect("written above"),
            attributes: Default::default(),
        };
        let CommandReply::Spawned { actor_id, topics } = ask(&mut client, wish) else {
            panic!("{type_id} must be made")
        };
        if round % 20 < 2 {
            let mut reader = reader(&bus, &topics[0]);
            step(&mut client, 2);
            drop(reader.latest().expect("frames keep the contract"));
        }
        assert_eq!(
            ask(&mut client, Command::Destroy { actor_id }),
            CommandReply::Done
        );
        if round == warm_up {
            before = Some(kept(&sandbox, daemon.pid()));
        }
        if round % 1000 == 999 {
            let now = kept(&sandbox, daemon.pid());
            println!("after {}: {now:?}", round + 1);
            let figures = [
                ("resident_kib", now.resident_kib as f64),
                ("descriptors", now.descriptors as f64),
                ("files", now.files as f64),
            ];
            result.row(&(round + 1).to_string(), &figures);
        }
    }
    step(&mut client, 1);
    let (before, after) = (
        before.expect("there were enough rounds"),
        kept(&sandbox, daemon.pid()),
    );
    println!(
        "{n} sensors made and ended: {before:?} after the first {warm_up}, {after:?} at the end"
    );
    // Also of a run that fails below.
    result.write()?;
    assert!(
        after.resident_kib <= before.resident_kib + MAX_GROWTH_KIB,
        "memory grew"
    );
    assert_eq!(
        (after.descriptors, after.files),
        (before.descriptors, before.files),
        "descriptors or files stay behind"
    );
    Ok(())
}
