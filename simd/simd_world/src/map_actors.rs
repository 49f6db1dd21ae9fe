//! The actors that every episode has: the spectator, and the lights and signs of the map.

use std::collections::BTreeMap;

use schema_frames::ActorKind;
use schema_frames::document::{BodyBox, Catalogue};
use schema_frames::limits::{MAX_ACTOR_TEXT_BYTES, MAX_ACTORS, json_bytes};
use schema_roads::{RoadMap, Signal, SignalKind};
use schema_types::{ActorId, Pose};

use crate::actors::{Actor, Actors, Counts};
use crate::catalogue;
use crate::errors::NoRoom;
use crate::map_data::{LoadError, MapData};
use crate::signals::{TrafficLights, trigger_box};

/// How far above the first spawn point the spectator begins, metres.
const SPECTATOR_ABOVE_M: f64 = 20.0;

/// What an episode begins with, beside the actors themselves.
pub(crate) struct MapActors {
    pub spectator: ActorId,
    pub lights: TrafficLights,
    /// Boxes of lights and signs on lanes, in their own space.
    pub trigger_boxes: BTreeMap<ActorId, BodyBox>,
}

/// Whether a world has room for the map's lights and signs beside the spectator.
///
/// # Errors
/// [`LoadError::Actors`].
pub(crate) fn check_actors(
    map: &MapData,
    roads: Option<&RoadMap>,
    counts: &Counts,
) -> Result<(), LoadError> {
    let signals = roads.map_or(&[][..], RoadMap::signals);
    let refuse = |source| {
        Err(LoadError::Actors {
            map: map.name.clone(),
            n_signals: signals.len(),
            source,
        })
    };
    if signals.len() >= MAX_ACTORS {
        return refuse(NoRoom::Actors);
    }
    if let Err(no_room) = counts.check_ids(MAX_ACTORS as u32) {
        return refuse(no_room);
    }
    // Half of the texts are left to those who come later.
    let text_bytes: usize = signals.iter().map(|signal| json_bytes(&signal.id)).sum();
    match text_bytes > MAX_ACTOR_TEXT_BYTES / 2 {
        true => refuse(NoRoom::Texts),
        false => Ok(()),
    }
}

/// Adds the spectator, then the map's lights and signs in the map's order.
pub(crate) fn add_map_actors(
    actors: &mut Actors,
    counts: &mut Counts,
    catalogue: &Catalogue,
    map: &MapData,
    roads: Option<&RoadMap>,
) -> MapActors {
    let mut add = |type_id: &str, kind, pose, attributes| {
        let catalogue_idx = catalogue::index_of(catalogue, type_id)
            .expect("the catalogue has every type the map can bring");
        let id = counts.new_id();
        actors.add(Actor {
            id,
            kind,
            catalogue_idx,
            role: String::new(),
            parent: None,
            pose,
            attributes,
            topics: Vec::new(),
        });
        id
    };
    let mut above = map.spawn_points.first().copied().unwrap_or_default();
    above.translation_m[2] += SPECTATOR_ABOVE_M;
    let spectator = add("spectator", ActorKind::Spectator, above, BTreeMap::new());
    let mut lights = TrafficLights::default();
    let mut trigger_boxes = BTreeMap::new();
    if let Some(roads) = roads {
        let mut light_ids = Vec::new();
        for signal in roads.signals() {
            let (type_id, kind) = type_of(signal, catalogue);
            let attributes = BTreeMap::from([("opendrive_id".to_owned(), signal.id.clone())]);
            let id = add(&type_id, kind, Pose::from(signal.pose), attributes);
            trigger_boxes.extend(trigger_box(roads, signal).map(|trigger| (id, trigger)));
            if kind == ActorKind::TrafficLight {
                light_ids.push(id);
            }
        }
        let mut light_ids = light_ids.into_iter();
        lights = TrafficLights::new(roads, || {
            light_ids
                .next()
                .expect("one actor was made for each light signal, in the same order")
        });
    }
    MapActors {
        spectator,
        lights,
        trigger_boxes,
    }
}

/// Catalogue id and kind of a signal's actor.
fn type_of(signal: &Signal, catalogue: &Catalogue) -> (String, ActorKind) {
    let limit = || {
        let kmh = signal.value.or_else(|| signal.subtype.parse().ok())?;
        let type_id = format!("traffic.speed_limit.{}", kmh.round());
        catalogue::index_of(catalogue, &type_id).map(|_| type_id)
    };
    match signal.kind {
        SignalKind::TrafficLight => ("traffic.traffic_light".to_owned(), ActorKind::TrafficLight),
        SignalKind::Stop => ("traffic.stop".to_owned(), ActorKind::TrafficSign),
        SignalKind::Yield => ("traffic.yield".to_owned(), ActorKind::TrafficSign),
        SignalKind::SpeedLimit => (
            limit().unwrap_or_else(|| "traffic.unknown".to_owned()),
            ActorKind::TrafficSign,
        ),
        SignalKind::Other => ("traffic.unknown".to_owned(), ActorKind::TrafficSign),
    }
}
