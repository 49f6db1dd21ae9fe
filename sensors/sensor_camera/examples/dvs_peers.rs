//! The same rendered frames for other event cameras and for ours: `benches/dvs_peers.py` feeds them to v2e and to ESIM's formula and compares.
//!
//! `cargo run --release -p sensor_camera --example dvs_peers -- FOLDER [WIDTH HEIGHT]` renders 101 frames of a drive along the test street,
//! 1 ms apart at 8 m/s, and writes into FOLDER: `luminance.f32` (frames × rows × columns, 0..1), `NAME.events` (records of 16 bytes as on the
//! bus, behind each its window's number as u64) for `motion` and `two_frame` every 50 ms and `two_frame_1khz`, and `cpu.txt` with each one's
//! CPU seconds per simulated second.

#[path = "../tests/kit/mod.rs"]
mod kit;

use std::io::Write as _;

use schema_frames::Modality;
use sensor_camera::dvs::{EventCamera, EventImages, Rows};
use sensor_camera::{CameraRenderer, Quality};
use sensor_spec::{DvsMode, DvsSpec};

const N_FRAMES: usize = 101;
const STEP_NANOS: u64 = 1_000_000;
const SPEED_MPS: f64 = 8.0;

/// Images of one moment in memory; flow is the motion since `since` frames before.
struct Shot {
    luminance: Vec<u8>,
    flow: Vec<u8>,
    depth: Vec<u8>,
    instance: Vec<u8>,
    class: Vec<u8>,
}

impl Shot {
    fn images(&self, width: usize) -> EventImages<'_> {
        EventImages {
            luminance: Rows::tight(&self.luminance, 4 * width),
            flow: Rows::tight(&self.flow, 8 * width),
            depth: Rows::tight(&self.depth, 4 * width),
            instance: Rows::tight(&self.instance, 4 * width),
            class: Rows::tight(&self.class, width),
        }
    }
}

fn main() -> std::io::Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let (folder, size_px) = match &words[..] {
        [folder] => (folder, [800, 600]),
        [folder, width, height] => (folder, [width, height].map(|text| text.parse().expect("width and height are whole numbers"))),
        _ => panic!("give a folder, and perhaps width and height"),
    };
    let folder = std::path::Path::new(folder);
    std::fs::create_dir_all(folder)?;
    let fine = drive(size_px, 1);
    let coarse = drive(size_px, 50);
    let mut file = std::io::BufWriter::new(std::fs::File::create(folder.join("luminance.f32"))?);
    fine.iter().try_for_each(|shot| file.write_all(&shot.luminance))?;
    file.flush()?;
    let mut cpu = std::fs::File::create(folder.join("cpu.txt"))?;
    let base = DvsSpec { max_events: 20_000_000, ..Default::default() };
    let two_frame = DvsSpec { mode: DvsMode::TwoFrame, ..base.clone() };
    for (name, shots, step, spec) in [
        ("motion", &coarse, 50, &base),
        ("motion_4px", &coarse, 50, &DvsSpec { substep_px: 4.0, ..base.clone() }),
        ("two_frame", &coarse, 50, &two_frame),
        ("two_frame_1khz", &fine, 1, &two_frame),
    ] {
        let secs = write_events(&folder.join(format!("{name}.events")), shots, size_px, step, spec)?;
        writeln!(cpu, "{name} {:.4}", secs / ((N_FRAMES - 1) as f64 * STEP_NANOS as f64 * 1e-9))?;
    }
    Ok(())
}

/// CPU seconds of making the events, one thread.
fn write_events(path: &std::path::Path, shots: &[Shot], size_px: [u32; 2], step: u64, spec: &DvsSpec) -> std::io::Result<f64> {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let mut camera = EventCamera::new(spec.clone(), size_px, 1, 2);
    let mut out = vec![0; spec.max_events as usize * 16];
    let (width, window_nanos) = (size_px[0] as usize, step * STEP_NANOS);
    let mut secs = 0.0;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread can be started");
    for (window, shot) in shots.iter().enumerate() {
        let begin = cpu_secs();
        let made = pool.install(|| camera.advance(&shot.images(width), window_nanos, &mut out));
        secs += if window > 0 { cpu_secs() - begin } else { 0.0 };
        for event in out.chunks_exact(16).take(made.n_events) {
            file.write_all(event)?;
            file.write_all(&(window.max(1) as u64 - 1).to_le_bytes())?;
        }
    }
    file.flush()?;
    Ok(secs)
}

fn cpu_secs() -> f64 {
    let usage = nix::sys::resource::getrusage(nix::sys::resource::UsageWho::RUSAGE_SELF).expect("a process may ask for its own usage");
    let secs = |t: nix::sys::time::TimeVal| t.tv_sec() as f64 + t.tv_usec() as f64 * 1e-6;
    secs(usage.user_time()) + secs(usage.system_time())
}

/// Every `step`-th frame of the drive; luminance from the picture's green.
fn drive(size_px: [u32; 2], step: usize) -> Vec<Shot> {
    let gpu = kit::gpu();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let (assets, car) = kit::street();
    let mut view = kit::view(&gpu, size_px[0], size_px[1]);
    let asked = [Modality::Rgb, Modality::Flow, Modality::Depth, Modality::Instance, Modality::Semantic];
    let mut shot = |frame: usize| {
        let secs = frame as f64 * STEP_NANOS as f64 * 1e-9;
        let x_m = secs * SPEED_MPS;
        let cars = (0..8).map(|i| kit::moving(20 + i, car, kit::pose(x_m * 1.1 + 9.0 * i as f64, -2.0, 0.0, [0.0; 3]))).collect();
        let scene = kit::scene(&assets, cars, (frame / step + 1) as u64 * step as u64 * STEP_NANOS);
        let mut frames = kit::render(&mut renderer, &scene, &mut view, kit::pose(x_m - 60.0, -2.0, 1.6, [0.0, 0.035, 0.0]), &asked);
        let mut take = |modality| frames.remove(&modality).expect("asked for").0;
        let rgb = take(Modality::Rgb);
        let linear = |value: u8| ((value as f32 / 255.0 + 0.055) / 1.055).powf(2.4);
        Shot {
            luminance: rgb.chunks_exact(4).flat_map(|pixel| linear(pixel[1]).to_le_bytes()).collect(),
            flow: take(Modality::Flow),
            depth: take(Modality::Depth),
            instance: take(Modality::Instance),
            class: take(Modality::Semantic),
        }
    };
    (0..N_FRAMES).step_by(step).map(&mut shot).collect()
}
