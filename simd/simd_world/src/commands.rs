//! Commands that change the world. Stepping, configuration, map loads and lockstep are the
//! daemon's.

use nalgebra::Vector3;
use schema_frames::{ActorKind, Command, CommandReply, LightState};
use schema_types::{ActorId, Pose};

use crate::spawn::unit_pose;
use crate::world::{ActorError, World};

impl World {
    /// Carries out a command; a refused one changes nothing.
    pub fn apply(&mut self, command: &Command) -> CommandReply {
        let done = |result: Result<(), String>| match result {
            Ok(()) => CommandReply::Done,
            Err(error) => CommandReply::Refused { error },
        };
        match command {
            Command::Spawn {
                type_id,
                pose,
                parent_id,
                role,
                attributes,
            } => {
                match self.spawn(
                    type_id,
                    Pose::from(*pose),
                    parent_id.map(ActorId),
                    role,
                    attributes,
                ) {
                    Ok(actor) => CommandReply::Spawned {
                        actor_id: actor.0,
                        topics: Vec::new(),
                    },
                    Err(error) => CommandReply::Refused {
                        error: error.to_string(),
                    },
                }
            }
            Command::Destroy { actor_id } => done(
                self.destroy(ActorId(*actor_id))
                    .map(drop)
                    .map_err(|error| error.to_string()),
            ),
            Command::SetPose { actor_id, pose } => done(
                self.set_pose(ActorId(*actor_id), (*pose).into())
                    .map_err(text),
            ),
            Command::SetVelocity {
                actor_id,
                velocity_in_world_mps,
            } => done(
                self.set_velocity(ActorId(*actor_id), *velocity_in_world_mps)
                    .map_err(text),
            ),
            Command::ControlVehicle { actor_id, control } => {
                let result = self.set_control(ActorId(*actor_id), *control);
                self.refresh_actor(ActorId(*actor_id));
                done(result.map_err(text))
            }
            Command::Skeleton { actor_id, action } => {
                self.act_on_skeleton(ActorId(*actor_id), action)
            }
            Command::Physics { actor_id, action } => self.act(ActorId(*actor_id), action),
            Command::ControlWalker { actor_id, control } => done(
                self.control_walker(ActorId(*actor_id), *control)
                    .map_err(text),
            ),
            Command::LeadWalker {
                actor_id,
                ground_point_m,
                yaw_rad,
                speed_mps,
            } => done(
                self.lead_walker(ActorId(*actor_id), *ground_point_m, *yaw_rad, *speed_mps)
                    .map_err(text),
            ),
            Command::SetLamps { actor_id, lamps } => {
                let result = self.set_lamps(ActorId(*actor_id), *lamps);
                self.refresh_actor(ActorId(*actor_id));
                done(result.map_err(text))
            }
            Command::SetDoors {
                actor_id,
                doors,
                open,
            } => done(
                self.set_doors(ActorId(*actor_id), *doors, *open)
                    .map_err(text),
            ),
            Command::SetTrafficLight { actor_id, state } => {
                done(self.set_traffic_light(ActorId(*actor_id), state))
            }
            Command::FreezeTrafficLights { frozen } => {
                self.lights.frozen = *frozen;
                self.refresh_records(None);
                CommandReply::Done
            }
            Command::SetTrafficLightTime {
                actor_id,
                state,
                secs,
            } => done(self.set_light_time(ActorId(*actor_id), state, *secs)),
            Command::ResetTrafficLights { actor_id } => {
                done(self.reset_lights(actor_id.map(ActorId)))
            }
            Command::LightBoxes { actor_id } => match self.light_boxes(ActorId(*actor_id)) {
                Ok(boxes) => CommandReply::Boxes { boxes },
                Err(error) => CommandReply::Refused { error },
            },
            Command::Scenery => self.scenery_reply(),
            Command::ShowObjects { object_ids, shown } => {
                done(self.show_objects(object_ids, *shown))
            }
            Command::ShowLayers { layers, shown } => {
                self.show_layers(*layers, *shown);
                CommandReply::Done
            }
            Command::SetSceneryLamps { changes } => done(self.set_scenery_lamps(changes)),
            Command::SetLampCycle { on } => {
                self.set_lamp_cycle(*on);
                CommandReply::Done
            }
            Command::SetWeather { weather } => done(self.set_weather(*weather)),
            Command::SetWeatherEffects { on } => {
                self.set_weather_effects(*on);
                CommandReply::Done
            }
            Command::Ping
            | Command::Step { .. }
            | Command::Configure { .. }
            | Command::SpawnSensor { .. }
            | Command::LoadMap { .. }
            | Command::ListMaps
            | Command::StoreMap(_)
            | Command::JoinLockstep { .. }
            | Command::LeaveLockstep { .. }
            | Command::SaveCheckpoint { .. }
            | Command::RestoreCheckpoint { .. }
            | Command::Reset
            | Command::CastRays { .. }
            | Command::DrawDebug { .. }
            | Command::ClearDebug
            | Command::Counters => CommandReply::Refused {
                error: "this command is for the daemon, not for the world".to_owned(),
            },
        }
    }

    /// Puts an actor somewhere in the world; a vehicle keeps its velocity, an attached sensor rides
    /// on from there.
    pub fn set_pose(&mut self, actor: ActorId, pose: Pose) -> Result<(), ActorError> {
        let pose = unit_pose(pose, self.map.origin_m).map_err(|problem| ActorError::Value {
            actor,
            what: "pose",
            problem,
        })?;
        let known = self.actors.get(&actor).ok_or(ActorError::Unknown(actor))?;
        let type_id = &self.catalogue.entries[known.catalogue_idx as usize].type_id;
        if type_id.starts_with("traffic.") {
            return Err(ActorError::WrongKind {
                actor,
                type_id: type_id.clone(),
                needed: "vehicle, walker, prop, sensor or the spectator",
            });
        }
        if let Some(vehicle) = self.vehicles.get_mut(&actor) {
            vehicle.set_pose(&mut self.physics, &pose.isometry());
        }
        let is_walker = World::is_walker(known.kind);
        if is_walker {
            self.put_walker(actor, &pose);
        }
        self.put_prop(actor, &pose);
        let known = &self.actors[&actor];
        let parent = known.parent.and_then(|parent| self.sensor_pose(parent));
        let local = parent.map_or(pose, |world_from_parent| {
            world_from_parent.inv_mul(&pose.isometry()).into()
        });
        if let Some(known) = self.actors.get_mut(&actor) {
            known.pose = local;
        }
        if self
            .actors
            .get(&actor)
            .is_some_and(|known| known.kind == ActorKind::Prop)
        {
            self.refresh_friction();
        }
        match self.vehicles.contains_key(&actor) {
            true => self.refresh_actor(actor),
            // The mount of what is attached stands in the list of actors.
            false => self.changed(),
        }
        Ok(())
    }

    /// Gives a vehicle's origin a velocity; at most 300 m/s.
    pub fn set_velocity(
        &mut self,
        actor: ActorId,
        velocity_in_world_mps: [f64; 3],
    ) -> Result<(), ActorError> {
        let velocity = Vector3::from(velocity_in_world_mps);
        if !velocity.norm().is_finite() || velocity.norm() > 300.0 {
            return Err(ActorError::Value {
                actor,
                what: "velocity",
                problem: "must be finite and at most 300 m/s",
            });
        }
        self.act_on(actor, |vehicle, physics| {
            vehicle.set_velocity(physics, &velocity)
        })?;
        self.refresh_actor(actor);
        Ok(())
    }

    fn set_traffic_light(&mut self, actor: ActorId, state: &str) -> Result<(), String> {
        let state = light_state(state)?;
        if !self.lights.set_state(actor, state) {
            return Err(self.no_light(actor));
        }
        self.refresh_records(None);
        Ok(())
    }

    fn set_light_time(&mut self, actor: ActorId, state: &str, secs: f64) -> Result<(), String> {
        let state = light_state(state)?;
        if self.lights.get(actor).is_none() {
            return Err(self.no_light(actor));
        }
        self.lights.set_time(actor, state, secs)?;
        self.refresh_records(None);
        Ok(())
    }

    fn reset_lights(&mut self, of: Option<ActorId>) -> Result<(), String> {
        match of {
            None => self.lights.reset_all(),
            Some(actor) => {
                let group = self
                    .lights
                    .get(actor)
                    .map(|light| light.group)
                    .ok_or_else(|| self.no_light(actor))?;
                self.lights.reset_group(group);
            }
        }
        self.refresh_records(None);
        Ok(())
    }

    fn no_light(&self, actor: ActorId) -> String {
        match self.actors.contains_key(&actor) {
            true => format!("actor {actor} is not a traffic light"),
            false => ActorError::Unknown(actor).to_string(),
        }
    }
}

fn light_state(name: &str) -> Result<LightState, String> {
    LightState::from_name(name)
        .ok_or_else(|| format!("state is {name:?}, but must be red, yellow, green, off or unknown"))
}

pub(crate) fn text(error: ActorError) -> String {
    error.to_string()
}
