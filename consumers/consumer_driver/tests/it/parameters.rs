//! What is set for a vehicle, seen in how it drives: on generated towns with the daemon's own
//! physics.

use std::collections::BTreeMap;
use std::sync::Arc;

use consumer_driver::plane::{Side, distance};
use consumer_driver::{Fleet, RoadOption, Settings, Snapshot, SpeedRule, Step, Traffic};
use schema_frames::{ActorList, Command, LightState, PhysicsAction};
use schema_roads::{LaneKey, LanePosition, RoadMap};
use schema_types::{ActorId, Pose};
use simd_world::{MapData, World, WorldOptions};

const PERIOD_NANOS: u64 = 50_000_000;

/// A world with vehicles where a test puts them.
struct Stage {
    world: World,
    roads: Arc<RoadMap>,
    fleet: Fleet,
    settings: Settings,
    actors: ActorList,
    driven: Vec<u32>,
    tick: u64,
}

impl Stage {
    fn new(town: &str) -> Stage {
        let town = simd_town::Town::generate(town, 1).unwrap();
        let roads = Arc::new(RoadMap::parse(&town.open_drive).unwrap());
        let mut world = World::new(WorldOptions::default());
        world.load(&MapData::of_town(&town, roads.clone())).unwrap();
        Stage {
            world,
            fleet: Fleet::new(roads.clone()),
            roads,
            settings: Settings::default(),
            actors: ActorList::default(),
            driven: Vec::new(),
            tick: 0,
        }
    }

    fn spawn(&mut self, at: LanePosition, role: &str) -> u32 {
        let mut pose = self.roads.pose(at).unwrap();
        pose.translation.z += 0.2;
        let attributes = BTreeMap::new();
        let model = "vehicle.tesla.model3";
        let pose = Pose::from(pose);
        let id = self
            .world
            .spawn(model, pose, None, role, &attributes)
            .unwrap();
        self.actors = self.world.actor_list();
        id.0
    }

    /// A vehicle that the fleet drives.
    fn drive(&mut self, at: LanePosition) -> u32 {
        let id = self.spawn(at, "autopilot");
        self.driven.push(id);
        id
    }

    fn traffic(&self) -> Traffic {
        let nanos = self.tick * PERIOD_NANOS;
        let records = self.world.snapshot_records();
        Traffic::of(&Snapshot {
            tick: self.tick,
            sim_nanos: nanos,
            period_nanos: PERIOD_NANOS,
            records,
            actors: &self.actors,
        })
    }

    fn step(&mut self) -> Step {
        self.world.step(PERIOD_NANOS);
        self.tick += 1;
        let traffic = self.traffic();
        self.fleet.assign(&self.driven, &traffic, |_| None);
        let step = self.fleet.step(&traffic, &mut self.settings);
        for record in &step.controls {
            let id = ActorId(record.actor_id);
            self.world.set_control(id, record.control()).unwrap();
        }
        for command in &step.commands {
            self.world.apply(command);
        }
        step
    }

    fn steps(&mut self, n: u64) {
        for _ in 0..n {
            self.step();
        }
    }

    fn speed_mps(&self, id: u32) -> f64 {
        self.world.record(ActorId(id)).unwrap().speed_mps()
    }

    fn place_m(&self, id: u32) -> [f64; 2] {
        let [x, y, _] = self
            .world
            .record(ActorId(id))
            .unwrap()
            .world_from_actor
            .translation_m;
        [x, y]
    }

    /// The lane whose middle is nearest to a vehicle.
    fn lane(&self, id: u32) -> LaneKey {
        let at = self
            .world
            .record(ActorId(id))
            .unwrap()
            .world_from_actor
            .translation_m;
        let drivable = |lane: &schema_roads::Lane| lane.kind.is_drivable();
        self.roads.nearest(at, drivable).unwrap().lane
    }

    /// The longest lane outside junctions that `fits`.
    fn long_lane(&self, fits: impl Fn(&RoadMap, &schema_roads::Lane) -> bool) -> LaneKey {
        self.roads
            .lanes()
            .iter()
            .filter(|lane| {
                lane.kind.is_drivable() && lane.junction.is_none() && fits(&self.roads, lane)
            })
            .max_by(|a, b| a.length_m.total_cmp(&b.length_m))
            .unwrap()
            .key
    }
}

/// Whether cars may use a neighbour.
fn is_drivable(roads: &RoadMap, beside: Option<LaneKey>) -> bool {
    beside.is_some_and(|key| roads.lane(key).is_some_and(|lane| lane.kind.is_drivable()))
}

/// The limit of the built-in highway is far above 8 m/s.
#[test]
fn a_desired_speed_is_driven_and_a_difference_counts_from_the_limit() {
    let mut stage = Stage::new("Town06");
    let key = stage.long_lane(|_, _| true);
    let id = stage.drive(LanePosition::new(key, 20.0));
    let limit = stage
        .roads
        .speed_limit_mps(LanePosition::new(key, 20.0))
        .unwrap();
    stage.settings.vehicle_mut(id).speed = SpeedRule::Desired(8.0);
    stage.steps(200);
    assert!(
        (stage.speed_mps(id) - 8.0).abs() < 0.5,
        "{}",
        stage.speed_mps(id)
    );
    stage.settings.vehicle_mut(id).speed = SpeedRule::Difference(40.0);
    stage.steps(200);
    let wanted = 0.6 * limit;
    assert!(
        (stage.speed_mps(id) - wanted).abs() < 0.05 * wanted,
        "{}",
        stage.speed_mps(id)
    );
}

/// A forced change goes to the lane that the map has on that side, and is taken from the settings
/// when it begins.
#[test]
fn a_forced_lane_change_ends_on_the_lane_beside() {
    let mut stage = Stage::new("Town06");
    let key = stage
        .long_lane(|roads, lane| is_drivable(roads, lane.left) && !is_drivable(roads, lane.right));
    let left = stage.roads.lane(key).unwrap().left.unwrap();
    let id = stage.drive(LanePosition::new(key, 20.0));
    stage.settings.vehicle_mut(id).changes_lanes = false;
    stage.steps(100);
    assert_eq!(stage.lane(id), key);
    stage.settings.vehicle_mut(id).forced_lane_change = Some(Side::Left);
    stage.steps(140);
    assert_eq!(stage.settings.vehicles[&id].forced_lane_change, None);
    assert_eq!(stage.lane(id), left);
    let foot = stage.fleet.drivers()[&id].foot();
    assert!(foot.offset_m.abs() < 0.3, "{foot:?}");
}

/// A car stands on the lane in front; there is a second lane, so the follower goes past it. Without
/// leave to change lanes, it stays behind.
#[test]
fn a_standing_car_is_overtaken_by_whoever_may_change_lanes() {
    for may_change in [true, false] {
        let mut stage = Stage::new("Town06");
        let key = stage.long_lane(|roads, lane| is_drivable(roads, lane.left));
        stage.spawn(LanePosition::new(key, 150.0), "");
        let id = stage.drive(LanePosition::new(key, 40.0));
        stage.settings.vehicle_mut(id).changes_lanes = may_change;
        let start = stage.place_m(id);
        stage.steps(600);
        let driven_m = distance(start, stage.place_m(id));
        assert_eq!(driven_m > 125.0, may_change, "{may_change}: {driven_m}");
        if !may_change {
            assert!(
                (85.0..110.0).contains(&driven_m),
                "it stands behind: {driven_m}"
            );
        }
    }
}

/// On a road with one lane each way, a car that stands far from any junction is passed over the
/// other lane when nobody comes.
#[test]
fn a_standing_car_on_a_narrow_road_is_passed() {
    let mut stage = Stage::new("Town07");
    let key = stage
        .long_lane(|roads, lane| !is_drivable(roads, lane.left) && !is_drivable(roads, lane.right));
    let length = stage.roads.lane(key).unwrap().length_m;
    stage.spawn(LanePosition::new(key, 0.5 * length), "");
    let id = stage.drive(LanePosition::new(key, 0.5 * length - 40.0));
    let passed = (0..1200).any(|_| {
        stage.step();
        let at = stage
            .world
            .record(ActorId(id))
            .unwrap()
            .world_from_actor
            .translation_m;
        let touched =
            stage.world.record(ActorId(id)).unwrap().flags & schema_frames::ActorRecord::TOUCHED;
        assert_eq!(touched, 0, "it touched something at {at:?}");
        stage
            .roads
            .project(key, at)
            .is_some_and(|place| place.s_m > 0.5 * length + 15.0)
    });
    assert!(passed, "{:?}", stage.place_m(id));
}

/// With every light on red, only the vehicle that ignores lights drives over its line.
#[test]
fn lights_hold_all_but_those_that_ignore_them() {
    for percent in [0.0, 100.0] {
        let mut stage = Stage::new("Town10HD");
        let signal = stage.roads.signals().iter().find(|s| {
            s.kind == schema_roads::SignalKind::TrafficLight
                && s.stops.iter().any(|stop| stop.stop.s_m > 50.0)
        });
        let stop = signal
            .unwrap()
            .stops
            .iter()
            .find(|stop| stop.stop.s_m > 50.0)
            .unwrap()
            .stop;
        let id = stage.drive(LanePosition::new(stop.lane, stop.s_m - 45.0));
        stage.settings.vehicle_mut(id).ignore_lights_percent = percent;
        let lights: Vec<u32> = stage
            .actors
            .actors
            .iter()
            .filter(|a| a.kind == "traffic_light")
            .map(|a| a.id)
            .collect();
        for actor_id in lights {
            let state = "red".to_owned();
            stage
                .world
                .apply(&Command::SetTrafficLight { actor_id, state });
        }
        stage
            .world
            .apply(&Command::FreezeTrafficLights { frozen: true });
        let start = stage.place_m(id);
        stage.steps(400);
        assert!(
            stage
                .traffic()
                .lights
                .values()
                .all(|state| *state == LightState::Red)
        );
        let driven_m = distance(start, stage.place_m(id));
        let passes = percent > 0.0;
        assert_eq!(driven_m > 50.0, passes, "{percent} %: {driven_m} m");
        assert!(
            passes || driven_m > 35.0,
            "it drives up to the line: {driven_m} m"
        );
    }
}

/// What was set as a route is what the vehicle plans, and does.
#[test]
fn a_route_decides_the_turns() {
    for (option, sign) in [(RoadOption::Left, 1.0), (RoadOption::Right, -1.0)] {
        let mut stage = Stage::new("Town01");
        // A lane whose junction offers both turns.
        let turns = |roads: &RoadMap, lane: &schema_roads::Lane| {
            let turn = |key: &LaneKey| {
                let yaw = |s: f64| {
                    let pose = roads.pose(LanePosition::new(*key, s)).unwrap();
                    pose.rotation.euler_angles().2
                };
                let length = roads.lane(*key).unwrap().length_m;
                consumer_driver::plane::wrap(yaw(length) - yaw(0.0))
            };
            let all: Vec<f64> = roads.successors(lane.key).iter().map(turn).collect();
            all.iter().any(|t| *t > 1.0) && all.iter().any(|t| *t < -1.0)
        };
        let key = stage.long_lane(turns);
        let length = stage.roads.lane(key).unwrap().length_m;
        let id = stage.drive(LanePosition::new(key, length - 50.0));
        stage.settings.vehicle_mut(id).route = vec![option];
        let heading = |stage: &Stage| {
            stage
                .world
                .record(ActorId(id))
                .unwrap()
                .world_from_actor
                .yaw_rad()
        };
        let before = heading(&stage);
        stage.steps(2);
        assert_eq!(stage.fleet.actions(id)[0].option, option);
        stage.steps(1200);
        let driver = &stage.fleet.drivers()[&id];
        assert!(stage.settings.vehicles[&id].route.is_empty());
        let turned = consumer_driver::plane::wrap(heading(&stage) - before);
        // It may have turned again since; the first turn is what was planned.
        assert!(
            driver.path().n_choices() > 0 || (sign * turned) > 1.0,
            "{turned}"
        );
    }
}

/// Within the radius of the hero vehicles have physics; the others are moved, and get their physics
/// back when they come near or are let go.
#[test]
fn hybrid_physics_moves_only_those_far_from_heroes() {
    let mut stage = Stage::new("Town06");
    let key = stage.long_lane(|_, _| true);
    stage.spawn(LanePosition::new(key, 20.0), "hero");
    let near = stage.drive(LanePosition::new(key, 50.0));
    let far = stage.drive(LanePosition::new(key, 250.0));
    stage.settings.common.hybrid_radius_m = Some(100.0);
    let step = stage.step();
    let simulated = |id: u32, enabled: bool| Command::Physics {
        actor_id: id,
        action: PhysicsAction::SetSimulated { enabled },
    };
    assert!(step.commands.contains(&simulated(far, false)));
    assert_eq!(step.controls.len(), 1);
    assert_eq!(step.controls[0].actor_id, near);
    let start = stage.place_m(far);
    stage.steps(100);
    let driven_m = distance(start, stage.place_m(far));
    assert!(
        driven_m > 20.0,
        "it is moved along the lane: {driven_m} m in 5 s"
    );
    assert_eq!(stage.lane(far), key);
    stage.driven.retain(|id| *id != far);
    assert!(stage.step().commands.contains(&simulated(far, true)));
}

/// The same traffic and seed give the same controls; another seed gives others.
#[test]
fn controls_follow_from_traffic_and_seed() {
    let run = |seed: u64| {
        let mut stage = Stage::new("Town03");
        stage.settings.seed = seed;
        let keys: Vec<LaneKey> = stage
            .roads
            .lanes()
            .iter()
            .filter(|lane| {
                lane.kind.is_drivable() && lane.junction.is_none() && lane.length_m > 40.0
            })
            .map(|lane| lane.key)
            .collect();
        for key in keys.iter().take(30) {
            stage.drive(LanePosition::new(*key, 20.0));
        }
        let mut bits = Vec::new();
        for _ in 0..900 {
            for record in stage.step().controls {
                bits.push(record.throttle_ratio.to_bits());
                bits.push(record.steer_ratio.to_bits());
            }
        }
        bits
    };
    let first = run(1);
    assert!(first == run(1));
    assert!(first != run(2));
}
