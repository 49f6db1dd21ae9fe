//! Measures views that are drawn in tiles on the processor against the renderer on the adapter, by
//! turns, in a town, and compares their pictures:
//! `tiles_bench [ROW …] [--place 0 …] [--json FILE] [--png FOLDER]`.
//!
//! Rows: `rgb`, `ids` (rgb, depth, classes, ids), `six`, `depth` (default: all). Prints the process's CPU
//! time per frame, median and least of all turns. Both leave out what is not seen; the camera moves
//! 0.4 m a frame.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use launch_cli::bench::anyhow::Context as _;
use launch_cli::bench::{self, BenchResult, Samples, anyhow, clap, process_cpu_secs};
use nalgebra::Isometry3;
use schema_frames::{Modality, VehicleControl};
use sensor_camera::{Quality, Rasteriser, TileCamera, TileImages, TileRenderer};
use sensor_core::Scene;
use sensor_gpu::{Gpu, GpuOptions};
use sensor_spec::Intrinsics;
use test_render::measure::WARM_UP;
use test_render::tiles::{Both, ColorDifference};
use test_render::{Cameras, Stage, weathers};

const SIX: [Modality; 6] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];
const ROWS: [(&str, &[Modality]); 4] = [
    ("rgb", &[Modality::Rgb]),
    (
        "ids",
        &[
            Modality::Rgb,
            Modality::Depth,
            Modality::Semantic,
            Modality::Instance,
        ],
    ),
    ("six", &SIX),
    ("depth", &[Modality::Depth]),
];
const NAMES: [&str; 4] = ["rgb", "ids", "six", "depth"];

/// Measures tiles on the processor against the adapter
#[derive(Debug, clap::Args)]
struct Args {
    /// Rows of the table [default: all]
    #[arg(value_name = "ROW", value_parser = clap::builder::PossibleValuesParser::new(NAMES))]
    rows: Vec<String>,
    #[arg(long, default_value = "Town10HD")]
    town: String,
    #[arg(long, default_value_t = 20)]
    vehicles: usize,
    #[arg(long, default_value_t = 40)]
    walkers: usize,
    #[arg(long, default_value_t = 800)]
    width: u32,
    #[arg(long, default_value_t = 600)]
    height: u32,
    #[arg(long, default_value_t = 20)]
    frames: usize,
    #[arg(long, default_value_t = 7)]
    turns: usize,
    /// Place of the camera
    #[arg(long, default_value_t = 0)]
    place: usize,
    #[arg(long, default_value = "day", value_parser = clap::builder::PossibleValuesParser::new(weathers::NAMES))]
    weather: String,
    /// Vehicles drive from frame to frame
    #[arg(long)]
    driving: bool,
    /// Also write the first picture of both into this folder
    #[arg(long, value_name = "FOLDER")]
    png: Option<PathBuf>,
}

fn main() -> ExitCode {
    bench::run("tiles_bench", measure)
}

/// Scenes and poses of a drive along a lane.
fn drive(args: &Args) -> anyhow::Result<Vec<(Arc<Scene>, Isometry3<f64>)>> {
    let mut stage = Stage::new(&args.town, 7, args.vehicles)?;
    stage.add_walkers(args.walkers);
    if args.driving {
        stage.drive(VehicleControl {
            throttle_ratio: 0.5,
            ..VehicleControl::default()
        });
    }
    let weather = weathers::named(&args.weather).context("no such weather")?;
    let mut scene = Arc::new(stage.scene(weather));
    let frame = |i: usize| {
        if args.driving {
            stage.step();
            scene = Arc::new(stage.scene(weather));
        }
        let pose = stage.camera(args.place, 0.4 * i as f64, 0.0, 2.0);
        (scene.clone(), pose)
    };
    Ok((0..args.frames + WARM_UP).map(frame).collect())
}

fn measure(args: &Args, result: &mut BenchResult) -> anyhow::Result<()> {
    let gpu = Gpu::open(&GpuOptions::default())?;
    result.set_gpu(gpu.name());
    let frames = drive(args)?;
    let lens = Intrinsics::from_fov(args.width, args.height, 90f64.to_radians());
    compare(args, &gpu, lens, &frames[WARM_UP])?;
    let wanted = |name: &str| args.rows.is_empty() || args.rows.iter().any(|row| row == name);
    for (row, modalities) in ROWS.iter().filter(|(row, _)| wanted(row)) {
        let mut cameras = Cameras::new(&gpu, Quality::Low, lens, &[modalities], 1);
        let (mut tiles, mut camera) = (TileRenderer::default(), TileCamera::new(lens));
        let mut millis: [Vec<f64>; 2] = Default::default();
        // The first turn compiles pipelines and does not count.
        for turn in 0..=args.turns {
            let figures = cameras.run(args.frames, |i| (frames[i].0.clone(), vec![frames[i].1]));
            let mut begin = 0.0;
            let mut images = TileImages::default();
            for (i, (scene, pose)) in frames.iter().enumerate() {
                if i == WARM_UP {
                    begin = process_cpu_secs();
                }
                tiles.render(scene, &mut camera, pose, modalities, &mut images);
            }
            let tile_ms = (process_cpu_secs() - begin) * 1e3 / args.frames as f64;
            if turn > 0 {
                millis[0].push(tile_ms);
                millis[1].push(figures.cpu_ms);
            }
        }
        let [tiles, adapter] = millis.map(|all| all.into_iter().collect::<Samples>());
        for (name, all) in [("tiles", &tiles), (gpu.name(), &adapter)] {
            println!(
                "{row}, {name}: CPU {:.1} ms, at least {:.1}",
                all.median(),
                all.best()
            );
        }
        result.row(
            row,
            &[
                ("tiles_cpu_ms", tiles.median()),
                ("tiles_least_cpu_ms", tiles.best()),
                ("adapter_cpu_ms", adapter.median()),
                ("adapter_least_cpu_ms", adapter.best()),
            ],
        );
    }
    Ok(())
}

/// Compares, and writes, the pictures of a frame.
fn compare(
    args: &Args,
    gpu: &Gpu,
    lens: Intrinsics,
    (scene, pose): &(Arc<Scene>, Isometry3<f64>),
) -> anyhow::Result<()> {
    let (bytes, images) =
        Both::new(gpu, Rasteriser::default_for(gpu), lens).draw(scene, *pose, &SIX);
    let color = &bytes[&Modality::Rgb];
    let apart = ColorDifference::of(color, &images.color);
    println!(
        "colour: {:.3} of 255 in the mean, above 8 in {:.3} % of pixels",
        apart.mean,
        100.0 * apart.far_ratio
    );
    if let Some(folder) = &args.png {
        write(&folder.join("adapter.png"), color, lens)?;
        write(
            &folder.join("tiles.png"),
            bytemuck::cast_slice(&images.color),
            lens,
        )?;
    }
    Ok(())
}

/// Writes bytes B, G, R, A as a picture.
fn write(path: &Path, bytes: &[u8], lens: Intrinsics) -> anyhow::Result<()> {
    let pixels = bytes.as_chunks::<4>().0.iter();
    let rgb: Vec<u8> = pixels.flat_map(|[b, g, r, _]| [*r, *g, *b]).collect();
    image::RgbImage::from_raw(lens.width_px, lens.height_px, rgb)
        .context("the image has another size")?
        .save(path)
        .with_context(|| format!("cannot write {}", path.display()))
}
