//! Calls about actors: who is there, making and removing them, moving vehicles, lamps and traffic lights.

use std::time::Duration;

use schema_frames::document::PoseText;
use schema_frames::{ActorKind, Command, CommandReply, LightState, StepMode, VehicleControlRecord};

use crate::axes::{self, Transform};
use crate::blueprints;
use crate::fields::{Description, Fields, Wrong};
use crate::gateway::{Answer, Failure, Gateway, Outcome};
use crate::list;
use crate::msgpack::Value;
use crate::shapes;

/// Longest wait for the first snapshot with a new actor in free-running mode.
const FIRST_SEEN: Duration = Duration::from_secs(2);
/// Lamps that exist; `VehicleLightState.All` has every bit.
pub(crate) const LAMPS: u32 = 0x7ff;

/// Our pose in a command.
pub(crate) fn pose(transform: &Transform) -> PoseText {
    axes::pose(transform).into()
}

/// The command that spawns, or why this type cannot be.
pub(crate) fn spawn_command(description: &Description, transform: &Transform, parent: Option<u32>) -> Result<Command, Wrong> {
    if !description.type_id.starts_with("vehicle.") {
        return Err(format!(
            "{:?} cannot be spawned through gantry-carla: only vehicles can; name sensors in the launch file and read them from shared memory",
            description.type_id
        ));
    }
    Ok(Command::Spawn {
        type_id: description.type_id.clone(),
        pose: pose(transform),
        parent_id: parent,
        role: description.attribute("role_name").unwrap_or_default().to_owned(),
        attributes: blueprints::settable(description),
    })
}

/// Name of CARLA's traffic-light state in commands.
pub(crate) fn light_name(state: u8) -> Result<String, Wrong> {
    match LightState::from_code(state.into()) {
        LightState::Unknown => Err(format!("traffic-light state is {state}, but must be 0 (red), 1 (yellow), 2 (green) or 3 (off)")),
        known => Ok(known.name().to_owned()),
    }
}

impl Gateway {
    pub(crate) fn actor_call(&self, method: &str, args: &mut Fields<'_>) -> Option<Outcome> {
        Some(match method {
            "get_spectator" => self.spectator(),
            "get_actors_by_id" => self.actors_by_id(args),
            "spawn_actor" => self.spawn(args, false),
            "spawn_actor_with_parent" => self.spawn(args, true),
            "destroy_actor" => self.destroy(args),
            "set_actor_location" => self.set_location(args),
            "set_actor_transform" => self.set_transform(args),
            "set_actor_target_velocity" => self.set_velocity(args),
            "get_actor_bounding_box" => self.bounding_box(args),
            "set_actor_simulate_physics" => self.simulate_physics(args),
            "set_actor_autopilot" => self.known_actor(args).map(|_| Answer::Void),
            "apply_control_to_vehicle" => self.apply_control(args),
            "get_vehicle_light_state" => self.vehicle_lamps(args),
            "set_vehicle_light_state" => self.set_vehicle_lamps(args),
            "get_vehicle_light_states" => Ok(Answer::Value(self.all_lamps())),
            "set_traffic_light_state" => self.set_traffic_light(args),
            "freeze_traffic_light" => args.u32().and_then(|_| args.bool()).map_err(Failure::from).and_then(|frozen| self.freeze(frozen)),
            "freeze_all_traffic_lights" => args.bool().map_err(Failure::from).and_then(|frozen| self.freeze(frozen)),
            "reset_all_traffic_lights" => {
                self.no_effect(method);
                Ok(Answer::Void)
            }
            "get_group_traffic_lights" => self.light_group(args),
            _ => return None,
        })
    }

    /// An actor id that exists.
    fn known_actor(&self, args: &mut Fields<'_>) -> Result<u32, Failure> {
        let id = args.u32()?;
        if self.world.known().has_actor(id) {
            return Ok(id);
        }
        Err(Failure::Refused(format!("actor {id} could not be found; it does not exist or was destroyed")))
    }

    fn spectator(&self) -> Outcome {
        let known = self.world.known();
        let found = known.actors.values().find(|actor| actor.kind == "spectator").and_then(|actor| shapes::listed_actor(&known, actor.id));
        found.map(Answer::Value).ok_or_else(|| Failure::Refused("the simulator has no spectator".to_owned()))
    }

    fn actors_by_id(&self, args: &mut Fields<'_>) -> Outcome {
        let ids = args.list()?;
        let mut fields = Fields::new("the ids", ids);
        let ids = (0..ids.len()).map(|_| fields.u32()).collect::<Result<Vec<u32>, _>>()?;
        let known = self.world.known();
        let actors: Vec<Value> = ids.into_iter().filter_map(|id| shapes::listed_actor(&known, id)).collect();
        Ok(Answer::Value(actors.into()))
    }

    fn spawn(&self, args: &mut Fields<'_>, has_parent: bool) -> Outcome {
        let (description, transform) = (args.description()?, args.transform()?);
        let parent = if has_parent { Some(args.u32()?) } else { None };
        let command = spawn_command(&description, &transform, parent)?;
        let (reply, _) = self.commander.ask_one(command)?;
        let CommandReply::Spawned { actor_id, .. } = reply else {
            return Err(Failure::Refused(format!("{reply:?} is no answer to a spawn")));
        };
        self.remember(actor_id, description.clone());
        self.wait_until_seen(actor_id);
        Ok(Answer::Value(shapes::new_actor(&self.world.known(), actor_id, parent.unwrap_or(0), &description)))
    }

    /// Keeps a client's own description of its actor.
    pub(crate) fn remember(&self, id: u32, description: Description) {
        self.world.change(|known| known.own.insert(id, description));
    }

    /// In free-running mode, waits for a snapshot with the actor: a Traffic Manager looks for it there.
    pub(crate) fn wait_until_seen(&self, id: u32) {
        let is_paced = |known: &crate::world::Known| known.info.as_ref().is_some_and(|info| info.mode == StepMode::FreeRunning);
        self.world.wait_for(FIRST_SEEN, |known| {
            let seen = known.snapshot.as_ref().is_some_and(|snapshot| snapshot.actor(id).is_some());
            (seen || !is_paced(known)).then_some(())
        });
    }

    fn destroy(&self, args: &mut Fields<'_>) -> Outcome {
        let actor_id = args.u32()?;
        self.commander.ask_one(Command::Destroy { actor_id })?;
        self.world.change(|known| known.own.remove(&actor_id));
        Ok(Answer::Value(true.into()))
    }

    fn set_transform(&self, args: &mut Fields<'_>) -> Outcome {
        let (actor_id, transform) = (self.known_actor(args)?, args.transform()?);
        self.commander.tell(Command::SetPose { actor_id, pose: pose(&transform) });
        Ok(Answer::Void)
    }

    /// The rotation is that of the newest snapshot.
    fn set_location(&self, args: &mut Fields<'_>) -> Outcome {
        let (actor_id, location_m) = (self.known_actor(args)?, args.vector()?);
        let snapshot = self.world.known().snapshot.clone();
        let rotation_deg = snapshot.and_then(|at| at.actor(actor_id).map(|record| axes::transform(&record.world_from_actor).rotation_deg));
        let transform = Transform { location_m, rotation_deg: rotation_deg.unwrap_or_default() };
        self.commander.tell(Command::SetPose { actor_id, pose: pose(&transform) });
        Ok(Answer::Void)
    }

    fn set_velocity(&self, args: &mut Fields<'_>) -> Outcome {
        let (actor_id, velocity) = (self.known_actor(args)?, args.vector()?);
        self.commander.tell(Command::SetVelocity { actor_id, velocity_in_world_mps: axes::mirror(velocity) });
        Ok(Answer::Void)
    }

    /// Never an error: one would end a client whose Traffic Manager asks for a vehicle that has just gone.
    fn bounding_box(&self, args: &mut Fields<'_>) -> Outcome {
        let id = args.u32()?;
        let known = self.world.known();
        let listed = known.actors.get(&id).map(|actor| actor.body_box);
        let own = || known.own.get(&id).and_then(|own| known.entry(&own.type_id)).map(|(_, entry)| entry.body_box);
        Ok(Answer::Value(listed.or_else(own).map_or_else(|| shapes::no_box(id), |body| shapes::bounding_box(&body, id))))
    }

    /// Never an error either, for the same reason.
    fn simulate_physics(&self, args: &mut Fields<'_>) -> Outcome {
        let (_, enabled) = (args.u32()?, args.bool()?);
        if !enabled {
            self.no_effect("set_simulate_physics(False)");
        }
        Ok(Answer::Void)
    }

    fn apply_control(&self, args: &mut Fields<'_>) -> Outcome {
        let (actor_id, control) = (self.known_actor(args)?, args.vehicle_control()?);
        self.commander.control(vec![VehicleControlRecord::new(actor_id, control)]);
        Ok(Answer::Void)
    }

    fn vehicle_lamps(&self, args: &mut Fields<'_>) -> Outcome {
        let id = self.known_actor(args)?;
        let snapshot = self.world.known().snapshot.clone();
        let lamps = snapshot.and_then(|at| at.actor(id)?.vehicle()).map_or(0, |part| part.lamps);
        Ok(Answer::Value(list![lamps]))
    }

    fn set_vehicle_lamps(&self, args: &mut Fields<'_>) -> Outcome {
        let (actor_id, lamps) = (self.known_actor(args)?, args.fields("a light state")?.u32()?);
        self.commander.tell(Command::SetLamps { actor_id, lamps: lamps & LAMPS });
        Ok(Answer::Void)
    }

    fn all_lamps(&self) -> Value {
        let snapshot = self.world.known().snapshot.clone();
        let records = snapshot.iter().flat_map(|snapshot| &snapshot.records);
        Value::Array(records.filter_map(|record| Some(list![record.id, record.vehicle()?.lamps])).collect())
    }

    fn set_traffic_light(&self, args: &mut Fields<'_>) -> Outcome {
        let (actor_id, state) = (self.known_actor(args)?, light_name(args.u8()?)?);
        self.commander.tell(Command::SetTrafficLight { actor_id, state });
        Ok(Answer::Void)
    }

    fn freeze(&self, frozen: bool) -> Outcome {
        self.commander.tell(Command::FreezeTrafficLights { frozen });
        Ok(Answer::Void)
    }

    fn light_group(&self, args: &mut Fields<'_>) -> Outcome {
        let id = self.known_actor(args)?;
        let snapshot = self.world.known().snapshot.clone();
        let group = snapshot.as_ref().and_then(|at| at.actor(id)?.traffic_light()).map(|part| part.group);
        let group = group.ok_or_else(|| Failure::Refused(format!("actor {id} is not a traffic light")))?;
        let lights = snapshot.iter().flat_map(|at| &at.records).filter(|record| record.kind() == Some(ActorKind::TrafficLight));
        let members = lights.filter(|record| record.traffic_light().is_some_and(|part| part.group == group));
        Ok(Answer::Value(Value::Array(members.map(|record| record.id.into()).collect())))
    }
}
