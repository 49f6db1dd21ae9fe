//! The same rendered frames for other event cameras and for ours: `benches/dvs_peers.py` feeds them
//! to v2e and to ESIM's formula and compares.
//!
//! `cargo run --release -p sensor_camera --example dvs_peers -- FOLDER [WIDTH HEIGHT]` renders 101
//! frames of a drive along the test street, 1 ms apart at 8 m/s, and writes into FOLDER:
//! `luminance.f32` (frames × rows × columns, 0..1), `NAME.events` (records of 16 bytes as on the
//! bus, behind each its window's number as u64) for `motion` and `two_frame` every 50 ms and
//! `two_frame_1khz`, and `cpu.txt` with each one's CPU seconds per simulated second.

#[path = "../tests/it/common.rs"]
mod common;
#[path = "dvs_shots/mod.rs"]
mod shots;

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use launch_cli::bench::{self, clap, process_cpu_secs};
use sensor_camera::dvs::EventCamera;
use sensor_spec::{DvsMode, DvsSpec};
use shots::{Shot, drive};

const N_FRAMES: u64 = 101;
const STEP_NANOS: u64 = 1_000_000;
const SPEED_MPS: f64 = 8.0;

/// Renders frames and makes events of them, for other event cameras
#[derive(Debug, clap::Args)]
struct Args {
    folder: PathBuf,
    #[arg(default_value_t = 800)]
    width: u32,
    #[arg(default_value_t = 600)]
    height: u32,
}

fn main() -> ExitCode {
    bench::run("dvs_peers", |args: &Args, result| {
        for (name, cpu_secs) in make(args)? {
            result.row(name, &[("cpu_secs", cpu_secs)]);
        }
        Ok(())
    })
}

/// Writes the files; the CPU seconds per simulated second of each way.
fn make(args: &Args) -> std::io::Result<Vec<(&'static str, f64)>> {
    let (folder, size_px) = (&args.folder, [args.width, args.height]);
    std::fs::create_dir_all(folder)?;
    let fine = frames(size_px, 1);
    let coarse = frames(size_px, 50);
    let mut file = std::io::BufWriter::new(std::fs::File::create(folder.join("luminance.f32"))?);
    fine.iter()
        .try_for_each(|shot| file.write_all(&shot.luminance))?;
    file.flush()?;
    let mut cpu = std::fs::File::create(folder.join("cpu.txt"))?;
    let mut spent = Vec::new();
    let base = DvsSpec {
        max_events: 20_000_000,
        ..Default::default()
    };
    let two_frame = DvsSpec {
        mode: DvsMode::TwoFrame,
        ..base.clone()
    };
    for (name, shots, step, spec) in [
        ("motion", &coarse, 50, &base),
        (
            "motion_4px",
            &coarse,
            50,
            &DvsSpec {
                substep_px: 4.0,
                ..base.clone()
            },
        ),
        ("two_frame", &coarse, 50, &two_frame),
        ("two_frame_1khz", &fine, 1, &two_frame),
    ] {
        let secs = write_events(
            &folder.join(format!("{name}.events")),
            shots,
            size_px,
            step,
            spec,
        )?;
        let secs = secs / ((N_FRAMES - 1) as f64 * STEP_NANOS as f64 * 1e-9);
        writeln!(cpu, "{name} {secs:.4}")?;
        spent.push((name, secs));
    }
    Ok(spent)
}

/// CPU seconds of making the events, one thread.
fn write_events(
    path: &std::path::Path,
    shots: &[Shot],
    size_px: [u32; 2],
    step: u64,
    spec: &DvsSpec,
) -> std::io::Result<f64> {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let mut camera = EventCamera::new(spec.clone(), size_px, 1, 2);
    let mut out = vec![0; spec.max_events as usize * 16];
    let (width, window_nanos) = (size_px[0] as usize, step * STEP_NANOS);
    let mut secs = 0.0;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread can be started");
    for (window, shot) in shots.iter().enumerate() {
        let begin = process_cpu_secs();
        let made = pool.install(|| camera.advance(&shot.images(width), window_nanos, &mut out));
        secs += if window > 0 {
            process_cpu_secs() - begin
        } else {
            0.0
        };
        for event in out.chunks_exact(16).take(made.n_events) {
            file.write_all(event)?;
            file.write_all(&(window.max(1) as u64 - 1).to_le_bytes())?;
        }
    }
    file.flush()?;
    Ok(secs)
}

/// Every `step`-th frame of the drive.
fn frames(size_px: [u32; 2], step: u64) -> Vec<Shot> {
    let moment = |frame: u64| {
        (
            frame as f64 * STEP_NANOS as f64 * 1e-9 * SPEED_MPS,
            (frame + step) * STEP_NANOS,
        )
    };
    drive(size_px, (0..N_FRAMES).step_by(step as usize).map(moment))
}
