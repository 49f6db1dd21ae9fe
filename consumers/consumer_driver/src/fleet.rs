//! All drivers of one process.

use std::collections::BTreeMap;
use std::sync::Arc;

use schema_frames::{Command, LightState, VehicleControlRecord};
use schema_roads::RoadMap;

use crate::crossing::{Crossings, Now};
use crate::driver::{Blocker, Driver, TickView, Wait};
use crate::lanes::network::{Network, TURN_RAD};
use crate::lanes::path::Leg;
use crate::lanes::strangers::Strangers;
use crate::lanes::table::{LaneTable, OnLane};
use crate::overtaking::{self, Around};
use crate::parameters::{Action, RoadOption, Settings, VehicleParameters};
use crate::plane::wrap;
use crate::steer::Geometry;
use crate::traffic::{Grid, Mover, STANDING_MPS, Traffic};
use crate::upkeep::Upkeep;

mod users;

/// A vehicle inside a junction that a waiting one has blocked for this long is given room, seconds.
const YIELD_AFTER_SECS: f64 = 5.0;
/// Largest number of vehicles in a queue that back off for it.
const MAX_QUEUE: usize = 6;

/// What a fleet does in a tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Step {
    /// One record per driven vehicle that is there and obeys physics, by rising id.
    pub controls: Vec<VehicleControlRecord>,
    /// What is asked of the simulator besides: vehicles that are moved without physics, removed, or
    /// brought back.
    pub commands: Vec<Command>,
}

/// All drivers of one process.
#[derive(Clone, Debug)]
pub struct Fleet {
    net: Network,
    drivers: BTreeMap<u32, Driver>,
    strangers: Strangers,
    crossings: Crossings,
    upkeep: Upkeep,
    lights: Vec<LightState>,
    plain: VehicleParameters,
    seed: u64,
}

impl Fleet {
    /// A fleet without drivers.
    pub fn new(map: Arc<RoadMap>) -> Fleet {
        Fleet {
            lights: vec![LightState::Unknown; map.signals().len()],
            net: Network::new(map),
            drivers: BTreeMap::new(),
            strangers: Strangers::default(),
            crossings: Crossings::default(),
            upkeep: Upkeep::default(),
            plain: VehicleParameters::default(),
            seed: 0,
        }
    }

    /// The drivers by vehicle.
    pub fn drivers(&self) -> &BTreeMap<u32, Driver> {
        &self.drivers
    }

    /// Number of vehicles that are driven.
    pub fn len(&self) -> usize {
        self.drivers.len()
    }

    /// Whether nobody is driven.
    pub fn is_empty(&self) -> bool {
        self.drivers.is_empty()
    }

    /// Drives exactly these vehicles from now on. `geometry` returns the geometry of those for
    /// which it is known.
    pub fn assign(
        &mut self,
        ids: &[u32],
        traffic: &Traffic,
        geometry: impl Fn(u32) -> Option<Geometry>,
    ) {
        let upkeep = &mut self.upkeep;
        self.drivers.retain(|id, driver| {
            let stays = ids.contains(id);
            if !stays && driver.glides && traffic.mover(*id).is_some() {
                upkeep.release(*id);
            }
            stays
        });
        for id in ids {
            if self.drivers.contains_key(id) {
                continue;
            }
            let Some(me) = traffic.mover(*id) else {
                continue;
            };
            if let Some(mut driver) = Driver::new(&mut self.net, me, self.seed) {
                if let Some(geometry) = geometry(*id) {
                    driver.set_geometry(geometry);
                }
                self.drivers.insert(*id, driver);
            }
        }
    }

    /// The decisions ahead of a vehicle, the next first; none for one that is not driven.
    pub fn actions(&self, id: u32) -> Vec<Action> {
        let Some(driver) = self.drivers.get(&id) else {
            return Vec::new();
        };
        let path = driver.path();
        let action = |option: RoadOption, arc_m: f64| {
            let point = path.at(arc_m);
            let [x, y] = point.position_m;
            Action {
                option,
                position_m: [x, y, point.height_m],
                heading_rad: point.heading_rad,
            }
        };
        let shift = path.shift().map(|shift| {
            let option = match shift.side {
                crate::plane::Side::Left => RoadOption::ChangeLaneLeft,
                crate::plane::Side::Right => RoadOption::ChangeLaneRight,
            };
            action(option, shift.arc_m[0].max(driver.foot().arc_m))
        });
        let here_m = driver.foot().arc_m;
        let ahead = path.legs().iter().filter(|leg| leg.arc_m[1] > here_m);
        let legs: Vec<&Leg> = ahead.collect();
        let junctions = legs
            .chunk_by(|a, b| a.zone() == b.zone())
            .filter(|group| group[0].zone().is_some());
        let turns = junctions.map(|group| {
            let turn_rad: f64 = group.iter().map(|leg| leg.way.turn_rad).sum();
            let option = match turn_rad {
                turn if turn > TURN_RAD => RoadOption::Left,
                turn if turn < -TURN_RAD => RoadOption::Right,
                _ => RoadOption::Straight,
            };
            action(option, group[0].arc_m[0].max(here_m))
        });
        let mut actions: Vec<Action> = shift.into_iter().chain(turns).collect();
        actions.push(action(RoadOption::LaneFollow, path.end().arc_m));
        actions
    }

    /// What to do in this tick. Decisions that have been carried out are taken from the settings.
    pub fn step(&mut self, traffic: &Traffic, settings: &mut Settings) -> Step {
        self.seed = settings.seed;
        self.read_lights(traffic);
        let grid = Grid::new(&traffic.movers);
        let tick = TickView {
            traffic,
            grid: &grid,
            lights: &self.lights,
            strangers: &self.strangers,
            settings,
            plain: &self.plain,
        };
        for (id, driver) in &mut self.drivers {
            if let Some(me) = traffic.mover(*id) {
                let view = tick.of(*id);
                driver.localise(&mut self.net, me, view);
                driver.see_lights(view, me);
            }
        }
        let mut lanes = self.table(traffic);
        let tick = TickView {
            traffic,
            grid: &grid,
            lights: &self.lights,
            strangers: &self.strangers,
            settings,
            plain: &self.plain,
        };
        let users = users::users(&mut self.net, &self.drivers, &lanes, &tick);
        let now = Now {
            tick: traffic.tick,
            time_secs: traffic.time_secs,
            period_secs: traffic.period_secs,
        };
        let passages = self.crossings.decide(&mut self.net, &users, now);
        for (id, driver) in &mut self.drivers {
            driver.take_passages(|zone| passages.get(&(*id, zone)).copied());
        }
        let forced = self.change_lanes(traffic, &grid, &mut lanes, settings);
        self.make_room(traffic, &grid);
        let mut step = Step::default();
        let heroes: Vec<[f64; 2]> = traffic
            .movers
            .iter()
            .filter(|mover| mover.is_hero)
            .map(Mover::middle)
            .collect();
        let tick = TickView {
            traffic,
            grid: &grid,
            lights: &self.lights,
            strangers: &self.strangers,
            settings,
            plain: &self.plain,
        };
        for (id, driver) in &mut self.drivers {
            let Some(me) = traffic.mover(*id) else {
                continue;
            };
            let view = tick.of(*id);
            let glides = self
                .upkeep
                .moves(driver, me, view, &heroes, &mut step.commands);
            if !glides {
                step.controls.push(driver.control(me, view));
            }
        }
        self.upkeep
            .tend(&self.net, &self.drivers, &tick, &heroes, &mut step.commands);
        self.note_progress(traffic, settings, &forced);
        step
    }

    fn read_lights(&mut self, traffic: &Traffic) {
        self.lights.fill(LightState::Unknown);
        for (id, state) in &traffic.lights {
            if let Some(idx) = self.net.signal(id) {
                self.lights[idx as usize] = *state;
            }
        }
    }

    /// Who is on which lane.
    fn table(&mut self, traffic: &Traffic) -> LaneTable {
        let Fleet {
            net,
            drivers,
            strangers,
            ..
        } = self;
        let mut entries = Vec::with_capacity(traffic.movers.len() + 8);
        let vehicles = traffic.movers.iter().enumerate();
        for (idx, mover) in vehicles.filter(|(_, mover)| mover.is_vehicle) {
            let on_lane = |at| OnLane {
                at,
                mover: idx as u32,
            };
            match drivers.get(&mover.id) {
                Some(driver) => entries.extend(driver.on_lanes().map(on_lane)),
                None => {
                    let place = strangers.place(net, mover, traffic.time_secs);
                    entries.extend(place.map(on_lane));
                }
            }
        }
        strangers.forget_absent(traffic, |id| drivers.contains_key(&id));
        LaneTable::new(entries)
    }

    /// Begins changes of lanes; returns the vehicles whose forced change has begun.
    fn change_lanes(
        &mut self,
        traffic: &Traffic,
        grid: &Grid,
        lanes: &mut LaneTable,
        settings: &Settings,
    ) -> Vec<u32> {
        let mut forced = Vec::new();
        let mut ids = Vec::new();
        for (idx, me) in traffic.movers.iter().enumerate() {
            let Some(driver) = self.drivers.get_mut(&me.id) else {
                continue;
            };
            let around = Around {
                traffic,
                grid,
                lanes,
                rules: settings.rules(me.id, &self.plain),
                seed: self.seed,
            };
            overtaking::watch_detour(driver, me, &around);
            let change = overtaking::consider(&mut self.net, driver, me, idx as u32, &around);
            if let Some(change) = change {
                if change.was_forced {
                    forced.push(me.id);
                }
                if let Some(at) = driver.lane_after(2.0) {
                    lanes.insert(OnLane {
                        at,
                        mover: idx as u32,
                    });
                }
            } else if driver.blocked_by().is_some() {
                ids.push(me.id);
            }
        }
        for id in ids {
            self.pass_standing(id, traffic, grid, lanes, settings);
        }
        forced
    }

    fn pass_standing(
        &mut self,
        id: u32,
        traffic: &Traffic,
        grid: &Grid,
        lanes: &LaneTable,
        settings: &Settings,
    ) {
        let Some(mut driver) = self.drivers.remove(&id) else {
            return;
        };
        if let Some(me) = traffic.mover(id) {
            let around = Around {
                traffic,
                grid,
                lanes,
                rules: settings.rules(id, &self.plain),
                seed: self.seed,
            };
            overtaking::pass_standing(&mut driver, me, &around, |other| self.queues(other));
        }
        self.drivers.insert(id, driver);
    }

    /// Whether a vehicle stands for a reason that will pass: a light, its turn, or a queue before
    /// it.
    fn queues(&self, id: u32) -> bool {
        match self.drivers.get(&id) {
            Some(driver) => driver.wait() != Wait::No && driver.wait() != Wait::End,
            None => self.strangers.is_before_junction(id),
        }
    }

    /// Makes a vehicle that waits before a junction and blocks another one inside it back off,
    /// together with the queue behind it.
    fn make_room(&mut self, traffic: &Traffic, grid: &Grid) {
        let blockers: Vec<u32> = self
            .drivers
            .iter()
            .filter_map(|(id, driver)| {
                let Blocker { id: blocker, secs } = driver.blocked_by()?;
                let me = traffic.mover(*id)?;
                let waits = secs > YIELD_AFTER_SECS && self.waits_at_junction(blocker);
                (waits && driver.is_inside(me) && !queues_behind(me, traffic.mover(blocker)?))
                    .then_some(blocker)
            })
            .collect();
        for first in blockers {
            let mut next = Some(first);
            for _ in 0..MAX_QUEUE {
                let Some(id) = next else { break };
                let (Some(driver), Some(me)) = (self.drivers.get_mut(&id), traffic.mover(id))
                else {
                    break;
                };
                if driver.is_inside(me)
                    || driver.is_reversing()
                    || me.speed_mps.abs() > STANDING_MPS
                {
                    break;
                }
                next = traffic.behind(me, 2.0, grid);
                driver.make_room();
            }
        }
    }

    fn waits_at_junction(&self, id: u32) -> bool {
        self.drivers
            .get(&id)
            .is_some_and(|driver| matches!(driver.wait(), Wait::Turn | Wait::Light | Wait::Sign))
    }

    /// Takes what has been carried out from the settings.
    fn note_progress(&mut self, traffic: &Traffic, settings: &mut Settings, forced: &[u32]) {
        for id in forced {
            settings.vehicle_mut(*id).forced_lane_change = None;
        }
        for (id, own) in &mut settings.vehicles {
            let Some((driver, me)) = self.drivers.get_mut(id).zip(traffic.mover(*id)) else {
                continue;
            };
            if let Some((route, places)) = driver.note_progress(me) {
                (own.route, own.custom_path_m) = (route, places);
            }
        }
    }
}

/// Whether a vehicle stands behind another one, headed the same way: it waits with it, and nobody
/// has to back off for it.
fn queues_behind(me: &Mover, ahead: &Mover) -> bool {
    let (sin, cos) = ahead.yaw_rad.sin_cos();
    let [x, y] = [0, 1].map(|i| me.middle()[i] - ahead.middle()[i]);
    x * cos + y * sin < 0.0 && wrap(me.yaw_rad - ahead.yaw_rad).abs() < 0.6
}
