//! Closed loop on generated towns with the daemon's own physics: light traffic that must flow, dense traffic that must not lock up.

use std::collections::BTreeMap;
use std::sync::Arc;

use consumer_drive::path::distance;
use consumer_drive::{Fleet, World};
use schema_frames::{ActorList, ActorRecord};
use schema_roads::RoadMap;
use schema_types::ActorId;
use simd_world::{MapData, WorldOptions};

const PERIOD_NANOS: u64 = 50_000_000;
const TICKS_PER_MINUTE: u64 = 1200;

/// What happened to one vehicle.
#[derive(Clone, Copy, Debug, Default)]
struct Log {
    driven_m: f64,
    worst_offset_m: f64,
    last: Option<[f64; 2]>,
    n_touches: u32,
}

struct Stage {
    world: simd_world::World,
    fleet: Fleet,
    actors: ActorList,
    logs: BTreeMap<u32, Log>,
    tick: u64,
}

impl Stage {
    fn new(town: &str, n_others: usize, seed: u64) -> Stage {
        let town = simd_town::Town::generate(town, 1).unwrap();
        let mut world = simd_world::World::new(WorldOptions { seed, ..WorldOptions::default() });
        world.load(&MapData::from(&town)).unwrap();
        world.spawn_scenario("vehicle.tesla.model3", 0, n_others).unwrap();
        let roads = Arc::new(RoadMap::parse(&town.open_drive).unwrap());
        assert!(roads.warnings().is_empty(), "{:?}", roads.warnings());
        let actors = world.actor_list();
        Stage { world, fleet: Fleet::new(roads, seed, 1.0), actors, logs: BTreeMap::new(), tick: 0 }
    }

    fn drive(&mut self, minutes: u64) {
        for _ in 0..minutes * TICKS_PER_MINUTE {
            self.step();
        }
    }

    fn step(&mut self) {
        self.world.step(PERIOD_NANOS);
        self.tick += 1;
        let view = World::from_records(self.tick, self.tick * PERIOD_NANOS, PERIOD_NANOS, self.world.snapshot_records(), &self.actors);
        if self.tick == 1 {
            let ids: Vec<u32> = view.movers.iter().map(|m| m.id).collect();
            let attribute = |id: u32, name: &str| {
                let actor = self.actors.actors.iter().find(|a| a.id == id)?;
                actor.attributes.get(name)?.parse::<f64>().ok()
            };
            self.fleet.assign(&ids, &view, |id| Some((attribute(id, "wheelbase_m")?, attribute(id, "max_steer_rad")?)));
            assert_eq!(self.fleet.len(), ids.len());
        }
        for record in self.fleet.step(&view) {
            self.world.set_control(ActorId(record.actor_id), record.control()).unwrap();
            if record.lamps != u32::MAX {
                self.world.set_lamps(ActorId(record.actor_id), record.lamps).unwrap();
            }
        }
        self.log(&view);
    }

    fn log(&mut self, view: &World) {
        for mover in &view.movers {
            let log = self.logs.entry(mover.id).or_default();
            let at = [mover.position_m[0], mover.position_m[1]];
            if let Some(last) = log.last.replace(at) {
                log.driven_m += distance(last, at);
            }
            let record = self.world.record(ActorId(mover.id)).unwrap();
            log.n_touches += u32::from(record.flags & ActorRecord::TOUCHED != 0);
            let offset_m = self.fleet.drivers()[&mover.id].foot().offset_m.abs();
            log.worst_offset_m = log.worst_offset_m.max(offset_m);
        }
    }

    fn driven_m(&self) -> f64 {
        self.logs.values().map(|log| log.driven_m).sum()
    }

    /// Vehicles that touched something, with the place of the last tick.
    fn touched(&self) -> Vec<(u32, Log)> {
        self.logs.iter().filter(|(_, log)| log.n_touches > 0).map(|(id, log)| (*id, *log)).collect()
    }
}

#[test]
fn twenty_one_vehicles_flow_for_five_minutes_without_touching() {
    let mut stage = Stage::new("Town10HD", 20, 1);
    stage.drive(5);
    assert_eq!(stage.touched().len(), 0, "{:?}", stage.touched());
    for (id, log) in &stage.logs {
        assert!(log.driven_m > 500.0, "{id}: {log:?}");
        assert!(log.worst_offset_m < 0.5, "{id}: {log:?}");
    }
}

/// Roads between Town01's junctions are short: queues reach back into the junction before, and whoever waits for somebody who
/// waits for it stands for ever. A rate in the last minutes that is near that of the first ones excludes this.
#[test]
fn sixty_vehicles_in_the_small_town_do_not_lock_up() {
    let mut stage = Stage::new("Town01", 60, 1);
    stage.drive(2);
    let first_m = stage.driven_m();
    stage.drive(2);
    let before_m = stage.driven_m();
    stage.drive(2);
    let last_m = stage.driven_m() - before_m;
    assert_eq!(stage.touched().len(), 0, "{:?}", stage.touched());
    assert!(last_m > 0.6 * first_m, "{first_m:.0} m in the first two minutes, {last_m:.0} m in the last two");
}
