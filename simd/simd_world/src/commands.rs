//! Changes to a world between steps, by method or by command.

use schema_frames::document::{TopicInfo, Weather};
use schema_frames::{
    ActorKind, Attachment, Command, CommandReply, LightState, PhysicsAction, PhysicsAnswer,
    PosedBox, SkeletonAction, VehicleControl, VehiclePhysics, WalkerControl,
};
use schema_types::{ActorId, Pose};

use crate::errors::{ActionError, ActorError, LightError, OutOfRange};
use crate::pose_check::unit_pose;
use crate::pushes::Push;
use crate::signals::lamp_head_boxes;
use crate::vehicles;
use crate::walkers::{self, Lead};
use crate::world::World;

impl World {
    /// Puts an actor somewhere in the world; a vehicle keeps its velocity, an attached actor stays
    /// attached at its new place.
    pub fn set_pose(&mut self, actor: ActorId, pose: Pose) -> Result<(), ActorError> {
        let pose = unit_pose(pose, self.map.origin_m).map_err(|problem| ActorError::Value {
            actor,
            what: "pose",
            problem,
        })?;
        let known = self.actors.get_mut(actor)?;
        let type_id = known.type_id(&self.catalogue);
        if type_id.starts_with("traffic.") {
            return Err(ActorError::WrongKind {
                actor,
                type_id: type_id.clone(),
                needed: "vehicle, walker, prop, sensor or the spectator",
            });
        }
        // What the engine does not move is moved by commands: their way is its motion.
        let prop = self.props.get(actor);
        let mut is_moved_by_engine = prop.is_some_and(|prop| prop.is_simulated);
        if let Some(vehicle) = self.vehicles.by_id.get_mut(&actor) {
            is_moved_by_engine = vehicle.switches.simulated;
            vehicle.set_pose(&mut self.physics, &pose.isometry());
        }
        if let Some(walker) = self.walkers.by_id.get_mut(&actor) {
            is_moved_by_engine = walker.simulated;
            walker.put_middle(&pose);
        }
        if is_moved_by_engine {
            self.jumps.note(actor);
        }
        self.props.set_pose(actor, &pose, &mut self.physics);
        let parent = known.parent.and_then(|parent| self.records.get(parent));
        known.pose = parent.map_or(pose, |parent| {
            let world_from_parent = parent.world_from_actor.isometry();
            world_from_parent.inv_mul(&pose.isometry()).into()
        });
        if known.kind == ActorKind::Prop {
            self.friction.refresh(&self.actors, &self.catalogue);
        }
        match self.vehicles.by_id.contains_key(&actor) {
            true => self.refresh_actor(actor),
            // The actor list contains the mount of an attached actor.
            false => self.actors_changed(),
        }
        Ok(())
    }

    /// Gives the origin of a vehicle, a walker or a prop that the engine moves a velocity; at most
    /// 300 m/s.
    pub fn set_velocity(
        &mut self,
        actor: ActorId,
        velocity_in_world_mps: [f64; 3],
    ) -> Result<(), ActorError> {
        let push = Push::velocity(actor, velocity_in_world_mps)?;
        if !self.push(actor, push) {
            vehicles::set_velocity(self.body(actor), velocity_in_world_mps)?;
        }
        self.refresh_actor(actor);
        Ok(())
    }

    /// Holds a vehicle's control until it is replaced. Values out of range are clamped; what is not
    /// finite counts as 0.
    pub fn set_control(
        &mut self,
        actor: ActorId,
        control: VehicleControl,
    ) -> Result<(), ActorError> {
        self.body(actor).vehicle?.set_control(control);
        Ok(())
    }

    /// Holds a walker's control until it is replaced.
    ///
    /// # Errors
    /// [`ActorError`] for another kind of actor and for numbers that cannot be used.
    pub fn control_walker(
        &mut self,
        actor: ActorId,
        control: WalkerControl,
    ) -> Result<(), ActorError> {
        walkers::check_control(actor, &control)?;
        self.walker_mut(actor)?.hold_control(control);
        self.refresh_records(None);
        Ok(())
    }

    /// Sets a vehicle's lamps, bits as in `VehiclePart::lamps`.
    pub fn set_lamps(&mut self, actor: ActorId, lamps: u32) -> Result<(), ActorError> {
        self.body(actor).vehicle?.lamps = lamps & 0x7ff;
        Ok(())
    }

    /// Replaces a vehicle's physical data.
    ///
    /// # Errors
    /// A sentence that names the value and what is allowed.
    pub fn set_vehicle_physics(
        &mut self,
        actor: ActorId,
        data: &VehiclePhysics,
    ) -> Result<(), ActionError> {
        let body = self.body(actor);
        vehicles::set_physics(body.vehicle?, body.physics, data)
    }

    /// Sets a sensor's topics for `world/actors`.
    pub fn set_topics(&mut self, actor: ActorId, topics: Vec<TopicInfo>) -> Result<(), ActorError> {
        self.actors.get_mut(actor)?.topics = topics;
        self.counts.actors_revision += 1;
        Ok(())
    }

    /// Sets how an attached actor follows its parent. Without a parent only `rigid` is allowed.
    pub fn set_attachment(
        &mut self,
        actor: ActorId,
        attachment: Attachment,
    ) -> Result<(), ActorError> {
        self.booms.attach(self.actors.get(actor)?, attachment)?;
        self.refresh_records(None);
        Ok(())
    }

    /// Changes the weather.
    ///
    /// # Errors
    /// If a value lies outside its range.
    pub fn set_weather(&mut self, weather: Weather) -> Result<(), OutOfRange> {
        self.weather.set(weather)
    }

    /// Sets whether weather acts on tyres and lidar. It does not by default, as in CARLA, where it
    /// is only visible.
    pub fn set_weather_effects(&mut self, on: bool) {
        self.weather.acts = on;
    }

    /// Carries out a command; a refused one changes nothing. Commands for the daemon (time, maps,
    /// sensors, lockstep, checkpoints) are refused.
    pub fn apply(&mut self, command: &Command) -> CommandReply {
        match command {
            Command::Spawn {
                type_id,
                pose,
                parent_id,
                role,
                attributes,
            } => {
                let parent = parent_id.map(ActorId);
                match self.spawn(type_id, Pose::from(*pose), parent, role, attributes) {
                    Ok(actor) => CommandReply::Spawned {
                        actor_id: actor.0,
                        topics: Vec::new(),
                    },
                    Err(error) => refused(error),
                }
            }
            Command::Destroy { actor_id } => done(self.destroy(ActorId(*actor_id)).map(drop)),
            Command::SetPose { actor_id, pose } => {
                done(self.set_pose(ActorId(*actor_id), (*pose).into()))
            }
            Command::SetVelocity {
                actor_id,
                velocity_in_world_mps,
            } => done(self.set_velocity(ActorId(*actor_id), *velocity_in_world_mps)),
            Command::ControlVehicle { actor_id, control } => {
                let result = self.set_control(ActorId(*actor_id), *control);
                self.refresh_actor(ActorId(*actor_id));
                done(result)
            }
            Command::Skeleton { actor_id, action } => {
                self.act_on_skeleton(ActorId(*actor_id), action)
            }
            Command::Physics { actor_id, action } => {
                let actor = ActorId(*actor_id);
                match self.act_on_body(actor, action) {
                    Ok(None) => {
                        self.refresh_actor(actor);
                        CommandReply::Done
                    }
                    Ok(Some(answer)) => CommandReply::Physics { answer },
                    Err(error) => refused(error),
                }
            }
            Command::ControlWalker { actor_id, control } => {
                done(self.control_walker(ActorId(*actor_id), *control))
            }
            Command::LeadWalker {
                actor_id,
                ground_point_m,
                yaw_rad,
                speed_mps,
            } => {
                let lead = Lead {
                    ground_point_m: *ground_point_m,
                    yaw_rad: *yaw_rad,
                    speed_mps: *speed_mps,
                };
                done(self.lead_walker(ActorId(*actor_id), &lead))
            }
            Command::SetLamps { actor_id, lamps } => {
                let result = self.set_lamps(ActorId(*actor_id), *lamps);
                self.refresh_actor(ActorId(*actor_id));
                done(result)
            }
            Command::SetDoors {
                actor_id,
                doors,
                open,
            } => done(vehicles::set_doors(
                self.body(ActorId(*actor_id)),
                *doors,
                *open,
            )),
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
                Err(error) => refused(error),
            },
            Command::Scenery => self.scenery.reply(&self.map, &self.weather.now),
            Command::ShowObjects { object_ids, shown } => {
                done(
                    self.scenery
                        .show_objects(object_ids, *shown, &self.map, &mut self.physics),
                )
            }
            Command::ShowLayers { layers, shown } => {
                self.scenery
                    .show_layers(*layers, *shown, &self.map, &mut self.physics);
                CommandReply::Done
            }
            Command::SetSceneryLamps { changes } => {
                done(self.scenery.set_lamps(changes, &self.map))
            }
            Command::SetLampCycle { on } => {
                self.scenery.set_lamp_cycle(*on);
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
            | Command::SetSpeed { .. }
            | Command::Seek { .. }
            | Command::SaveCheckpoint { .. }
            | Command::RestoreCheckpoint { .. }
            | Command::Reset
            | Command::CastRays { .. }
            | Command::DrawDebug { .. }
            | Command::ClearDebug { .. }
            | Command::ShowTelemetry { .. }
            | Command::HideActors { .. }
            | Command::Counters
            | Command::Journal { .. } => {
                refused("this command is for the daemon, not for the world")
            }
        }
    }

    /// Pushes a walker or a prop; false if the actor is neither.
    fn push(&mut self, actor: ActorId, push: Push) -> bool {
        if let Some(walker) = self.walkers.by_id.get_mut(&actor) {
            walker.take(push);
        } else if let Some(prop) = self.props.get_mut(actor) {
            prop.take(push, &mut self.physics);
        } else {
            return false;
        }
        true
    }

    /// Acts on an actor's body.
    fn act_on_body(
        &mut self,
        actor: ActorId,
        action: &PhysicsAction,
    ) -> Result<Option<PhysicsAnswer>, ActionError> {
        use PhysicsAction::{SetCollisions, SetGravity, SetSimulated};
        if let Some(push) = Push::of(actor, action)?
            && self.push(actor, push)
        {
            return Ok(None);
        }
        if let Some(walker) = self.walkers.by_id.get_mut(&actor) {
            walker.switch(action);
        }
        if let Some(prop) = self.props.get_mut(actor) {
            prop.switch(action, &mut self.physics);
        }
        let is_switch = matches!(
            action,
            SetGravity { .. } | SetSimulated { .. } | SetCollisions { .. }
        );
        let is_no_vehicle =
            self.actors.contains(actor) && !self.vehicles.by_id.contains_key(&actor);
        if is_switch && is_no_vehicle {
            // What is neither vehicle nor walker nor prop has nothing to switch.
            return Ok(None);
        }
        vehicles::act(self.body(actor), action)
    }

    fn act_on_skeleton(&mut self, actor: ActorId, action: &SkeletonAction) -> CommandReply {
        let walker = match self.walker_mut(actor) {
            Ok(walker) => walker,
            Err(error) => return refused(error),
        };
        match walkers::act_on_skeleton(walker, action) {
            Ok(None) => CommandReply::Done,
            Ok(Some(bones)) => CommandReply::Bones { bones },
            Err(error) => refused(error),
        }
    }

    fn lead_walker(&mut self, actor: ActorId, lead: &Lead) -> Result<(), ActorError> {
        walkers::check_lead(actor, lead)?;
        self.walker_mut(actor)?;
        if let Some(walker) = self.walkers.by_id.get_mut(&actor) {
            walker.lead(lead, &self.physics);
        }
        self.refresh_records(None);
        Ok(())
    }

    fn set_traffic_light(&mut self, actor: ActorId, state: &str) -> Result<(), LightError> {
        let state = light_state(state)?;
        if !self.lights.set_state(actor, state) {
            return Err(self.no_light(actor));
        }
        self.refresh_records(None);
        Ok(())
    }

    fn set_light_time(&mut self, actor: ActorId, state: &str, secs: f64) -> Result<(), LightError> {
        let state = light_state(state)?;
        if self.lights.get(actor).is_none() {
            return Err(self.no_light(actor));
        }
        self.lights.set_time(actor, state, secs)?;
        self.refresh_records(None);
        Ok(())
    }

    fn reset_lights(&mut self, of: Option<ActorId>) -> Result<(), LightError> {
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

    fn light_boxes(&self, actor: ActorId) -> Result<Vec<PosedBox>, LightError> {
        match self.lights.get(actor) {
            Some(light) => Ok(lamp_head_boxes(light, &self.map)),
            None => Err(LightError::NotALight(actor)),
        }
    }

    fn no_light(&self, actor: ActorId) -> LightError {
        match self.actors.contains(actor) {
            true => LightError::NotALight(actor),
            false => ActorError::Unknown(actor).into(),
        }
    }
}

fn light_state(name: &str) -> Result<LightState, LightError> {
    LightState::from_name(name).ok_or_else(|| LightError::UnknownState(name.to_owned()))
}

fn done<E: ToString>(result: Result<(), E>) -> CommandReply {
    match result {
        Ok(()) => CommandReply::Done,
        Err(error) => refused(error),
    }
}

fn refused(error: impl ToString) -> CommandReply {
    CommandReply::Refused {
        error: error.to_string(),
    }
}
