//! Measures cameras in a town and prints a table:
//! `rendering_bench [ROW …] [--frames 60 …] [--json FILE]`.
//!
//! Rows: `six` `separate` `apart` `rgb` `depth` `trio` `wide` `many` `effects` `hide` `peer`
//! (default: all but `effects`, one rgb camera with each effect of its lens and film by turns,
//! `hide`, which times the upload when objects are hidden, and `peer`, which needs `--ply FILE`).
//! `separate`: one view of six modalities against six sensors of one modality each, each rendered
//! in a submission of its own, by turns in one run. `apart`: the same against six such views that
//! go through one submission together. `--help` says the other arguments. Times are per frame of all
//! cameras of a row, milliseconds: median, best, mean, and CPU time of the process.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use launch_cli::bench::anyhow::Context as _;
use launch_cli::bench::{self, BenchResult, anyhow, clap};
use nalgebra::Isometry3;
use schema_frames::{Modality, VehicleControl};
use schema_types::ObjectId;
use sensor_camera::{CameraRenderer, Quality, Rasteriser};
use sensor_core::{Scene, SceneAssets};
use sensor_gpu::{CopyPath, Gpu, GpuOptions};
use sensor_spec::{FilmCurve, Intrinsics, OpticsSpec};
use test_render::separate::{Sides, best, median};
use test_render::{Cameras, Figures, Stage, peer, weathers};

const SIX: [Modality; 6] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];
const TRIO: [Modality; 3] = [Modality::Rgb, Modality::Depth, Modality::Semantic];
const ROWS: [&str; 8] = [
    "six", "separate", "apart", "rgb", "depth", "trio", "wide", "many",
];
const OTHER_ROWS: [&str; 3] = ["effects", "hide", "peer"];
/// Turns of the cameras with and without effects.
const N_TURNS: usize = 4;

/// Measures cameras in a town
#[derive(Debug, clap::Args)]
struct Options {
    /// Rows of the table [default: all but effects, hide and peer]
    #[arg(value_name = "ROW", value_parser = clap::builder::PossibleValuesParser::new([&ROWS[..], &OTHER_ROWS].concat()))]
    rows: Vec<String>,
    #[arg(long, default_value = "Town10HD")]
    town: String,
    #[arg(long, default_value_t = 20)]
    vehicles: usize,
    #[arg(long, default_value_t = 60, value_parser = at_least_one)]
    frames: usize,
    /// Width and height of images, pixels [default: 800x600, of the row many 256x256]
    #[arg(long = "size", value_parser = size)]
    size_px: Option<Size>,
    /// Quality of the pictures, low or high [default: that of the adapter]
    #[arg(long, value_parser = quality)]
    quality: Option<Quality>,
    /// Rasteriser, drawn or computed [default: that of the adapter]
    #[arg(long, value_parser = rasteriser)]
    rasteriser: Option<Rasteriser>,
    /// Also print a hash of the last frames' bytes
    #[arg(long)]
    hash: bool,
    /// Frames in flight [default: 2, or 1 in software]
    #[arg(long = "inflight", value_parser = at_least_one)]
    in_flight: Option<usize>,
    /// Cameras of the row many
    #[arg(long, default_value_t = 64, value_parser = at_least_one)]
    cameras: usize,
    /// Place of the cameras
    #[arg(long, default_value_t = 0)]
    place: usize,
    #[arg(long, default_value = "day", value_parser = clap::builder::PossibleValuesParser::new(weathers::NAMES))]
    weather: String,
    /// Mesh of the row peer
    #[arg(long, value_name = "FILE")]
    ply: Option<String>,
    /// Also say what the passes take
    #[arg(long)]
    times: bool,
    /// Vehicles drive from frame to frame
    #[arg(long)]
    driving: bool,
    /// 1: frames are copied behind their drawing; 2: beside the next, where the adapter can
    #[arg(long = "queues", value_name = "1|2", default_value = "2", value_parser = copies)]
    copies: CopyPath,
}

/// Width and height of an image, pixels.
type Size = [u32; 2];

impl Options {
    /// Size of the images of most rows.
    fn size_px(&self) -> Size {
        self.size_px.unwrap_or([800, 600])
    }
}

fn at_least_one(text: &str) -> Result<usize, String> {
    let number = text.parse::<usize>().ok().filter(|n| *n > 0);
    number.ok_or_else(|| "give a whole number, at least 1".to_owned())
}

fn size(text: &str) -> Result<Size, String> {
    let read = || {
        let (width, height) = text.split_once('x')?;
        Some([width.parse().ok()?, height.parse().ok()?])
    };
    read().ok_or_else(|| "a size is like 800x600".to_owned())
}

fn quality(text: &str) -> Result<Quality, String> {
    match text {
        "low" => Ok(Quality::Low),
        "high" => Ok(Quality::High),
        _ => Err("a quality is low or high".to_owned()),
    }
}

fn rasteriser(text: &str) -> Result<Rasteriser, String> {
    match text {
        "drawn" => Ok(Rasteriser::Drawn),
        "computed" => Ok(Rasteriser::Computed),
        _ => Err("a rasteriser is drawn or computed".to_owned()),
    }
}

fn copies(text: &str) -> Result<CopyPath, String> {
    match text {
        "1" => Ok(CopyPath::Behind),
        "2" => Ok(CopyPath::Beside),
        _ => Err("give 1 or 2".to_owned()),
    }
}

struct Bench<'a> {
    gpu: Gpu,
    options: &'a Options,
    quality: Quality,
    in_flight: usize,
    /// One scene per frame, or a single scene for all.
    scenes: Vec<Arc<Scene>>,
    stage: Stage,
    result: RefCell<&'a mut BenchResult>,
}

impl Bench<'_> {
    fn lens(&self, size_px: [u32; 2]) -> Intrinsics {
        Intrinsics::from_fov(size_px[0], size_px[1], 90f64.to_radians())
    }

    fn town(
        &self,
        name: &str,
        size_px: [u32; 2],
        asked: &[&[Modality]],
        pose: impl Fn(usize, f64) -> Isometry3<f64>,
    ) -> Figures {
        let mut cameras = Cameras::new(
            &self.gpu,
            self.quality,
            self.lens(size_px),
            asked,
            self.in_flight,
        );
        if let Some(rasteriser) = self.options.rasteriser {
            cameras.rasterise(self.quality, rasteriser);
        }
        self.gpu.set_timing(self.options.times);
        let figures = cameras.run(self.options.frames, |frame| {
            let along_m = 0.4 * frame as f64;
            (
                self.scenes[frame % self.scenes.len()].clone(),
                (0..asked.len()).map(|i| pose(i, along_m)).collect(),
            )
        });
        self.print(name, &figures, asked.len());
        if self.options.hash {
            println!("    hash of the last frames: {:016x}", cameras.hash());
        }
        if self.options.times {
            let n_frames = self.options.frames as f64;
            let spans = self.gpu.take_spans();
            let texts = spans.iter().map(|span| {
                format!(
                    "{} {} {:.3}",
                    span.place,
                    span.label,
                    span.millis / n_frames
                )
            });
            println!("    ms a frame: {}", texts.collect::<Vec<_>>().join(", "));
            let labels: Vec<(String, f64)> = spans
                .iter()
                .map(|span| {
                    (
                        format!("{} {}, ms", span.place, span.label),
                        span.millis / n_frames,
                    )
                })
                .collect();
            let figures: Vec<(&str, f64)> = labels
                .iter()
                .map(|(label, millis)| (label.as_str(), *millis))
                .collect();
            self.note(&format!("passes of {name}"), &figures);
        }
        figures
    }

    fn one_pose(&self, name: &str, asked: &[&[Modality]]) -> Figures {
        self.town(name, self.options.size_px(), asked, |view, along_m| {
            // Cameras stand a micrometre apart, because cameras with equal poses would share one
            // view.
            self.stage
                .camera(self.options.place, along_m + 1e-6 * view as f64, 0.0, 0.0)
        })
    }

    /// Six modalities of one pose against six sensors that are rendered one after the other.
    fn separate(&self) {
        let mut sides = Sides::new(
            &self.gpu,
            self.quality,
            self.lens(self.options.size_px()),
            &SIX,
            self.in_flight,
        );
        let comparison = sides.run(self.options.frames, |frame| {
            let pose = self
                .stage
                .camera(self.options.place, 0.4 * frame as f64, 0.0, 0.0);
            (self.scenes[frame % self.scenes.len()].clone(), pose)
        });
        let middle = |list: &[f64]| median(list.iter().copied());
        for (name, turns) in [
            ("merged: one view, six modalities", &comparison.merged),
            ("six sensors, one after the other", &comparison.separate),
        ] {
            let (wall_ms, cpu_ms) = (&turns.wall_ms, &turns.cpu_ms);
            println!(
                "{name:38} p50 {:8.3}  best {:8.3} ms a set  {:8.1} sets/s  CPU {:7.2} best {:7.2} ms",
                middle(wall_ms),
                best(wall_ms),
                1e3 / middle(wall_ms),
                middle(cpu_ms),
                best(cpu_ms)
            );
            self.note(
                name,
                &[
                    ("p50_ms", middle(wall_ms)),
                    ("best_ms", best(wall_ms)),
                    ("sets_per_sec", 1e3 / middle(wall_ms)),
                    ("cpu_ms", middle(cpu_ms)),
                    ("cpu_best_ms", best(cpu_ms)),
                ],
            );
        }
        let each = SIX.iter().zip(&comparison.each_ms);
        let each: Vec<_> = each
            .map(|(modality, list)| {
                format!(
                    "{} {:.1} ({:.1})",
                    modality.name(),
                    middle(list),
                    best(list)
                )
            })
            .collect();
        if !each.is_empty() {
            println!("    wall ms, median (best): {}", each.join(", "));
        }
        let ([wall, cpu], [best_wall, best_cpu]) = (comparison.ratios(), comparison.best_ratios());
        println!(
            "  six separate sensors against one view: {wall:.2} x wall, {cpu:.2} x CPU (medians of turns); best sets {best_wall:.2} x wall, {best_cpu:.2} x CPU"
        );
        self.note(
            "six separate sensors against one view",
            &[
                ("wall", wall),
                ("cpu", cpu),
                ("best_wall", best_wall),
                ("best_cpu", best_cpu),
            ],
        );
    }

    fn row(&self, row: &str) {
        match row {
            "separate" => self.separate(),
            "six" => drop(self.one_pose("one view, six modalities", &[&SIX])),
            "apart" => {
                let together = self.one_pose("one view, six modalities", &[&SIX]);
                let apart = self.one_pose(
                    "six views, one modality each",
                    &SIX.each_ref().map(std::slice::from_ref),
                );
                let (wall, cpu) = (
                    apart.mean_ms / together.mean_ms,
                    apart.cpu_ms / together.cpu_ms,
                );
                println!("  six views against one: {wall:.2} x wall, {cpu:.2} x CPU");
                self.note("six views against one", &[("wall", wall), ("cpu", cpu)]);
            }
            "rgb" => drop(self.one_pose("rgb", &[&[Modality::Rgb]])),
            "depth" => drop(self.one_pose("depth", &[&[Modality::Depth]])),
            "trio" => drop(self.one_pose("rgb, depth, semantic", &[&TRIO])),
            "wide" => {
                let of = |n: usize| vec![&[Modality::Rgb][..]; n];
                let pose = |i: usize, along_m: f64| self.stage.camera(7 * i, along_m, 0.0, 0.0);
                let one = self.town("1 rgb camera 1920x1080", [1920, 1080], &of(1), pose);
                let all = self.town(
                    "16 rgb cameras 1920x1080, 16 places",
                    [1920, 1080],
                    &of(16),
                    pose,
                );
                let each_ms = (all.mean_ms - one.mean_ms) / 15.0;
                println!("  each further camera: {each_ms:.3} ms");
                self.note("each further camera", &[("ms", each_ms)]);
            }
            "many" => {
                let pose = |i: usize, along_m: f64| self.stage.camera(3 * i, along_m, 0.0, 0.0);
                let [width, height] = self.options.size_px.unwrap_or([256, 256]);
                let n = self.options.cameras;
                let all = self.town(
                    &format!("{n} rgb cameras {width}x{height}, {n} places"),
                    [width, height],
                    &vec![&[Modality::Rgb][..]; n],
                    pose,
                );
                let per_sec = n as f64 * 1e3 / all.mean_ms;
                println!("  images per second: {per_sec:.0}");
                self.note("images per second", &[("per_sec", per_sec)]);
            }
            "effects" => self.effects(),
            "hide" => self.hide(),
            _ => self.peer(),
        }
    }

    /// One rgb camera by turns with every effect off and with one of them on.
    fn effects(&self) {
        let with = |change: fn(&mut OpticsSpec)| {
            let mut optics = OpticsSpec::default();
            change(&mut optics);
            optics
        };
        let kinds = [
            ("rgb, no effects", with(|_| ())),
            ("rgb, film", with(|it| it.film.curve = FilmCurve::Shaped)),
            ("rgb, flare", with(|it| it.flare_intensity = 1.0)),
            ("rgb, bent lens", with(|it| it.distortion_k = 30.0)),
            (
                "rgb, motion blur",
                with(|it| it.motion_blur.shutter_secs = 0.02),
            ),
            ("rgb, focus at 8 m", with(|it| it.focus.distance_m = 8.0)),
        ];
        let mut cameras = kinds.each_ref().map(|(_, optics)| {
            Cameras::with_optics(
                &self.gpu,
                self.quality,
                self.lens(self.options.size_px()),
                optics.clone(),
                &[&[Modality::Rgb]],
                self.in_flight,
            )
        });
        let mut figures = kinds.each_ref().map(|_| Vec::new());
        for turn in 0..N_TURNS {
            for (cameras, figures) in cameras.iter_mut().zip(&mut figures) {
                figures.push(cameras.run(self.options.frames, |frame| {
                    let along_m = 0.4 * (turn * self.options.frames + frame) as f64 % 40.0;
                    let scene = self.scenes[frame % self.scenes.len()].clone();
                    let pose = self.stage.camera(self.options.place, along_m, 0.0, 0.0);
                    (scene, vec![pose])
                }));
            }
        }
        for ((name, _), figures) in kinds.iter().zip(&figures) {
            let least = |of: fn(&Figures) -> f64| figures.iter().map(of).fold(f64::MAX, f64::min);
            let turn = Figures {
                p50_ms: median(figures.iter().map(|turn| turn.p50_ms)),
                best_ms: least(|turn| turn.best_ms),
                mean_ms: least(|turn| turn.mean_ms),
                cpu_ms: least(|turn| turn.cpu_ms),
                cpu_best_ms: least(|turn| turn.cpu_best_ms),
                ..figures[0]
            };
            self.print(name, &turn, 1);
        }
    }

    /// Times the upload after objects are hidden, against the upload of a new map.
    fn hide(&self) {
        let whole = &self.scenes[0].assets;
        let ids = whole
            .meshes
            .iter()
            .flat_map(|mesh| &mesh.vertices)
            .map(|vertex| vertex.object_id);
        let objects: BTreeSet<ObjectId> = ids.filter(|id| *id != 0).map(ObjectId).collect();
        let mut renderer = CameraRenderer::new(&self.gpu, self.quality);
        for (name, step) in [("one object", objects.len()), ("every tenth object", 10)] {
            let hidden: BTreeSet<ObjectId> = objects.iter().step_by(step).copied().collect();
            let mut best = [(f64::INFINITY, 0); 2];
            for _ in 0..5 {
                let less = whole.without(&hidden);
                let anew = SceneAssets {
                    episode: whole.episode + 1,
                    ..less.clone()
                };
                for (best, assets) in best.iter_mut().zip([anew, less]) {
                    renderer.load(whole);
                    let begin = Instant::now();
                    let n_bytes = renderer.load(&Arc::new(assets));
                    *best = (best.0.min(begin.elapsed().as_secs_f64() * 1e3), n_bytes);
                }
            }
            let [(whole_ms, whole_bytes), (ms, n_bytes)] = best;
            println!(
                "hide {name:20} all uploaded {whole_ms:8.3} ms, {whole_bytes} bytes; what changed {ms:8.3} ms, {n_bytes} bytes"
            );
            self.note(
                name,
                &[
                    ("whole_ms", whole_ms),
                    ("whole_bytes", whole_bytes as f64),
                    ("ms", ms),
                    ("bytes", n_bytes as f64),
                ],
            );
        }
    }

    /// The camera of `render_mujoco.py`: 1.9 m above the street, six directions by turns, vertical
    /// field of view 60 degrees.
    fn peer(&self) {
        let Some(path) = &self.options.ply else {
            eprintln!("row peer needs ply=FILE, made by gen_street.py");
            std::process::exit(2);
        };
        let scene = peer::scene(std::path::Path::new(path)).unwrap_or_else(|error| {
            eprintln!("{error:#}");
            std::process::exit(2);
        });
        let focal_px = 300.0 / 30f64.to_radians().tan();
        let lens = Intrinsics {
            width_px: 800,
            height_px: 600,
            focal_px,
        };
        for asked in [
            &[Modality::Rgb][..],
            &[Modality::Depth],
            &[Modality::Semantic],
            &TRIO,
        ] {
            let mut cameras = Cameras::new(&self.gpu, self.quality, lens, &[asked], self.in_flight);
            let figures = cameras.run(self.options.frames, |frame| {
                let turn = nalgebra::UnitQuaternion::from_euler_angles(
                    0.0,
                    0.0,
                    frame as f64 * std::f64::consts::FRAC_PI_3,
                );
                (
                    scene.clone(),
                    vec![Isometry3::from_parts(
                        nalgebra::Translation3::new(0.0, -1.7, 1.9),
                        turn,
                    )],
                )
            });
            let names: Vec<_> = asked.iter().map(|modality| modality.name()).collect();
            self.print(&format!("peer's street: {}", names.join(", ")), &figures, 1);
        }
    }

    /// Adds a row to the result that `--json` writes.
    fn note(&self, name: &str, figures: &[(&str, f64)]) {
        self.result.borrow_mut().row(name, figures);
    }

    fn print(&self, name: &str, figures: &Figures, n_views: usize) {
        let Figures {
            p50_ms,
            best_ms,
            mean_ms,
            cpu_ms,
            cpu_best_ms,
            n_triangles,
            n_draws,
            n_passes,
        } = figures;
        println!(
            "{name:38} p50 {p50_ms:8.3}  best {best_ms:8.3}  mean {mean_ms:8.3} ms  {:8.1} sets/s  CPU {cpu_ms:7.2} best {cpu_best_ms:7.2} ms  {} views {n_triangles} triangles {n_draws} draws {n_passes} passes",
            1e3 / mean_ms,
            n_views
        );
        self.note(
            name,
            &[
                ("p50_ms", *p50_ms),
                ("best_ms", *best_ms),
                ("mean_ms", *mean_ms),
                ("sets_per_sec", 1e3 / mean_ms),
                ("cpu_ms", *cpu_ms),
                ("cpu_best_ms", *cpu_best_ms),
                ("n_views", n_views as f64),
                ("n_triangles", *n_triangles as f64),
                ("n_draws", *n_draws as f64),
                ("n_passes", *n_passes as f64),
            ],
        );
    }
}

fn main() -> ExitCode {
    bench::run("rendering_bench", measure)
}

fn measure(options: &Options, result: &mut BenchResult) -> anyhow::Result<()> {
    let gpu = Gpu::open(&GpuOptions {
        copies: options.copies,
        ..Default::default()
    })?;
    result.set_gpu(gpu.name());
    let quality = options
        .quality
        .unwrap_or_else(|| Quality::default_for(&gpu));
    let in_flight = options
        .in_flight
        .unwrap_or(if gpu.is_software() { 1 } else { 2 });
    let mut stage = Stage::new(&options.town, 7, options.vehicles)?;
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    println!(
        "{}; quality {quality:?}; {} with {} vehicles{}, {}; {} frames, {in_flight} in flight, copied {}; load {}",
        gpu.name(),
        stage.name,
        options.vehicles,
        if options.driving { " that drive" } else { "" },
        options.weather,
        options.frames,
        if gpu.copies_beside() {
            "beside"
        } else {
            "behind"
        },
        load.trim()
    );
    let weather = weathers::named(&options.weather)
        .with_context(|| format!("there is no weather {:?}", options.weather))?;
    let mut scenes = vec![Arc::new(stage.scene(weather))];
    if options.driving {
        stage.drive(VehicleControl {
            throttle_ratio: 0.4,
            ..Default::default()
        });
        for _ in 0..options.frames + test_render::measure::WARM_UP {
            stage.step();
            scenes.push(Arc::new(stage.scene(weather)));
        }
    }
    let bench = Bench {
        result: RefCell::new(result),
        gpu,
        quality,
        in_flight,
        scenes,
        stage,
        options,
    };
    let usual = ROWS.map(String::from);
    let rows = match options.rows.is_empty() {
        true => &usual[..],
        false => &options.rows,
    };
    rows.iter().for_each(|row| bench.row(row));
    Ok(())
}
