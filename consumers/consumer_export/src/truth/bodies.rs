//! Bodies: actors with a box, as training sets describe them.

use nalgebra::{Isometry3, Translation3, Vector3};
use schema_frames::{ActorKind, ActorRecord, WalkerPart};

use crate::ticks::World;

/// An actor with a box.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Actor id; also in instance images and semantic clouds.
    pub id: u32,
    /// [`ActorKind::Vehicle`], [`ActorKind::Walker`] or [`ActorKind::Prop`].
    pub kind: ActorKind,
    /// Semantic class.
    pub class: u8,
    /// Catalogue id, e.g. `vehicle.tesla.model3`; empty if the recording has no list of actors.
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

/// All bodies of a world by rising id, without `carrier_id`, whose own sensors look out of it, and
/// without actors whose state was not finite.
pub fn bodies(world: &World, carrier_id: u32) -> Vec<Body> {
    let wanted = |record: &&ActorRecord| {
        let has_box = record
            .half_box_m
            .iter()
            .all(|half| half.is_finite() && *half > 0.0);
        record.id != carrier_id && has_box && record.flags & ActorRecord::QUARANTINED == 0
    };
    world
        .records
        .iter()
        .filter(wanted)
        .filter_map(|record| {
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
        })
        .collect()
}
