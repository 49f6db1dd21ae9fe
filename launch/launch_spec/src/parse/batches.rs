//! `[batch.NAME]`: cameras of one size and rate whose images come as one frame.

use std::collections::BTreeMap;

use schema_frames::{Modality, SensorKind};
use sensor_spec::{CameraSpec, SensorSpec};
use toml::Value as Toml;

use super::sections::named;
use crate::batch::{Batch, MAX_CAMERAS, MAX_FRAME_BYTES, fits};
use crate::error::{Errors, Place, did_you_mean};
use crate::fill::{refuse_unknown, table_or_error};
use crate::model::{Launch, PlacedSensor};
use crate::tree::{Entry, Table};

/// A camera and its name `rig/sensor`.
struct Camera<'a> {
    name: String,
    sensor: &'a str,
    spec: &'a CameraSpec,
}

pub(super) fn read(file: &Table, launch: &Launch, errors: &mut Errors) -> BTreeMap<String, Batch> {
    let placed = launch.placed_sensors();
    let mut batches = BTreeMap::new();
    for (name, entry) in named(file, "batch", errors) {
        if let Some(batch) = batch(&format!("batch.{name}"), entry, &placed, errors) {
            batches.insert(name.to_owned(), batch);
        }
    }
    batches
}

fn batch(
    path: &str,
    entry: &Entry,
    placed: &[PlacedSensor<'_>],
    errors: &mut Errors,
) -> Option<Batch> {
    let table = table_or_error(entry, path, errors)?;
    refuse_unknown(table, &["cameras", "modalities"], path, errors);
    let modalities = match table.get("modalities") {
        Some(entry) => modalities(entry, path, errors),
        None => Some(vec![Modality::Rgb]),
    };
    let Some(listed) = table.get("cameras") else {
        errors.push(
            entry.key_at,
            format!("[{path}] has no cameras; give a list such as cameras = [\"ego/left\", \"ego/right\"] or [\"*/front\"]"),
        );
        return None;
    };
    let cameras = cameras(listed, path, placed, errors)?;
    let at = Wrong {
        path,
        cameras: listed.node.at,
        modalities: table
            .get("modalities")
            .map_or(entry.key_at, |entry| entry.node.at),
    };
    let modalities = modalities?;
    at.check(&cameras, &modalities, errors);
    Some(Batch {
        cameras: cameras.into_iter().map(|camera| camera.name).collect(),
        modalities,
    })
}

fn texts(value: &Toml) -> Option<Vec<&str>> {
    let list = value.as_array().filter(|list| !list.is_empty())?;
    list.iter().map(Toml::as_str).collect()
}

fn modalities(entry: &Entry, path: &str, errors: &mut Errors) -> Option<Vec<Modality>> {
    let value = entry.node.plain();
    let image = |name: &str| Modality::from_name(name).filter(|it| it.is_image());
    let found: Option<Vec<Modality>> =
        texts(&value).and_then(|names| names.into_iter().map(image).collect());
    let twice = |list: &Vec<Modality>| (1..list.len()).any(|i| list[..i].contains(&list[i]));
    if found.as_ref().is_none_or(twice) {
        let images = Modality::ALL
            .iter()
            .filter(|modality| modality.is_image() && modality.sensor_kind() == SensorKind::Camera);
        let images: Vec<&str> = images.map(|modality| modality.name()).collect();
        errors.push(
            entry.node.at,
            format!("{path}.modalities is {value}, but must be a list of kinds of images, each once: {}", images.join(", ")),
        );
        return None;
    }
    found
}

/// The cameras that a list names, in its order.
fn cameras<'a>(
    entry: &Entry,
    path: &str,
    placed: &[PlacedSensor<'a>],
    errors: &mut Errors,
) -> Option<Vec<Camera<'a>>> {
    let value = entry.node.plain();
    let Some(patterns) = texts(&value) else {
        errors.push(
            entry.node.at,
            format!("{path}.cameras is {value}, but must be a list of one or more cameras such as \"ego/left\" or \"*/front\""),
        );
        return None;
    };
    let mut found: Vec<Camera<'a>> = Vec::new();
    let n_errors = errors.len();
    for pattern in patterns {
        let is_pattern = pattern.contains('*');
        let named: Vec<Camera<'a>> = placed
            .iter()
            .filter(|sensor| {
                pattern
                    .split_once('/')
                    .is_some_and(|(rig, name)| fits(rig, sensor.rig) && fits(name, sensor.name))
            })
            .filter_map(|sensor| camera(sensor, pattern, path, entry, errors))
            .collect();
        let is_sensor = |sensor: &PlacedSensor<'_>| sensor.full_name() == pattern;
        if named.is_empty() && (is_pattern || !placed.iter().any(is_sensor)) {
            let known: Vec<String> = placed
                .iter()
                .filter(|sensor| matches!(sensor.spec, SensorSpec::Camera(_)))
                .map(PlacedSensor::full_name)
                .collect();
            let hint = did_you_mean(pattern, known.iter().map(String::as_str));
            errors.push(
                entry.node.at,
                format!("{path}.cameras has {pattern:?}, but no camera of this launch is called so{hint}"),
            );
        }
        for camera in named {
            let is_known = found.iter().any(|known| known.name == camera.name);
            if is_known && !is_pattern {
                errors.push(
                    entry.node.at,
                    format!("{path}.cameras has {:?} twice; keep one", camera.name),
                );
            } else if !is_known {
                found.push(camera);
            }
        }
    }
    (errors.len() == n_errors).then_some(found)
}

/// A sensor as a camera; one of another kind is passed over by a pattern, and refused by its name.
fn camera<'a>(
    sensor: &PlacedSensor<'a>,
    pattern: &str,
    path: &str,
    entry: &Entry,
    errors: &mut Errors,
) -> Option<Camera<'a>> {
    let SensorSpec::Camera(spec) = sensor.spec else {
        if !pattern.contains('*') {
            errors.push(
                entry.node.at,
                format!("{path}.cameras has {pattern:?}, which is no camera; a batch holds images only, so remove it"),
            );
        }
        return None;
    };
    Some(Camera {
        name: sensor.full_name(),
        sensor: sensor.name,
        spec,
    })
}

/// Where errors of a batch are.
struct Wrong<'p> {
    path: &'p str,
    cameras: Place,
    modalities: Place,
}

impl Wrong<'_> {
    /// Whether cameras can be one batch.
    fn check(&self, cameras: &[Camera<'_>], modalities: &[Modality], errors: &mut Errors) {
        let path = self.path;
        let Some(first) = cameras.first() else {
            return;
        };
        let size = |camera: &Camera<'_>| (camera.spec.width_px, camera.spec.height_px);
        if let Some(other) = cameras.iter().find(|camera| size(camera) != size(first)) {
            let ((width, height), (width2, height2)) = (size(first), size(other));
            errors.push(
                self.cameras,
                format!("{path} has images of {width} × {height} px ({}) and of {width2} × {height2} px ({}); a batch needs one size, so make them equal or take two batches", first.name, other.name),
            );
            return;
        }
        if let Some(bent) = cameras.iter().find(|camera| camera.spec.lens.is_some()) {
            errors.push(
                self.cameras,
                format!("{path} has {:?}, whose lens has a model; frames of batches are of pinhole cameras, so remove it", bent.name),
            );
        }
        let rate = |camera: &Camera<'_>| camera.spec.rate_hz;
        if let Some(other) = cameras.iter().find(|camera| rate(camera) != rate(first)) {
            errors.push(
                self.cameras,
                format!("{path} has cameras of {} Hz ({}) and of {} Hz ({}); a batch needs one rate_hz, so make them equal or take two batches", rate(first), first.name, rate(other), other.name),
            );
        }
        if cameras.len() > MAX_CAMERAS {
            errors.push(
                self.cameras,
                format!("{path} has {} cameras, but may have at most {MAX_CAMERAS}; take several batches", cameras.len()),
            );
        }
        let pixels = u64::from(first.spec.width_px) * u64::from(first.spec.height_px);
        for modality in modalities {
            let name = modality.name();
            let lacking = cameras
                .iter()
                .find(|camera| !camera.spec.modalities.contains(modality));
            if let Some(lacking) = lacking {
                errors.push(
                    self.modalities,
                    format!("{path}.modalities has {name:?}, but camera {:?} does not; add it to sensor.{}.modalities or remove it here", lacking.name, lacking.sensor),
                );
            }
            let image_bytes = pixels * modality.element_bytes() as u64;
            if !image_bytes.is_multiple_of(4) && cameras.len() > 1 {
                errors.push(
                    self.modalities,
                    format!("{path}.modalities has {name:?}, whose images of {image_bytes} bytes cannot lie one after the other: GPUs write to multiples of 4; make the width or the height of the cameras a multiple of 4"),
                );
            }
            let n_bytes = image_bytes * cameras.len() as u64;
            if n_bytes > MAX_FRAME_BYTES {
                errors.push(
                    self.cameras,
                    format!("{path} has frames of {} MiB ({name}), but they may have at most {} MiB; take several batches, or fewer or smaller images", n_bytes.div_ceil(1 << 20), MAX_FRAME_BYTES >> 20),
                );
            }
        }
    }
}
