//! Calls that are accepted without effect, because Gantry has nothing that they could change. Each
//! is logged once.

use crate::gateway::Gateway;
use crate::list;
use crate::rpc::call::{Call, Calls};
use crate::wire::axes::{self, Transform};
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};
use crate::wire::streams;
use crate::wire::structures;

/// Numbers of streams without messages start here: below clients' world streams and above all
/// actors' streams.
const SILENT_STREAMS: u32 = 0x4000_0000;
/// Numbers reserved per camera; CARLA has 13 G-buffers.
const BUFFERS_OF_CAMERA: u32 = 16;

pub(crate) const CALLS: Calls = &[
    // Scenery.
    ("set_annotations_traverse_translucency", accept),
    ("apply_color_texture_to_objects", accept),
    ("apply_float_color_texture_to_objects", accept),
    // Parts of actors.
    ("set_actor_dead", accept),
    ("get_actor_component_world_transform", component_in_world),
    ("get_actor_component_relative_transform", |gateway, call| {
        call.known_actor(gateway)?;
        Ok(Answer::Value(structures::transform(&Transform::default())))
    }),
    ("get_actor_component_names", no_parts),
    ("get_actor_socket_names", no_parts),
    ("get_actor_socket_world_transforms", no_parts),
    ("get_actor_socket_relative_transforms", no_parts),
    // Other vehicle simulators.
    ("enable_carsim", accept),
    ("use_carsim_road", accept),
    ("enable_chrono_physics", accept),
    ("restore_physx_physics", accept),
    // Other outputs of sensors.
    ("enable_sensor_for_ros", accept),
    ("disable_sensor_for_ros", accept),
    ("is_sensor_enabled_for_ros", |_, _| {
        Ok(Answer::Value(false.into()))
    }),
    ("send", send_custom),
    ("enable_gbuffers", accept),
    ("are_gbuffers_enabled", |_, _| {
        Ok(Answer::Value(false.into()))
    }),
    ("get_gbuffer_token", |gateway, call| {
        let silent = silent_stream(call.u32()?, call.u32()?);
        Ok(Answer::Value(Value::Bin(streams::token(
            silent,
            gateway.stream_port,
        ))))
    }),
];

/// A stream of its own for each buffer: the client keeps streams by number, and a second one with
/// the same number would free the first while it connects.
fn silent_stream(camera: u32, buffer: u32) -> u32 {
    let number = camera
        .wrapping_mul(BUFFERS_OF_CAMERA)
        .wrapping_add(buffer % BUFFERS_OF_CAMERA);
    SILENT_STREAMS | number & (SILENT_STREAMS - 1)
}

fn accept(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    gateway.no_effect(call.method);
    Ok(Answer::Void)
}

/// Sends a text by radio.
fn send_custom(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let station = call.known_actor(gateway)?;
    gateway.v2x.send(station, call.text()?)?;
    Ok(Answer::Void)
}

/// Actors have no parts.
fn no_parts(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    call.known_actor(gateway)?;
    Ok(Answer::Value(list![]))
}

/// An actor's only component is the actor itself.
fn component_in_world(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let id = call.known_actor(gateway)?;
    let snapshot = gateway.world.known().snapshot.clone();
    let pose = snapshot.and_then(|at| {
        at.actor(id)
            .map(|record| axes::transform(&record.world_from_actor))
    });
    let pose = pose.ok_or_else(|| Failure::Refused(format!("actor {id} is in no snapshot yet")))?;
    Ok(Answer::Value(structures::transform(&pose)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_buffer_has_a_stream_of_its_own_that_is_no_world_stream() {
        let streams: std::collections::BTreeSet<u32> = (1..40)
            .flat_map(|camera| (0..13).map(move |buffer| silent_stream(camera, buffer)))
            .collect();
        assert_eq!(streams.len(), 39 * 13);
        assert!(
            [1, u32::MAX]
                .iter()
                .all(|camera| !streams::is_world(silent_stream(*camera, 12)))
        );
        assert!(
            streams
                .iter()
                .all(|number| !streams::is_world(*number) && *number > 1_000_000)
        );
    }
}
