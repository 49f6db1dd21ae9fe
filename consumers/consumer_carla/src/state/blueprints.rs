//! The blueprint library: `world/catalogue` in CARLA's shape, and the attributes of CARLA's
//! sensors.

use schema_frames::{ActorInfo, Catalogue, CatalogueEntry};

use crate::list;
use crate::wire::description::{Attribute, Description};
use crate::wire::msgpack::Value;
use crate::wire::sensor_kinds;

/// CARLA's numbers of attribute types.
const BOOL: u8 = 1;
const INT: u8 = 2;
const FLOAT: u8 = 3;
const TEXT: u8 = 4;
const COLOR: u8 = 5;

/// Attributes of all vehicles that are not in the catalogue and cannot be set.
const VEHICLE_CONSTANTS: &[(&str, u8, &str)] = &[("object_type", TEXT, "")];
/// Attributes that scripts may set on every vehicle; they are kept and have no effect.
const VEHICLE_KEPT: &[(&str, u8, &str)] = &[("terramechanics", BOOL, "false")];
/// The same for two-wheelers; scripts choose among the recommended values.
const RIDER_KEPT: &[(&str, u8, &str)] = &[("driver_id", INT, "0")];
/// Roles that CARLA recommends for vehicles.
const VEHICLE_ROLES: [&str; 3] = ["autopilot", "scenario", "ego_vehicle"];
/// Roles that CARLA recommends for sensors.
const SENSOR_ROLES: [&str; 8] = [
    "front",
    "back",
    "left",
    "right",
    "front_left",
    "front_right",
    "back_left",
    "back_right",
];
/// Attributes of the catalogue that CARLA has, too: name, type, and whether a script may set them.
const BODY_ATTRIBUTES: &[(&str, u8, bool)] = &[
    ("base_type", TEXT, false),
    ("special_type", TEXT, false),
    ("generation", INT, false),
    ("number_of_wheels", INT, false),
    ("has_lights", BOOL, false),
    ("has_dynamic_doors", BOOL, false),
    ("color", COLOR, true),
    ("sticky_control", BOOL, true),
    ("age", TEXT, false),
    ("gender", TEXT, false),
    ("is_invincible", BOOL, true),
    ("speed", FLOAT, true),
    ("can_use_wheelchair", BOOL, false),
    ("use_wheelchair", BOOL, true),
    ("size", TEXT, false),
    ("friction", FLOAT, true),
    ("extent_x", FLOAT, true),
    ("extent_y", FLOAT, true),
    ("extent_z", FLOAT, true),
    ("mesh_path", TEXT, true),
    ("scale", FLOAT, true),
    ("mass", FLOAT, true),
];
/// Kinds of actors whose attributes are in the catalogue, and CARLA's default role for them.
const BODIES: &[(&str, &str)] = &[
    ("vehicle", "autopilot"),
    ("walker", "pedestrian"),
    ("prop", "prop"),
    ("controller", "default"),
];

type Spec = (&'static str, u8, &'static str);
const CAMERA: &[Spec] = &[
    ("image_size_x", INT, "800"),
    ("image_size_y", INT, "600"),
    ("fov", FLOAT, "90.0"),
    ("lens_circle_falloff", FLOAT, "5.0"),
    ("lens_circle_multiplier", FLOAT, "0.0"),
    ("lens_k", FLOAT, "-1.0"),
    ("lens_kcube", FLOAT, "0.0"),
    ("lens_x_size", FLOAT, "0.08"),
    ("lens_y_size", FLOAT, "0.08"),
];
/// Attributes of colour cameras: those that `spawn/optics.rs` reads, and others that are kept
/// without effect.
const COLOUR: &[Spec] = &[
    ("enable_postprocess_effects", BOOL, "true"),
    ("gamma", FLOAT, "2.2"),
    ("exposure_mode", TEXT, "histogram"),
    ("exposure_compensation", FLOAT, "0.0"),
    ("shutter_speed", FLOAT, "200.0"),
    ("iso", FLOAT, "100.0"),
    ("fstop", FLOAT, "1.4"),
    ("exposure_min_bright", FLOAT, "10.0"),
    ("exposure_max_bright", FLOAT, "12.0"),
    ("exposure_speed_up", FLOAT, "3.0"),
    ("exposure_speed_down", FLOAT, "1.0"),
    ("calibration_constant", FLOAT, "16.0"),
    ("motion_blur_intensity", FLOAT, "0.45"),
    ("motion_blur_max_distortion", FLOAT, "0.35"),
    ("motion_blur_min_object_screen_size", FLOAT, "0.1"),
    ("bloom_intensity", FLOAT, "0.675"),
    ("lens_flare_intensity", FLOAT, "0.1"),
    ("focal_distance", FLOAT, "1000.0"),
    ("blur_amount", FLOAT, "1.0"),
    ("blur_radius", FLOAT, "0.0"),
    ("min_fstop", FLOAT, "1.2"),
    ("blade_count", INT, "5"),
    ("slope", FLOAT, "0.88"),
    ("toe", FLOAT, "0.55"),
    ("shoulder", FLOAT, "0.26"),
    ("black_clip", FLOAT, "0.0"),
    ("white_clip", FLOAT, "0.04"),
    ("temp", FLOAT, "6500.0"),
    ("tint", FLOAT, "0.0"),
    ("chromatic_aberration_intensity", FLOAT, "0.0"),
    ("chromatic_aberration_offset", FLOAT, "0.0"),
];
const DVS: &[Spec] = &[
    ("positive_threshold", FLOAT, "0.3"),
    ("negative_threshold", FLOAT, "0.3"),
    ("sigma_positive_threshold", FLOAT, "0.0"),
    ("sigma_negative_threshold", FLOAT, "0.0"),
    ("refractory_period_ns", INT, "0"),
    ("use_log", BOOL, "true"),
    ("log_eps", FLOAT, "0.001"),
];
const LIDAR: &[Spec] = &[
    ("channels", INT, "32"),
    ("range", FLOAT, "10.0"),
    ("points_per_second", INT, "56000"),
    ("rotation_frequency", FLOAT, "10.0"),
    ("upper_fov", FLOAT, "10.0"),
    ("lower_fov", FLOAT, "-30.0"),
    ("horizontal_fov", FLOAT, "360.0"),
];
const LIDAR_NOISE: &[Spec] = &[
    ("atmosphere_attenuation_rate", FLOAT, "0.004"),
    ("dropoff_general_rate", FLOAT, "0.45"),
    ("dropoff_intensity_limit", FLOAT, "0.8"),
    ("dropoff_zero_intensity", FLOAT, "0.4"),
    ("noise_stddev", FLOAT, "0.0"),
    ("noise_seed", INT, "0"),
];
const RADAR: &[Spec] = &[
    ("horizontal_fov", FLOAT, "30"),
    ("vertical_fov", FLOAT, "30"),
    ("points_per_second", INT, "1500"),
    ("range", FLOAT, "100"),
    ("noise_seed", INT, "0"),
];
const IMU: &[Spec] = &[
    ("noise_seed", INT, "0"),
    ("noise_accel_stddev_x", FLOAT, "0.0"),
    ("noise_accel_stddev_y", FLOAT, "0.0"),
    ("noise_accel_stddev_z", FLOAT, "0.0"),
    ("noise_gyro_stddev_x", FLOAT, "0.0"),
    ("noise_gyro_stddev_y", FLOAT, "0.0"),
    ("noise_gyro_stddev_z", FLOAT, "0.0"),
    ("noise_gyro_bias_x", FLOAT, "0.0"),
    ("noise_gyro_bias_y", FLOAT, "0.0"),
    ("noise_gyro_bias_z", FLOAT, "0.0"),
];
const GNSS: &[Spec] = &[
    ("noise_seed", INT, "0"),
    ("noise_lat_bias", FLOAT, "0.0"),
    ("noise_lat_stddev", FLOAT, "0.0"),
    ("noise_lon_bias", FLOAT, "0.0"),
    ("noise_lon_stddev", FLOAT, "0.0"),
    ("noise_alt_bias", FLOAT, "0.0"),
    ("noise_alt_stddev", FLOAT, "0.0"),
];
const OBSTACLE: &[Spec] = &[
    ("distance", FLOAT, "5.0"),
    ("hit_radius", FLOAT, "0.5"),
    ("only_dynamics", BOOL, "false"),
    ("debug_linetrace", BOOL, "false"),
];
const RADIO: &[Spec] = &[
    ("noise_seed", INT, "0"),
    ("transmit_power", FLOAT, "21.5"),
    ("receiver_sensitivity", FLOAT, "-99.0"),
    ("frequency_ghz", FLOAT, "5.9"),
    ("combined_antenna_gain", FLOAT, "10.0"),
    ("scenario", TEXT, "highway"),
    ("path_loss_model", TEXT, "geometric"),
    ("path_loss_exponent", FLOAT, "2.7"),
    ("d_ref", FLOAT, "1.0"),
    ("filter_distance", FLOAT, "500.0"),
    ("use_etsi_fading", BOOL, "true"),
    ("custom_fading_stddev", FLOAT, "0.0"),
];
const AWARENESS: &[Spec] = &[
    ("gen_cam_min", FLOAT, "0.1"),
    ("gen_cam_max", FLOAT, "1.0"),
    ("fixed_rate", BOOL, "false"),
    ("noise_vel_stddev_x", FLOAT, "0.0"),
    ("noise_accel_stddev_x", FLOAT, "0.0"),
    ("noise_accel_stddev_y", FLOAT, "0.0"),
    ("noise_accel_stddev_z", FLOAT, "0.0"),
    ("noise_yawrate_stddev", FLOAT, "0.0"),
    ("noise_yawrate_bias", FLOAT, "0.0"),
    ("noise_lat_stddev", FLOAT, "0.0"),
    ("noise_lat_bias", FLOAT, "0.0"),
    ("noise_lon_stddev", FLOAT, "0.0"),
    ("noise_lon_bias", FLOAT, "0.0"),
    ("noise_alt_stddev", FLOAT, "0.0"),
    ("noise_alt_bias", FLOAT, "0.0"),
    ("noise_head_stddev", FLOAT, "0.0"),
    ("noise_head_bias", FLOAT, "0.0"),
];
/// Gantry's own attribute; CARLA's model is `two_frame`.
const DVS_MODE: &[Spec] = &[("gantry_mode", TEXT, "motion")];
/// Recommended values of attributes with a fixed choice.
const CHOICES: &[(&str, &[&str])] = &[
    ("scenario", &["highway", "rural", "urban"]),
    ("path_loss_model", &["winner", "geometric"]),
    ("gantry_mode", &["motion", "two_frame"]),
    ("exposure_mode", &["manual", "histogram"]),
];
const SENSOR_TICK: &[Spec] = &[("sensor_tick", FLOAT, "0.0")];

/// The attribute tables of a sensor's blueprint.
fn sensor_specs(type_id: &str) -> Vec<&'static [Spec]> {
    match type_id {
        "sensor.camera.rgb" => vec![SENSOR_TICK, CAMERA, COLOUR],
        "sensor.camera.dvs" => vec![SENSOR_TICK, CAMERA, COLOUR, DVS, DVS_MODE],
        _ if type_id.starts_with("sensor.camera.") => vec![SENSOR_TICK, CAMERA],
        "sensor.lidar.ray_cast" => vec![SENSOR_TICK, LIDAR, LIDAR_NOISE],
        "sensor.lidar.ray_cast_semantic" => vec![SENSOR_TICK, LIDAR],
        "sensor.other.radar" => vec![SENSOR_TICK, RADAR],
        "sensor.other.imu" => vec![SENSOR_TICK, IMU],
        "sensor.other.gnss" => vec![SENSOR_TICK, GNSS],
        sensor_kinds::AWARENESS => vec![SENSOR_TICK, RADIO, AWARENESS],
        sensor_kinds::CUSTOM => vec![SENSOR_TICK, RADIO],
        "sensor.other.obstacle" => vec![SENSOR_TICK, OBSTACLE],
        _ => vec![],
    }
}

/// Names of the attributes that a sensor's blueprint has beside `role_name` and `ros_name`.
pub fn sensor_attributes(type_id: &str) -> impl Iterator<Item = &'static str> {
    sensor_specs(type_id)
        .into_iter()
        .flatten()
        .map(|(name, _, _)| *name)
}

/// One attribute of a blueprint.
struct Line {
    name: String,
    kind: u8,
    value: String,
    recommended: Vec<Value>,
    modifiable: bool,
}

impl Line {
    fn new(name: &str, kind: u8, value: &str, modifiable: bool) -> Line {
        Line {
            name: name.to_owned(),
            kind,
            value: value.to_owned(),
            recommended: Vec::new(),
            modifiable,
        }
    }

    /// One attribute as the client reads it. The client takes the first recommended value as the
    /// default, so there must be one, unless the default is empty.
    fn definition(self) -> Value {
        let recommended = if self.recommended.is_empty() && !self.value.is_empty() {
            vec![self.value.clone().into()]
        } else {
            self.recommended
        };
        list![
            self.name,
            self.kind,
            self.value,
            recommended,
            self.modifiable,
            false
        ]
    }

    fn recommending(name: &str, kind: u8, value: &str, values: &[&str]) -> Line {
        Line {
            recommended: values.iter().map(|value| (*value).into()).collect(),
            ..Line::new(name, kind, value, true)
        }
    }
}

fn lines(entry: &CatalogueEntry) -> Vec<Line> {
    let last = entry.type_id.rsplit('.').next().unwrap_or_default();
    if let Some((kind, role)) = BODIES.iter().find(|(kind, _)| *kind == entry.kind) {
        let known = BODY_ATTRIBUTES
            .iter()
            .filter_map(|(name, kind, modifiable)| {
                let mut line = Line::new(name, *kind, entry.attributes.get(*name)?, *modifiable);
                line.recommended = entry
                    .recommended
                    .get(*name)
                    .into_iter()
                    .flatten()
                    .map(|value| value.clone().into())
                    .collect();
                Some(line)
            });
        let constants = if *kind == "vehicle" {
            VEHICLE_CONSTANTS
        } else {
            &[]
        };
        let constant = constants
            .iter()
            .map(|(name, kind, value)| Line::new(name, *kind, value, false));
        let rides = entry
            .attributes
            .get("number_of_wheels")
            .is_some_and(|wheels| wheels == "2");
        let of_riders = if rides { RIDER_KEPT } else { &[] };
        let of_vehicles = if *kind == "vehicle" {
            VEHICLE_KEPT
        } else {
            &[]
        };
        let kept = of_vehicles
            .iter()
            .map(|(name, kind, value)| Line::new(name, *kind, value, true));
        let riders = of_riders
            .iter()
            .map(|(name, kind, value)| Line::recommending(name, *kind, value, &[*value]));
        let roles: &[&str] = if entry.kind == "vehicle" {
            &VEHICLE_ROLES
        } else {
            &[*role]
        };
        return known
            .chain(constant)
            .chain(kept)
            .chain(riders)
            .chain([Line::recommending("role_name", TEXT, role, roles)])
            .collect();
    }
    let own = sensor_specs(&entry.type_id)
        .into_iter()
        .flatten()
        .map(|(name, kind, value)| {
            let mut line = Line::new(name, *kind, value, true);
            let choices = CHOICES
                .iter()
                .find(|(of, _)| of == name)
                .map_or(&[][..], |(_, choices)| choices);
            line.recommended = choices.iter().map(|choice| (*choice).into()).collect();
            line
        });
    let role = Line::recommending("role_name", TEXT, "default", &SENSOR_ROLES);
    own.chain([role, Line::new("ros_name", TEXT, last, true)])
        .collect()
}

/// Whether scripts see this entry in the blueprint library.
fn is_blueprint(entry: &CatalogueEntry) -> bool {
    // `sensor.camera.view` is Gantry's own: one camera with any modalities, which CARLA does not
    // have.
    let spawned = entry.kind == "sensor" || BODIES.iter().any(|(kind, _)| *kind == entry.kind);
    spawned && entry.type_id != "sensor.camera.view"
}

/// The blueprint library, as `get_actor_definitions` returns it.
pub fn definitions(catalogue: &Catalogue) -> Value {
    let definition = |(idx, entry): (usize, &CatalogueEntry)| {
        let attributes: Vec<Value> = lines(entry).into_iter().map(Line::definition).collect();
        list![
            idx as u32 + 1,
            entry.type_id.as_str(),
            entry.type_id.replace('.', ","),
            attributes
        ]
    };
    Value::Array(
        catalogue
            .entries
            .iter()
            .enumerate()
            .filter(|(_, entry)| is_blueprint(entry))
            .map(definition)
            .collect(),
    )
}

/// The description of an actor that no client of this gateway spawned.
pub fn describe(actor: &ActorInfo, entry: Option<&CatalogueEntry>) -> Description {
    let mut attributes: Vec<Attribute> = match entry {
        Some(entry) if is_blueprint(entry) => lines(entry)
            .into_iter()
            .map(|line| Attribute {
                name: line.name,
                kind: line.kind,
                value: line.value,
            })
            .collect(),
        _ => vec![Attribute {
            name: "role_name".into(),
            kind: TEXT,
            value: String::new(),
        }],
    };
    for attribute in &mut attributes {
        if attribute.name == "role_name" {
            attribute.value = actor.role.clone();
        } else if let Some(value) = actor.attributes.get(&attribute.name) {
            attribute.value = value.clone();
        }
    }
    attributes.sort_by(|a, b| a.name.cmp(&b.name));
    Description {
        type_id: actor.type_id.clone(),
        attributes,
    }
}

/// The attributes that are passed on to the simulator: those that a script may set on a body,
/// except its role.
pub fn settable(description: &Description) -> std::collections::BTreeMap<String, String> {
    let settable = |attribute: &&Attribute| {
        BODY_ATTRIBUTES
            .iter()
            .any(|(name, _, modifiable)| *modifiable && *name == attribute.name)
    };
    description
        .attributes
        .iter()
        .filter(settable)
        .map(|a| (a.name.clone(), a.value.to_lowercase()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_frames::BodyBox;

    fn entry(type_id: &str, kind: &str) -> CatalogueEntry {
        let attributes = [
            ("color", "1,2,3"),
            ("number_of_wheels", "4"),
            ("mass_kg", "900"),
        ]
        .map(|(k, v)| (k.to_owned(), v.to_owned()))
        .into();
        CatalogueEntry {
            type_id: type_id.into(),
            kind: kind.into(),
            class: 14,
            body_box: BodyBox {
                centre_m: [0.0; 3],
                half_m: [1.0; 3],
            },
            attributes,
            recommended: Default::default(),
        }
    }

    #[test]
    fn only_what_scripts_may_spawn_is_a_blueprint() {
        let entries = vec![
            entry("vehicle.a.b", "vehicle"),
            entry("sensor.camera.rgb", "sensor"),
            entry("sensor.camera.view", "sensor"),
            entry("spectator", "spectator"),
            entry("traffic.stop", "traffic_sign"),
        ];
        let Value::Array(found) = definitions(&Catalogue { entries }) else {
            unreachable!()
        };
        assert_eq!(found.len(), 2);
        let text = format!("{found:?}");
        assert!(
            text.contains("image_size_x")
                && text.contains("number_of_wheels")
                && !text.contains("mass_kg"),
            "{text}"
        );
    }

    #[test]
    fn sensors_that_fire_on_events_have_no_sensor_tick() {
        for type_id in ["sensor.other.collision", "sensor.other.lane_invasion"] {
            assert!(
                !lines(&entry(type_id, "sensor"))
                    .iter()
                    .any(|line| line.name == "sensor_tick"),
                "{type_id}"
            );
        }
    }
}
