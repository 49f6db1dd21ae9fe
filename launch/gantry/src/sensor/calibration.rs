//! `gantry sensor import` and `export`: calibrations between other programs' files and launch files.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Context as _;
use launch_cli::{CommonArgs, Exit, wrong_usage};
use launch_spec::{FileText, Launch};
use nalgebra::Isometry3;
use schema_bus::names::WORLD_INFO;
use schema_calibration::{Camera, Format};
use schema_frames::{Calibration, CameraInfo, WorldInfo};
use schema_types::Pose;
use schema_types::files::{MAX_SETTINGS_BYTES, read_text};
use schema_types::lens::Lens;
use sensor_spec::{CameraSpec, LensSpec, SensorSpec};

use crate::cli::{SensorExportArgs, SensorImportArgs, SizePx};
use crate::look::topic::document;

/// Longest name of a sensor.
const MAX_NAME: usize = 32;

/// Runs `gantry sensor import`.
pub fn import(args: &SensorImportArgs) -> anyhow::Result<Exit> {
    let file = args.file.display().to_string();
    let text = read_text(&args.file, MAX_SETTINGS_BYTES)
        .map_err(|error| wrong_usage(format!("cannot read {file}: {error}")))?;
    let size_px = args.size.map(|SizePx(size)| size);
    let (format, cameras) = schema_calibration::read(&text, args.format, size_px)
        .map_err(|fault| wrong_usage(fault.of_file(&file)))?;
    let launch = launch_file(&file, format, &cameras);
    check(&file, &launch)?;
    print!("{launch}");
    Ok(Exit::Done)
}

/// The launch file of some cameras, to be included by another.
fn launch_file(file: &str, format: Format, cameras: &[Camera]) -> String {
    let name = Path::new(file).file_name().unwrap_or_default();
    let mut text = format!(
        "# From {}, a calibration of {}, by gantry sensor import.\nversion = 1\n",
        name.to_string_lossy(),
        format.name()
    );
    let mut names: Vec<String> = Vec::new();
    for camera in cameras {
        let mut name = sensor_name(&camera.name);
        while names.contains(&name) {
            name.truncate(MAX_NAME - 1);
            name.push('_');
        }
        let [width, height] = camera.size_px;
        let _ = write!(
            text,
            "\n[sensor.{name}]\nkind = \"camera\"\nwidth_px = {width}\nheight_px = {height}\nlens = {}\n",
            lens_table(&camera.lens, camera.max_angle_rad)
        );
        if let Some(pose) = &camera.carrier_from_sensor {
            let place = pose.translation.vector;
            let (roll, pitch, yaw) = pose.rotation.euler_angles();
            // Adding 0 makes −0 the usual one.
            let [roll, pitch, yaw] = [roll, pitch, yaw].map(|it| it.to_degrees() + 0.0);
            let _ = writeln!(
                text,
                "mount = {{ position_m = [{:?}, {:?}, {:?}], rpy_deg = [{roll:?}, {pitch:?}, {yaw:?}] }}",
                place.x, place.y, place.z
            );
        }
        names.push(name);
    }
    text
}

/// The keys of a lens that differ from what they are without being written.
fn lens_table(lens: &Lens, max_angle_rad: Option<f64>) -> toml::Value {
    let usual = LensSpec::default();
    let own = LensSpec {
        max_angle_deg: match max_angle_rad {
            Some(angle) => angle.to_degrees().min(usual.max_angle_deg),
            None => usual.max_angle_deg,
        },
        ..LensSpec::of(lens)
    };
    let table = |spec: &LensSpec| match toml::Value::try_from(spec) {
        Ok(toml::Value::Table(table)) => table,
        _ => toml::Table::new(),
    };
    let usual = table(&usual);
    let kept = table(&own).into_iter();
    toml::Value::Table(
        kept.filter(|(key, value)| usual.get(key) != Some(value))
            .collect(),
    )
}

/// A name as sensors have them: lower-case letters, digits and `_`, a letter first.
fn sensor_name(of: &str) -> String {
    let plain = |it: char| match it.to_ascii_lowercase() {
        it if it.is_ascii_lowercase() || it.is_ascii_digit() => it,
        _ => '_',
    };
    let name: String = of.chars().map(plain).collect();
    let mut name = match name.starts_with(|it: char| it.is_ascii_lowercase()) {
        true => name,
        false => format!("camera_{name}"),
    };
    name.truncate(MAX_NAME);
    name
}

/// Whether cameras can be simulated; the sentences are those of launch files.
fn check(file: &str, text: &str) -> anyhow::Result<()> {
    Launch::parse(text, &format!("the launch file of {file}"))
        .map(|_| ())
        .map_err(|errors| wrong_usage(errors.to_string()))
}

/// Runs `gantry sensor export`.
pub fn export(args: &SensorExportArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    let is_file = args.from.ends_with(".toml");
    let mut cameras = match is_file {
        true => of_launch_file(Path::new(&args.from))?,
        false => of_topic(&args.from, common)?,
    };
    if let Some(asked) = &args.sensor {
        let is_it = |name: &str| name == asked || name.rsplit('/').next() == Some(asked.as_str());
        let known = names(&cameras);
        cameras.retain(|(name, ..)| is_it(name));
        if cameras.is_empty() {
            return Err(wrong_usage(format!(
                "{} has no camera {asked:?}; it has {known}",
                args.from
            )));
        }
    }
    let cameras: Vec<Camera> = cameras
        .into_iter()
        .map(|(name, calibration, mount)| camera(&name, &calibration, mount, args.format))
        .collect::<anyhow::Result<_>>()?;
    let text = schema_calibration::write(args.format, &cameras)
        .map_err(|error| wrong_usage(error.to_string()))?;
    print!("{text}");
    Ok(Exit::Done)
}

/// Name, calibration and pose on the carrier.
type Found = (String, Calibration, Option<Isometry3<f64>>);

fn names(cameras: &[Found]) -> String {
    let names: Vec<&str> = cameras.iter().map(|(name, ..)| name.as_str()).collect();
    match names.is_empty() {
        true => "none".to_owned(),
        false => names.join(", "),
    }
}

fn of_launch_file(path: &Path) -> anyhow::Result<Vec<Found>> {
    let launch = Launch::load(&[path.to_owned()], &[], &mut FileText::read)
        .map_err(|errors| wrong_usage(errors.to_string()))?;
    let cameras: Vec<Found> = launch
        .sensors
        .iter()
        .filter_map(|(name, sensor)| {
            let SensorSpec::Camera(camera) = &sensor.spec else {
                return None;
            };
            let calibration = CameraSpec::calibration(camera)?;
            let pose = camera.mount.vehicle_from_sensor();
            Some((name.clone(), calibration, Some(pose)))
        })
        .collect();
    match cameras.is_empty() {
        true => Err(wrong_usage(format!("{} has no camera", path.display()))),
        false => Ok(cameras),
    }
}

fn of_topic(topic: &str, common: &CommonArgs) -> anyhow::Result<Vec<Found>> {
    let bus = schema_bus::Bus::open(&common.domain, "gantry")
        .context("the bus is not usable; `gantry doctor` says more")?;
    let topic = topic
        .strip_prefix(&format!("{}/", common.domain))
        .unwrap_or(topic);
    let info: WorldInfo = document(&bus, WORLD_INFO).ok_or_else(|| {
        wrong_usage(format!(
            "nothing publishes a world on domain {:?}; start a simulator or a replay, or name a launch file that ends in .toml",
            common.domain
        ))
    })?;
    let is_it = |camera: &&CameraInfo| {
        let rest = topic.strip_prefix(camera.name.as_str());
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    };
    let Some(found) = info.cameras.iter().find(is_it) else {
        let known: Vec<&str> = info.cameras.iter().map(|it| it.name.as_str()).collect();
        return Err(wrong_usage(format!(
            "{topic:?} is no topic of a camera on domain {:?}; its cameras are {}",
            common.domain,
            match known.is_empty() {
                true => "none".to_owned(),
                false => known.join(", "),
            }
        )));
    };
    let pose = found.mount.map(|it| Pose::from(it).isometry());
    Ok(vec![(found.name.clone(), found.calibration.clone(), pose)])
}

fn camera(
    name: &str,
    calibration: &Calibration,
    carrier_from_sensor: Option<Isometry3<f64>>,
    format: Format,
) -> anyhow::Result<Camera> {
    if calibration.distortion().is_some() {
        return Err(wrong_usage(format!(
            "{name} has optics.distortion_k or distortion_k_cubed, CARLA's bending, which {} cannot say; it can say {}",
            format.name(),
            format.models()
        )));
    }
    Ok(Camera {
        name: name.rsplit('/').next().unwrap_or(name).to_owned(),
        size_px: calibration.size_px(),
        lens: calibration.lens().clone(),
        max_angle_rad: Some(calibration.lens().max_angle_rad()),
        carrier_from_sensor,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHAIN: &str = "cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.0132, 0.0204, -0.0113, 0.0021]
  distortion_model: equidistant
  intrinsics: [285.0, 286.5, 421.5, 398.25]
  resolution: [848, 800]
Left-2:
  T_cn_cnm1: [[0, 0, -1, -0.11], [0, 1, 0, 0], [1, 0, 0, 0.02], [0, 0, 0, 1]]
  camera_model: ds
  distortion_model: none
  intrinsics: [-0.2, 0.59, 285.0, 286.5, 421.5, 398.25]
  resolution: [848, 800]
";

    /// A launch file of a text, and what launch files make of it.
    fn imported(text: &str) -> (String, Launch) {
        let (format, cameras) = schema_calibration::read(text, None, None).unwrap();
        let launch = launch_file("some/cams.yaml", format, &cameras);
        let parsed = Launch::parse(&launch, "l").unwrap_or_else(|e| panic!("{e}\n{launch}"));
        (launch, parsed)
    }

    #[test]
    fn an_imported_chain_is_a_launch_file_with_its_lenses_and_places() {
        let (text, launch) = imported(CHAIN);
        assert!(text.starts_with("# From cams.yaml, a calibration of kalibr, by"));
        let names: Vec<_> = launch.sensors.keys().map(String::as_str).collect();
        assert_eq!(names, ["cam0", "left_2"]);
        let (_, cameras) = schema_calibration::read(CHAIN, None, None).unwrap();
        for (name, camera) in names.iter().zip(&cameras) {
            let SensorSpec::Camera(spec) = &launch.sensors[*name].spec else {
                panic!("{name} is no camera")
            };
            let lens = spec.lens().unwrap();
            assert_eq!(
                (lens.model(), lens.plane()),
                (camera.lens.model(), camera.lens.plane())
            );
            assert_eq!([spec.width_px, spec.height_px], camera.size_px);
            let off =
                spec.mount.vehicle_from_sensor().inverse() * camera.carrier_from_sensor.unwrap();
            assert!(off.translation.vector.norm() < 1e-12 && off.rotation.angle() < 1e-7);
        }
    }

    #[test]
    fn what_a_launch_file_has_is_written_and_read_as_the_same_chain() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        std::fs::write(&path, imported(CHAIN).0).unwrap();
        let found = of_launch_file(&path).unwrap();
        let cameras: Vec<Camera> = found
            .iter()
            .map(|(name, calibration, pose)| {
                camera(name, calibration, *pose, Format::Kalibr).unwrap()
            })
            .collect();
        let text = schema_calibration::write(Format::Kalibr, &cameras).unwrap();
        let (_, again) = schema_calibration::read(&text, None, None).unwrap();
        let (_, first) = schema_calibration::read(CHAIN, None, None).unwrap();
        for (a, b) in again.iter().zip(&first) {
            assert_eq!(
                (a.lens.model(), a.lens.plane()),
                (b.lens.model(), b.lens.plane())
            );
        }
        let step = |cameras: &[Camera]| cameras[1].carrier_from_sensor.unwrap();
        let off = step(&again).inverse() * step(&first);
        assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-7);
    }

    #[test]
    fn what_cannot_be_simulated_is_refused_by_the_launch_file_s_own_sentence() {
        let (format, cameras) =
            schema_calibration::read(&CHAIN.replace("[848, 800]", "[8480, 800]"), None, None)
                .unwrap();
        let text = launch_file("cams.yaml", format, &cameras);
        let sentence = check("cams.yaml", &text).unwrap_err().to_string();
        assert!(
            sentence.contains("sensor.cam0.width_px is 8480, but must be 16 to 4096"),
            "{sentence}"
        );
        let bent = Calibration::pinhole(
            [100.0, 100.0, 50.0, 50.0],
            schema_types::Distortion::from_array([0.1, 0.0, 1.0, 1.0]),
            [100, 100],
        );
        let sentence = camera("front", &bent.unwrap(), None, Format::Ros).unwrap_err();
        assert!(
            sentence
                .to_string()
                .contains("CARLA's bending, which ros cannot say")
        );
    }
}
