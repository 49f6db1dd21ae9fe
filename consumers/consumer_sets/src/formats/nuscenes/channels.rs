//! Which sensors are exported, and what nuScenes calls them.

use std::sync::Arc;

use nalgebra::Isometry3;
use schema_frames::{Modality, SensorKind};
use serde_json::{Value, json};

use super::tables::{pose_json, token};
use crate::options::{ImageForm, Options};
use consumer_truth::scenario::{Scenario, Sensor};

/// A sensor under its name in nuScenes.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// nuScenes' name, e.g. `CAM_FRONT`.
    pub name: String,
    /// `camera`, `lidar` or `radar`.
    pub modality: &'static str,
    /// Name of the sensor.
    pub sensor: String,
    /// Topic that is exported.
    pub topic: Arc<str>,
}

/// Names with the direction in which they look, degrees counter-clockwise from ahead.
const CAMERAS: [(&str, f64); 6] = [
    ("CAM_FRONT", 0.0),
    ("CAM_FRONT_RIGHT", -55.0),
    ("CAM_FRONT_LEFT", 55.0),
    ("CAM_BACK", 180.0),
    ("CAM_BACK_LEFT", 110.0),
    ("CAM_BACK_RIGHT", -110.0),
];
const RADARS: [(&str, f64); 5] = [
    ("RADAR_FRONT", 0.0),
    ("RADAR_FRONT_LEFT", 90.0),
    ("RADAR_FRONT_RIGHT", -90.0),
    ("RADAR_BACK_LEFT", 150.0),
    ("RADAR_BACK_RIGHT", -150.0),
];
/// Farther than this from a name's direction a sensor is not called so, degrees.
const REACH_DEG: f64 = 40.0;

/// All exported sensors: cameras with colour, lidars (the semantic one first), radars.
///
/// # Errors
/// A sentence if a camera that was asked for is none.
pub fn channels(scenario: &Scenario, options: &Options) -> anyhow::Result<Vec<Channel>> {
    let cameras = scenario.cameras(&options.cameras)?;
    let cameras: Vec<&Sensor> = cameras
        .into_iter()
        .filter(|c| c.has(Modality::Rgb))
        .collect();
    let radars: Vec<&Sensor> = scenario.with(Modality::Radar).collect();
    let mut found = Vec::new();
    for (sensors, names, wanted) in [
        (cameras, &CAMERAS[..], Modality::Rgb),
        (radars, &RADARS[..], Modality::Radar),
    ] {
        for (sensor, name) in sensors.iter().zip(by_direction(&sensors, names)) {
            found.extend(channel(sensor, wanted, name));
        }
    }
    let semantic: Vec<&Sensor> = scenario.with(Modality::SemanticLidar).collect();
    let plain = scenario.with(Modality::Lidar).filter(|plain| {
        let same =
            |other: &&&Sensor| apart(&plain.carrier_from_sensor, &other.carrier_from_sensor) < 1e-6;
        semantic.iter().find(same).is_none()
    });
    let all = semantic
        .iter()
        .copied()
        .map(|s| (s, Modality::SemanticLidar));
    let returns = scenario.with(Modality::LidarReturns);
    let all = all
        .chain(returns.map(|s| (s, Modality::LidarReturns)))
        .chain(plain.map(|s| (s, Modality::Lidar)));
    for (at, (sensor, wanted)) in all.enumerate() {
        let name = if at == 0 {
            "LIDAR_TOP".into()
        } else {
            own_name("LIDAR", sensor)
        };
        found.extend(channel(sensor, wanted, name));
    }
    for at in 1..found.len() {
        let clash = |name: &str| found[..at].iter().any(|other: &Channel| other.name == name);
        if clash(&found[at].name) {
            let base = found[at].name.clone();
            let free = (2..)
                .map(|n| format!("{base}_{n}"))
                .find(|name| !clash(name));
            found[at].name = free.expect("numbers do not end");
        }
    }
    Ok(found)
}

fn channel(sensor: &Sensor, wanted: Modality, name: String) -> Option<Channel> {
    let topic = sensor.topic(wanted)?;
    Some(Channel {
        name,
        modality: modality(sensor.kind)?,
        sensor: sensor.name.clone(),
        topic: topic.name.clone(),
    })
}

/// nuScenes' word for a kind of sensor; `None` for those that are not exported.
fn modality(kind: SensorKind) -> Option<&'static str> {
    match kind {
        SensorKind::Camera => Some("camera"),
        SensorKind::Lidar => Some("lidar"),
        SensorKind::Radar => Some("radar"),
        _ => None,
    }
}

fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    (a.translation.vector - b.translation.vector).norm() + a.rotation.angle_to(&b.rotation)
}

fn own_name(kind: &str, sensor: &Sensor) -> String {
    format!("{kind}_{}", sensor.name.to_uppercase())
}

/// Names of sensors: the nearest pairs of sensor and direction first, each name once; who is too far
/// from every free name keeps its own.
fn by_direction(sensors: &[&Sensor], names: &[(&str, f64)]) -> Vec<String> {
    let ahead_deg = |sensor: &Sensor| {
        let ahead = sensor.carrier_from_sensor.rotation * nalgebra::Vector3::x();
        ahead.y.atan2(ahead.x).to_degrees()
    };
    let mut pairs: Vec<(i64, usize, usize)> = Vec::new();
    for (at, sensor) in sensors.iter().enumerate() {
        for (name, (_, direction)) in names.iter().enumerate() {
            let off = (ahead_deg(sensor) - direction + 540.0).rem_euclid(360.0) - 180.0;
            if off.abs() <= REACH_DEG {
                pairs.push(((off.abs() * 1e3).round() as i64, at, name));
            }
        }
    }
    pairs.sort_unstable();
    let kind = names[0].0.split('_').next().unwrap_or_default();
    let mut given: Vec<Option<usize>> = vec![None; sensors.len()];
    for (_, at, name) in pairs {
        if given[at].is_none() && !given.contains(&Some(name)) {
            given[at] = Some(name);
        }
    }
    let name = |(at, given): (usize, Option<usize>)| match given {
        Some(name) => names[name].0.to_string(),
        None => own_name(kind, sensors[at]),
    };
    given.into_iter().enumerate().map(name).collect()
}

impl Channel {
    /// Token of its row in calibrated_sensor.
    pub fn calibration_token(&self, scenario: &Scenario) -> String {
        token(&["calibrated_sensor", &scenario.name, &self.name])
    }

    /// Its row in calibrated_sensor.
    pub fn calibration(&self, scenario: &Scenario, sensor: &Sensor) -> Value {
        let is_camera = self.modality == "camera";
        let place = if is_camera {
            sensor.carrier_from_camera()
        } else {
            sensor.carrier_from_sensor
        };
        let (translation, rotation) = pose_json(&place);
        let [fx, fy, cx, cy] = sensor.first().intrinsics_px;
        let intrinsic = if is_camera {
            json!([[fx, 0.0, cx - 0.5], [0.0, fy, cy - 0.5], [0.0, 0.0, 1.0]])
        } else {
            json!([])
        };
        json!({
            "token": self.calibration_token(scenario), "sensor_token": token(&["sensor", &self.name]),
            "translation": translation, "rotation": rotation, "camera_intrinsic": intrinsic,
        })
    }

    /// Ending of its files.
    pub fn ending(&self, form: ImageForm) -> &'static str {
        match self.modality {
            "camera" => form.ending(),
            "radar" => "pcd",
            _ => "pcd.bin",
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};
    use schema_frames::FrameHeader;

    use super::*;
    use consumer_truth::scenario::Topic;

    fn camera(name: &str, yaw_deg: f64) -> Sensor {
        let first = FrameHeader::new(Modality::Rgb);
        let topic = Topic {
            name: format!("ego/{name}/rgb").into(),
            sensor: name.into(),
            modality: Modality::Rgb,
            first,
        };
        Sensor {
            name: name.into(),
            kind: SensorKind::Camera,
            carrier_from_sensor: Isometry3::new(
                Vector3::zeros(),
                Vector3::z() * yaw_deg.to_radians(),
            ),
            topics: vec![topic],
        }
    }

    #[test]
    fn cameras_are_called_by_where_they_look_and_each_name_is_given_once() {
        let rig = [
            camera("a", 57.0),
            camera("b", 0.0),
            camera("c", -60.0),
            camera("d", 179.0),
            camera("e", 3.0),
        ];
        let names = by_direction(&rig.iter().collect::<Vec<_>>(), &CAMERAS);
        assert_eq!(
            names,
            [
                "CAM_FRONT_LEFT",
                "CAM_FRONT",
                "CAM_FRONT_RIGHT",
                "CAM_BACK",
                "CAM_E"
            ]
        );
    }
}
