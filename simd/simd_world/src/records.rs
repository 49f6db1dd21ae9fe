//! The records of all actors for the snapshot, made anew after every step and every change.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Vector3};
use schema_frames::document::{BodyBox, Catalogue};
use schema_frames::snapshot::id_bytes;
use schema_frames::{
    ActorKind, ActorRecord, LightState, TrafficLightPart, TrafficSignPart, VehiclePart,
};
use schema_roads::RoadMap;
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};

use crate::actors::{Actor, Actors};
use crate::booms::{self, Boom, Booms};
use crate::physics::{Collision, Physics};
use crate::props::Props;
use crate::signals::{FIRST_LIMIT_MPS, PostedLimits, TrafficLights};
use crate::vehicles::{MAX_WHEELS, Vehicle, Vehicles};
use crate::walkers::Walkers;

/// A vehicle's speed limit is looked up again after this distance, metres.
const LIMIT_EVERY_M: f64 = 1.0;

/// Pose, velocity and spin of an actor's origin.
struct OriginMotion {
    pose: Pose,
    velocity: Vector3<f64>,
    spin: Vector3<f64>,
}

/// The speed limit where a vehicle is.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct SpeedLimit {
    looked_up_at_m: [f64; 3],
    /// 0 if none is known.
    limit_mps: f32,
}

/// The parts of the world that records are made from.
pub(crate) struct Observed<'w> {
    pub catalogue: &'w Catalogue,
    pub actors: &'w Actors,
    pub vehicles: &'w Vehicles,
    pub walkers: &'w Walkers,
    pub props: &'w Props,
    pub lights: &'w TrafficLights,
    pub roads: Option<&'w RoadMap>,
    pub posted: &'w PostedLimits,
    pub physics: &'w Physics,
    /// Contacts of the last step, by (actor, other).
    pub collisions: &'w [Collision],
}

/// State that changes while records are made: cached speed limits, and booms.
struct Memory<'w> {
    limits: &'w mut BTreeMap<ActorId, SpeedLimit>,
    booms: &'w mut Booms,
}

/// The records, by rising id.
#[derive(Default, Serialize, Deserialize)]
pub(crate) struct Records {
    #[serde(with = "crate::serde_forms::pods")]
    all: Vec<ActorRecord>,
    /// Records before the last step or change. They are read for accelerations, and their memory is
    /// used again.
    #[serde(skip)]
    previous: Vec<ActorRecord>,
    limits: BTreeMap<ActorId, SpeedLimit>,
}

/// A copy has no earlier records: nothing is read of them before they are replaced.
impl Clone for Records {
    fn clone(&self) -> Self {
        let Records {
            all,
            previous: _,
            limits,
        } = self;
        Records {
            all: all.clone(),
            previous: Vec::new(),
            limits: limits.clone(),
        }
    }

    fn clone_from(&mut self, source: &Self) {
        let Records {
            all,
            previous: _,
            limits,
        } = source;
        self.all.clone_from(all);
        self.limits.clone_from(limits);
    }
}

fn find(records: &[ActorRecord], actor: ActorId) -> Option<&ActorRecord> {
    records
        .binary_search_by_key(&actor.0, |record| record.id)
        .ok()
        .map(|idx| &records[idx])
}

impl Records {
    pub fn all(&self) -> &[ActorRecord] {
        &self.all
    }

    pub fn get(&self, actor: ActorId) -> Option<&ActorRecord> {
        find(&self.all, actor)
    }

    /// Drops the record and the cached speed limit of a destroyed actor.
    pub fn remove(&mut self, actor: ActorId) {
        self.limits.remove(&actor);
        if let Ok(idx) = self.all.binary_search_by_key(&actor.0, |record| record.id) {
            self.all.remove(idx);
        }
    }

    /// Makes the record of a new actor; those of the others stay. Making all anew instead would
    /// make a hundred million records for ten thousand actors.
    pub fn add(&mut self, seen: &Observed<'_>, booms: &mut Booms, actor: ActorId) {
        let limits = &mut self.limits;
        let mut memory = Memory { limits, booms };
        let Some(actor) = seen.actors.by_id.get(&actor) else {
            return;
        };
        let record = seen.record(actor, &self.all, None, &mut memory, None);
        let at = self.all.partition_point(|other| other.id < record.id);
        self.all.insert(at, record);
    }

    /// Drops all cached speed limits, for a new episode.
    pub fn forget_all(&mut self) {
        self.limits.clear();
    }

    /// Makes all records anew. `dt_secs` is the length of the step that led here. Without one (a
    /// change between steps) accelerations and contact flags stay.
    pub fn refresh(&mut self, seen: &Observed<'_>, booms: &mut Booms, dt_secs: Option<f64>) {
        std::mem::swap(&mut self.all, &mut self.previous);
        self.all.clear();
        let limits = &mut self.limits;
        let mut memory = Memory { limits, booms };
        for actor in seen.actors.by_id.values() {
            // Mostly nobody came or went, so a record has the place that it had.
            let same_place = self.previous.get(self.all.len());
            let before = same_place
                .filter(|record| record.id == actor.id.0)
                .or_else(|| find(&self.previous, actor.id));
            let record = seen.record(actor, &self.all, before, &mut memory, dt_secs);
            self.all.push(record);
        }
    }

    /// Makes the records of one actor, and of what is attached to it, anew after a change between
    /// steps that concerns nobody else. Refreshing everything instead would make a million records
    /// for a tick's commands to a thousand vehicles.
    pub fn refresh_one(&mut self, seen: &Observed<'_>, booms: &mut Booms, actor: ActorId) {
        let limits = &mut self.limits;
        let mut memory = Memory { limits, booms };
        let mut changed = vec![actor];
        // What is attached to another actor has a larger id.
        for (id, other) in seen.actors.by_id.range(actor..) {
            let is_attached = other.parent.is_some_and(|parent| changed.contains(&parent));
            if is_attached {
                changed.push(*id);
            }
            if (is_attached || *id == actor)
                && let Ok(idx) = self.all.binary_search_by_key(&id.0, |record| record.id)
            {
                let before = Some(&self.all[idx]);
                self.all[idx] = seen.record(other, &self.all, before, &mut memory, None);
            }
        }
    }
}

impl Observed<'_> {
    fn record(
        &self,
        actor: &Actor,
        made: &[ActorRecord],
        before: Option<&ActorRecord>,
        memory: &mut Memory<'_>,
        dt_secs: Option<f64>,
    ) -> ActorRecord {
        let mut motion = self.motion(actor, made);
        if let Some(boom) = memory.booms.by_id.get_mut(&actor.id) {
            self.hang(&mut motion, boom, actor, made, dt_secs.unwrap_or(0.0));
        }
        let mut record = self.constants_of(actor, &motion);
        self.fill_changes(&mut record, before, dt_secs);
        match actor.kind {
            ActorKind::Vehicle => {
                let vehicle = &self.vehicles.by_id[&actor.id];
                let limit = memory.limits.entry(actor.id).or_insert(SpeedLimit {
                    looked_up_at_m: [f64::INFINITY; 3],
                    limit_mps: 0.0,
                });
                if self.posted.is_empty() {
                    self.look_up_limit(motion.pose.translation_m, limit);
                } else {
                    self.heed_signs(&motion.pose.isometry(), vehicle.model.half_m, limit);
                }
                record.flags |= match (vehicle.quarantined, vehicle.switches.simulated) {
                    (true, _) => ActorRecord::QUARANTINED,
                    (false, simulated) => ActorRecord::PHYSICS * u32::from(simulated),
                };
                record.set_part(&self.vehicle_part(vehicle, &motion, limit.limit_mps));
            }
            ActorKind::Walker => {
                let walker = &self.walkers.by_id[&actor.id];
                record.flags |= if walker.lost {
                    ActorRecord::QUARANTINED
                } else {
                    0
                };
                record.set_part(&walker.part());
            }
            ActorKind::TrafficLight => record.set_part(&self.light_part(actor.id)),
            ActorKind::TrafficSign => {
                let opendrive_id = actor
                    .attributes
                    .get("opendrive_id")
                    .map_or([0; 32], |id| id_bytes(id));
                record.set_part(&TrafficSignPart {
                    opendrive_id,
                    reserved: [0; 64],
                });
            }
            _ => {}
        }
        record
    }

    /// Parents have smaller ids than what is attached to them, so their records are made already.
    fn motion(&self, actor: &Actor, made: &[ActorRecord]) -> OriginMotion {
        let is_attached = actor.parent.is_some();
        // A town has hundreds of these.
        if matches!(actor.kind, ActorKind::TrafficLight | ActorKind::TrafficSign) {
            return OriginMotion {
                pose: actor.pose,
                velocity: Vector3::zeros(),
                spin: Vector3::zeros(),
            };
        }
        let vehicle = self.vehicles.get(actor.id);
        // An attached body rides along until its physics is switched on.
        if let Some(vehicle) = vehicle.filter(|it| it.switches.simulated || !is_attached) {
            let (velocity, spin) = vehicle.velocity(self.physics);
            return OriginMotion {
                pose: vehicle.pose(self.physics).into(),
                velocity,
                spin,
            };
        }
        let walker = self.walkers.get(actor.id);
        if let Some(walker) = walker.filter(|it| it.simulated || !is_attached) {
            let spin = Vector3::new(0.0, 0.0, walker.yaw_radps);
            return OriginMotion {
                pose: walker.pose().into(),
                velocity: walker.velocity_mps.into(),
                spin,
            };
        }
        let parent = actor.parent.and_then(|id| find(made, id));
        let Some(parent) = parent else {
            let prop = self.props.get(actor.id);
            let (velocity, spin) =
                prop.map_or_else(Default::default, |prop| prop.velocity(self.physics));
            return OriginMotion {
                pose: actor.pose,
                velocity,
                spin,
            };
        };
        let world_from_parent = parent.world_from_actor.isometry();
        let lever = world_from_parent.rotation * Vector3::from(actor.pose.translation_m);
        let spin = Vector3::from(parent.angular_velocity_in_world_radps);
        let velocity = Vector3::from(parent.velocity_in_world_mps) + spin.cross(&lever);
        OriginMotion {
            pose: (world_from_parent * actor.pose.isometry()).into(),
            velocity,
            spin,
        }
    }

    /// Places an actor that hangs on a boom. Its velocity stays that of a rigid mount.
    fn hang(
        &self,
        motion: &mut OriginMotion,
        boom: &mut Boom,
        actor: &Actor,
        made: &[ActorRecord],
        dt_secs: f64,
    ) {
        let parent = actor.parent.and_then(|id| find(made, id));
        let Some(parent) = parent else { return };
        let body = self
            .vehicles
            .get(ActorId(parent.id))
            .map(|vehicle| vehicle.body);
        let free_m = |pivot: &Vector3<f64>, direction: &Vector3<f64>, length_m: f64| {
            booms::free_m(self.physics, body, pivot, direction, length_m)
        };
        motion.pose = boom
            .follow(
                &parent.world_from_actor.isometry(),
                &actor.pose.isometry(),
                dt_secs,
                free_m,
            )
            .into();
    }

    fn constants_of(&self, actor: &Actor, motion: &OriginMotion) -> ActorRecord {
        let entry = &self.catalogue.entries[actor.catalogue_idx as usize];
        let BodyBox { half_m, .. } = entry.body_box;
        ActorRecord {
            id: actor.id.0,
            parent_id: actor.parent.map_or(0, |parent| parent.0),
            catalogue_idx: actor.catalogue_idx,
            kind: actor.kind as u16,
            class: entry.class,
            reserved: 0,
            world_from_actor: motion.pose,
            velocity_in_world_mps: motion.velocity.into(),
            angular_velocity_in_world_radps: motion.spin.into(),
            acceleration_in_world_mps2: [0.0; 3],
            half_box_m: half_m,
            flags: 0,
            part: [0; 96],
        }
    }

    /// Sets the acceleration, as a finite difference over the tick, and the contact flag.
    fn fill_changes(
        &self,
        record: &mut ActorRecord,
        before: Option<&ActorRecord>,
        dt_secs: Option<f64>,
    ) {
        let Some(dt_secs) = dt_secs else {
            if let Some(before) = before {
                record.acceleration_in_world_mps2 = before.acceleration_in_world_mps2;
                record.flags |= before.flags & ActorRecord::TOUCHED;
            }
            return;
        };
        if let Some(before) = before {
            let change = |axis: usize| {
                (record.velocity_in_world_mps[axis] - before.velocity_in_world_mps[axis]) / dt_secs
            };
            record.acceleration_in_world_mps2 = [change(0), change(1), change(2)];
        }
        let collisions = self.collisions;
        let first = collisions.partition_point(|collision| collision.actor.0 < record.id);
        if collisions
            .get(first)
            .is_some_and(|collision| collision.actor.0 == record.id)
        {
            record.flags |= ActorRecord::TOUCHED;
        }
    }

    /// Takes over the limit of a sign that is passed; before the first one 30 km/h hold.
    fn heed_signs(
        &self,
        world_from_vehicle: &Isometry3<f64>,
        half_m: [f64; 3],
        limit: &mut SpeedLimit,
    ) {
        if limit.limit_mps == 0.0 {
            limit.limit_mps = FIRST_LIMIT_MPS;
        }
        if let Some(passed_mps) = self.posted.passed(world_from_vehicle, half_m) {
            limit.limit_mps = passed_mps;
        }
    }

    fn look_up_limit(&self, at_m: [f64; 3], limit: &mut SpeedLimit) {
        let moved = (Vector3::from(at_m) - Vector3::from(limit.looked_up_at_m)).norm();
        if moved < LIMIT_EVERY_M {
            return;
        }
        limit.looked_up_at_m = at_m;
        if let Some(roads) = self.roads {
            let lane = roads.nearest(at_m, |lane| lane.kind.is_drivable());
            limit.limit_mps = lane.and_then(|at| roads.speed_limit_mps(at)).unwrap_or(0.0) as f32;
        }
    }

    fn vehicle_part(
        &self,
        vehicle: &Vehicle,
        motion: &OriginMotion,
        speed_limit_mps: f32,
    ) -> VehiclePart {
        let control = vehicle.control;
        let world_from_vehicle: Isometry3<f64> = motion.pose.isometry();
        let light = self
            .lights
            .light_at(&world_from_vehicle, vehicle.model.half_m);
        let mut part = VehiclePart {
            throttle_ratio: control.throttle_ratio,
            steer_ratio: control.steer_ratio,
            brake_ratio: control.brake_ratio,
            control_flags: control.hand_brake as u32
                | (control.reverse as u32) << 1
                | (control.manual_gear_shift as u32) << 2
                | (vehicle.is_rolled_over(self.physics) as u32) << 8
                | vehicle.doors.flags(),
            gear: vehicle.powertrain.gear,
            engine_radps: vehicle.powertrain.engine_radps,
            speed_limit_mps,
            lamps: vehicle.shining_lamps(),
            light_actor_id: light.map_or(0, |light| light.actor.0),
            light_state: light.map_or(LightState::Green, |light| light.state) as u32,
            wheel_steer_rad: vehicle.steer_rad,
            wheels_on_ground: 0,
            wheel_spin_rad: [0.0; MAX_WHEELS],
            wheel_travel_m: [0.0; MAX_WHEELS],
        };
        for (i, wheel) in vehicle.visible_wheels().take(MAX_WHEELS).enumerate() {
            part.wheels_on_ground |= (wheel.on_ground as u32) << i;
            part.wheel_spin_rad[i] = wheel.spin_rad;
            part.wheel_travel_m[i] = wheel.travel_m;
        }
        part
    }

    fn light_part(&self, actor: ActorId) -> TrafficLightPart {
        let light = self
            .lights
            .get(actor)
            .expect("every traffic light actor has a light");
        let [green_secs, yellow_secs, red_secs] = self.lights.stage_secs(light);
        TrafficLightPart {
            state: light.state as u32,
            flags: self.lights.frozen as u32,
            elapsed_secs: (light.in_state_nanos as f64 * 1e-9) as f32,
            green_secs,
            yellow_secs,
            red_secs,
            group: light.group as u32 + 1,
            pole_idx: light.pole_idx,
            opendrive_id: id_bytes(&light.signal_id),
            reserved: [0; 32],
        }
    }
}
