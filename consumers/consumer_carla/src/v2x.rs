//! Vehicle-to-everything radio: `sensor.other.v2x` sends and receives cooperative awareness
//! messages, `sensor.other.v2x_custom` the texts that scripts `send`.
//!
//! The gateway does this itself: stations are actors without topics. After each snapshot, before
//! clients see it, messages travel from antenna to antenna. A station's antenna is on the roof of
//! its carrier; a station without one is its own carrier.

mod cam;
mod noise;
mod radio;
mod solids;

use std::collections::BTreeMap;
use std::time::Duration;

use consumer_kit::WorldAt;
use nalgebra::Point3;
use parking_lot::Mutex;
use schema_frames::scenery::SceneryObjectInfo;
use schema_frames::{Command, CommandReply, SnapshotHeader};
use schema_types::{Class, Pose};

use crate::feeds::relay::Stations;
use crate::state::commander::answer::{Answer, CommandError};
use crate::state::commander::{Commander, Pending};
use crate::state::known_world::{Known, Own, World};
use crate::wire::axes;
use crate::wire::description::{Attributes, Description};
use crate::wire::fields::Wrong;
use crate::wire::geolocation::geo_reference_deg;
use crate::wire::sensor_kinds;
use crate::wire::sensor_kinds::{CUSTOM, is_station};
use crate::wire::sensor_message::push_prefix;
use crate::wire::streams::StreamMessage;
use cam::{Record, Sender, Service};
use noise::Stream;
use radio::{Link, Radio};
use solids::Solid;

/// Bytes of a custom message, including the received power in front.
const CUSTOM_BYTES: usize = 136;
/// Longest text; a zero byte follows it.
const MAX_TEXT_BYTES: usize = 99;
/// Messages of a station that are kept until its next delivery; beyond this they are lost.
const MAX_RECEIVED_BYTES: usize = 1 << 20;
/// Most texts that may wait for the next tick.
const MAX_OUTBOX: usize = 1024;
/// Longest wait of the world for the list of buildings; radio waves pass everywhere until it is
/// there. A busy machine needs more than a second, and what is received must not depend on it.
const SCENERY_PATIENCE: Duration = Duration::from_secs(10);
/// Height of an antenna above the roof, metres.
const ANTENNA_M: f64 = 0.02;

/// All stations.
#[derive(Debug, Default)]
pub struct V2x(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    stations: BTreeMap<u32, Station>,
    /// Texts that wait for the next tick, with the stations that send them.
    outbox: Vec<(u32, String)>,
    episode: Option<u64>,
    buildings: Option<Vec<Solid>>,
    /// The question for them, until it is answered.
    asked: Option<Pending>,
}

#[derive(Debug)]
struct Station {
    /// The actor that carries it; the station itself if it is not attached.
    carrier: u32,
    number: u64,
    radio: Radio,
    service: Option<Service>,
    stream: Stream,
    /// When it sends and delivers.
    clock: Clock,
    /// Messages that it received and has not delivered yet.
    received: Vec<u8>,
}

/// When a station sends and delivers: at every step, or at most once per interval.
#[derive(Debug)]
struct Clock {
    interval_nanos: u64,
    due_nanos: Option<u64>,
    is_due: bool,
}

impl Clock {
    fn of(given: &Attributes<'_>) -> Clock {
        let secs = given.float("sensor_tick", 0.0);
        Clock {
            interval_nanos: if secs > 0.0 {
                (secs * 1e9).round().min(1e18) as u64
            } else {
                0
            },
            due_nanos: None,
            is_due: true,
        }
    }

    /// Goes on to a time: the first step is due, then the first one after each interval.
    fn go_to(&mut self, nanos: u64) {
        let due_nanos = *self.due_nanos.get_or_insert(nanos);
        self.is_due = nanos >= due_nanos;
        if self.is_due && self.interval_nanos > 0 {
            let n_passed = (nanos - due_nanos) / self.interval_nanos + 1;
            self.due_nanos =
                Some(due_nanos.saturating_add(n_passed.saturating_mul(self.interval_nanos)));
        }
    }
}

/// What messages travel through at a tick.
struct Air {
    /// Places of antennas, by their carriers.
    antennas: BTreeMap<u32, Point3<f64>>,
    /// Boxes that stand in the way.
    solids: Vec<Solid>,
}

/// A message that was sent at this tick.
struct Message {
    station: u32,
    carrier: u32,
    number: u64,
    stream: u64,
    transmit_dbm: f64,
    bytes: Vec<u8>,
}

/// Checks the attributes of a station.
///
/// # Errors
/// A sentence.
pub fn check(description: &Description) -> Result<(), Wrong> {
    let stream = Stream::new(description, ["", ""], 0, [].iter());
    Station::new(0, 0, description, stream).map(drop)
}

impl Station {
    fn new(
        id: u32,
        parent: u32,
        description: &Description,
        stream: Stream,
    ) -> Result<Station, Wrong> {
        let given = Attributes::of(description);
        let is_custom = description.type_id == CUSTOM;
        Ok(Station {
            carrier: if parent == 0 { id } else { parent },
            number: sensor_kinds::kind(&description.type_id).map_or(0, |kind| kind.number),
            radio: Radio::of(&given)?,
            service: if is_custom {
                None
            } else {
                Some(Service::of(&given)?)
            },
            stream,
            clock: Clock::of(&given),
            received: Vec::new(),
        })
    }

    fn message(&self, id: u32, bytes: Vec<u8>) -> Message {
        Message {
            station: id,
            carrier: self.carrier,
            number: self.number,
            stream: self.stream.number(),
            transmit_dbm: self.radio.transmit_dbm,
            bytes,
        }
    }
}

impl V2x {
    /// Queues a text that the station sends with the next tick.
    ///
    /// # Errors
    /// If the text is too long or too many wait.
    pub fn send(&self, station: u32, text: &str) -> Result<(), Wrong> {
        if text.len() > MAX_TEXT_BYTES || text.contains('\0') {
            let n_bytes = text.len();
            return Err(Wrong::Value(format!(
                "a custom message has {n_bytes} bytes; at most {MAX_TEXT_BYTES} are sent, none of them zero"
            )));
        }
        let mut state = self.0.lock();
        if state.outbox.len() >= MAX_OUTBOX {
            return Err(Wrong::Value(format!(
                "{MAX_OUTBOX} messages wait for the next tick; this one is not sent"
            )));
        }
        state.outbox.push((station, text.to_owned()));
        Ok(())
    }

    /// Sends and receives the messages of the newest snapshot.
    pub fn step(&self, world: &World, commander: &Commander, listeners: &Stations) {
        let Some(snapshot) = world.known().snapshot.clone() else {
            return;
        };
        let asked = {
            let mut state = self.0.lock();
            state.keep_up(&world.known(), &snapshot, listeners);
            if state.stations.is_empty() {
                state.outbox.clear();
                return;
            }
            state.ask_for_buildings(commander)
        };
        // Who sends a message meanwhile is not held up.
        if let Some(asked) = asked {
            let answer = asked.wait_for(SCENERY_PATIENCE);
            self.0.lock().note_buildings(asked, answer);
        }
        let mut state = self.0.lock();
        let known = world.known();
        state.go_to(&snapshot);
        let messages = state.messages(&known, &snapshot);
        if messages.is_empty() && state.stations.values().all(|it| it.received.is_empty()) {
            return;
        }
        let antennas = state
            .stations
            .values()
            .filter_map(|station| {
                let at = antenna(&known, &snapshot, station.carrier)?;
                Some((station.carrier, at))
            })
            .collect();
        let mut solids = vehicles(&known, &snapshot);
        drop(known);
        solids.extend(state.buildings.iter().flatten().cloned());
        let air = Air { antennas, solids };
        state.receive(&messages, &air, &snapshot, listeners);
    }
}

impl State {
    /// Adds new stations and drops those that are gone.
    fn keep_up(&mut self, known: &Known, snapshot: &WorldAt, listeners: &Stations) {
        let episode = crate::wire::world_message::episode_id(&snapshot.header);
        if self.episode.replace(episode) != Some(episode) {
            *self = State {
                episode: self.episode,
                ..State::default()
            };
        }
        if snapshot.header.flags & SnapshotHeader::SCENERY_CHANGED != 0 {
            (self.buildings, self.asked) = (None, None);
        }
        let is_there = |id: u32| snapshot.actor(id).is_some();
        self.stations.retain(|id, _| is_there(*id));
        // By rising id, so that stations alike are numbered in the order in which they were made.
        let new: BTreeMap<u32, &Own> = known
            .own
            .iter()
            .filter(|(id, own)| is_station(&own.description.type_id) && is_there(**id))
            .filter(|(id, _)| !self.stations.contains_key(id))
            .map(|(id, own)| (*id, own))
            .collect();
        for (id, own) in new {
            let living = self.stations.values().map(|station| &station.stream);
            let carrier = type_and_role(known, own.parent);
            let tick = snapshot.header.tick;
            let stream = Stream::new(&own.description, carrier, tick, living);
            match Station::new(id, own.parent, &own.description, stream) {
                Ok(station) => drop(self.stations.insert(id, station)),
                Err(error) => tracing::warn!(station = id, %error, "a station cannot be made"),
            }
        }
        let stations = &self.stations;
        listeners.retain(|id| stations.contains_key(&id) || known.own.contains_key(&id));
    }

    /// Finds which stations send and deliver at this tick.
    fn go_to(&mut self, snapshot: &WorldAt) {
        let nanos = snapshot.header.sim_nanos;
        self.stations
            .values_mut()
            .for_each(|station| station.clock.go_to(nanos));
    }

    /// The messages that stations send at this tick.
    fn messages(&mut self, known: &Known, snapshot: &WorldAt) -> Vec<Message> {
        let nanos = snapshot
            .header
            .sim_nanos
            .saturating_sub(snapshot.header.episode_start_nanos);
        let geo_reference_deg = known
            .geo_reference_deg
            .unwrap_or_else(|| geo_reference_deg(""));
        let mut messages = Vec::new();
        for (id, station) in self
            .stations
            .iter_mut()
            .filter(|(_, station)| station.clock.is_due)
        {
            let (Some(service), Some(record)) =
                (&mut station.service, snapshot.actor(station.carrier))
            else {
                continue;
            };
            let mut noise = station.stream.at(snapshot.header.tick, 0);
            let sender = Sender {
                record,
                info: known.actors.get(&station.carrier),
                nanos,
                geo_reference_deg,
            };
            if let Some(bytes) = service.message(&sender, &mut noise) {
                messages.push(station.message(*id, bytes.to_vec()));
            }
        }
        for (id, text) in std::mem::take(&mut self.outbox) {
            let Some(station) = self
                .stations
                .get(&id)
                .filter(|station| station.service.is_none())
            else {
                continue;
            };
            if !station.clock.is_due {
                self.outbox.push((id, text));
                continue;
            }
            let mut record = Record([0; CUSTOM_BYTES]);
            record.header(0, station.carrier);
            record.0[32..32 + text.len()].copy_from_slice(text.as_bytes());
            messages.push(station.message(id, record.0.to_vec()));
        }
        messages
    }

    /// Asks for the boxes of buildings and walls, once after every change of the scenery; what was
    /// asked before and is not answered yet is awaited again.
    fn ask_for_buildings(&mut self, commander: &Commander) -> Option<Pending> {
        if self.buildings.is_some() {
            return None;
        }
        let asked = self.asked.take();
        Some(asked.unwrap_or_else(|| commander.begin(vec![Command::Scenery])))
    }

    /// Notes the answer, or keeps the question for the next tick if there is none yet.
    fn note_buildings(&mut self, asked: Pending, answer: Option<Result<Answer, CommandError>>) {
        let reply = match answer {
            None => return self.asked = Some(asked),
            Some(Ok(answer)) => answer.replies.into_iter().next(),
            Some(Err(error)) => {
                tracing::debug!(%error, "no scenery; radio waves pass everywhere");
                None
            }
        };
        let objects = match reply {
            Some(CommandReply::Scenery { objects, .. }) => objects,
            _ => Vec::new(),
        };
        let is_solid = |object: &SceneryObjectInfo| {
            object.shown && [Class::BUILDINGS, Class::WALLS].contains(&Class(object.class))
        };
        let solid = |object: SceneryObjectInfo| Solid {
            vehicle: None,
            pose: Pose::from(object.box_pose).isometry(),
            half_m: object.box_half_m,
        };
        self.buildings = Some(objects.into_iter().filter(is_solid).map(solid).collect());
    }

    fn receive(
        &mut self,
        messages: &[Message],
        air: &Air,
        snapshot: &WorldAt,
        listeners: &Stations,
    ) {
        let nanos = snapshot
            .header
            .sim_nanos
            .saturating_sub(snapshot.header.episode_start_nanos);
        for (id, station) in &mut self.stations {
            let (Some(roof), Some(own)) = (air.antennas.get(&station.carrier), snapshot.actor(*id))
            else {
                continue;
            };
            let mut bytes = std::mem::take(&mut station.received);
            // How many messages of each sender came to the station.
            let mut heard = BTreeMap::<u64, u64>::new();
            for message in messages
                .iter()
                .filter(|message| message.number == station.number && message.station != *id)
            {
                // Awareness messages are about the carrier, so its other stations do not receive
                // them.
                if station.service.is_some() && message.carrier == station.carrier {
                    continue;
                }
                let Some(sender) = air.antennas.get(&message.carrier) else {
                    continue;
                };
                let distance_m = (roof - sender).norm();
                if !station.radio.reaches(distance_m) {
                    continue;
                }
                let grounds = [message.carrier, station.carrier].map(|id| {
                    snapshot
                        .actor(id)
                        .map_or(0.0, |at| at.world_from_actor.translation_m[2])
                });
                let ground_m = grounds[0].min(grounds[1]);
                let link = Link {
                    distance_m,
                    heights_m: [sender.z - ground_m, roof.z - ground_m],
                };
                let path = solids::path(
                    &air.solids,
                    sender,
                    roof,
                    [message.carrier, station.carrier],
                );
                let nth = heard.entry(message.stream).or_default();
                *nth += 1;
                let fading = station
                    .stream
                    .at(snapshot.header.tick, message.stream.wrapping_add(*nth))
                    .normal();
                if let Some(power_dbm) =
                    station
                        .radio
                        .received_dbm(message.transmit_dbm, &link, &path, fading)
                {
                    bytes.extend((power_dbm as f32).to_le_bytes());
                    bytes.extend(&message.bytes[4..]);
                }
            }
            let relay = listeners.relay(*id);
            if !station.clock.is_due {
                // Nobody listens to what nobody would get.
                if relay.is_some() && bytes.len() < MAX_RECEIVED_BYTES {
                    station.received = bytes;
                }
                continue;
            }
            if let Some(relay) = relay.filter(|_| !bytes.is_empty()) {
                let mut whole = Vec::with_capacity(48 + bytes.len());
                push_prefix(
                    &mut whole,
                    station.number,
                    snapshot.header.tick,
                    nanos,
                    &axes::transform(&own.world_from_actor),
                );
                whole.extend(bytes);
                relay.send(&StreamMessage {
                    tick: snapshot.header.tick,
                    bytes: whole.into(),
                });
            }
        }
    }
}

/// Catalogue id and role of a carrier, both empty for a station that has none.
fn type_and_role(known: &Known, carrier: u32) -> [&str; 2] {
    if let Some(own) = known.own.get(&carrier) {
        let role = own.description.attribute("role_name");
        return [&own.description.type_id, role.unwrap_or("")];
    }
    match known.actors.get(&carrier) {
        Some(info) => [&info.type_id, &info.role],
        None => ["", ""],
    }
}

/// The place of the antenna on a carrier.
fn antenna(known: &Known, snapshot: &WorldAt, carrier: u32) -> Option<Point3<f64>> {
    let record = snapshot.actor(carrier)?;
    let top_m = known.actors.get(&carrier).map_or(0.0, |info| {
        f64::from(info.body_box.centre_m[2] + info.body_box.half_m[2])
    });
    Some(record.world_from_actor.isometry() * Point3::new(0.0, 0.0, top_m + ANTENNA_M))
}

/// Boxes of all vehicles of a snapshot.
fn vehicles(known: &Known, snapshot: &WorldAt) -> Vec<Solid> {
    let solid = |record: &schema_frames::ActorRecord| {
        record.vehicle()?;
        let centre_m = known
            .actors
            .get(&record.id)?
            .body_box
            .centre_m
            .map(f64::from);
        let middle = nalgebra::Translation3::from(centre_m);
        Some(Solid {
            vehicle: Some(record.id),
            pose: record.world_from_actor.isometry() * middle,
            half_m: record.half_box_m.map(f64::from),
        })
    };
    snapshot.records.iter().filter_map(solid).collect()
}
