//! Who yields to whom: the table of `docs/explanation/traffic.md`, case by case, without physics.
//! Vehicles are put at a distance and a speed, the fleet decides, and the decision is held against
//! the rules of the road and times to arrival that are worked out here.

use std::f64::consts::PI;
use std::sync::Arc;

use consumer_driver::crossing::Refusal;
use consumer_driver::driver::Wait;
use consumer_driver::{Fleet, Mover, RoadOption, Settings, Traffic};
use schema_frames::{LightState, VehicleControl};
use schema_roads::{LaneKey, LanePosition, RoadMap};

use crate::junction_map::{
    Arm, EAST, HALF_LANE_M, Junction, LIGHT, LIMIT_MPS, NORTH, SOUTH, STOP, WEST, YIELD, signal_id,
    straight_road,
};

const PERIOD_SECS: f64 = 0.05;
/// Half length and half width of a car and of a bicycle, metres.
const CAR_M: [f64; 2] = [2.3, 0.95];
const BICYCLE_M: [f64; 2] = [0.9, 0.35];
/// Where whoever waits for its turn stands, metres before the junction.
const WAITING_M: f64 = 2.5;
/// Acceleration with which a driver counts for itself, m/s².
const CALM_ACCEL_MPS2: f64 = 1.4;
/// Hardest acceleration of the model, m/s².
const MAX_ACCEL_MPS2: f64 = 2.7;
/// Ids: the driven vehicle that is asked about, and the other one.
const MINE: u32 = 1;
const OTHER: u32 = 2;

/// What the driven vehicle does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Verdict {
    Goes,
    YieldsTo(u32),
    Waits(Wait),
}
use Verdict::{Goes, Waits, YieldsTo};

struct Scene {
    fleet: Fleet,
    settings: Settings,
    driven: Vec<u32>,
    movers: Vec<Mover>,
    lights: Vec<(String, LightState)>,
    tick: u64,
}

impl Scene {
    fn new(roads: Arc<RoadMap>) -> Scene {
        Scene {
            fleet: Fleet::new(roads),
            settings: Settings::default(),
            driven: Vec::new(),
            movers: Vec::new(),
            lights: Vec::new(),
            tick: 0,
        }
    }

    fn put(&mut self, id: u32, (place, yaw_rad): ([f64; 2], f64), speed_mps: f64) -> &mut Mover {
        self.movers.retain(|mover| mover.id != id);
        let (sin, cos) = yaw_rad.sin_cos();
        self.movers.push(Mover {
            id,
            number: id,
            is_vehicle: true,
            position_m: [place[0], place[1], 0.0],
            yaw_rad,
            speed_mps,
            velocity_mps: [speed_mps * cos, speed_mps * sin],
            half_m: CAR_M,
            ..Mover::default()
        });
        self.movers.sort_by_key(|mover| mover.id);
        self.movers.iter_mut().find(|mover| mover.id == id).unwrap()
    }

    fn drive(&mut self, id: u32, at: ([f64; 2], f64), speed_mps: f64, route: RoadOption) {
        self.put(id, at, speed_mps);
        self.driven.push(id);
        self.settings.vehicle_mut(id).route = vec![route];
    }

    /// One tick with everybody where they are.
    fn step(&mut self) -> VehicleControl {
        self.tick += 1;
        let traffic = Traffic {
            tick: self.tick,
            time_secs: self.tick as f64 * PERIOD_SECS,
            period_secs: PERIOD_SECS,
            movers: self.movers.clone(),
            lights: self.lights.iter().cloned().collect(),
        };
        self.fleet.assign(&self.driven, &traffic, |_| None);
        assert_eq!(self.fleet.len(), self.driven.len());
        let controls = self.fleet.step(&traffic, &mut self.settings).controls;
        let mine = controls.iter().find(|record| record.actor_id == MINE);
        mine.unwrap().control()
    }

    fn verdict_of(&self, id: u32) -> Verdict {
        let driver = &self.fleet.drivers()[&id];
        match (driver.refusal(), driver.wait()) {
            (Some(Refusal::Vehicle(other)), _) => YieldsTo(other),
            (_, Wait::No) => Goes,
            (_, wait) => Waits(wait),
        }
    }

    /// What the first vehicle does after this time in which nobody has moved.
    fn after(&mut self, secs: f64) -> Verdict {
        for _ in 0..(secs / PERIOD_SECS).round() as u64 {
            self.step();
        }
        self.verdict_of(MINE)
    }

    fn now(&mut self) -> Verdict {
        self.step();
        self.verdict_of(MINE)
    }
}

/// Indices of the arms of a crossing.
const E: usize = 0;
const N: usize = 1;
const W: usize = 2;
const S: usize = 3;

fn crossing(arms: [Arm; 4], ways: &[(usize, usize)]) -> Junction {
    Junction {
        arms: arms.to_vec(),
        ways: ways.to_vec(),
        radius_m: 10.0,
    }
}

const STRAIGHT: [(usize, usize); 4] = [(E, W), (W, E), (N, S), (S, N)];

/// A place on an arm from which the vehicle's front is so far before the junction.
fn before(junction: &Junction, arm: usize, front_m: f64) -> ([f64; 2], f64) {
    junction.inbound(arm, front_m + CAR_M[0])
}

/// Time to cover a distance from rest as fast as the model does, seconds.
fn soonest_secs(distance_m: f64) -> f64 {
    (2.0 * distance_m / MAX_ACCEL_MPS2).sqrt()
}

/// The distance from which a stranger at this speed is at the junction after a time, if it speeds up
/// with 2.8 m/s² to 1.15 times the limit: the worst that is expected of it.
fn worst_m(secs: f64, speed_mps: f64) -> f64 {
    let most_mps = 1.15 * LIMIT_MPS;
    let run_secs = ((most_mps - speed_mps) / 2.8).min(secs);
    speed_mps * run_secs + 1.4 * run_secs * run_secs + most_mps * (secs - run_secs)
}

/// The smallest time to arrival at the junction, in steps of 0.1 s, of a stranger before whom a
/// vehicle that waits goes, seconds.
fn accepted_secs(
    junction: &Junction,
    (mine, route): (usize, RoadOption),
    theirs: usize,
    speed_mps: f64,
) -> f64 {
    let roads = junction.roads();
    let goes = |secs: f64| {
        let mut scene = Scene::new(roads.clone());
        scene.drive(MINE, before(junction, mine, WAITING_M), 0.0, route);
        let place = before(junction, theirs, worst_m(secs, speed_mps));
        scene.put(OTHER, place, speed_mps);
        match scene.now() {
            Goes => true,
            YieldsTo(OTHER) => false,
            verdict => panic!("{verdict:?}"),
        }
    };
    let secs: Vec<f64> = (5..=120).map(|i| 0.1 * f64::from(i)).collect();
    let first = secs.iter().position(|secs| goes(*secs)).unwrap();
    assert!(
        secs[first..].iter().all(|secs| goes(*secs)),
        "a longer gap than {:.1} s is refused",
        secs[first]
    );
    secs[first]
}

/// Gaps before strangers on a priority road, as times until they reach the junction at worst. They
/// lie between 1 s below and 3 s above the critical headways of the Highway Capacity Manual (2010,
/// two-way stop control, two lanes). For going straight across they are worked out: 0.4 s to start,
/// 1.4 m/s² from the waiting line until the rear has left their lane, 0.9 s to spare, less their time
/// from the edge of the junction to our lane; 0.5 s are left for the room between the sides.
#[test]
fn gaps_on_a_priority_road_are_accepted_by_time_to_arrival() {
    use RoadOption::{Left, Right, Straight};
    let minor = crossing(
        [EAST, NORTH, WEST, SOUTH.with(YIELD)],
        &[(E, W), (W, E), (S, N), (S, E), (S, W)],
    );
    let main = crossing([EAST, NORTH, WEST, SOUTH], &[(E, W), (W, N), (W, E)]);
    let length_m = 2.0 * CAR_M[0];
    // From the waiting line to where the rear has left the near lane, and the far one.
    let [near_m, far_m] =
        [-HALF_LANE_M, HALF_LANE_M].map(|lane_m| WAITING_M + 10.0 + lane_m + CAR_M[1] + length_m);
    // From the edge of the junction to the near side of our lane, for one from the left and right.
    let [left_edge_m, right_edge_m] =
        [HALF_LANE_M, -HALF_LANE_M].map(|lane_m| 10.0 + lane_m - CAR_M[1]);
    let cases = [
        (
            "through, from the left",
            &minor,
            (S, Straight),
            W,
            Some([near_m, left_edge_m]),
            6.5,
        ),
        (
            "through, from the right",
            &minor,
            (S, Straight),
            E,
            Some([far_m, right_edge_m]),
            6.5,
        ),
        ("right", &minor, (S, Right), W, None, 6.2),
        ("left", &minor, (S, Left), W, None, 7.1),
        ("left off the main road", &main, (W, Left), E, None, 4.1),
    ];
    for (name, junction, mine, theirs, crossing_m, critical_secs) in cases {
        for speed_mps in [8.0, LIMIT_MPS] {
            let accepted = accepted_secs(junction, mine, theirs, speed_mps);
            assert!(
                (critical_secs - 1.0..critical_secs + 3.0).contains(&accepted),
                "{name} before one at {speed_mps:.1} m/s: {accepted:.1} s of {critical_secs} s"
            );
            let expected = crossing_m.map(|[mine_m, theirs_m]| {
                0.4 + (2.0 * mine_m / CALM_ACCEL_MPS2).sqrt() + 0.9 - theirs_m / (1.15 * LIMIT_MPS)
            });
            assert!(
                expected.is_none_or(|secs| (accepted - secs).abs() < 0.5),
                "{name} before one at {speed_mps:.1} m/s: {accepted:.1} s, not {expected:.1?}"
            );
        }
    }
}

/// A row of strangers 4 s apart leaves no gap for crossing: whoever waits never goes, not after a
/// minute either, and goes once the row has ended.
#[test]
fn patience_never_becomes_right_of_way() {
    let junction = crossing([EAST, NORTH, WEST, SOUTH.with(YIELD)], &STRAIGHT);
    let mut scene = Scene::new(junction.roads());
    let at = before(&junction, S, WAITING_M);
    scene.drive(MINE, at, 0.0, RoadOption::Straight);
    let headway_m = 4.0 * LIMIT_MPS;
    for tick in 0..1200 {
        let shift_m = (f64::from(tick) * PERIOD_SECS * LIMIT_MPS) % headway_m;
        for car in 0..5 {
            let front_m = headway_m * (f64::from(car) + 1.0) - shift_m;
            let place = before(&junction, W, front_m);
            scene.put(10 + car as u32, place, LIMIT_MPS);
        }
        let verdict = scene.now();
        assert!(
            matches!(verdict, YieldsTo(10..15)),
            "{verdict:?} after {:.1} s",
            f64::from(tick) * PERIOD_SECS
        );
    }
    scene.movers.retain(|mover| mover.id == MINE);
    assert_eq!(scene.now(), Goes);
}

/// Without signs the vehicle from the right goes first, whoever drives it; both are 3 s away.
#[test]
fn right_goes_before_left_among_driven_cars_strangers_and_cyclists() {
    let junction = crossing([EAST, NORTH, WEST, SOUTH], &STRAIGHT);
    let roads = junction.roads();
    let speed_mps = 8.0;
    let place = |arm| before(&junction, arm, 3.0 * speed_mps);
    let straight = RoadOption::Straight;

    let mut both = Scene::new(roads.clone());
    both.drive(MINE, place(W), speed_mps, straight);
    both.drive(OTHER, place(S), speed_mps, straight);
    assert_eq!(
        (both.now(), both.verdict_of(OTHER)),
        (YieldsTo(OTHER), Goes)
    );

    // (arm of mine, arm of the stranger, half lengths, expected)
    for (mine, theirs, half_m, expected) in [
        (W, S, CAR_M, YieldsTo(OTHER)),
        (W, S, BICYCLE_M, YieldsTo(OTHER)),
        (S, W, CAR_M, Goes),
        (S, W, BICYCLE_M, Goes),
        // Opposite ways do not meet.
        (W, E, CAR_M, Goes),
    ] {
        let mut scene = Scene::new(roads.clone());
        scene.drive(MINE, place(mine), speed_mps, straight);
        scene.put(OTHER, place(theirs), speed_mps).half_m = half_m;
        assert_eq!(scene.now(), expected, "{mine} {theirs} {half_m:?}");
    }

    // 10 m before the junction at 12 m/s it takes 7.2 m/s² to stop: it will not, whoever has to.
    let mut late = Scene::new(roads);
    late.drive(MINE, before(&junction, S, WAITING_M), 0.0, straight);
    late.put(OTHER, before(&junction, W, 10.0), 12.0);
    assert_eq!(late.now(), YieldsTo(OTHER));
}

/// Whoever turns left lets an oncoming car or cyclist pass.
#[test]
fn turning_left_yields_to_oncoming_traffic() {
    let junction = crossing([EAST, NORTH, WEST, SOUTH], &[(W, N), (W, E), (E, W)]);
    for (half_m, speed_mps) in [(CAR_M, 8.0), (BICYCLE_M, 5.0)] {
        for (route, expected) in [
            (RoadOption::Left, YieldsTo(OTHER)),
            (RoadOption::Straight, Goes),
        ] {
            let mut scene = Scene::new(junction.roads());
            scene.drive(MINE, before(&junction, W, WAITING_M), 0.0, route);
            let place = before(&junction, E, 2.0 * speed_mps);
            scene.put(OTHER, place, speed_mps).half_m = half_m;
            assert_eq!(scene.now(), expected, "{half_m:?} {route:?}");
        }
    }
}

/// Lights: red holds, green goes before red; a stranger that can still stop at its red light with
/// 4.5 m/s² is expected to, one that cannot is let pass. From 13.9 m/s that takes 21.4 m.
#[test]
fn lights_decide_and_a_red_light_that_is_run_is_seen() {
    let lit = [EAST, NORTH, WEST, SOUTH].map(|arm| arm.with(LIGHT));
    let junction = crossing(lit, &STRAIGHT);
    let roads = junction.roads();
    let verdict = |mine: LightState, theirs: LightState, front_m: f64| {
        let mut scene = Scene::new(roads.clone());
        scene.lights = vec![
            (signal_id(S), mine),
            (signal_id(N), mine),
            (signal_id(W), theirs),
            (signal_id(E), theirs),
        ];
        let place = before(&junction, S, WAITING_M);
        scene.drive(MINE, place, 0.0, RoadOption::Straight);
        scene.put(OTHER, before(&junction, W, front_m), LIMIT_MPS);
        scene.now()
    };
    let stop_m = LIMIT_MPS * LIMIT_MPS / (2.0 * 4.5);
    use LightState::{Green, Red};
    assert_eq!(verdict(Red, Green, 60.0), Waits(Wait::Light));
    assert_eq!(verdict(Green, Red, stop_m + 2.0), Goes);
    assert_eq!(verdict(Green, Red, stop_m - 2.0), YieldsTo(OTHER));
}

/// Whoever is beyond its line when the light changes clears the junction, or it stands in the way of
/// those whose turn it is. Before the line, a vehicle that has just set off goes on in the yellow if
/// it could only stop beyond: at 1.2 m/s, with 4 m/s³ until it brakes with 3 m/s², it needs 0.7 m.
#[test]
fn who_is_beyond_the_line_when_the_light_changes_clears_the_junction() {
    let lit = [EAST, NORTH, WEST, SOUTH].map(|arm| arm.with(LIGHT));
    let junction = crossing(lit, &STRAIGHT);
    let roads = junction.roads();
    // The line is 0.2 m before the junction.
    let verdict = |changed: LightState, to_line_m: f64, speed_mps: f64| {
        let mut scene = Scene::new(roads.clone());
        scene.lights = vec![(signal_id(S), LightState::Green)];
        let place = before(&junction, S, to_line_m + 0.2);
        scene.drive(MINE, place, speed_mps, RoadOption::Straight);
        assert_eq!(scene.now(), Goes);
        scene.lights = vec![(signal_id(S), changed)];
        scene.after(0.5)
    };
    use LightState::{Red, Yellow};
    for changed in [Yellow, Red] {
        assert_eq!(verdict(changed, -0.1, 0.4), Goes, "{changed:?}");
        assert_eq!(
            verdict(changed, 3.0, 0.4),
            Waits(Wait::Light),
            "{changed:?}"
        );
    }
    assert_eq!(verdict(Yellow, 0.4, 1.2), Goes);
    assert_eq!(verdict(Yellow, 3.0, 1.2), Waits(Wait::Light));
}

/// Lights out and no sign: everybody stops for a second before going on.
#[test]
fn where_lights_are_out_everybody_stops_first() {
    let lit = [EAST, NORTH, WEST, SOUTH].map(|arm| arm.with(LIGHT));
    let junction = crossing(lit, &STRAIGHT);
    let mut scene = Scene::new(junction.roads());
    scene.lights = (0..4)
        .map(|arm| (signal_id(arm), LightState::Off))
        .collect();
    let place = before(&junction, S, WAITING_M);
    scene.drive(MINE, place, 0.0, RoadOption::Straight);
    assert_eq!(scene.after(0.8), Waits(Wait::Sign));
    assert_eq!(scene.after(0.7), Goes);
}

/// All-way stop: whoever arrived first goes first; of two that arrive together, the right one.
#[test]
fn an_all_way_stop_is_left_in_the_order_of_arrival() {
    let signs = [EAST, NORTH, WEST, SOUTH].map(|arm| arm.with(STOP));
    let junction = crossing(signs, &STRAIGHT);
    let roads = junction.roads();
    let straight = RoadOption::Straight;
    let line = |arm| before(&junction, arm, WAITING_M);

    let mut together = Scene::new(roads.clone());
    together.drive(MINE, line(W), 0.0, straight);
    together.drive(OTHER, line(S), 0.0, straight);
    assert_eq!(together.after(0.9), Waits(Wait::Sign));
    assert_eq!(together.after(0.4), YieldsTo(OTHER));
    assert_eq!(together.verdict_of(OTHER), Goes);

    // The left one has stood for 2 s when the other one comes to its line.
    let mut first = Scene::new(roads.clone());
    first.drive(MINE, line(S), 0.0, straight);
    first.put(OTHER, line(W), 0.0);
    first.put(MINE, before(&junction, S, 80.0), 10.0);
    first.after(2.0);
    first.put(MINE, line(S), 0.0);
    assert_eq!(first.after(1.3), YieldsTo(OTHER));
    // A stranger that does not use its turn is waited for at least 6 s and at most 15 s.
    assert_eq!(first.after(4.5), YieldsTo(OTHER));
    assert_eq!(first.after(9.0), Goes);

    let mut four = Scene::new(roads);
    for (arm, id) in [(E, 1), (N, 2), (W, 3), (S, 4)] {
        four.drive(id, line(arm), 0.0, straight);
    }
    four.after(1.5);
    let n_going = (1..=4).filter(|id| four.verdict_of(*id) == Goes).count();
    assert!((1..=2).contains(&n_going), "{n_going} of four go");
}

/// A ramp that joins a main road at 20°: who is on the main road goes first. Both ways join 40 m
/// behind their entries.
#[test]
fn a_ramp_yields_to_the_main_road() {
    let ramp = Arm::new(PI + 20f64.to_radians()).with(YIELD);
    let junction = Junction {
        arms: vec![EAST, WEST, ramp],
        ways: vec![(1, 0), (2, 0)],
        radius_m: 40.0,
    };
    let roads = junction.roads();
    let verdict = |theirs_m: f64| {
        let mut scene = Scene::new(roads.clone());
        scene.drive(MINE, before(&junction, 2, 20.0), 10.0, RoadOption::Straight);
        scene.put(OTHER, before(&junction, 1, theirs_m), LIMIT_MPS);
        scene.now()
    };
    // Beside it, and as far behind as it comes nearer while we drive to the place of joining.
    assert_eq!(verdict(20.0), YieldsTo(OTHER));
    assert_eq!(verdict(40.0), YieldsTo(OTHER));
    // 10 s behind, and well ahead of us: 50 m at 10 m/s take 5 s, in which it comes 139 m nearer.
    assert_eq!(verdict(10.0 * LIMIT_MPS), Goes);
}

/// Roundabout: whoever is in it goes before whoever comes in, and is not stopped by it. At 6 m/s, 9 m
/// before the entry, the one in the ring is there in 1.5 s.
#[test]
fn a_roundabout_is_entered_after_those_in_it() {
    let town = simd_town::Town::generate("Town03", 1).unwrap();
    let roads = Arc::new(RoadMap::parse(&town.open_drive).unwrap());
    let (ring, entry) = ring_and_entry(&roads);
    let place = |lane: LaneKey, front_m: f64| {
        let length_m = roads.lane(lane).unwrap().length_m;
        let at = LanePosition::new(lane, length_m - front_m - CAR_M[0]);
        let pose = roads.pose(at).unwrap();
        let [x, y, z] = pose.translation.vector.into();
        ([x, y], pose.rotation.euler_angles().2, z)
    };
    let verdict = |mine: (LaneKey, f64, f64), theirs: Option<(LaneKey, f64, f64)>| {
        let mut scene = Scene::new(roads.clone());
        let (at, yaw_rad, z) = place(mine.0, mine.1);
        scene.drive(MINE, (at, yaw_rad), mine.2, RoadOption::LaneFollow);
        scene.put(MINE, (at, yaw_rad), mine.2).position_m[2] = z;
        if let Some((lane, front_m, speed_mps)) = theirs {
            let (at, yaw_rad, z) = place(lane, front_m);
            scene.put(OTHER, (at, yaw_rad), speed_mps).position_m[2] = z;
        }
        scene.now()
    };
    let waits = (entry, WAITING_M, 0.0);
    assert_eq!(verdict(waits, None), Goes);
    assert_eq!(verdict(waits, Some((ring, 9.0, 6.0))), YieldsTo(OTHER));
    assert_eq!(verdict((ring, 9.0, 6.0), Some((entry, 12.0, 6.0))), Goes);
}

/// A lane of a roundabout's ring that ends where another road comes in, and that road's lane.
fn ring_and_entry(roads: &RoadMap) -> (LaneKey, LaneKey) {
    let inside = |lane: &&schema_roads::Lane| lane.junction.is_some() && lane.kind.is_drivable();
    let bends_left = |key: LaneKey| {
        let length_m = roads.lane(key).unwrap().length_m;
        [0.1, 0.5, 0.9].iter().all(|share| {
            let bend = roads.curvature_per_m(LanePosition::new(key, share * length_m));
            (1.0 / 45.0..1.0 / 20.0).contains(&bend)
        })
    };
    let all = || roads.lanes().iter().filter(inside);
    for through in all().filter(|lane| bends_left(lane.key)) {
        let [ring] = roads.predecessors(through.key) else {
            continue;
        };
        if !bends_left(*ring) {
            continue;
        }
        for joining in all().filter(|lane| lane.junction == through.junction) {
            let [entry] = roads.predecessors(joining.key) else {
                continue;
            };
            let joins = roads.successors(joining.key) == roads.successors(through.key);
            let is_long = roads.lane(*entry).unwrap().length_m > 30.0;
            if joins && entry != ring && is_long {
                return (*ring, *entry);
            }
        }
    }
    panic!("the town has no roundabout");
}

/// People on foot: on the lane or about to step onto it within 2.5 s they stop a car; on the
/// pavement, or walking away from the lane, they do not.
#[test]
fn people_on_the_lane_or_about_to_be_on_it_stop_a_car() {
    let roads = straight_road();
    let verdict = |aside_m: f64, sideways_mps: f64| {
        let mut scene = Scene::new(roads.clone());
        let place = ([100.0, -HALF_LANE_M], 0.0);
        scene.drive(MINE, place, 8.0, RoadOption::LaneFollow);
        let walker = scene.put(OTHER, ([117.0, -HALF_LANE_M + aside_m], PI / 2.0), 0.0);
        walker.is_vehicle = false;
        walker.half_m = [0.25, 0.25];
        walker.velocity_mps = [0.0, sideways_mps];
        walker.speed_mps = sideways_mps;
        scene.now()
    };
    assert_eq!(verdict(0.0, 0.0), Waits(Wait::Ahead));
    assert_eq!(verdict(0.0, 1.4), Waits(Wait::Ahead));
    // 4 m aside at 1.4 m/s: on the way of the car, 1.65 m wide to each side, in 1.7 s.
    assert_eq!(verdict(-4.0, 1.4), Waits(Wait::Ahead));
    assert_eq!(verdict(-4.0, 0.0), Goes);
    assert_eq!(verdict(-4.0, -1.4), Goes);
    // 8 m aside it needs 4.5 s.
    assert_eq!(verdict(-8.0, 1.4), Goes);
}

/// Somebody brakes with 8 m/s² to a stop, 1.8 s ahead at 50 km/h: who follows stops behind. A car
/// that stands 14.7 m ahead needs v²/2s = 6.9 m/s², of the 9 m/s² of the full brake.
#[test]
fn an_emergency_stop_ahead_is_answered_with_the_brake_that_it_takes() {
    let roads = straight_road();
    let at = |x_m: f64| ([x_m, -HALF_LANE_M], 0.0);
    let mut scene = Scene::new(roads.clone());
    let (mut x_m, mut v) = (100.0, LIMIT_MPS);
    let (mut their_x_m, mut their_v) = (100.0 + 2.0 * CAR_M[0] + 1.8 * LIMIT_MPS, LIMIT_MPS);
    scene.drive(MINE, at(x_m), v, RoadOption::LaneFollow);
    for _ in 0..200 {
        scene.put(MINE, at(x_m), v);
        scene.put(OTHER, at(their_x_m), their_v);
        let control = scene.step();
        let pedals = 4.5 * f64::from(control.throttle_ratio) - 9.0 * f64::from(control.brake_ratio);
        v = (v + pedals * PERIOD_SECS).max(0.0);
        their_v = (their_v - 8.0 * PERIOD_SECS).max(0.0);
        x_m += v * PERIOD_SECS;
        their_x_m += their_v * PERIOD_SECS;
        let gap_m = their_x_m - x_m - 2.0 * CAR_M[0];
        assert!(gap_m > 0.5, "{gap_m:.2} m at {v:.1} m/s");
    }
    assert!(v < 0.1, "{v}");

    let mut late = Scene::new(roads);
    let gap_m = 14.0;
    late.drive(MINE, at(100.0), LIMIT_MPS, RoadOption::LaneFollow);
    late.put(OTHER, at(100.0 + 2.0 * CAR_M[0] + gap_m), 0.0);
    let needed = LIMIT_MPS * LIMIT_MPS / (2.0 * gap_m) / 9.0;
    let brake = f64::from(late.step().brake_ratio);
    assert!(brake > needed - 0.05, "{brake:.2} of {needed:.2}");
}

/// A car waits 11 m behind one that is parked on a road of two lanes; an oncoming one comes.
struct Pass {
    scene: Scene,
}

/// Places of the car that waits and of the parked one, metres along the road.
const WAITER_X_M: f64 = 200.0;
const PARKED_X_M: f64 = WAITER_X_M + 11.0 + 2.0 * CAR_M[0];

impl Pass {
    fn new() -> Pass {
        let mut scene = Scene::new(straight_road());
        let at = |x_m: f64| ([x_m, -HALF_LANE_M], 0.0);
        scene.drive(MINE, at(WAITER_X_M), 0.0, RoadOption::LaneFollow);
        scene.put(OTHER, at(PARKED_X_M), 0.0);
        Pass { scene }
    }

    /// A vehicle whose front is so far before the parked car's front, towards us.
    fn oncoming(&mut self, apart_m: f64, speed_mps: f64) {
        let x_m = PARKED_X_M + CAR_M[0] + apart_m + CAR_M[0];
        self.scene.put(3, ([x_m, HALF_LANE_M], PI), speed_mps);
    }

    fn begins(mut self) -> bool {
        self.scene.after(10.0) == Goes
    }
}

/// The rear is past the parked car's front after 11 m and two lengths, in 3.9 s from rest at full
/// acceleration: an oncoming car that is there by then is let pass, at any speed. One that needs 20 s
/// even if it drives as fast as it may is no reason to wait.
#[test]
fn a_pass_over_the_oncoming_lane_is_begun_by_both_speeds() {
    assert!(Pass::new().begins(), "nobody comes");
    let least = soonest_secs(11.0 + 4.0 * CAR_M[0]);
    for speed_mps in [5.0, LIMIT_MPS] {
        let mut pass = Pass::new();
        pass.oncoming(20.0 * LIMIT_MPS, speed_mps);
        assert!(
            pass.begins(),
            "at {speed_mps:.1} m/s, 20 s away at the limit"
        );
    }
    for speed_mps in [5.0, LIMIT_MPS, 30.0] {
        let begins = |secs: f64| {
            let mut pass = Pass::new();
            pass.oncoming(secs * speed_mps, speed_mps);
            pass.begins()
        };
        assert!(!begins(least), "at {speed_mps:.1} m/s, {least:.1} s away");
    }
}

/// A pass that has begun is broken off if somebody comes that was not there, while the lane has not
/// been left; once beside the parked car it is finished.
#[test]
fn a_pass_is_broken_off_while_it_can_be() {
    let verdict = |x_m: f64, comes: bool| {
        let mut pass = Pass::new();
        assert_eq!(pass.scene.after(10.0), Goes);
        let aside_m = if x_m > WAITER_X_M + 8.0 { 3.0 } else { 0.0 };
        let place = ([x_m, -HALF_LANE_M + aside_m], 0.0);
        pass.scene.put(MINE, place, 2.0);
        if comes {
            // 2 s away.
            pass.oncoming(2.0 * LIMIT_MPS, LIMIT_MPS);
        }
        pass.scene.after(0.1)
    };
    assert_eq!(verdict(WAITER_X_M + 2.0, false), Goes);
    assert_eq!(verdict(WAITER_X_M + 2.0, true), Waits(Wait::Ahead));
    assert_eq!(verdict(PARKED_X_M + 4.0, false), Goes);
}
