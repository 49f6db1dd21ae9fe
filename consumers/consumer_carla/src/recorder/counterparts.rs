//! What of a recording is in this run already, and what can never be: ids of the same actors,
//! traffic lights at the same place, types that the catalogue lacks.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use schema_frames::TrafficLightPart;

use crate::recorder::file::Cast;
use crate::recorder::frame::Born;
use crate::recorder::text::ROOM;
use crate::state::known_world::Known;
use crate::wire::axes;
use crate::wire::sensor_kinds;

/// CARLA's files name no OpenDRIVE signal: a traffic light of theirs is the nearest here within
/// this distance, metres.
const SAME_LIGHT_M: f64 = 2.0;

/// Counterparts of recorded actors, by their recorded ids.
#[derive(Debug, Default)]
pub struct Counterparts {
    /// Ids of actors that exist under their recorded id and type.
    pub ids: BTreeMap<u32, u32>,
    /// Recorded ids of heroes.
    pub heroes: BTreeSet<u32>,
    /// Ids of traffic lights.
    pub lights: BTreeMap<u32, u32>,
    /// Recorded id of the spectator.
    pub spectator: Option<u32>,
    /// Recorded ids of actors whose types the catalogue lacks.
    pub unknown: BTreeSet<u32>,
    /// Recorded ids of two-wheelers.
    pub two_wheelers: BTreeSet<u32>,
    /// Sentences about what cannot be replayed, one a line.
    pub missing: String,
}

/// Whether a replay moves actors of this type.
pub fn is_played(type_id: &str) -> bool {
    ["vehicle.", "walker.", "static.prop."]
        .iter()
        .any(|family| type_id.starts_with(family))
}

/// Whether this type is a sensor that the gateway can spawn.
pub fn is_sensor(type_id: &str) -> bool {
    sensor_kinds::kind(type_id).is_some() || sensor_kinds::CLIENT_SIDE.contains(&type_id)
}

impl Counterparts {
    /// Looks for what is recorded in the world as it is.
    pub fn find(cast: &Cast, known: &Known) -> Counterparts {
        let mut found = Counterparts::default();
        let mut unknown_types: BTreeMap<&str, usize> = BTreeMap::new();
        let mut n_lights = 0;
        for born in cast.iter() {
            let (id, type_id) = (born.id, born.description.type_id.as_str());
            if cast.is_hero(id) {
                found.heroes.insert(id);
            }
            if known.n_wheels_of(type_id) == Some(2) {
                found.two_wheelers.insert(id);
            }
            if is_played(type_id) {
                let is_here = known
                    .actors
                    .get(&id)
                    .is_some_and(|actor| actor.type_id == type_id);
                if is_here {
                    found.ids.insert(id, id);
                } else if known.entry(type_id).is_none() {
                    found.unknown.insert(id);
                    *unknown_types.entry(type_id).or_default() += 1;
                }
            } else if type_id == "spectator" {
                found.spectator = Some(id);
            } else if type_id == "traffic.traffic_light" {
                n_lights += 1;
                found.lights.extend(light(born, known).map(|now| (id, now)));
            }
        }
        found.tell(&unknown_types, n_lights);
        found
    }

    fn tell(&mut self, unknown_types: &BTreeMap<&str, usize>, n_lights: usize) {
        if !unknown_types.is_empty() {
            let all: Vec<String> = unknown_types
                .iter()
                .map(|(type_id, n)| format!("{type_id} ({n})"))
                .collect();
            let all = all.join(", ");
            writeln!(
                self.missing,
                "Not replayed, because the catalogue lacks them: {all}"
            )
            .expect(ROOM);
        }
        let n_found = self.lights.len();
        if n_found < n_lights {
            writeln!(
                self.missing,
                "Of {n_lights} recorded traffic lights, {} are not in this map and not replayed",
                n_lights - n_found
            )
            .expect(ROOM);
        }
    }
}

/// The traffic light of the same OpenDRIVE signal, or else the nearest.
fn light(born: &Born, known: &Known) -> Option<u32> {
    let records = || known.snapshot.iter().flat_map(|at| &at.records);
    if let Some(signal) = born.description.attribute("opendrive_id") {
        let of_signal = |part: TrafficLightPart| part.opendrive_id() == signal;
        return records()
            .find(|record| record.traffic_light().is_some_and(of_signal))
            .map(|record| record.id);
    }
    let [x, y, _] = axes::mirror(born.at.location_m);
    records()
        .filter(|record| record.traffic_light().is_some())
        .map(|record| {
            let at = record.world_from_actor.translation_m;
            ((at[0] - x).hypot(at[1] - y), record.id)
        })
        .filter(|(distance_m, _)| *distance_m <= SAME_LIGHT_M)
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, id)| id)
}
