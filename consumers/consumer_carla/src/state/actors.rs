//! Actors as clients see them: CARLA's actor structure.

use schema_frames::{ActorInfo, BodyBox};

use crate::list;
use crate::state::blueprints;
use crate::state::known_world::Known;
use crate::wire::axes;
use crate::wire::description::Description;
use crate::wire::msgpack::Value;
use crate::wire::sensor_kinds;
use crate::wire::streams;
use crate::wire::structures::bounding_box;

/// The box that clients know of an actor: for lights and signs their trigger volume, else the
/// body's box.
pub fn box_of(info: &ActorInfo) -> BodyBox {
    info.trigger_box
        .map_or(info.body_box, |trigger| axes::sign_box(&trigger))
}

/// The structure of an actor that the simulator lists.
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

/// The structure of an actor that a client of this gateway spawned and that is not listed yet: in a
/// stepped world it is listed with the next tick.
pub fn unlisted_actor(known: &Known, id: u32) -> Option<Value> {
    let own = known.own.get(&id)?;
    Some(new_actor(known, id, own.parent, &own.description))
}

/// The structure of an actor that was spawned a moment ago and is not listed yet.
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
    // The client takes only the stream's number from this token.
    let token = if sensor_kinds::kind(&description.type_id).is_some() {
        streams::token(streams::stream_of(id), 0)
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
