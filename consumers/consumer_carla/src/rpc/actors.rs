//! Calls about actors of any kind: their list, poses, velocities and boxes.

use schema_frames::Command;

use crate::gateway::Gateway;
use crate::rpc::batch_item::{Commands, Item};
use crate::rpc::call::{Call, Calls};
use crate::state::actors;
use crate::wire::axes::{self, Transform};
use crate::wire::fields::{Fields, Structures as _};
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};
use crate::wire::structures;

pub(crate) const CALLS: Calls = &[
    ("get_spectator", |gateway, _| spectator(gateway)),
    ("get_actors_by_id", actors_by_id),
    ("set_actor_location", set_location),
    ("set_actor_transform", set_transform),
    ("set_actor_target_velocity", set_velocity),
    ("get_actor_bounding_box", bounding_box),
    ("set_actor_autopilot", |gateway, call| {
        call.known_actor(gateway).map(|_| Answer::Void)
    }),
];

/// Commands of a batch for actors of any kind.
pub(crate) const BATCH: Commands = &[
    (6, |actor, fields| {
        Ok(Item::ask(
            actor,
            Command::SetPose {
                actor_id: actor,
                pose: axes::pose(&fields.transform()?).into(),
            },
        ))
    }),
    (8, |actor, fields| {
        let velocity_in_world_mps = axes::mirror(fields.vector()?);
        Ok(Item::ask(
            actor,
            Command::SetVelocity {
                actor_id: actor,
                velocity_in_world_mps,
            },
        ))
    }),
    (19, |actor, fields| {
        Ok(Item::Move {
            actor,
            location_m: fields.vector()?,
        })
    }),
    // `SetAutopilot`: the client itself registers the vehicle with its Traffic Manager.
    (16, |actor, _| Ok(Item::Nothing { actor, what: None })),
];

fn spectator(gateway: &Gateway) -> Outcome {
    let known = gateway.world.known();
    let found = known
        .actors
        .values()
        .find(|actor| actor.kind == "spectator")
        .and_then(|actor| actors::listed_actor(&known, actor.id));
    found
        .map(Answer::Value)
        .ok_or_else(|| Failure::Refused("the simulator has no spectator".to_owned()))
}

fn actors_by_id(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let ids = call.list()?;
    let mut fields = Fields::new("the ids", ids);
    let ids = (0..ids.len())
        .map(|_| fields.u32())
        .collect::<Result<Vec<u32>, _>>()?;
    let known = gateway.world.known();
    let actors: Vec<Value> = ids
        .into_iter()
        .filter_map(|id| {
            actors::listed_actor(&known, id).or_else(|| actors::unlisted_actor(&known, id))
        })
        .collect();
    Ok(Answer::Value(actors.into()))
}

fn set_transform(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (actor_id, transform) = (call.known_actor(gateway)?, call.transform()?);
    gateway.commander.tell(Command::SetPose {
        actor_id,
        pose: axes::pose(&transform).into(),
    });
    Ok(Answer::Void)
}

fn set_location(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (actor_id, location_m) = (call.known_actor(gateway)?, call.vector()?);
    gateway
        .commander
        .tell(place_at(gateway, actor_id, location_m));
    Ok(Answer::Void)
}

/// Moves an actor and keeps its rotation of the newest snapshot.
pub(crate) fn place_at(gateway: &Gateway, actor_id: u32, location_m: [f64; 3]) -> Command {
    let snapshot = gateway.world.known().snapshot.clone();
    let rotation_deg = snapshot.and_then(|at| {
        at.actor(actor_id)
            .map(|record| axes::transform(&record.world_from_actor).rotation_deg)
    });
    let transform = Transform {
        location_m,
        rotation_deg: rotation_deg.unwrap_or_default(),
    };
    Command::SetPose {
        actor_id,
        pose: axes::pose(&transform).into(),
    }
}

fn set_velocity(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (actor_id, velocity) = (call.known_actor(gateway)?, call.vector()?);
    gateway.commander.tell(Command::SetVelocity {
        actor_id,
        velocity_in_world_mps: axes::mirror(velocity),
    });
    Ok(Answer::Void)
}

/// Never fails: an error would end a client whose Traffic Manager asks for a vehicle that has just
/// gone.
fn bounding_box(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let id = call.u32()?;
    let known = gateway.world.known();
    let listed = known.actors.get(&id).map(actors::box_of);
    let own = || {
        known
            .own
            .get(&id)
            .and_then(|own| known.entry(&own.description.type_id))
            .map(|(_, entry)| entry.body_box)
    };
    Ok(Answer::Value(listed.or_else(own).map_or_else(
        || structures::no_box(id),
        |body| structures::bounding_box(&body, id),
    )))
}
