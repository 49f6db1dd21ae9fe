//! The catalogue: what can be spawned, and what the map brings.

use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

use schema_frames::document::{BodyBox, Catalogue, CatalogueEntry};
use schema_types::Class;

use crate::friction_areas;
use crate::props::prop_models;
use crate::vehicles::{self, vehicle_models};
use crate::walkers::walker_models;

/// Sensor types that exist as passive actors. `sensor.camera.view` is our own and has any of the
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
/// Sensors that the daemon only keeps as actors, because clients or the CARLA gateway make their
/// messages.
pub const PASSIVE_SENSORS: &[&str] = &[
    "sensor.other.lane_invasion",
    "sensor.other.v2x",
    "sensor.other.v2x_custom",
];
/// Types that come with the map and cannot be spawned.
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
/// Speed limits, km/h, for which there is a `traffic.speed_limit.N`.
const SPEED_LIMITS: [u32; 14] = [10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120, 130, 140];

const NO_BOX: BodyBox = BodyBox {
    centre_m: [0.0; 3],
    half_m: [0.0; 3],
};

/// The catalogue, which all worlds share.
pub(crate) fn catalogue() -> Arc<Catalogue> {
    static CATALOGUE: LazyLock<Arc<Catalogue>> = LazyLock::new(|| Arc::new(make()));
    CATALOGUE.clone()
}

/// Vehicles in the order of [`vehicle_models`], walkers, props, then the rest.
fn make() -> Catalogue {
    let vehicles = vehicle_models().iter().map(vehicles::catalogue_entry);
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
        attributes: friction_areas::ATTRIBUTES
            .map(|(name, value)| (name.to_owned(), value.to_owned()))
            .into(),
        ..bare(friction_areas::TYPE_ID, "prop", Class::UNLABELED)
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

/// Index of a type in the catalogue.
pub(crate) fn index_of(catalogue: &Catalogue, type_id: &str) -> Option<u32> {
    catalogue
        .entries
        .iter()
        .position(|entry| entry.type_id == type_id)
        .map(|idx| idx as u32)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_unique() {
        let entries = &catalogue().entries;
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
}
