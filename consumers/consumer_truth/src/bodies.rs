//! Bodies: actors and cars of the map with a box, as training sets describe them.

use nalgebra::{Isometry3, Translation3, Vector3};
use schema_frames::{ActorKind, ActorRecord, WalkerPart};
use schema_recording::scenery::SceneryBox;
use schema_types::{ObjectId, Pose};

use crate::ticks::World;

/// An actor, or a thing of the map, with a box.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Actor id, or with bit 31 that of an object of the map; also in instance images and semantic
    /// clouds.
    pub id: u32,
    /// [`ActorKind::Vehicle`], [`ActorKind::Walker`] or [`ActorKind::Prop`].
    pub kind: ActorKind,
    /// Semantic class.
    pub class: u8,
    /// Catalogue id, e.g. `vehicle.tesla.model3`; empty if the recording has no list of actors. Of an
    /// object of the map its kind, e.g. `parked_car`.
    pub type_id: String,
    /// The catalogue's attribute `base_type` (`car`, `truck`, `van`, `bus`, …); else empty.
    pub base_type: String,
    /// The catalogue's attribute `special_type` (`emergency`, `taxi`, …); else empty.
    pub special_type: String,
    /// The catalogue's attribute `age` of a walker; else empty.
    pub age: String,
    /// Whether a walker sits in a wheelchair.
    pub is_seated: bool,
    /// Whether a walker lies on the ground.
    pub is_down: bool,
    /// Middle and axes of the box, x forward, in the world.
    pub world_from_box: Isometry3<f64>,
    /// Half of length, width and height, metres.
    pub half_m: Vector3<f64>,
    /// Velocity of the actor's origin in the world, m/s.
    pub velocity_mps: Vector3<f64>,
}

impl Body {
    /// The body of an object of the map; `None` if it is hidden, or neither a vehicle nor a person.
    pub fn of_scenery(object: &SceneryBox) -> Option<Body> {
        let kind = match object.class {
            12 => ActorKind::Walker,
            14..=19 => ActorKind::Vehicle,
            _ => return None,
        };
        let is_finite = |half: &f64| half.is_finite() && *half > 0.0;
        if !object.shown || !object.box_half_m.iter().all(is_finite) {
            return None;
        }
        let kind_of_thing = object.name.trim_end_matches(|c: char| c.is_ascii_digit());
        Some(Body {
            id: object.id,
            kind,
            class: object.class,
            type_id: kind_of_thing.trim_end_matches('_').to_owned(),
            base_type: String::new(),
            special_type: String::new(),
            age: String::new(),
            is_seated: false,
            is_down: false,
            world_from_box: Pose::from(object.box_pose).isometry(),
            half_m: Vector3::from(object.box_half_m),
            velocity_mps: Vector3::zeros(),
        })
    }

    /// Whether it is an object of the map, which never moves.
    pub fn is_scenery(&self) -> bool {
        ObjectId(self.id).is_scenery()
    }

    /// Length, width and height, metres.
    pub fn size_m(&self) -> [f64; 3] {
        (self.half_m * 2.0).into()
    }

    /// The box's corners in the world: bit 0 of the index is +x, bit 1 +y, bit 2 +z.
    pub fn corners_in_world_m(&self) -> [nalgebra::Point3<f64>; 8] {
        std::array::from_fn(|i| {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let corner = self
                .half_m
                .component_mul(&Vector3::new(sign(0), sign(1), sign(2)));
            self.world_from_box * nalgebra::Point3::from(corner)
        })
    }

    /// Speed over ground, m/s.
    pub fn speed_mps(&self) -> f64 {
        self.velocity_mps.norm()
    }
}

/// All bodies of a world by rising id, those of the map behind the actors, without `carrier_id`, whose own sensors look out of it, and
/// without actors whose state was not finite.
pub fn bodies(world: &World, carrier_id: u32) -> Vec<Body> {
    let wanted = |record: &&ActorRecord| {
        let has_box = record
            .half_box_m
            .iter()
            .all(|half| half.is_finite() && *half > 0.0);
        record.id != carrier_id && has_box && record.flags & ActorRecord::QUARANTINED == 0
    };
    let actors = world.records.iter().filter(wanted).filter_map(|record| {
        let kind = record.kind().filter(|kind| {
            matches!(
                kind,
                ActorKind::Vehicle | ActorKind::Walker | ActorKind::Prop
            )
        })?;
        let info = world.actors.by_id.get(&record.id);
        let attribute = |name: &str| {
            let value = info.and_then(|info| info.attributes.get(name));
            value.cloned().unwrap_or_default()
        };
        let centre_m = info.map_or([0.0; 3], |info| info.body_box.centre_m);
        let flags = record.walker().map_or(0, |walker| walker.flags);
        Some(Body {
            id: record.id,
            kind,
            class: record.class,
            type_id: info.map(|info| info.type_id.clone()).unwrap_or_default(),
            base_type: attribute("base_type"),
            special_type: attribute("special_type"),
            age: attribute("age"),
            is_seated: flags & WalkerPart::SEATED != 0,
            is_down: flags & WalkerPart::DOWN != 0,
            world_from_box: record.world_from_actor.isometry()
                * Translation3::from(centre_m.map(f64::from)),
            half_m: Vector3::from(record.half_box_m.map(f64::from)),
            velocity_mps: Vector3::from(record.velocity_in_world_mps),
        })
    });
    let of_map = world.scenery.iter().filter_map(Body::of_scenery);
    actors.chain(of_map).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parked_cars_are_bodies_and_poles_are_not() {
        let mut object = SceneryBox {
            id: 1 << 31 | 7,
            name: "parked_car_6".into(),
            class: 14,
            box_pose: Pose::default().into(),
            box_half_m: [2.0, 1.0, 0.8],
            shown: true,
        };
        let car = Body::of_scenery(&object).expect("a car");
        assert_eq!(car.kind, ActorKind::Vehicle);
        assert_eq!(car.type_id, "parked_car");
        assert_eq!(car.size_m(), [4.0, 2.0, 1.6]);
        assert!(car.is_scenery() && car.speed_mps() == 0.0);
        object.shown = false;
        assert_eq!(Body::of_scenery(&object), None);
        (object.shown, object.class) = (true, 6);
        assert_eq!(Body::of_scenery(&object), None);
    }
}
