//! What other programs may set while a session drives: parameters, further vehicles, seed and
//! lockstep. It outlives maps and restarts of the simulator.

use std::collections::{BTreeMap, BTreeSet};

use consumer_driver::fleet::Fleet;
use consumer_driver::parameters::{Action, Parameters, Settings, Surroundings, VehicleParameters};
use consumer_rpc::budget::Holding;
use launch_cli::accept::Seldom;
use schema_frames::limits::MAX_ACTORS;
use schema_frames::{ActorList, Command, StepMode, WorldInfo};
use serde::{Deserialize, Serialize};

/// Something to do between two snapshots; what it returns is called when it counts.
pub type Request = Box<dyn FnOnce(&mut Desk) -> Answer + Send>;
/// Tells whoever asked.
pub type Answer = Box<dyn FnOnce() + Send>;

/// Most points of paths, decisions of routes and ignored actors of all vehicles together.
pub const MAX_SETTING_ITEMS: usize = 1 << 18;

/// A change of what holds for one vehicle.
#[derive(Debug)]
pub struct Setting {
    /// The vehicle.
    pub vehicle: u32,
    /// The method that sets it.
    pub method: &'static str,
    /// The other actor, where the method is about a pair.
    pub other: u32,
    /// What it costs the connection that set it.
    pub cost: Holding,
}

/// Why something is not set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SetError {
    /// All paths, routes and ignored actors together are too many.
    #[error(
        "the paths, routes and ignored actors of all vehicles have {MAX_SETTING_ITEMS} items already, and no more are kept; remove some"
    )]
    TooMany,
}

/// Low beams are switched on when the sun stands lower than this, degrees.
const DARK_BELOW_DEG: f32 = 15.0;
/// Low beams are switched on in rain above this, percent.
const WET_ABOVE_PERCENT: f32 = 80.0;
/// Low beams and fog lamps are switched on in fog above this, percent.
const FOGGY_ABOVE_PERCENT: f32 = 20.0;
/// Radius of hybrid physics that CARLA's clients expect, metres.
const HYBRID_RADIUS_M: f64 = 70.0;
/// Distances from a hero at which dormant vehicles return, metres.
const RESPAWN_M: [f64; 2] = [100.0, 1000.0];

/// What is set apart from whether it is on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Switches {
    /// Whether vehicles far from every hero move without physics.
    pub is_hybrid: bool,
    /// Radius around heroes within which vehicles obey physics, metres.
    pub hybrid_radius_m: f64,
    /// Whether dormant vehicles come back near a hero.
    pub respawns: bool,
    /// Least and greatest distance from a hero at which they do, metres.
    pub respawn_m: [f64; 2],
}

impl Default for Switches {
    fn default() -> Self {
        Switches {
            is_hybrid: false,
            hybrid_radius_m: HYBRID_RADIUS_M,
            respawns: false,
            respawn_m: RESPAWN_M,
        }
    }
}

/// What a session begins with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Start {
    /// What holds for all vehicles.
    pub common: Parameters,
    /// Seed of choices; `None` takes the simulator's.
    pub seed: Option<u64>,
    /// Whether the simulator always waits for the controls of each tick.
    pub lockstep: bool,
    /// Whether people are led, too.
    pub leads_people: bool,
}

/// What outlives a session that was killed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    /// The simulator's epoch.
    pub epoch: u64,
    /// Its episode.
    pub episode: u32,
    settings: Settings,
    switches: Switches,
    has_own_seed: bool,
    registered: BTreeSet<u32>,
    lockstep: bool,
}

impl Memory {
    pub(crate) fn n_registered(&self) -> usize {
        self.registered.len()
    }
}

/// What is set, and what is known of those who are driven.
#[derive(Debug, Default)]
pub struct Desk {
    start: Start,
    settings: Settings,
    switches: Switches,
    has_own_seed: bool,
    /// Seed of the simulator.
    world_seed: u64,
    registered: BTreeSet<u32>,
    /// Vehicles that are let go and shall stand.
    parked: Vec<u32>,
    revision: u64,
    lockstep: bool,
    is_stepped: bool,
    /// Simulated time at which the episode began.
    begin_nanos: u64,
    actors: ActorList,
    episode: Option<(u64, u32)>,
    /// Vehicles somebody has asked about, with what they will do next.
    watched: BTreeMap<u32, Vec<Action>>,
    commands: Vec<Command>,
    /// Whether a list of actors has come in this episode.
    has_list: bool,
    /// What settings cost those who set them, by vehicle, method and other actor.
    costs: BTreeMap<(u32, &'static str, u32), Holding>,
    warnings: Seldom,
}

impl Desk {
    pub(crate) fn new(start: Start) -> Desk {
        let mut desk = Desk {
            start,
            ..Desk::default()
        };
        desk.reset_common();
        desk
    }

    /// Drives these vehicles from now on, besides those of the selection.
    pub fn register(&mut self, ids: &[u32]) {
        for id in ids {
            if self.may_exist(*id) {
                self.registered.insert(*id);
            }
        }
        self.revision += 1;
    }

    /// Whether there is such an actor, or may be one that no list has named yet. Ids rise, so one
    /// that is missing among those of a list is gone. Of anything else nothing is kept.
    fn may_exist(&self, id: u32) -> bool {
        let all = &self.actors.actors;
        let newest = all.last().map_or(0, |actor| actor.id);
        let exists = if !self.has_list {
            let n_kept = self.registered.len() + self.settings.vehicles.len() + self.watched.len();
            n_kept < MAX_ACTORS
        } else if id > newest {
            id - newest <= MAX_ACTORS as u32
        } else {
            all.binary_search_by_key(&id, |actor| actor.id).is_ok()
        };
        if !exists && let Some(n_unsaid) = self.warnings.is_due() {
            tracing::warn!(
                id,
                n_unsaid,
                "a client asks something of an actor that does not exist; it is ignored"
            );
        }
        exists
    }

    /// Changes what holds for a vehicle; ignored if there is none with its id.
    ///
    /// # Errors
    /// [`SetError`]; nothing is changed then.
    pub fn set_vehicle(
        &mut self,
        setting: Setting,
        set: impl FnOnce(&mut VehicleParameters),
    ) -> Result<(), SetError> {
        let Setting {
            vehicle,
            method,
            other,
            cost,
        } = setting;
        if !self.may_exist(vehicle) || other != 0 && !self.may_exist(other) {
            return Ok(());
        }
        let mut changed = self
            .settings
            .vehicles
            .get(&vehicle)
            .cloned()
            .unwrap_or_default();
        let before = n_items(&changed);
        set(&mut changed);
        let after = n_items(&changed);
        if after > before {
            let all: usize = self.settings.vehicles.values().map(n_items).sum();
            if all - before + after > MAX_SETTING_ITEMS {
                return Err(SetError::TooMany);
            }
        }
        *self.settings.vehicle_mut(vehicle) = changed;
        self.costs.insert((vehicle, method, other), cost);
        Ok(())
    }

    /// Drives these vehicles no longer. What was set for them is kept, and they keep their last
    /// controls.
    pub fn unregister(&mut self, ids: &[u32]) {
        for id in ids {
            self.registered.remove(id);
        }
        self.revision += 1;
    }

    /// Sets for all vehicles what held at the start, also seed and lockstep.
    pub fn reset_common(&mut self) {
        self.settings.common = self.start.common.clone();
        self.switches = Switches::default();
        self.has_own_seed = self.start.seed.is_some();
        self.settings.seed = self.start.seed.unwrap_or(self.world_seed);
        self.lockstep = false;
    }

    /// Begins anew: nothing is registered or set, and the vehicles that were driven stop.
    pub fn reset(&mut self) {
        self.reset_common();
        self.parked.extend(std::mem::take(&mut self.registered));
        self.settings.vehicles.clear();
        self.costs.clear();
        self.watched.clear();
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

    /// Changes what is set apart from whether it is on.
    pub fn switch(&mut self, change: impl FnOnce(&mut Switches)) {
        change(&mut self.switches);
        let (switches, common) = (&self.switches, &mut self.settings.common);
        common.hybrid_radius_m = switches.is_hybrid.then_some(switches.hybrid_radius_m);
        common.respawn_m = switches.respawns.then_some(switches.respawn_m);
    }

    /// Sends a command to the simulator, before the next tick.
    pub fn command(&mut self, command: Command) {
        self.commands.push(command);
    }

    /// Decides every choice from now on; all vehicles plan their ways anew.
    pub fn set_seed(&mut self, seed: u64) {
        self.settings.seed = seed;
        self.has_own_seed = true;
    }

    /// Sets whether the simulator waits for the controls of each tick, also where it steps by itself.
    pub fn set_lockstep(&mut self, on: bool) {
        self.lockstep = on;
    }

    /// Whether the simulator shall wait for the controls of each tick: when that was asked for, and
    /// while registered vehicles are driven or people led in a world that a client steps, however
    /// fast.
    pub fn lockstep(&self) -> bool {
        let has_work = self.start.leads_people || !self.registered.is_empty();
        self.start.lockstep || self.lockstep || self.is_stepped && has_work
    }

    /// The actors of the newest list, by rising id.
    pub fn actors(&self) -> &ActorList {
        &self.actors
    }

    /// What a vehicle will do, the next first, as of the last tick. The first question about a
    /// vehicle is answered with nothing.
    pub fn actions(&mut self, id: u32) -> Vec<Action> {
        match self.may_exist(id) {
            true => self.watched.entry(id).or_default().clone(),
            false => Vec::new(),
        }
    }

    pub(crate) fn settings_mut(&mut self) -> &mut Settings {
        &mut self.settings
    }

    /// Takes what the simulator says about itself.
    pub(crate) fn set_world(&mut self, info: &WorldInfo) {
        self.is_stepped = info.mode == StepMode::Stepped;
        self.begin_nanos = info.episode_start_nanos;
        self.world_seed = info.seed;
        if !self.has_own_seed {
            self.settings.seed = info.seed;
        }
        let weather = &info.weather;
        self.settings.common.surroundings = Surroundings {
            dark: weather.sun_altitude_deg < DARK_BELOW_DEG
                || weather.precipitation > WET_ABOVE_PERCENT
                || weather.fog_density > FOGGY_ABOVE_PERCENT,
            foggy: weather.fog_density > FOGGY_ABOVE_PERCENT,
        };
    }

    /// Notes the episode. Vehicles of another one are forgotten: their ids may be others' now.
    pub(crate) fn set_episode(&mut self, epoch: u64, episode: u32) {
        let now = Some((epoch, episode));
        if self.episode.is_some() && self.episode != now {
            self.registered.clear();
            self.parked.clear();
            self.settings.vehicles.clear();
            self.costs.clear();
            self.watched.clear();
            self.has_list = false;
            self.revision += 1;
        }
        self.episode = now;
    }

    /// Simulated time at which the episode began.
    pub(crate) fn begin_nanos(&self) -> u64 {
        self.begin_nanos
    }

    /// Epoch and episode of the newest snapshot.
    pub(crate) fn episode(&self) -> Option<(u64, u32)> {
        self.episode
    }

    /// What to remember, for a session that takes over; `None` before the first snapshot.
    pub(crate) fn memory(&self) -> Option<Memory> {
        let (epoch, episode) = self.episode?;
        Some(Memory {
            epoch,
            episode,
            settings: self.settings.clone(),
            switches: self.switches.clone(),
            has_own_seed: self.has_own_seed,
            registered: self.registered.clone(),
            lockstep: self.lockstep,
        })
    }

    /// Goes on where a session of the same episode was killed.
    pub(crate) fn recall(&mut self, memory: Memory) {
        let since = std::mem::take(&mut self.registered);
        self.registered = memory.registered;
        self.registered.extend(since);
        let since = std::mem::replace(&mut self.settings, memory.settings);
        self.settings.vehicles.extend(since.vehicles);
        self.switches = memory.switches;
        self.has_own_seed = memory.has_own_seed;
        self.lockstep |= memory.lockstep;
        self.revision += 1;
    }

    /// Commands that wait to be sent.
    pub(crate) fn take_commands(&mut self) -> Vec<Command> {
        std::mem::take(&mut self.commands)
    }

    /// Vehicles that are let go and shall stand.
    pub(crate) fn take_parked(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.parked)
    }

    /// Counts changes of the registrations.
    pub(crate) fn revision(&self) -> u64 {
        self.revision
    }

    /// Takes a new list of actors; forgets what was set for vehicles that are gone.
    pub(crate) fn set_actors(&mut self, mut list: ActorList) {
        list.actors.sort_by_key(|actor| actor.id);
        let newest = list.actors.last().map_or(0, |actor| actor.id);
        let is_there = |id: &u32| list.actors.binary_search_by_key(id, |a| a.id).is_ok();
        let stays = |id: &u32| is_there(id) || *id > newest;
        self.registered.retain(stays);
        self.settings.vehicles.retain(|id, own| {
            own.ignored.retain(stays);
            stays(id)
        });
        self.costs
            .retain(|(id, _, other), _| stays(id) && (*other == 0 || stays(other)));
        self.watched.retain(|id, _| stays(id));
        (self.actors, self.has_list) = (list, true);
    }

    /// Notes what the vehicles that were asked about will do.
    pub(crate) fn note_actions(&mut self, fleet: &mut Fleet) {
        for (id, actions) in &mut self.watched {
            *actions = fleet.actions(*id);
        }
    }
}

fn n_items(own: &VehicleParameters) -> usize {
    own.ignored.len() + own.custom_path_m.len() + own.route.len()
}

#[cfg(test)]
pub(crate) mod tests {
    use consumer_rpc::budget::{Account, MAX_CONNECTION_BYTES};

    use super::*;

    fn setting(account: &Account, vehicle: u32, n_bytes: usize) -> Setting {
        Setting {
            vehicle,
            method: "set_path",
            other: 0,
            cost: account.hold(n_bytes).unwrap(),
        }
    }

    pub(crate) fn list(ids: &[u32]) -> ActorList {
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
        }
    }

    /// A vehicle may be registered before any list names it; it is forgotten when a list no longer
    /// has it.
    #[test]
    fn settings_wait_for_a_vehicle_and_leave_with_it() {
        let mut desk = Desk::new(Start::default());
        desk.register(&[7, 8]);
        desk.settings.vehicle_mut(8).ignore_lights_percent = 100.0;
        desk.set_actors(list(&[7]));
        assert_eq!(desk.registered().collect::<Vec<_>>(), [7, 8]);
        desk.set_actors(list(&[7, 8]));
        desk.set_actors(list(&[7, 9]));
        assert_eq!(desk.registered().collect::<Vec<_>>(), [7]);
        assert_eq!(desk.settings.vehicle_mut(8).ignore_lights_percent, 0.0);
    }

    #[test]
    fn nothing_is_kept_for_vehicles_that_do_not_exist() {
        let mut desk = Desk::new(Start::default());
        desk.set_episode(1, 1);
        desk.set_actors(list(&[7, 9]));
        let account = Account::of(1);
        let invented = (0..3_000_000u32)
            .step_by(151)
            .filter(|id| ![7, 9].contains(id));
        for id in invented {
            let set = |own: &mut VehicleParameters| own.ignore_lights_percent = 50.0;
            desk.set_vehicle(setting(&account, id, 1), set).unwrap();
            desk.register(&[id]);
            assert!(desk.actions(id).is_empty());
        }
        // Those may be about to be listed; there are only so many, and the next list decides.
        let n_kept = desk.settings.vehicles.len();
        assert!(
            n_kept <= MAX_ACTORS && desk.registered.len() <= MAX_ACTORS,
            "{n_kept}"
        );
        desk.set_actors(list(&[7, 9, 4_000_000]));
        assert!(desk.settings.vehicles.is_empty() && desk.costs.is_empty());
        assert!(desk.registered.is_empty() && desk.watched.is_empty());
    }

    /// What is set costs the connection that set it, until it is set anew or the vehicle is gone.
    #[test]
    fn settings_cost_and_have_a_bound() {
        let mut desk = Desk::new(Start::default());
        desk.set_actors(list(&[7, 8]));
        let account = Account::of(1);
        let path =
            |n: usize| move |own: &mut VehicleParameters| own.custom_path_m = vec![[0.0; 3]; n];
        let half = MAX_CONNECTION_BYTES / 2;
        for _ in 0..4 {
            desk.set_vehicle(setting(&account, 7, half), path(5))
                .unwrap();
            assert!(account.hold(half).is_ok() && account.hold(half + 1).is_err());
        }
        desk.set_actors(list(&[8]));
        assert!(account.hold(MAX_CONNECTION_BYTES).is_ok());
        let most = MAX_SETTING_ITEMS;
        let set = |desk: &mut Desk, id, n| desk.set_vehicle(setting(&account, id, 1), path(n));
        assert_eq!(set(&mut desk, 8, most), Ok(()));
        assert_eq!(set(&mut desk, 9, 1), Err(SetError::TooMany));
        assert_eq!(set(&mut desk, 8, most - 1), Ok(()));
        assert_eq!(set(&mut desk, 9, 1), Ok(()));
    }
}
