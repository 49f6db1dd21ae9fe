//! Pictures of towns: `rendering_gallery sheets OUT_DIR` writes the contact sheets of
//! docs/gallery/sensors; `rendering_gallery look OUT_DIR TOWN PLACE low|high WEATHER …` writes
//! single pictures to look at; `rendering_gallery front OUT_DIR` the picture of the README;
//! `rendering_gallery lenses OUT_DIR` what calibrated lenses see.

use std::path::Path;

use anyhow::{Context as _, bail};
use schema_frames::Modality;
use schema_types::lens::{Lens, LensModel, Plane};
use sensor_camera::{CameraRenderer, Output, Place, Quality, View, ViewJob, ViewSpec};
use sensor_gpu::{Gpu, GpuOptions};
use sensor_spec::Intrinsics;
use test_render::sheet::Picture;
use test_render::{Stage, weathers};

const ALL: [Modality; 7] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
    Modality::Dvs,
];

/// Position lamps, low beam.
const LIGHTS_ON: u32 = 0b11;

struct Studio {
    gpu: Gpu,
    renderer: CameraRenderer,
    stage: Stage,
}

impl Studio {
    fn new(gpu: &Gpu, town: &str, quality: Quality) -> anyhow::Result<Studio> {
        Ok(Studio {
            gpu: gpu.clone(),
            renderer: CameraRenderer::new(gpu, quality),
            stage: Stage::new(town, 7, 60)?,
        })
    }

    /// Fires a moving camera three times and returns the pictures of the last firing.
    fn shoot(
        &mut self,
        place: usize,
        weather: &str,
        size_px: [u32; 2],
        modalities: &[Modality],
    ) -> anyhow::Result<Vec<Picture>> {
        let lens = Intrinsics::from_fov(size_px[0], size_px[1], 80f64.to_radians());
        self.shoot_as(ViewSpec::pinhole(lens), place, weather, modalities)
    }

    /// The same by any camera.
    fn shoot_as(
        &mut self,
        spec: ViewSpec,
        place: usize,
        weather: &str,
        modalities: &[Modality],
    ) -> anyhow::Result<Vec<Picture>> {
        let size_px = [spec.intrinsics.width_px, spec.intrinsics.height_px];
        let weather = weathers::named(weather).with_context(|| {
            format!(
                "weather {weather:?} is none of {}",
                weathers::NAMES.join(", ")
            )
        })?;
        let is_dark = weather.sun_altitude_deg < 5.0
            || weather.precipitation > 30.0
            || weather.fog_density > 30.0;
        self.stage.set_lamps(if is_dark { LIGHTS_ON } else { 0 });
        let mut view = View::new(&self.gpu, spec);
        let mut bytes: Vec<Vec<u8>> = modalities
            .iter()
            .map(|modality| vec![0; view.payload_bytes(*modality)])
            .collect();
        let mut lengths = Vec::new();
        for step in 0..3 {
            self.stage.step();
            let world_from_sensor = self.stage.camera(place, 0.4 * step as f64, 0.0, 1.0);
            let outputs = modalities
                .iter()
                .zip(&mut bytes)
                .map(|(m, bytes)| Output {
                    modality: *m,
                    place: Place::Memory(bytes),
                })
                .collect();
            let job = ViewJob {
                view: &mut view,
                world_from_sensor,
                outputs,
            };
            let submission = self
                .renderer
                .render(&self.stage.scene(weather), vec![job])?;
            let results = submission.wait()?;
            lengths = results[0]
                .outputs
                .iter()
                .map(|output| output.n_bytes)
                .collect();
        }
        let size_px = size_px.map(|side| side as usize);
        let pictures = modalities.iter().zip(&bytes).zip(lengths);
        Ok(pictures
            .map(|((modality, bytes), n)| Picture::of(*modality, size_px, &bytes[..n]))
            .collect())
    }
}

fn look(gpu: &Gpu, folder: &Path, words: &[String]) -> anyhow::Result<()> {
    let [town, place, quality, weathers @ ..] = words else {
        bail!("look needs OUT_DIR TOWN PLACE low|high WEATHER …");
    };
    let place = place
        .parse()
        .with_context(|| format!("place is {place:?}, but must be a whole number"))?;
    let quality = if quality == "high" {
        Quality::High
    } else {
        Quality::Low
    };
    let mut studio = Studio::new(gpu, town, quality)?;
    for weather in weathers {
        let picture = studio
            .shoot(place, weather, [960, 600], &[Modality::Rgb])?
            .remove(0);
        picture.write(
            &folder.join(format!("{town}_{place}_{quality:?}_{weather}.png").to_lowercase()),
        )?;
    }
    Ok(())
}

const TOWNS: [(&str, usize, usize); 3] = [
    ("Town10HD", 57, 101),
    ("Town03", 12, 80),
    ("Town07", 20, 66),
];

fn sheets(gpu: &Gpu, folder: &Path) -> anyhow::Result<()> {
    for (town, first, second) in TOWNS {
        let mut studio = Studio::new(gpu, town, Quality::High)?;
        let mut light = Vec::new();
        for weather in ["day", "dusk", "night", "rain", "fog", "overcast"] {
            for place in [first, second] {
                light.push(
                    studio
                        .shoot(place, weather, [800, 500], &[Modality::Rgb])?
                        .remove(0)
                        .shrunk(2),
                );
            }
        }
        let name = town.to_lowercase();
        Picture::sheet(&light, 4).write_jpeg(&folder.join(format!("{name}_light.jpg")))?;
        let mut all = Vec::new();
        for weather in ["day", "dusk", "night", "rain", "fog"] {
            all.extend(
                studio
                    .shoot(first, weather, [480, 300], &ALL)?
                    .iter()
                    .map(|picture| picture.shrunk(2)),
            );
        }
        Picture::sheet(&all, ALL.len())
            .write_jpeg(&folder.join(format!("{name}_modalities.jpg")))?;
    }
    Ok(())
}

/// Six modalities of one view behind the traffic of Town10HD.
fn front(gpu: &Gpu, folder: &Path) -> anyhow::Result<()> {
    let mut studio = Studio::new(gpu, "Town10HD", Quality::High)?;
    let shown = [
        Modality::Rgb,
        Modality::Depth,
        Modality::Semantic,
        Modality::Instance,
        Modality::Flow,
        Modality::Dvs,
    ];
    let all: Vec<Picture> = studio
        .shoot(57, "day", [960, 720], &shown)?
        .iter()
        .map(|picture| picture.shrunk(2))
        .collect();
    Picture::sheet(&all, 3).write(&folder.join("front.png"))
}

/// Lenses of cameras that are sold: a fisheye of 190°, one whose circle lies in the image, a double
/// sphere, and a wide pinhole with OpenCV's distortion.
fn lenses() -> anyhow::Result<[Lens; 4]> {
    let make = |model, focal_px, max_deg: f64| {
        let plane = Plane {
            focal_px: [focal_px; 2],
            shear_px: [0.0; 2],
            centre_px: [402.0, 298.5],
        };
        Lens::new(model, plane, Some(max_deg.to_radians()))
    };
    let kannala_brandt = |coefficients| LensModel::KannalaBrandt { coefficients };
    let opencv = LensModel::OpenCv {
        coefficients: vec![-0.28, 0.1, 0.0006, -0.0004, -0.016],
    };
    let double_sphere = LensModel::DoubleSphere {
        xi: -0.2,
        alpha: 0.6,
    };
    Ok([
        make(kannala_brandt([0.04, -0.012, 0.003, -0.0005]), 235.0, 95.0)?,
        make(
            kannala_brandt([0.083, -0.011, 0.0086, -0.0009]),
            150.0,
            95.0,
        )?,
        make(double_sphere, 190.0, 100.0)?,
        make(opencv, 330.0, 62.0)?,
    ])
}

fn through_lenses(gpu: &Gpu, folder: &Path) -> anyhow::Result<()> {
    let mut studio = Studio::new(gpu, "Town10HD", Quality::High)?;
    let mut shown = Vec::new();
    for weather in ["day", "rain", "night"] {
        for lens in lenses()? {
            let spec = ViewSpec {
                lens: Some(lens),
                ..ViewSpec::pinhole(Intrinsics::from_fov(800, 600, 1.0))
            };
            let rgb = studio
                .shoot_as(spec, 57, weather, &[Modality::Rgb])?
                .remove(0);
            rgb.write(&folder.join(format!("lens_{weather}_{}.png", shown.len() % 4)))?;
            shown.push(rgb.shrunk(2));
        }
    }
    Picture::sheet(&shown, 4).write_jpeg(&folder.join("lenses.jpg"))
}

fn run() -> anyhow::Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [command, folder, rest @ ..] = words.as_slice() else {
        bail!("say sheets OUT_DIR, look OUT_DIR …, front OUT_DIR or lenses OUT_DIR");
    };
    let folder = Path::new(folder);
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let gpu = Gpu::open(&GpuOptions::default())?;
    match command.as_str() {
        "look" => look(&gpu, folder, rest),
        "sheets" => sheets(&gpu, folder),
        "front" => front(&gpu, folder),
        "lenses" => through_lenses(&gpu, folder),
        _ => bail!("{command:?} is none of sheets, look, front and lenses"),
    }
}

fn main() {
    if let Err(error) = run() {
        eprintln!("{error:#}");
        std::process::exit(2);
    }
}
