//! Calls about actors of any kind: who is there, where, how fast, how large.

use schema_frames::Command;
use schema_frames::document::PoseText;

use crate::axes::{self, Transform};
use crate::fields::Fields;
use crate::gateway::{Answer, Failure, Gateway, Outcome};
use crate::msgpack::Value;
use crate::rpc::batch::{Commands, Item};
use crate::rpc::{Call, Calls};
use crate::shapes;

pub(crate) const CALLS: Calls = &[
    ("get_spectator", |gateway, _| gateway.spectator()),
    ("get_actors_by_id", Gateway::actors_by_id),
    ("set_actor_location", Gateway::set_location),
    ("set_actor_transform", Gateway::set_transform),
    ("set_actor_target_velocity", Gateway::set_velocity),
    ("get_actor_bounding_box", Gateway::bounding_box),
    ("set_actor_autopilot", |gateway, call| {
        gateway.known_actor(call).map(|_| Answer::Void)
    }),
];

/// A batch's commands about any actor.
pub(crate) const BATCH: Commands = &[
    (6, |actor, fields| {
        Ok(Item::ask(
            actor,
            Command::SetPose {
                actor_id: actor,
                pose: pose(&fields.transform()?),
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
    // The client itself registers the vehicle with its Traffic Manager.
    (16, |actor, _| Ok(Item::Nothing { actor, what: None })),
];

/// Our pose in a command.
pub(crate) fn pose(transform: &Transform) -> PoseText {
    axes::pose(transform).into()
}

impl Gateway {
    /// An actor id that exists.
    pub(crate) fn known_actor(&self, call: &mut Call<'_>) -> Result<u32, Failure> {
        let id = call.u32()?;
        if self.world.known().has_actor(id) {
            return Ok(id);
        }
        Err(Failure::Refused(format!(
            "actor {id} could not be found; it does not exist or was destroyed"
        )))
    }

    fn spectator(&self) -> Outcome {
        let known = self.world.known();
        let found = known
            .actors
            .values()
            .find(|actor| actor.kind == "spectator")
            .and_then(|actor| shapes::listed_actor(&known, actor.id));
        found
            .map(Answer::Value)
            .ok_or_else(|| Failure::Refused("the simulator has no spectator".to_owned()))
    }

    fn actors_by_id(&self, call: &mut Call<'_>) -> Outcome {
        let ids = call.list()?;
        let mut fields = Fields::new("the ids", ids);
        let ids = (0..ids.len())
            .map(|_| fields.u32())
            .collect::<Result<Vec<u32>, _>>()?;
        let known = self.world.known();
        let actors: Vec<Value> = ids
            .into_iter()
            .filter_map(|id| shapes::listed_actor(&known, id))
            .collect();
        Ok(Answer::Value(actors.into()))
    }

    fn set_transform(&self, call: &mut Call<'_>) -> Outcome {
        let (actor_id, transform) = (self.known_actor(call)?, call.transform()?);
        self.commander.tell(Command::SetPose {
            actor_id,
            pose: pose(&transform),
        });
        Ok(Answer::Void)
    }

    /// The rotation is that of the newest snapshot.
    fn set_location(&self, call: &mut Call<'_>) -> Outcome {
        let (actor_id, location_m) = (self.known_actor(call)?, call.vector()?);
        let snapshot = self.world.known().snapshot.clone();
        let rotation_deg = snapshot.and_then(|at| {
            at.actor(actor_id)
                .map(|record| axes::transform(&record.world_from_actor).rotation_deg)
        });
        let transform = Transform {
            location_m,
            rotation_deg: rotation_deg.unwrap_or_default(),
        };
        self.commander.tell(Command::SetPose {
            actor_id,
            pose: pose(&transform),
        });
        Ok(Answer::Void)
    }

    fn set_velocity(&self, call: &mut Call<'_>) -> Outcome {
        let (actor_id, velocity) = (self.known_actor(call)?, call.vector()?);
        self.commander.tell(Command::SetVelocity {
            actor_id,
            velocity_in_world_mps: axes::mirror(velocity),
        });
        Ok(Answer::Void)
    }

    /// Never an error: one would end a client whose Traffic Manager asks for a vehicle that has
    /// just gone.
    fn bounding_box(&self, call: &mut Call<'_>) -> Outcome {
        let id = call.u32()?;
        let known = self.world.known();
        let listed = known.actors.get(&id).map(shapes::box_of);
        let own = || {
            known
                .own
                .get(&id)
                .and_then(|own| known.entry(&own.description.type_id))
                .map(|(_, entry)| entry.body_box)
        };
        Ok(Answer::Value(listed.or_else(own).map_or_else(
            || shapes::no_box(id),
            |body| shapes::bounding_box(&body, id),
        )))
    }
}
