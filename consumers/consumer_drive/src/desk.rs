//! What other programs may set while a session drives: parameters, further vehicles, seed and
//! lockstep. It outlives maps and restarts of the simulator.

use std::collections::{BTreeMap, BTreeSet};

use schema_frames::ActorList;

use crate::fleet::Fleet;
use crate::parameters::{Action, Parameters, Settings, VehicleParameters};

/// Something to do between two snapshots.
pub type Request = Box<dyn FnOnce(&mut Desk) + Send>;

/// What is set, and what is known of those who are driven.
#[derive(Debug, Default)]
pub struct Desk {
    settings: Settings,
    has_own_seed: bool,
    registered: BTreeSet<u32>,
    revision: u64,
    lockstep: bool,
    actors: ActorList,
    /// Vehicles somebody has asked about, with what they will do next.
    watched: BTreeMap<u32, Vec<Action>>,
}

impl Desk {
    pub(crate) fn new(seed: Option<u64>, speed_difference_percent: f64, lockstep: bool) -> Desk {
        Desk {
            settings: Settings {
                common: Parameters {
                    speed_difference_percent,
                    ..Parameters::default()
                },
                seed: seed.unwrap_or(0),
                ..Settings::default()
            },
            has_own_seed: seed.is_some(),
            lockstep,
            ..Desk::default()
        }
    }

    /// Drives these vehicles from now on, besides those of the selection.
    pub fn register(&mut self, ids: &[u32]) {
        self.registered.extend(ids);
        self.revision += 1;
    }

    /// Drives these vehicles no longer and forgets what was set for them.
    pub fn unregister(&mut self, ids: &[u32]) {
        for id in ids {
            self.registered.remove(id);
            self.settings.vehicles.remove(id);
            self.watched.remove(id);
        }
        self.revision += 1;
    }

    /// Vehicles that were registered, by rising id.
    pub fn registered(&self) -> impl Iterator<Item = u32> + '_ {
        self.registered.iter().copied()
    }

    /// What holds for all vehicles, to be changed.
    pub fn parameters_mut(&mut self) -> &mut Parameters {
        &mut self.settings.common
    }

    /// What holds for one vehicle, to be changed.
    pub fn vehicle_mut(&mut self, id: u32) -> &mut VehicleParameters {
        self.settings.vehicle_mut(id)
    }

    /// Decides every choice from now on; all vehicles plan their ways anew.
    pub fn set_seed(&mut self, seed: u64) {
        self.settings.seed = seed;
        self.has_own_seed = true;
    }

    /// Sets whether the simulator waits for the controls of each tick.
    pub fn set_lockstep(&mut self, on: bool) {
        self.lockstep = on;
    }

    /// Whether the simulator shall wait for the controls of each tick.
    pub fn lockstep(&self) -> bool {
        self.lockstep
    }

    /// The actors of the newest list, by rising id.
    pub fn actors(&self) -> &ActorList {
        &self.actors
    }

    /// What a vehicle will do, the next first, as of the last tick. The first question about a
    /// vehicle is answered with nothing.
    pub fn actions(&mut self, id: u32) -> Vec<Action> {
        self.watched.entry(id).or_default().clone()
    }

    pub(crate) fn settings_mut(&mut self) -> &mut Settings {
        &mut self.settings
    }

    pub(crate) fn has_own_seed(&self) -> bool {
        self.has_own_seed
    }

    /// Counts changes of the registrations.
    pub(crate) fn revision(&self) -> u64 {
        self.revision
    }

    /// Takes a new list of actors; forgets what was set for vehicles that are gone.
    pub(crate) fn set_actors(&mut self, mut list: ActorList) {
        list.actors.sort_by_key(|actor| actor.id);
        let was_there = |id: &u32| {
            self.actors
                .actors
                .binary_search_by_key(id, |a| a.id)
                .is_ok()
        };
        let is_there = |id: &u32| list.actors.binary_search_by_key(id, |a| a.id).is_ok();
        let stays = |id: &u32| is_there(id) || !was_there(id);
        self.registered.retain(stays);
        self.settings.vehicles.retain(|id, _| stays(id));
        self.watched.retain(|id, _| stays(id));
        self.actors = list;
    }

    /// Notes what the vehicles that were asked about will do.
    pub(crate) fn note_actions(&mut self, fleet: &mut Fleet) {
        for (id, actions) in &mut self.watched {
            *actions = fleet.actions(*id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list(ids: &[u32]) -> ActorList {
        let actor = |id: &u32| schema_frames::ActorInfo {
            id: *id,
            type_id: "vehicle.tesla.model3".into(),
            kind: "vehicle".into(),
            role: String::new(),
            parent_id: 0,
            mount: None,
            body_box: schema_frames::BodyBox {
                centre_m: [0.0; 3],
                half_m: [2.0, 1.0, 0.7],
            },
            trigger_box: None,
            attributes: BTreeMap::new(),
            topics: Vec::new(),
        };
        ActorList {
            actors: ids.iter().map(actor).collect(),
            ..ActorList::default()
        }
    }

    /// A vehicle may be registered before any list names it; it is forgotten when a list no longer
    /// has it.
    #[test]
    fn settings_wait_for_a_vehicle_and_leave_with_it() {
        let mut desk = Desk::new(None, 0.0, false);
        desk.register(&[7, 8]);
        desk.vehicle_mut(7).ignore_lights_percent = 100.0;
        desk.set_actors(list(&[8]));
        assert_eq!(desk.registered().collect::<Vec<_>>(), [7, 8]);
        desk.set_actors(list(&[7, 8]));
        desk.set_actors(list(&[8]));
        assert_eq!(desk.registered().collect::<Vec<_>>(), [8]);
        assert_eq!(desk.vehicle_mut(7).ignore_lights_percent, 0.0);
    }
}
