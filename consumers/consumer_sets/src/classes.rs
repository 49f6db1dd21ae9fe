//! CARLA's classes in each format's words: the one table, and what a body is called.

use schema_frames::ActorKind;
use schema_types::class::CLASSES;

use consumer_truth::Body;

/// One class in every format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClassRow {
    /// Category id of COCO for things; `None` for what has no instances there.
    pub coco: Option<u8>,
    /// Label id of KITTI-360 (which are those of Cityscapes).
    pub kitti360: u8,
    /// Label of SemanticKITTI for what stands still.
    pub semantickitti: u16,
    /// Label of SemanticKITTI for what moves; the same as the other for what cannot.
    pub semantickitti_moving: u16,
    /// Index of nuScenes' lidarseg categories.
    pub lidarseg: u8,
}

const fn row(coco: u8, kitti360: u8, semantickitti: u16, moving: u16, lidarseg: u8) -> ClassRow {
    ClassRow {
        coco: if coco == 0 { None } else { Some(coco) },
        kitti360,
        semantickitti,
        semantickitti_moving: moving,
        lidarseg,
    }
}

/// The table: the index is CARLA's number.
pub const ROWS: [ClassRow; CLASSES.len()] = [
    //  COCO, KITTI-360, SemanticKITTI still, moving, lidarseg
    row(0, 0, 0, 0, 0),      // Unlabeled
    row(0, 7, 40, 40, 24),   // Roads
    row(0, 8, 48, 48, 26),   // Sidewalks
    row(0, 11, 50, 50, 28),  // Buildings
    row(0, 12, 52, 52, 28),  // Walls
    row(0, 13, 51, 51, 28),  // Fences
    row(0, 17, 80, 80, 28),  // Poles
    row(10, 19, 99, 99, 28), // TrafficLight
    row(0, 20, 81, 81, 28),  // TrafficSigns
    row(0, 21, 70, 70, 30),  // Vegetation
    row(0, 22, 72, 72, 27),  // Terrain
    row(0, 23, 0, 0, 0),     // Sky
    row(1, 24, 30, 254, 2),  // Pedestrians
    row(1, 25, 31, 253, 14), // Rider
    row(3, 26, 10, 252, 17), // Car
    row(8, 27, 18, 258, 23), // Truck
    row(6, 28, 13, 257, 16), // Bus
    row(7, 31, 16, 256, 29), // Train
    row(4, 32, 15, 255, 21), // Motorcycle
    row(2, 33, 11, 253, 14), // Bicycle
    row(0, 4, 99, 99, 29),   // Static
    row(0, 5, 99, 99, 10),   // Dynamic
    row(0, 44, 99, 99, 29),  // Other
    row(0, 6, 49, 49, 25),   // Water
    row(0, 7, 60, 60, 24),   // RoadLines
    row(0, 6, 49, 49, 25),   // Ground
    row(0, 15, 52, 52, 28),  // Bridge
    row(0, 10, 49, 49, 25),  // RailTrack
    row(0, 14, 51, 51, 28),  // GuardRail
];

/// The row of a class; numbers without a name are those of class 0.
pub fn of(class: u8) -> &'static ClassRow {
    ROWS.get(usize::from(class)).unwrap_or(&ROWS[0])
}

/// Speed from which something counts as moving, m/s: slower is what a parked vehicle's suspension
/// does.
pub const MOVING_MPS: f64 = 0.3;

/// Categories of COCO that can occur: id, name, super-category. YOLO numbers them from 0 in this
/// order.
pub const COCO: [(u8, &str, &str); 8] = [
    (1, "person", "person"),
    (2, "bicycle", "vehicle"),
    (3, "car", "vehicle"),
    (4, "motorcycle", "vehicle"),
    (6, "bus", "vehicle"),
    (7, "train", "vehicle"),
    (8, "truck", "vehicle"),
    (10, "traffic light", "outdoor"),
];

/// Type of a body in KITTI's labels; `None` for what KITTI does not label. KITTI has no motorcycles
/// and buses, they are `Misc`.
pub fn kitti(body: &Body) -> Option<&'static str> {
    match (body.kind, body.class) {
        (ActorKind::Walker, _) if body.is_seated => Some("Person_sitting"),
        (ActorKind::Walker, _) => Some("Pedestrian"),
        (ActorKind::Vehicle, 19) => Some("Cyclist"),
        (ActorKind::Vehicle, _) if body.base_type == "van" => Some("Van"),
        (ActorKind::Vehicle, 14) => Some("Car"),
        (ActorKind::Vehicle, 15) => Some("Truck"),
        (ActorKind::Vehicle, 17) => Some("Tram"),
        (ActorKind::Vehicle, _) => Some("Misc"),
        _ => None,
    }
}

/// nuScenes' lidarseg categories: the index is the label.
pub const NUSCENES: [&str; 32] = [
    "noise",
    "animal",
    "human.pedestrian.adult",
    "human.pedestrian.child",
    "human.pedestrian.construction_worker",
    "human.pedestrian.personal_mobility",
    "human.pedestrian.police_officer",
    "human.pedestrian.stroller",
    "human.pedestrian.wheelchair",
    "movable_object.barrier",
    "movable_object.debris",
    "movable_object.pushable_pullable",
    "movable_object.trafficcone",
    "static_object.bicycle_rack",
    "vehicle.bicycle",
    "vehicle.bus.bendy",
    "vehicle.bus.rigid",
    "vehicle.car",
    "vehicle.construction",
    "vehicle.emergency.ambulance",
    "vehicle.emergency.police",
    "vehicle.motorcycle",
    "vehicle.trailer",
    "vehicle.truck",
    "flat.driveable_surface",
    "flat.other",
    "flat.sidewalk",
    "flat.terrain",
    "static.manmade",
    "static.other",
    "static.vegetation",
    "vehicle.ego",
];

/// Index of a body's category in [`NUSCENES`].
pub fn nuscenes(body: &Body) -> u8 {
    let id = body.type_id.as_str();
    match body.kind {
        ActorKind::Walker if body.is_seated => 8,
        ActorKind::Walker if body.age == "child" => 3,
        ActorKind::Walker => 2,
        ActorKind::Vehicle if body.special_type == "emergency" && id.contains("police") => 20,
        ActorKind::Vehicle if body.special_type == "emergency" && id.contains("ambulance") => 19,
        ActorKind::Vehicle if body.base_type == "van" => 23,
        ActorKind::Vehicle => of(body.class).lidarseg,
        _ if id.contains("cone") => 12,
        _ if id.contains("barrier") => 9,
        _ if ["bin", "cart", "trolley", "container"]
            .iter()
            .any(|word| id.contains(word)) =>
        {
            11
        }
        _ => 10,
    }
}

/// nuScenes' attributes: name, description.
pub const NUSCENES_ATTRIBUTES: [(&str, &str); 8] = [
    ("vehicle.moving", "Vehicle is moving."),
    (
        "vehicle.stopped",
        "Vehicle stands with a driver who means to move on.",
    ),
    ("vehicle.parked", "Vehicle stands without meaning to move."),
    (
        "cycle.with_rider",
        "There is a rider on the bicycle or motorcycle.",
    ),
    (
        "cycle.without_rider",
        "There is no rider on the bicycle or motorcycle.",
    ),
    ("pedestrian.sitting_lying_down", "The person sits or lies."),
    ("pedestrian.standing", "The person stands."),
    ("pedestrian.moving", "The person moves."),
];

/// Index of a body's attribute in [`NUSCENES_ATTRIBUTES`]; `None` for what has none.
pub fn nuscenes_attribute(body: &Body) -> Option<usize> {
    let moves = body.speed_mps() >= MOVING_MPS;
    match (body.kind, body.class) {
        (ActorKind::Walker, _) if body.is_down || body.is_seated => Some(5),
        (ActorKind::Walker, _) => Some(if moves { 7 } else { 6 }),
        (ActorKind::Vehicle, 18 | 19) if body.is_scenery() => Some(4),
        (ActorKind::Vehicle, _) if body.is_scenery() => Some(2),
        // Two-wheelers are always made with a rider.
        (ActorKind::Vehicle, 18 | 19) => Some(3),
        (ActorKind::Vehicle, _) => Some(if moves { 0 } else { 1 }),
        _ => None,
    }
}

/// Label of SemanticKITTI for a point: of the class, and of the body that it lies on, if any.
pub fn semantickitti(class: u8, body: Option<&Body>) -> u16 {
    let moves = body.is_some_and(|body| body.speed_mps() >= MOVING_MPS);
    let on_motorcycle = body.is_some_and(|body| body.class == 18);
    match (class, moves) {
        (13, false) if on_motorcycle => 32,
        (13, true) if on_motorcycle => 255,
        (_, false) => of(class).semantickitti,
        (_, true) => of(class).semantickitti_moving,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_category_of_coco_in_the_table_is_in_the_list() {
        for row in ROWS {
            if let Some(id) = row.coco {
                assert!(COCO.iter().any(|(known, ..)| *known == id), "{id}");
            }
            assert!(usize::from(row.lidarseg) < NUSCENES.len());
            assert!(row.kitti360 <= 44);
        }
        assert_eq!(of(200), &ROWS[0]);
    }
}
