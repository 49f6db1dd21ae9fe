//! Turns a sensor's attributes into a `spawn_sensor` command.

use std::collections::BTreeMap;

use schema_frames::document::PoseText;
use schema_frames::{Attachment, Command};
use serde_json::{Map, Value, json};

use crate::spawn::optics::optics;
use crate::v2x;
use crate::wire::description::{Attributes, Description};
use crate::wire::fields::Wrong;
use crate::wire::sensor_kinds::{CLIENT_SIDE, Kind, kind};

/// The command that spawns the sensor of a description.
///
/// # Errors
/// For sensors that the simulator does not have.
pub fn command(
    description: &Description,
    pose: PoseText,
    parent_id: Option<u32>,
    attachment: Attachment,
) -> Result<Command, Wrong> {
    let type_id = description.type_id.clone();
    let attributes: BTreeMap<String, String> = description
        .attributes
        .iter()
        .map(|attribute| (attribute.name.clone(), attribute.value.clone()))
        .collect();
    if CLIENT_SIDE.contains(&type_id.as_str()) {
        return Ok(Command::Spawn {
            type_id,
            pose,
            parent_id,
            role: String::new(),
            attributes: BTreeMap::new(),
        });
    }
    let Some(kind) = kind(&type_id) else {
        return Err(Wrong::Value(format!(
            "{type_id:?} cannot be spawned: the simulator has no such sensor; docs/reference/carla-compatibility.md lists those it has"
        )));
    };
    if kind.modalities.is_empty() {
        v2x::check(description)?;
        return Ok(Command::Spawn {
            type_id,
            pose,
            parent_id,
            role: String::new(),
            attributes: BTreeMap::new(),
        });
    }
    let given = Attributes::of(description);
    let interval_secs = given.float("sensor_tick", 0.0);
    let interval_nanos = if interval_secs > 0.0 {
        (interval_secs * 1e9).round().min(1e18) as u64
    } else {
        0
    };
    let spec = spec(kind, &given);
    Ok(Command::SpawnSensor {
        type_id,
        pose,
        parent_id,
        attachment,
        interval_nanos,
        spec,
        attributes,
    })
}

fn spec(kind: &Kind, given: &Attributes<'_>) -> Map<String, Value> {
    let keys = match kind.type_id {
        "sensor.lidar.ray_cast" | "sensor.lidar.ray_cast_semantic" => lidar(kind, given),
        "sensor.other.radar" => radar(given),
        "sensor.other.obstacle" => obstacle(given),
        "sensor.other.collision" => json!({ "kind": "collision" }),
        "sensor.other.imu" => imu(given),
        "sensor.other.gnss" => gnss(given),
        _ => camera(kind, given),
    };
    match keys {
        Value::Object(keys) => keys,
        _ => Map::new(),
    }
}

fn camera(kind: &Kind, given: &Attributes<'_>) -> Value {
    let modalities: Vec<&str> = kind
        .modalities
        .iter()
        .map(|modality| modality.name())
        .collect();
    let mut keys = json!({
        "kind": "camera",
        "modalities": modalities,
        "width_px": given.int("image_size_x", 800),
        "height_px": given.int("image_size_y", 600),
        "fov_deg": given.float("fov", 90.0),
    });
    if let Some(optics) = optics(given, kind.type_id == "sensor.camera.rgb") {
        keys["optics"] = optics;
    }
    if kind.type_id == "sensor.camera.dvs" {
        keys["dvs"] = json!({
            "positive_threshold": given.float("positive_threshold", 0.3),
            "negative_threshold": given.float("negative_threshold", 0.3),
            "sigma_positive_threshold": given.float("sigma_positive_threshold", 0.0),
            "sigma_negative_threshold": given.float("sigma_negative_threshold", 0.0),
            "refractory_nanos": given.int("refractory_period_ns", 0),
            "use_log": given.bool("use_log", true),
            "log_eps": given.float("log_eps", 0.001),
            "mode": given.text("gantry_mode").unwrap_or("motion"),
        });
    }
    keys
}

fn lidar(kind: &Kind, given: &Attributes<'_>) -> Value {
    let mut keys = json!({
        "kind": "lidar",
        "scan": "sweep",
        "channels": given.int("channels", 32),
        "points_per_second": given.int("points_per_second", 56_000),
        "rotation_hz": given.float("rotation_frequency", 10.0),
        "horizontal_fov_deg": given.float("horizontal_fov", 360.0),
        "range_m": given.float("range", 10.0),
        "upper_fov_deg": given.float("upper_fov", 10.0),
        "lower_fov_deg": given.float("lower_fov", -30.0),
    });
    if kind.type_id == "sensor.lidar.ray_cast_semantic" {
        keys["semantic"] = true.into();
    } else {
        keys["attenuation_per_m"] = given.float("atmosphere_attenuation_rate", 0.004).into();
        keys["dropoff_general_ratio"] = given.float("dropoff_general_rate", 0.45).into();
        keys["dropoff_intensity_limit"] = given.float("dropoff_intensity_limit", 0.8).into();
        keys["dropoff_zero_intensity_ratio"] = given.float("dropoff_zero_intensity", 0.4).into();
        keys["noise_range_stddev_m"] = given.float("noise_stddev", 0.0).into();
        keys["noise_seed"] = given.seed().into();
    }
    keys
}

fn radar(given: &Attributes<'_>) -> Value {
    json!({
        "kind": "radar",
        "horizontal_fov_deg": given.float("horizontal_fov", 30.0),
        "vertical_fov_deg": given.float("vertical_fov", 30.0),
        "range_m": given.float("range", 100.0),
        "points_per_second": given.int("points_per_second", 1500),
        "noise_seed": given.seed(),
    })
}

fn obstacle(given: &Attributes<'_>) -> Value {
    json!({
        "kind": "obstacle",
        "distance_m": given.float("distance", 5.0),
        "hit_radius_m": given.float("hit_radius", 0.5),
        "only_dynamics": given.bool("only_dynamics", false),
        "debug_linetrace": given.bool("debug_linetrace", false),
    })
}

fn imu(given: &Attributes<'_>) -> Value {
    // Standard deviations have no sign, so mirroring y leaves them as they are; a gyroscope's bias
    // is mirrored as an axial vector.
    let three =
        |name: &str| ["x", "y", "z"].map(|axis| given.float(&format!("{name}_{axis}"), 0.0));
    let [x, y, z] = three("noise_gyro_bias");
    json!({
        "kind": "imu",
        "noise_accel_stddev_mps2": three("noise_accel_stddev"),
        "noise_gyro_stddev_radps": three("noise_gyro_stddev"),
        "bias_gyro_radps": [-x, y, -z],
        "noise_seed": given.seed(),
    })
}

fn gnss(given: &Attributes<'_>) -> Value {
    json!({
        "kind": "gnss",
        "noise_position_stddev_deg": [given.float("noise_lat_stddev", 0.0), given.float("noise_lon_stddev", 0.0)],
        "noise_altitude_stddev_m": given.float("noise_alt_stddev", 0.0),
        "bias_position_deg": [given.float("noise_lat_bias", 0.0), given.float("noise_lon_bias", 0.0)],
        "bias_altitude_m": given.float("noise_alt_bias", 0.0),
        "noise_seed": given.seed(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::description::Attribute;

    fn described(type_id: &str, attributes: &[(&str, &str)]) -> Description {
        let attribute = |(name, value): &(&str, &str)| Attribute {
            name: (*name).into(),
            kind: 4,
            value: (*value).into(),
        };
        Description {
            type_id: type_id.into(),
            attributes: attributes.iter().map(attribute).collect(),
        }
    }

    fn pose() -> PoseText {
        schema_types::Pose::IDENTITY.into()
    }

    #[test]
    fn attributes_become_a_specification() {
        let given = described(
            "sensor.camera.rgb",
            &[
                ("image_size_x", "64.0"),
                ("image_size_y", "48px"),
                ("fov", "70deg"),
                ("sensor_tick", "0.1"),
            ],
        );
        let Command::SpawnSensor {
            spec,
            interval_nanos,
            parent_id,
            attachment,
            ..
        } = command(&given, pose(), Some(3), Attachment::SpringArm).unwrap()
        else {
            panic!()
        };
        assert_eq!(
            (interval_nanos, parent_id, attachment),
            (100_000_000, Some(3), Attachment::SpringArm)
        );
        assert_eq!(
            Value::Object(spec),
            json!({"kind": "camera", "modalities": ["rgb"], "width_px": 64, "height_px": 48, "fov_deg": 70.0})
        );
        let Command::SpawnSensor { spec, .. } = command(
            &described("sensor.lidar.ray_cast", &[]),
            pose(),
            None,
            Attachment::Rigid,
        )
        .unwrap() else {
            panic!()
        };
        assert_eq!(
            (
                spec["channels"].as_i64(),
                spec["points_per_second"].as_i64(),
                spec["range_m"].as_f64()
            ),
            (Some(32), Some(56_000), Some(10.0))
        );
    }

    #[test]
    fn what_clients_compute_themselves_is_a_bare_actor_and_what_nobody_has_is_a_sentence() {
        assert!(matches!(
            command(
                &described("sensor.other.lane_invasion", &[]),
                pose(),
                Some(1),
                Attachment::Rigid
            ),
            Ok(Command::Spawn { .. })
        ));
        let error = command(
            &described("sensor.other.sonar", &[]),
            pose(),
            None,
            Attachment::Rigid,
        )
        .unwrap_err()
        .to_string();
        assert!(error.contains("sensor.other.sonar"), "{error}");
    }
}
