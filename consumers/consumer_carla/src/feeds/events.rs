//! Event sensors (collision, obstacle): each event becomes one message.

use schema_bus::Frame;
use schema_frames::{CollisionEvent, Modality, ObstacleEvent};
use schema_types::Class;

use crate::list;
use crate::state::actors;
use crate::state::known_world::Known;
use crate::wire::axes;
use crate::wire::msgpack::{self, Value};
use crate::wire::structures;

/// The message bodies for the events of a frame; `None` if the frame is no event sensor's.
pub fn bodies(known: &Known, frame: &Frame) -> Option<Vec<Vec<u8>>> {
    let owner = frame.header().parent_id;
    let bytes = |value: Value| {
        let mut out = Vec::new();
        msgpack::write(&mut out, &value);
        out
    };
    match frame.modality() {
        Modality::Collision => Some(
            frame
                .elements::<CollisionEvent>()?
                .iter()
                .map(|event| bytes(collision(known, owner, event)))
                .collect(),
        ),
        Modality::Obstacle => Some(
            frame
                .elements::<ObstacleEvent>()?
                .iter()
                .map(|event| bytes(obstacle(known, owner, event)))
                .collect(),
        ),
        _ => None,
    }
}

/// The sensor's carrier, the body that it touched, and the impulse on the carrier.
fn collision(known: &Known, owner: u32, event: &CollisionEvent) -> Value {
    let [x, y, z] = axes::mirror(event.impulse_in_world_ns).map(|newton_secs| newton_secs as f32);
    list![
        touched(known, owner, 0),
        touched(known, event.other_id, event.class),
        list![x, y, z]
    ]
}

/// The sensor's carrier, the body ahead of it, and the distance to that body.
fn obstacle(known: &Known, owner: u32, event: &ObstacleEvent) -> Value {
    list![
        touched(known, owner, 0),
        touched(known, event.object_id, event.class),
        event.distance_m
    ]
}

/// An actor's structure, or for scenery a placeholder with id 0 and a name by its class.
fn touched(known: &Known, id: u32, class: u8) -> Value {
    actors::listed_actor(known, id)
        .unwrap_or_else(|| structures::scenery(&scenery_type(class), class))
}

/// `static.` followed by the class's name in lower case and singular.
fn scenery_type(class: u8) -> String {
    let name = Class(class)
        .info()
        .filter(|_| class != Class::UNLABELED.0)
        .map_or("unknown", |info| info.name);
    let name: String = name
        .chars()
        .filter(char::is_ascii_alphanumeric)
        .collect::<String>()
        .to_ascii_lowercase();
    format!(
        "static.{}",
        name.strip_suffix('s')
            .filter(|_| name != "grass")
            .unwrap_or(&name)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenery_is_named_as_scripts_expect() {
        for (class, name) in [
            (1, "static.road"),
            (3, "static.building"),
            (4, "static.wall"),
            (6, "static.pole"),
            (0, "static.unknown"),
            (9, "static.vegetation"),
            (28, "static.guardrail"),
        ] {
            assert_eq!(scenery_type(class), name);
        }
    }
}
