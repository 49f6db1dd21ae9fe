//! The bus side of driving: reads documents and snapshots and sends controls, across restarts of
//! the simulator.

use std::collections::BTreeMap;
use std::os::fd::AsFd as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use consumer_driver::crowd::CrowdOptions;
use consumer_driver::fleet::{Fleet, Step};
use consumer_driver::parameters::Parameters;
use consumer_driver::steer::Geometry;
use consumer_driver::traffic::{Snapshot, Traffic};
use consumer_kit::{FollowedDocument, Lockstep, SnapshotTrail, WorldAt};
use schema_bus::{
    Bus, BusError, CommandClient, CommandError, ControlWriter, Notifier, Token, WaitSet, names,
};
use schema_frames::{
    ActorList, Command, CommandBatch, CommandReply, VehicleControl, VehicleControlRecord, WorldInfo,
};
use schema_roads::RoadMap;

use crate::desk::{Answer, Desk, Start};
use crate::peers::{Peers, TickId, writer_name};
use crate::people::People;
use crate::selection::Selection;
use crate::served::Served;
use crate::share::Share;

/// Longest wait for a snapshot, so that a shutdown is seen in time.
const MAX_WAIT: Duration = Duration::from_millis(50);
/// Wait while no snapshot has been announced yet, in case this simulator announces none.
const POLL: Duration = Duration::from_millis(4);
/// How long a snapshot waits for the list of its actors.
const LIST_WAIT: Duration = Duration::from_millis(200);
/// How long it waits for list and map in lockstep, where the world waits as well: what is driven must
/// not depend on when a document arrives.
const LOCKSTEP_WAIT: Duration = Duration::from_secs(10);
/// How long a command waits for its answer.
const COMMAND_WAIT: Duration = Duration::from_secs(2);
/// Between attempts to join lockstep.
const JOIN_EVERY: Duration = Duration::from_secs(1);

/// Everything between two waits.
static DRIVE: schema_stages::Stage = schema_stages::Stage::new("drive");

/// What was asked for.
#[derive(Clone, Debug)]
pub struct Options {
    /// Domain.
    pub domain: String,
    /// Whom to drive.
    pub vehicles: Selection,
    /// Which share of these, if other processes drive the others.
    pub share: Option<Share>,
    /// Whether the simulator waits for us.
    pub lockstep: bool,
    /// Name under which it waits; `None` is made from whom it drives.
    pub lockstep_name: Option<String>,
    /// Seed of the turns; `None` takes the simulator's.
    pub seed: Option<u64>,
    /// What holds for all vehicles until it is set.
    pub parameters: Parameters,
    /// Whom to lead on foot.
    pub crowd: CrowdOptions,
}

/// Drives until `stop` says so, and does what clients of `served` ask.
///
/// # Errors
/// The bus fails, or a document of the simulator cannot be read.
pub fn drive(
    options: &Options,
    served: Option<Served>,
    stop: &dyn Fn() -> bool,
) -> anyhow::Result<()> {
    let mut session = Session::open(options, served)?;
    while !stop() {
        session.wait()?;
        schema_stages::post(0);
        let _span = DRIVE.span();
        session.turn()?;
    }
    session.park()
}

/// One map, and who drives on it.
struct Episode {
    epoch: u64,
    episode: u32,
    map_revision: u64,
    fleet: Fleet,
}

struct Session<'o> {
    options: &'o Options,
    name: String,
    // Dropped in this order: ports before their node.
    lockstep: Option<Lockstep>,
    next_join: Instant,
    wake: WaitSet,
    snapshots: Token,
    announced: bool,
    served: Option<Served>,
    daemon: Notifier,
    writer: ControlWriter,
    trail: SnapshotTrail,
    map: FollowedDocument,
    info: FollowedDocument,
    info_episode: Option<(u64, u32)>,
    actors: FollowedDocument,
    list_revision: u64,
    list_epoch: u64,
    desk: Desk,
    people: Option<People>,
    /// Opened when the first command is sent.
    commands: Option<CommandClient>,
    command_name: String,
    episode: Option<Episode>,
    done: TickId,
    peers: Option<Peers>,
    /// List, registrations and shares by which vehicles were assigned.
    assigned: Option<(u64, u64, u64, u64)>,
    /// Epoch and revision of a map on which nobody can drive.
    refused_map: Option<(u64, u64)>,
    /// Since when a tick has waited for its map.
    waiting: Option<(TickId, Instant)>,
    bus: Bus,
}

impl<'o> Session<'o> {
    fn open(options: &'o Options, mut served: Option<Served>) -> anyhow::Result<Session<'o>> {
        let whom = match &served {
            Some(served) => served.name(),
            None => options.vehicles.to_string(),
        };
        let name = writer_name(&whom, options.share);
        let bus = Bus::open(&options.domain, &format!("gantry-{name}"))?;
        let share = options.share;
        let peers = share
            .map(|share| Peers::open(&bus, &whom, share))
            .transpose()?;
        let mut wake = WaitSet::new();
        let snapshots = wake.add(bus.listener(names::WORLD_SNAPSHOT)?);
        if let Some(served) = &mut served {
            served.announce(&bus)?;
        }
        Ok(Session {
            options,
            lockstep: None,
            next_join: Instant::now(),
            wake,
            snapshots,
            announced: false,
            served,
            daemon: bus.notifier(names::CONTROL_WAKE)?,
            writer: bus.control_writer(&name)?,
            trail: SnapshotTrail::new(),
            map: FollowedDocument::new(names::WORLD_MAP),
            info: FollowedDocument::new(names::WORLD_INFO),
            info_episode: None,
            actors: FollowedDocument::new(names::WORLD_ACTORS),
            list_revision: 0,
            list_epoch: 0,
            desk: Desk::new(Start {
                common: options.parameters.clone(),
                seed: options.seed,
                lockstep: options.lockstep,
                leads_people: options.crowd.walkers > 0,
            }),
            people: People::new(options.crowd),
            commands: None,
            command_name: format!("gantry-{name}"),
            episode: None,
            done: TickId::default(),
            peers,
            assigned: None,
            refused_map: None,
            waiting: None,
            bus,
            name,
        })
    }

    /// Waits for the next snapshot or request.
    fn wait(&mut self) -> anyhow::Result<()> {
        let most = if self.announced { MAX_WAIT } else { POLL };
        match &self.served {
            None => self.wake.wait(most)?,
            Some(served) => {
                served.greet();
                let requests = [served.requests.as_fd()];
                !self.wake.wait_beside(&requests, most)?.is_empty()
            }
        };
        self.announced |= self.wake.woken(self.snapshots);
        Ok(())
    }

    /// Answers the newest snapshot and runs requests.
    ///
    /// Who asks has seen at most the snapshot that is on the bus when its request is taken. That one
    /// is answered first, so that what is asked between two ticks counts from the same tick in every
    /// run.
    fn turn(&mut self) -> anyhow::Result<()> {
        let requests = self.served.as_ref().map(|served| served.requests.take());
        self.answer()?;
        let Some(requests) = requests else {
            return Ok(());
        };
        let answers: Vec<Answer> = requests
            .into_iter()
            .map(|request| request(&mut self.desk))
            .collect();
        if !answers.is_empty() {
            let parked = self.desk.take_parked();
            self.brake(&parked)?;
            let commands = self.desk.take_commands();
            self.send(commands)?;
            self.read_info()?;
            self.leave_lockstep_if_asked();
            if self.lockstep.is_none() {
                self.next_join = Instant::now();
                self.join()?;
            }
        }
        if let Some(served) = &mut self.served {
            served.keep(&self.desk, answers);
        }
        Ok(())
    }

    fn answer(&mut self) -> anyhow::Result<()> {
        let Some(world) = self.trail.newest(&self.bus)? else {
            return Ok(());
        };
        let now = tick_id(&world);
        self.read_info()?;
        self.leave_lockstep_if_asked();
        if let Some(peers) = &mut self.peers {
            peers.listen(now, world.header.period_nanos, self.lockstep.is_some())?;
        }
        if now == self.done {
            return self.join();
        }
        self.desk
            .set_episode(world.header.epoch, world.header.episode);
        if let Some(served) = &mut self.served {
            served.recall(&mut self.desk);
        }
        self.read_list(&world)?;
        let is_ready = self.prepare(&world)?;
        // Without a map nothing can be driven; in a world that stands still it is looked for again.
        if !is_ready && (!self.desk.lockstep() || self.waits_for_map(&world)) {
            return Ok(());
        }
        self.join()?;
        if self.desk.lockstep() && !self.answers(now) {
            self.done = now;
            return Ok(());
        }
        let step = if is_ready {
            self.step(&world)
        } else {
            Step::default()
        };
        // Peers hear from an answer without controls that somebody is at work.
        if !step.controls.is_empty() || self.peers.is_some() {
            self.writer.send(world.header.tick, &step.controls)?;
            self.daemon.notify();
        }
        self.send(step.commands)?;
        self.populate()?;
        self.done = now;
        if let Some(lockstep) = &self.lockstep {
            lockstep.ack(world.header.tick)?;
        }
        Ok(())
    }

    /// Whether the simulator waits for what is said about this tick. Controls for an earlier one
    /// would arrive before or after it has begun the next, as chance will have it.
    fn answers(&self, now: TickId) -> bool {
        self.lockstep
            .as_ref()
            .is_some_and(|it| it.epoch() == now.epoch && it.first_tick() <= now.tick)
    }

    /// In lockstep, a tick whose map has not arrived is not answered yet.
    fn waits_for_map(&mut self, world: &WorldAt) -> bool {
        let now = tick_id(world);
        let is_refused = self
            .refused_map
            .is_some_and(|(epoch, _)| epoch == now.epoch);
        if !self.desk.lockstep() || is_refused {
            return false;
        }
        let since = match self.waiting {
            Some((of, since)) if of == now => since,
            _ => Instant::now(),
        };
        self.waiting = Some((now, since));
        since.elapsed() < LOCKSTEP_WAIT
    }

    /// Joins lockstep, and joins again after a restart.
    fn join(&mut self) -> anyhow::Result<()> {
        if !self.desk.lockstep() {
            return Ok(());
        }
        let epoch = self
            .trail
            .newest(&self.bus)?
            .map(|world| world.header.epoch);
        if self
            .lockstep
            .as_ref()
            .is_some_and(|l| epoch.is_some_and(|e| e != l.epoch()))
        {
            self.lockstep = None;
        }
        if self.lockstep.is_none() && epoch.is_some() && Instant::now() >= self.next_join {
            self.next_join = Instant::now() + JOIN_EVERY;
            let name = self.options.lockstep_name.as_ref().unwrap_or(&self.name);
            match Lockstep::join(&self.bus, name, JOIN_EVERY) {
                Ok(lockstep) => {
                    tracing::info!(first_tick = lockstep.first_tick(), "joined lockstep");
                    self.lockstep = Some(lockstep);
                }
                Err(error) => tracing::warn!(%error, "will try again"),
            }
        }
        Ok(())
    }

    /// Reads the list of actors until it matches this snapshot, but waits only a short while.
    fn read_list(&mut self, world: &WorldAt) -> anyhow::Result<()> {
        let wait = if self.desk.lockstep() {
            LOCKSTEP_WAIT
        } else {
            LIST_WAIT
        };
        let deadline = Instant::now() + wait;
        loop {
            if let Some(document) = heal(self.actors.changed(&self.bus))?.flatten() {
                let list = document.json().context("world/actors")?;
                (self.list_revision, self.list_epoch) =
                    (document.header.revision, document.header.epoch);
                self.desk.set_actors(list);
            }
            let is_of_now = self.list_epoch == world.header.epoch
                && self.list_revision >= world.header.actors_revision;
            if is_of_now || Instant::now() >= deadline {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Reads what the simulator says about itself.
    fn read_info(&mut self) -> anyhow::Result<()> {
        if let Some(document) = heal(self.info.changed(&self.bus))?.flatten()
            && let Ok(info) = document.json::<WorldInfo>()
        {
            self.info_episode = Some((document.header.epoch, info.episode));
            self.desk.set_world(&info);
        }
        Ok(())
    }

    /// Leaves lockstep when it has been switched off.
    fn leave_lockstep_if_asked(&mut self) {
        if !self.desk.lockstep() && self.lockstep.take().is_some() {
            tracing::info!("left lockstep");
        }
    }

    /// Makes sure that there is a fleet for this episode; false while its map or its seed has not
    /// arrived.
    fn prepare(&mut self, world: &WorldAt) -> anyhow::Result<bool> {
        let (epoch, episode) = (world.header.epoch, world.header.episode);
        if self
            .episode
            .as_ref()
            .is_some_and(|e| (e.epoch, e.episode) == (epoch, episode))
        {
            return Ok(true);
        }
        if self.info_episode != Some((epoch, episode)) {
            return Ok(false);
        }
        heal(self.map.changed(&self.bus))?;
        let Some(document) = self.map.newest().filter(|d| d.header.epoch == epoch) else {
            return Ok(false);
        };
        let revision = document.header.revision;
        let used = self
            .episode
            .as_ref()
            .filter(|e| e.epoch == epoch)
            .map(|e| e.map_revision);
        if used.is_some_and(|used| revision <= used) || self.refused_map == Some((epoch, revision))
        {
            return Ok(false);
        }
        match RoadMap::parse(&document.text) {
            Ok(map) => {
                for warning in map.warnings() {
                    tracing::debug!(%warning, "map");
                }
                tracing::info!(
                    lanes = map.lanes().len(),
                    signals = map.signals().len(),
                    episode,
                    "read the map"
                );
                let map = Arc::new(map);
                let fleet = Fleet::new(map.clone());
                if let Some(people) = &mut self.people {
                    people.begin(map, self.desk.settings_mut().seed);
                }
                self.episode = Some(Episode {
                    epoch,
                    episode,
                    map_revision: revision,
                    fleet,
                });
                self.assigned = None;
                Ok(true)
            }
            Err(error) => {
                tracing::error!(%error, "cannot drive on this map");
                self.refused_map = Some((epoch, revision));
                Ok(false)
            }
        }
    }

    fn step(&mut self, at: &WorldAt) -> Step {
        let Some(episode) = &mut self.episode else {
            return Step::default();
        };
        let header = &at.header;
        let traffic = Traffic::of(&Snapshot {
            tick: header.tick,
            // Choices must not depend on what was driven before this episode.
            sim_nanos: header.sim_nanos.saturating_sub(self.desk.begin_nanos()),
            period_nanos: header.period_nanos,
            records: &at.records,
            actors: self.desk.actors(),
        });
        let shares = self.peers.as_ref().map_or(0, Peers::revision);
        let now = (
            self.list_epoch,
            self.list_revision,
            self.desk.revision(),
            shares,
        );
        // Vehicles that could not be placed on a lane are tried again once a second.
        if self.assigned != Some(now) || header.tick.is_multiple_of(20) {
            let mut ids = self.options.vehicles.choose(self.desk.actors());
            ids.extend(self.desk.registered());
            ids.sort_unstable();
            ids.dedup();
            if let Some(peers) = &self.peers {
                ids.retain(|id| peers.drives(*id));
            }
            let before = episode.fleet.len();
            let geometry = geometry(self.desk.actors());
            episode
                .fleet
                .assign(&ids, &traffic, |id| geometry.get(&id).copied());
            if episode.fleet.len() != before {
                tracing::info!(vehicles = episode.fleet.len(), "driving");
            }
            self.assigned = Some(now);
        }
        let mut step = episode.fleet.step(&traffic, self.desk.settings_mut());
        self.desk.note_actions(&mut episode.fleet);
        if let Some(people) = &mut self.people {
            step.commands.extend(people.step(&traffic));
        }
        step
    }

    /// Lets people come that are still missing.
    fn populate(&mut self) -> anyhow::Result<()> {
        let Some(people) = &mut self.people else {
            return Ok(());
        };
        people.prepare(&self.bus, self.desk.actors())?;
        let spawns = people.missing();
        if !spawns.is_empty() {
            let replies = self.send(spawns.clone())?;
            if let Some(people) = &mut self.people {
                people.came(&spawns, &replies);
            }
        }
        Ok(())
    }

    /// Sends commands and waits until they are taken, so that they act on the next tick. Returns
    /// their replies, or nothing if the simulator took none.
    fn send(&mut self, commands: Vec<Command>) -> anyhow::Result<Vec<CommandReply>> {
        if commands.is_empty() {
            return Ok(Vec::new());
        }
        let client = match &mut self.commands {
            Some(client) => client,
            none => none.insert(self.bus.command_client(&self.command_name)?),
        };
        match client.request(&CommandBatch::new(commands), COMMAND_WAIT) {
            Ok(answer) => {
                for reply in &answer.replies {
                    tracing::debug!(?reply, "command");
                }
                Ok(answer.replies)
            }
            Err(CommandError::Bus(error)) => Err(error.into()),
            Err(error) => {
                tracing::warn!(%error, "the simulator took no command");
                Ok(Vec::new())
            }
        }
    }

    /// Stops all driven vehicles, because the simulator keeps applying the last controls, and takes
    /// the crowd away.
    fn park(&mut self) -> anyhow::Result<()> {
        if let Some(people) = &mut self.people {
            let commands = people.leave();
            self.send(commands)?;
        }
        let driven = self.episode.iter().flat_map(|e| e.fleet.drivers().keys());
        let ids: Vec<u32> = driven.copied().collect();
        if let Some(served) = &mut self.served {
            served.end();
        }
        self.brake(&ids)
    }

    fn brake(&mut self, ids: &[u32]) -> anyhow::Result<()> {
        let brake = VehicleControl {
            brake_ratio: 1.0,
            ..VehicleControl::default()
        };
        let records: Vec<VehicleControlRecord> = ids
            .iter()
            .map(|id| VehicleControlRecord::new(*id, brake))
            .collect();
        if !records.is_empty() {
            self.writer.send(self.done.tick, &records)?;
            self.daemon.notify();
        }
        Ok(())
    }
}

fn tick_id(world: &WorldAt) -> TickId {
    TickId {
        epoch: world.header.epoch,
        tick: world.header.tick,
    }
}

/// Skips a document that breaks the contract; any other error is returned.
fn heal<T>(result: Result<T, BusError>) -> Result<Option<T>, BusError> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(error @ BusError::BadSample { .. }) => {
            tracing::warn!(%error, "passed over a document");
            Ok(None)
        }
        Err(other) => Err(other),
    }
}

/// Geometry by vehicle, for those whose attributes tell it.
fn geometry(list: &ActorList) -> BTreeMap<u32, Geometry> {
    let of = |actor: &schema_frames::ActorInfo| {
        let number = |name: &str| {
            actor
                .attributes
                .get(name)?
                .parse::<f64>()
                .ok()
                .filter(|x| x.is_finite() && *x > 0.0)
        };
        let geometry = Geometry {
            wheelbase_m: number("wheelbase_m")?,
            max_steer_rad: number("max_steer_rad")?,
        };
        Some((actor.id, geometry))
    };
    list.actors.iter().filter_map(of).collect()
}
