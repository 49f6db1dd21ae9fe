//! Closed loop on the generated town with the daemon's own physics: the ego and twenty others for five minutes.

use std::collections::BTreeMap;
use std::sync::Arc;

use consumer_drive::driver::Wait;
use consumer_drive::path::distance;
use consumer_drive::{Fleet, World};
use schema_frames::{ActorList, LightState};
use schema_roads::RoadMap;
use schema_types::ActorId;
use simd_world::{CollisionMesh, MapData, WorldOptions};

const PERIOD_NANOS: u64 = 50_000_000;

/// What happened to one vehicle.
#[derive(Clone, Copy, Debug, Default)]
struct Log {
    driven_m: f64,
    worst_offset_m: f64,
    last: Option<[f64; 2]>,
    longest_stand_secs: f64,
    stands_secs: f64,
    n_touches: u32,
    ran_red: u32,
    n_rescues: u32,
}

struct Stage {
    world: simd_world::World,
    fleet: Fleet,
    actors: ActorList,
    logs: BTreeMap<u32, Log>,
    tick: u64,
}

impl Stage {
    fn new(n_others: usize, seed: u64) -> Stage {
        let town = simd_town::Town::generate(&std::env::var("DRIVE_TOWN").unwrap_or("Town10HD".into()), 1).unwrap();
        let mut map = MapData::from(&town);
        if map.collision.is_empty() {
            map.collision = vec![CollisionMesh {
                vertices_m: vec![[-900.0, -900.0, 0.0], [900.0, -900.0, 0.0], [900.0, 900.0, 0.0], [-900.0, 900.0, 0.0]],
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                ..CollisionMesh::default()
            }];
        }
        let mut world = simd_world::World::new(WorldOptions { seed, ..WorldOptions::default() });
        world.load(&map).unwrap();
        world.spawn_scenario("vehicle.tesla.model3", 0, n_others).unwrap();
        let roads = Arc::new(RoadMap::parse(&town.open_drive).unwrap());
        assert!(roads.warnings().is_empty(), "{:?}", roads.warnings());
        let actors = world.actor_list();
        Stage { world, fleet: Fleet::new(roads, seed, 1.0), actors, logs: BTreeMap::new(), tick: 0 }
    }

    fn step(&mut self) -> World {
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
        view
    }

    fn log(&mut self, view: &World) {
        let touched: Vec<u32> =
            self.world.snapshot_records().iter().filter(|r| r.flags & schema_frames::ActorRecord::TOUCHED != 0).map(|r| r.id).collect();
        let mut logs = std::mem::take(&mut self.logs);
        for mover in &view.movers {
            let log = logs.entry(mover.id).or_default();
            let at = [mover.position_m[0], mover.position_m[1]];
            if let Some(last) = log.last.replace(at) {
                log.driven_m += distance(last, at);
            }
            log.stands_secs = if mover.speed_mps.abs() < 0.3 { log.stands_secs + 0.05 } else { 0.0 };
            log.longest_stand_secs = log.longest_stand_secs.max(log.stands_secs);
            if touched.contains(&mover.id) {
                log.n_touches += 1;
                if log.n_touches == 1 && std::env::var_os("DRIVE_LOG").is_some() {
                    let near: Vec<u32> = view.movers.iter().filter(|o| o.id != mover.id && o.overlaps(mover, 0.3)).map(|o| o.id).collect();
                    eprintln!("t={:.2} {} touches {near:?} at {at:?} v={:.1}", view.time_secs, mover.id, mover.speed_mps);
                    self.print_near(view, mover);
                }
            }
            if let Some(driver) = self.fleet.drivers().get(&mover.id) {
                if std::env::var("DRIVE_TRACE").is_ok_and(|t| t.parse() == Ok(mover.id)) {
                    let f = driver.foot();
                    eprintln!(
                        "T {:.2} v {:.2} off {:.3} course {:.4} steer {:.4} wheel {:.4} yawrate {:.4} k {:.4} s {:.1}",
                        view.time_secs,
                        mover.speed_mps,
                        f.offset_m,
                        consumer_drive::path::wrap(mover.yaw_rad - f.heading_rad),
                        mover.steer_ratio,
                        mover.wheel_steer_rad,
                        mover.yaw_rate_radps,
                        driver.path().at(f.arc_m).curvature_per_m,
                        f.arc_m
                    );
                }
                if driver.n_rescues() > log.n_rescues && std::env::var_os("DRIVE_LOG").is_some() {
                    eprintln!("t={:.2} {} backs off at {at:?}", view.time_secs, mover.id);
                    self.print_near(view, mover);
                }
                log.n_rescues = driver.n_rescues();
                log.worst_offset_m = log.worst_offset_m.max(driver.foot().offset_m.abs());
            }
        }
        self.logs = logs;
    }

    /// Everybody near one vehicle.
    fn print_near(&self, view: &World, mover: &consumer_drive::Mover) {
        for o in view.movers.iter().filter(|o| distance(o.middle(), mover.middle()) < 20.0) {
            let d = &self.fleet.drivers()[&o.id];
            let record = self.world.record(ActorId(o.id)).unwrap();
            let (part, [x, y]) = (record.vehicle().unwrap(), o.middle());
            eprintln!(
                "   {} ({x:.1}, {y:.1}) z {:.2} yaw {:.2} half {:.1?} v {:.1} {:?} {:?} entry {:.1?} arc {:.1} offset {:.2} heading {:.2} throttle {:.2} brake {:.2} gear {} wheels {}",
                o.id,
                o.position_m[2],
                o.yaw_rad,
                o.half_m,
                o.speed_mps,
                d.wait(),
                d.lane(),
                d.entry(),
                d.foot().arc_m,
                d.foot().offset_m,
                d.foot().heading_rad,
                part.throttle_ratio,
                part.brake_ratio,
                part.gear,
                part.wheels_on_ground
            );
        }
    }

    fn print(&self, view: &World) {
        for (id, log) in &self.logs {
            let driver = &self.fleet.drivers()[id];
            let mover = view.mover(*id).unwrap();
            let kind = &self.actors.actors.iter().find(|a| a.id == *id).unwrap().type_id;
            eprintln!(
                "{id:4} {kind:32} {:6.0} m  offset {:.2} m  stand {:5.1} s  touches {:4} red {}  v {:4.1} {:?} {:?}",
                log.driven_m,
                log.worst_offset_m,
                log.longest_stand_secs,
                log.n_touches,
                log.ran_red,
                mover.speed_mps,
                driver.wait(),
                driver.lane()
            );
        }
    }
}

#[test]
fn twenty_one_vehicles_flow_for_five_minutes_without_touching() {
    let minutes: f64 = std::env::var("DRIVE_MINUTES").ok().and_then(|m| m.parse().ok()).unwrap_or(5.0);
    let seed: u64 = std::env::var("DRIVE_SEED").ok().and_then(|m| m.parse().ok()).unwrap_or(1);
    let cars: usize = std::env::var("DRIVE_CARS").ok().and_then(|m| m.parse().ok()).unwrap_or(20);
    let mut stage = Stage::new(cars, seed);
    let mut view = World::default();
    for i in 0..(minutes * 1200.0) as u64 {
        view = stage.step();
        if std::env::var_os("DRIVE_LOG").is_some() && i % 600 == 599 {
            eprintln!("--- {:.0} s", view.time_secs);
            stage.print(&view);
        }
    }
    let states: Vec<&LightState> = view.lights.values().collect();
    assert!(!states.is_empty());
    let touches: u32 = stage.logs.values().map(|l| l.n_touches).sum();
    let total: f64 = stage.logs.values().map(|l| l.driven_m).sum();
    eprintln!("{total:.0} m, {touches} touches, {} waiting", stage.fleet.drivers().values().filter(|d| d.wait() != Wait::No).count());
    assert_eq!(touches, 0);
    for (id, log) in &stage.logs {
        assert!(log.driven_m > 100.0 * minutes, "{id}: {log:?}");
        assert!(log.worst_offset_m < 0.5, "{id}: {log:?}");
    }
}
