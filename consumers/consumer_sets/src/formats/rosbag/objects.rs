//! Objects of the world as the detections of a bag.

use consumer_forms::ros2::world::Detection3d;
use consumer_truth::Body;
use consumer_truth::ticks::World;
use nalgebra::Isometry3;
use schema_frames::{ActorKind, ActorRecord};
use schema_types::Class;

/// The boxes of vehicles, walkers and props.
pub fn of_world(world: &World) -> Vec<Detection3d> {
    let is_solid = |record: &&ActorRecord| {
        let kinds = [ActorKind::Vehicle, ActorKind::Walker, ActorKind::Prop];
        kinds.iter().any(|kind| *kind as u16 == record.kind)
            && record.half_box_m.iter().all(|half| *half > 0.0)
    };
    let detection = |record: &ActorRecord| {
        let centre = world
            .actors
            .by_id
            .get(&record.id)
            .map_or([0.0; 3], |actor| actor.body_box.centre_m.map(f64::from));
        let at = record.world_from_actor.isometry()
            * Isometry3::translation(centre[0], centre[1], centre[2]);
        let size_m = record.half_box_m.map(|half| 2.0 * f64::from(half));
        sure(record.class, record.id, at, size_m)
    };
    world
        .records
        .iter()
        .filter(is_solid)
        .map(detection)
        .collect()
}

/// The box of a vehicle or person that belongs to the map.
pub fn of_body(body: &Body) -> Detection3d {
    sure(body.class, body.id, body.world_from_box, body.size_m())
}

/// A detection that is certain.
fn sure(class: u8, id: u32, at: Isometry3<f64>, size_m: [f64; 3]) -> Detection3d {
    Detection3d {
        class: Class(class).info().map_or("Unlabeled", |it| it.name).into(),
        score: 1.0,
        id,
        pose: at.into(),
        size_m,
    }
}
