//! What can be spawned: vehicles, sensors, and what the map brings itself.

use std::collections::BTreeMap;

use schema_frames::document::{BodyBox, Catalogue, CatalogueEntry};
use schema_types::Class;
use simd_body::BodyStyle;

use crate::friction;
use crate::models::{VehicleModel, vehicle_models};
use crate::props::prop_models;
use crate::walkers::walker_models;

/// Sensors that are accepted as passive actors; `sensor.camera.view` is ours and has any of the
/// camera modalities.
const SENSORS: &[&str] = &[
    "sensor.camera.view",
    "sensor.camera.rgb",
    "sensor.camera.depth",
    "sensor.camera.semantic_segmentation",
    "sensor.camera.instance_segmentation",
    "sensor.camera.optical_flow",
    "sensor.camera.normals",
    "sensor.camera.dvs",
    "sensor.lidar.ray_cast",
    "sensor.lidar.ray_cast_semantic",
    "sensor.other.radar",
    "sensor.other.imu",
    "sensor.other.gnss",
    "sensor.other.collision",
    "sensor.other.lane_invasion",
    "sensor.other.obstacle",
    "sensor.camera.cosmos_visualization",
    "sensor.other.v2x",
    "sensor.other.v2x_custom",
];
/// Sensors that measure nothing here, because others make their messages: an actor is all that
/// there is of them.
pub const PASSIVE_SENSORS: &[&str] = &[
    "sensor.other.lane_invasion",
    "sensor.other.v2x",
    "sensor.other.v2x_custom",
];
/// Brought by the map; they cannot be spawned by hand.
const OF_THE_MAP: &[(&str, &str, Class)] = &[
    ("spectator", "spectator", Class::UNLABELED),
    (
        "traffic.traffic_light",
        "traffic_light",
        Class::TRAFFIC_LIGHT,
    ),
    ("traffic.stop", "traffic_sign", Class::TRAFFIC_SIGNS),
    ("traffic.yield", "traffic_sign", Class::TRAFFIC_SIGNS),
    ("traffic.unknown", "traffic_sign", Class::TRAFFIC_SIGNS),
];
/// km/h for which there is a `traffic.speed_limit.N`.
const SPEED_LIMITS: [u32; 14] = [10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120, 130, 140];

const NO_BOX: BodyBox = BodyBox {
    centre_m: [0.0; 3],
    half_m: [0.0; 3],
};

/// The catalogue: vehicles in the order of [`vehicle_models`], walkers, props, then the rest.
pub(crate) fn catalogue() -> Catalogue {
    let vehicles = vehicle_models().iter().map(|model| CatalogueEntry {
        type_id: model.type_id.to_owned(),
        kind: "vehicle".to_owned(),
        class: model.class.0,
        body_box: model.body_box(),
        attributes: vehicle_attributes(model),
        recommended: BTreeMap::from([(
            "color".to_owned(),
            model
                .colors
                .iter()
                .map(|color| color_text(*color))
                .collect(),
        )]),
    });
    let props = prop_models().iter().map(|model| model.catalogue_entry());
    let walkers = walker_models().iter().map(|model| model.catalogue_entry());
    let sensors = SENSORS
        .iter()
        .map(|type_id| bare(type_id, "sensor", Class::UNLABELED));
    let map = OF_THE_MAP
        .iter()
        .map(|(type_id, kind, class)| bare(type_id, kind, *class));
    let limits = SPEED_LIMITS.iter().map(|kmh| {
        bare(
            &format!("traffic.speed_limit.{kmh}"),
            "traffic_sign",
            Class::TRAFFIC_SIGNS,
        )
    });
    let empty = bare("util.actor.empty", "controller", Class::UNLABELED);
    let friction = CatalogueEntry {
        attributes: friction::ATTRIBUTES
            .map(|(name, value)| (name.to_owned(), value.to_owned()))
            .into(),
        ..bare(friction::TYPE_ID, "prop", Class::UNLABELED)
    };
    Catalogue {
        entries: vehicles
            .chain(walkers)
            .chain(props)
            .chain([bare("controller.ai.walker", "controller", Class::UNLABELED)])
            .chain(sensors)
            .chain(map)
            .chain(limits)
            .chain([friction, empty])
            .collect(),
    }
}

fn bare(type_id: &str, kind: &str, class: Class) -> CatalogueEntry {
    CatalogueEntry {
        type_id: type_id.to_owned(),
        kind: kind.to_owned(),
        class: class.0,
        body_box: NO_BOX,
        attributes: BTreeMap::new(),
        recommended: BTreeMap::new(),
    }
}

/// Attributes that describe a vehicle and cannot be set; the rest of `vehicle_attributes` can.
pub(crate) const FIXED_ATTRIBUTES: &[&str] = &[
    "base_type",
    "special_type",
    "generation",
    "number_of_wheels",
    "has_lights",
    "has_dynamic_doors",
    "mass_kg",
    "wheelbase_m",
    "max_steer_rad",
    "wheel_radius_m",
];

fn vehicle_attributes(model: &VehicleModel) -> BTreeMap<String, String> {
    let pairs = [
        ("base_type", model.base_type.to_owned()),
        ("special_type", model.special_type.to_owned()),
        ("generation", model.generation.to_string()),
        ("number_of_wheels", model.n_wheels().to_string()),
        (
            "has_lights",
            (model.style != BodyStyle::Bicycle).to_string(),
        ),
        ("has_dynamic_doors", model.has_dynamic_doors().to_string()),
        ("mass_kg", model.mass_kg.to_string()),
        ("wheelbase_m", model.wheelbase_m.to_string()),
        ("max_steer_rad", model.max_steer_rad().to_string()),
        ("wheel_radius_m", model.wheel_radius_m.to_string()),
        ("color", color_text(model.colors[0])),
        ("sticky_control", "true".to_owned()),
    ];
    let driver = model
        .is_two_wheeler()
        .then(|| ("driver_id", "0".to_owned()));
    pairs
        .into_iter()
        .chain(driver)
        .map(|(name, value)| (name.to_owned(), value))
        .collect()
}

/// `r,g,b`.
pub(crate) fn color_text([r, g, b]: [u8; 3]) -> String {
    format!("{r},{g},{b}")
}

/// Reads `r,g,b` with each 0..=255.
pub(crate) fn parse_color(text: &str) -> Option<[u8; 3]> {
    let parts: Vec<u8> = text
        .split(',')
        .map(|part| part.trim().parse().ok())
        .collect::<Option<_>>()?;
    parts.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_unique() {
        let entries = catalogue().entries;
        for (i, entry) in entries.iter().enumerate() {
            assert!(
                entries[..i]
                    .iter()
                    .all(|other| other.type_id != entry.type_id),
                "{} twice",
                entry.type_id
            );
        }
    }

    #[test]
    fn colour_reads_back() {
        assert_eq!(parse_color(&color_text([1, 20, 255])), Some([1, 20, 255]));
        assert_eq!(parse_color("1,2"), None);
        assert_eq!(parse_color("1,2,256"), None);
    }
}
