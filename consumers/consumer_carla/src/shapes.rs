//! CARLA's structures as msgpack values.

use schema_frames::{ActorInfo, BodyBox, PosedBox};

use crate::axes::{self, Transform};
use crate::blueprints;
use crate::fields::Description;
use crate::list;
use crate::msgpack::Value;
use crate::sensors;
use crate::stream;
use crate::world::Known;

fn vector([x, y, z]: [f64; 3]) -> Value {
    list![x as f32, y as f32, z as f32]
}

/// `[[x, y, z], [pitch, yaw, roll]]`.
pub fn transform(transform: &Transform) -> Value {
    list![vector(transform.location_m), vector(transform.rotation_deg)]
}

/// A box in its actor's space.
pub fn bounding_box(body: &BodyBox, actor: u32) -> Value {
    let [x, y, z] = axes::mirror(body.centre_m).map(|metres| metres + 0.0);
    let [half_x, half_y, half_z] = body.half_m;
    list![
        list![x, y, z],
        list![half_x, half_y, half_z],
        list![0.0f32, 0.0f32, 0.0f32],
        actor
    ]
}

/// A box in the world.
pub fn posed_box(posed: &PosedBox) -> Value {
    let [pitch, yaw, roll] = axes::transform(&posed.pose.into()).rotation_deg;
    list![
        vector(axes::mirror(posed.pose.translation_m)),
        vector(posed.half_m),
        vector([pitch, yaw, roll]),
        0u32
    ]
}

/// The box that clients know of an actor: its body's, or of lights and signs the trigger volume.
pub fn box_of(info: &ActorInfo) -> BodyBox {
    info.trigger_box
        .map_or(info.body_box, |trigger| axes::sign_box(&trigger))
}

/// The box of an actor that is not there.
pub fn no_box(actor: u32) -> Value {
    bounding_box(
        &BodyBox {
            centre_m: [0.0; 3],
            half_m: [0.0; 3],
        },
        actor,
    )
}

/// An actor that the simulator lists.
pub fn listed_actor(known: &Known, id: u32) -> Option<Value> {
    let info: &ActorInfo = known.actors.get(&id)?;
    let entry = known.entry(&info.type_id);
    let described = known
        .own
        .get(&id)
        .map(|own| own.description.clone())
        .unwrap_or_else(|| blueprints::describe(info, entry.map(|(_, entry)| entry)));
    Some(actor(known, id, info.parent_id, &described, &box_of(info)))
}

/// An actor that was spawned a moment ago.
pub fn new_actor(known: &Known, id: u32, parent: u32, description: &Description) -> Value {
    let no_body = BodyBox {
        centre_m: [0.0; 3],
        half_m: [0.0; 3],
    };
    let body = known
        .entry(&description.type_id)
        .map_or(no_body, |(_, entry)| entry.body_box);
    actor(known, id, parent, description, &body)
}

/// What stands for scenery in events.
pub fn scenery(type_id: &str, class: u8) -> Value {
    list![
        0u32,
        0u32,
        list![0u32, type_id, Value::Array(Vec::new())],
        no_box(0),
        Value::Bin(vec![class]),
        Value::Bin(Vec::new())
    ]
}

fn actor(known: &Known, id: u32, parent: u32, description: &Description, body: &BodyBox) -> Value {
    let attributes: Vec<Value> = description
        .attributes
        .iter()
        .map(|attribute| {
            list![
                attribute.name.as_str(),
                attribute.kind,
                attribute.value.as_str()
            ]
        })
        .collect();
    let (uid, tags) = match known.entry(&description.type_id) {
        Some((idx, entry)) if entry.class != 0 => (idx as u32 + 1, vec![entry.class]),
        Some((idx, _)) => (idx as u32 + 1, vec![]),
        None => (0, vec![]),
    };
    let described = list![uid, description.type_id.as_str(), attributes];
    // The client takes only the stream's number from here.
    let token = if sensors::kind(&description.type_id).is_some() {
        stream::token(sensors::stream_of(id), 0)
    } else {
        Vec::new()
    };
    list![
        id,
        parent,
        described,
        bounding_box(body, id),
        Value::Bin(tags),
        Value::Bin(token)
    ]
}
