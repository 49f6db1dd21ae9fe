//! Measures how the fleet drives: on a town or an OpenDRIVE map, with the daemon's own physics, over
//! simulated time. Prints one line per run: collisions, red lights run, vehicles that stood for more
//! than 90 s, mean speed, the 95th percentile of jerk, the cost of a tick, and a sum over the bits
//! of all controls, by which two runs are compared.
//!
//! The first five are measured from positions and light states alone, not from what drivers think.
//!
//! ```sh
//! cargo run --release --example traffic_quality -- --maps Town10HD,Town01 --vehicles 100 --minutes 60
//! ```
//!
//! With `--strangers` so many of the vehicles are driven by somebody else, who keeps the right of way
//! ([`strangers`]); every contact with the fleet is printed with the seconds before and with whose
//! fault it is ([`faults`]).

mod faults;
mod strangers;

use std::collections::{BTreeMap, HashMap};
use std::process::ExitCode;
use std::sync::Arc;

use consumer_driver::plane::distance;
use consumer_driver::{Fleet, Geometry, Settings, Snapshot, Traffic};
use faults::Faults;
use launch_cli::bench::{self, BenchResult, clap, thread_cpu_secs};
use schema_frames::{ActorKind, ActorList, ActorRecord, LightState};
use schema_roads::{LanePosition, RoadMap, SignalKind};
use schema_types::{ActorId, ObjectId};
use simd_town::imported::{ImportOptions, import};
use simd_world::{MapData, World, WorldOptions};
use strangers::Strangers;

const PERIOD_NANOS: u64 = 50_000_000;
const PERIOD_SECS: f64 = 0.05;
/// A vehicle slower than this stands, m/s.
const STANDING_MPS: f64 = 0.1;
/// A vehicle that stands longer is stuck, seconds.
const STUCK_SECS: f64 = 90.0;
/// Touches of one vehicle within this time are one collision, seconds.
const ONE_COLLISION_SECS: f64 = 3.0;
/// Cells of stop lines, metres.
const CELL_M: f64 = 32.0;

/// What to measure.
#[derive(Debug, clap::Args)]
struct Args {
    /// Names of built-in towns, or OpenDRIVE files, with commas
    #[arg(
        long,
        value_name = "MAP",
        value_delimiter = ',',
        default_value = "Town10HD"
    )]
    maps: Vec<String>,
    /// Vehicles
    #[arg(long, default_value_t = 100)]
    vehicles: usize,
    /// Walkers
    #[arg(long, default_value_t = 0)]
    walkers: usize,
    /// Simulated minutes
    #[arg(long, default_value_t = 5.0)]
    minutes: f64,
    /// Vehicles that the fleet does not know, of all vehicles
    #[arg(long, default_value_t = 0)]
    strangers: usize,
    /// Speeds that strangers drive where bends let them, km/h
    #[arg(long, value_delimiter = ',', default_value = "50,80,110,130")]
    strangers_kmh: Vec<f64>,
    /// Share of other vehicles that the fleet does not see, percent: a planted fault, which must show
    #[arg(long, default_value_t = 0.0)]
    careless: f64,
    /// Seed of places and choices
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Prints what went wrong where
    #[arg(long)]
    verbose: bool,
    /// Prints what this vehicle does in every tick
    #[arg(long, value_name = "ID")]
    trace: Option<u32>,
}

/// What happened to one vehicle.
#[derive(Clone, Debug, Default)]
struct Log {
    driven_m: f64,
    last: Option<[f64; 2]>,
    touched_at_secs: Option<f64>,
    standing_secs: f64,
    speeds: Vec<f64>,
}

/// A stop line.
struct Line {
    signal: String,
    /// Index of the lane that it guards.
    lane: u32,
    point: [f64; 2],
    along: [f64; 2],
}

#[derive(Default)]
struct Sums {
    collisions: u32,
    /// Contacts with what belongs to the map.
    scenery: u32,
    red_lights: u32,
    /// Contacts with strangers, by whose fault it is.
    at_fault: u32,
    strangers_fault: u32,
    strangers_kmh: Vec<f32>,
    stuck: u32,
    jerks: Vec<f32>,
    ticks_micros: Vec<f64>,
    hash: u64,
}

fn load(map: &str) -> (MapData, Arc<RoadMap>) {
    if map.ends_with(".xodr") {
        let text = std::fs::read_to_string(map).expect("the map can be read");
        let roads = RoadMap::parse(&text).expect("the map is OpenDRIVE");
        let options = ImportOptions {
            visible: false,
            ..ImportOptions::default()
        };
        let town = import(map, &text, &roads, 1, &options).expect("the map can be built");
        let roads = Arc::new(roads);
        (MapData::of_import(&town, roads.clone()), roads)
    } else {
        let town = simd_town::Town::generate(map, 1).expect("a town of that name");
        let roads = Arc::new(RoadMap::parse(&town.open_drive).expect("towns are OpenDRIVE"));
        (MapData::of_town(&town, roads.clone()), roads)
    }
}

fn main() -> ExitCode {
    bench::run("traffic_quality", |args: &Args, result| {
        for map in &args.maps {
            run(args, map, result);
        }
        Ok(())
    })
}

fn run(args: &Args, map: &str, result: &mut BenchResult) {
    let (data, roads) = load(map);
    let mut world = World::new(WorldOptions {
        seed: args.seed,
        ..WorldOptions::default()
    });
    world.load(&data).expect("the map loads");
    let placed = world
        .spawn_scenario(None, args.vehicles)
        .expect("vehicles find a place");
    fill(&mut world, &roads, args.vehicles - placed.others.len());
    world.spawn_walkers(args.walkers);
    let actors = world.actor_list();
    let lines = lines(&roads);
    let solids = Solids::new(&data);
    let ids: Vec<u32> = cars(world.snapshot_records());
    // Spread over the map as the others are.
    let every = (ids.len() / args.strangers.max(1)).max(1);
    let ids = ids.iter().step_by(every).take(args.strangers);
    let ids: Vec<u32> = ids.copied().collect();
    let mut strangers = Strangers::new(&roads, &ids, &args.strangers_kmh, args.seed);
    let mut faults = Faults::new(&roads);
    let mut fleet = Fleet::new(roads);
    let mut settings = Settings {
        seed: args.seed,
        ..Settings::default()
    };
    for id in cars(world.snapshot_records()) {
        settings.vehicle_mut(id).ignore_vehicles_percent = args.careless;
    }
    let mut logs: BTreeMap<u32, Log> = BTreeMap::new();
    let mut red_since: BTreeMap<String, f64> = BTreeMap::new();
    let mut sums = Sums::default();
    let n_ticks = (args.minutes * 60.0 / PERIOD_SECS) as u64;
    for tick in 1..=n_ticks {
        world.step(PERIOD_NANOS);
        let records = world.snapshot_records();
        let start = thread_cpu_secs();
        let time = tick * PERIOD_NANOS;
        let traffic = Traffic::of(&Snapshot {
            tick,
            sim_nanos: time,
            period_nanos: PERIOD_NANOS,
            records,
            actors: &actors,
        });
        if tick % 20 == 1 {
            assign(&mut fleet, &mut strangers, &traffic, &actors);
        }
        let step = fleet.step(&traffic, &mut settings);
        sums.ticks_micros.push((thread_cpu_secs() - start) * 1e6);
        if !strangers.ids().is_empty() {
            let fast = strangers.ids().iter().filter_map(|id| traffic.mover(*id));
            sums.strangers_kmh
                .extend(fast.map(|it| (3.6 * it.speed_mps) as f32));
            faults.note(&traffic);
            meet(&mut faults, &strangers, &traffic, &world);
        }
        for record in step.controls.into_iter().chain(strangers.step(&traffic)) {
            let bits = [
                record.throttle_ratio,
                record.brake_ratio,
                record.steer_ratio,
            ]
            .map(f32::to_bits);
            for bits in bits {
                sums.hash = (sums.hash ^ u64::from(bits)).wrapping_mul(0x0100_0000_01b3);
            }
            world
                .set_control(ActorId(record.actor_id), record.control())
                .expect("the vehicle is there");
            if record.lamps != u32::MAX {
                world
                    .set_lamps(ActorId(record.actor_id), record.lamps)
                    .expect("the vehicle has lamps");
            }
        }
        if let Some(mover) = args.trace.and_then(|id| traffic.mover(id)) {
            let driver = fleet.drivers().get(&mover.id);
            eprintln!(
                "{:.2} {} foot {:?} line {:?} entries {:?}",
                traffic.time_secs,
                describe(&fleet, mover),
                driver.map(|d| d.foot().arc_m + mover.front_m()),
                driver.and_then(|d| d.light_line_m()),
                driver.map(|d| d
                    .entries()
                    .iter()
                    .map(|e| (e.line_m, e.arc_m))
                    .collect::<Vec<_>>()),
            );
        }
        for (id, state) in &traffic.lights {
            if *state == LightState::Red {
                red_since.entry(id.clone()).or_insert(traffic.time_secs);
            } else {
                red_since.remove(id);
            }
        }
        let seen = Seen {
            world: &world,
            fleet: &fleet,
            traffic: &traffic,
            lines: &lines,
            solids: &solids,
            red_since: &red_since,
            verbose: args.verbose,
        };
        watch(&seen, &mut logs, &mut sums);
    }
    (sums.at_fault, sums.strangers_fault) = (faults.n_fleet, faults.n_stranger);
    report(args, map, logs.len(), &logs, sums, result);
}

/// Puts further vehicles on lanes outside junctions, where the spawn points are too few.
fn fill(world: &mut World, roads: &RoadMap, n_wanted: usize) {
    let lanes = roads
        .lanes()
        .iter()
        .filter(|lane| lane.kind.is_drivable() && lane.junction.is_none());
    let places: Vec<LanePosition> = lanes
        .flat_map(|lane| {
            let n = (lane.length_m / 14.0) as usize;
            (0..n).map(move |i| LanePosition::new(lane.key, 7.0 + 14.0 * i as f64))
        })
        .collect();
    let mut n_left = n_wanted;
    // Spread over the whole map: a stride that has no divisor in common with any likely count.
    for i in 0..places.len() {
        if n_left == 0 {
            return;
        }
        let Some(mut pose) = roads.pose(places[i * 7919 % places.len()]) else {
            continue;
        };
        pose.translation.z += 0.3;
        let place = world.spawn(
            "vehicle.tesla.model3",
            pose.into(),
            None,
            "autopilot",
            &BTreeMap::new(),
        );
        n_left -= usize::from(place.is_ok());
    }
}

/// The vehicles among the actors.
fn cars(records: &[ActorRecord]) -> Vec<u32> {
    let is_vehicle = |it: &&ActorRecord| it.kind == ActorKind::Vehicle as u16;
    records.iter().filter(is_vehicle).map(|it| it.id).collect()
}

/// Judges the contacts of strangers with the fleet.
fn meet(faults: &mut Faults, strangers: &Strangers, traffic: &Traffic, world: &World) {
    for touched in world.collisions() {
        let Some(other) = touched.other else {
            continue;
        };
        let is_stranger = |id: u32| strangers.ids().contains(&id);
        if !is_stranger(touched.actor.0) || is_stranger(other.0) {
            continue;
        }
        if let (Some(stranger), Some(other)) =
            (traffic.mover(touched.actor.0), traffic.mover(other.0))
            && other.is_vehicle
        {
            faults.judge(stranger, other, traffic.time_secs);
        }
    }
}

fn assign(fleet: &mut Fleet, strangers: &mut Strangers, traffic: &Traffic, actors: &ActorList) {
    let vehicles = traffic.movers.iter().filter(|m| m.is_vehicle);
    let vehicles = vehicles.filter(|m| !strangers.ids().contains(&m.id));
    let ids: Vec<u32> = vehicles.map(|m| m.id).collect();
    let attribute = |id: u32, name: &str| {
        let actor = actors.actors.iter().find(|a| a.id == id)?;
        actor.attributes.get(name)?.parse::<f64>().ok()
    };
    let geometry = |id: u32| {
        Some(Geometry {
            wheelbase_m: attribute(id, "wheelbase_m")?,
            max_steer_rad: attribute(id, "max_steer_rad")?,
        })
    };
    fleet.assign(&ids, traffic, geometry);
    strangers.assign(traffic, geometry);
}

/// The stop lines of all lights, by cell.
fn lines(roads: &RoadMap) -> HashMap<[i32; 2], Vec<Line>> {
    let mut lines: HashMap<[i32; 2], Vec<Line>> = HashMap::new();
    for signal in roads.signals() {
        if signal.kind != SignalKind::TrafficLight {
            continue;
        }
        for stop in &signal.stops {
            // The middle of the lane, where its junction begins or at the sign itself.
            let Some(pose) = roads.pose(LanePosition::new(stop.stop.lane, stop.stop.s_m)) else {
                continue;
            };
            let point = [pose.translation.x, pose.translation.y];
            let yaw = pose.rotation.euler_angles().2;
            let Some(lane) = roads.lane_idx(stop.lane) else {
                continue;
            };
            lines.entry(cell(point)).or_default().push(Line {
                signal: signal.id.clone(),
                lane: lane as u32,
                point,
                along: [yaw.cos(), yaw.sin()],
            });
        }
    }
    lines
}

/// What belongs to the map, to name what was touched.
struct Solids<'m> {
    map: &'m MapData,
    names: HashMap<ObjectId, &'m str>,
}

impl<'m> Solids<'m> {
    fn new(map: &'m MapData) -> Solids<'m> {
        let names = map.objects.iter().map(|it| (it.id, it.name.as_str()));
        Solids {
            names: names.collect(),
            map,
        }
    }

    /// The triangle whose corners are nearest to a place, by the mean of their distances.
    fn nearest(&self, place_m: [f64; 3]) -> String {
        let place: [f64; 3] = std::array::from_fn(|i| place_m[i] - self.map.origin_m[i]);
        let mut best = (f64::INFINITY, String::new());
        for (idx, mesh) in self.map.collision.iter().enumerate() {
            for (n, corners) in mesh.triangles.iter().enumerate() {
                let corners = corners.map(|c| mesh.vertices_m[c as usize].map(f64::from));
                let away = triangle_m(place, corners);
                if away < best.0 {
                    let object = self.map.collision_objects.get(idx).and_then(|it| it.get(n));
                    let name = object
                        .and_then(|it| self.names.get(it))
                        .unwrap_or(&"nothing");
                    let shown = corners.map(|c| {
                        let p: [f64; 3] = std::array::from_fn(|i| c[i] + self.map.origin_m[i]);
                        p.map(|x| (100.0 * x).round() / 100.0)
                    });
                    best = (away, format!("{name} of {:?} {shown:?}", mesh.class));
                }
            }
        }
        best.1
    }
}

/// Distance from a triangle, by points of it.
fn triangle_m(place: [f64; 3], [a, b, c]: [[f64; 3]; 3]) -> f64 {
    let middle = [0, 1].map(|i| (a[i] + b[i] + c[i]) / 3.0 - place[i]);
    let reach = distance([a[0], a[1]], [b[0], b[1]]).max(distance([a[0], a[1]], [c[0], c[1]]));
    if middle[0].hypot(middle[1]) > reach + 2.0 {
        return f64::INFINITY;
    }
    let n = 12;
    let mut least = f64::INFINITY;
    for i in 0..=n {
        for k in 0..=n - i {
            let (u, v) = (f64::from(i) / f64::from(n), f64::from(k) / f64::from(n));
            let off = |x: usize| a[x] + u * (b[x] - a[x]) + v * (c[x] - a[x]) - place[x];
            least = least.min((off(0) * off(0) + off(1) * off(1) + off(2) * off(2)).sqrt());
        }
    }
    least
}

fn cell(point: [f64; 2]) -> [i32; 2] {
    point.map(|x| (x / CELL_M).floor() as i32)
}

/// What is known in one tick.
struct Seen<'s> {
    world: &'s World,
    fleet: &'s Fleet,
    traffic: &'s Traffic,
    lines: &'s HashMap<[i32; 2], Vec<Line>>,
    solids: &'s Solids<'s>,
    /// Since when each light has shown red, seconds.
    red_since: &'s BTreeMap<String, f64>,
    verbose: bool,
}

fn watch(seen: &Seen<'_>, logs: &mut BTreeMap<u32, Log>, sums: &mut Sums) {
    let &Seen {
        world,
        fleet,
        traffic,
        lines,
        solids,
        red_since,
        verbose,
    } = seen;
    let now = traffic.time_secs;
    for mover in traffic.movers.iter().filter(|mover| mover.is_vehicle) {
        let log = logs.entry(mover.id).or_default();
        let front = mover.point(mover.front_m(), 0.0);
        let at = [mover.position_m[0], mover.position_m[1]];
        let last = log.last.replace(front);
        let step_m = last.map_or(0.0, |last| distance(last, front));
        log.driven_m += step_m;
        let record = world.record(ActorId(mover.id)).expect("it is there");
        let moves = mover.speed_mps.abs() > STANDING_MPS;
        if moves && record.flags & ActorRecord::TOUCHED != 0 {
            let is_new = log
                .touched_at_secs
                .is_none_or(|at| now > at + ONE_COLLISION_SECS);
            log.touched_at_secs = Some(now);
            if is_new {
                let near = traffic
                    .movers
                    .iter()
                    .filter(|other| other.id != mover.id && mover.overlaps(other, 0.5));
                let near: Vec<String> = near.map(|other| describe(fleet, other)).collect();
                let mut touched = world.collisions().iter();
                if touched.any(|it| it.actor.0 == mover.id && it.other.is_some()) {
                    sums.collisions += 1;
                } else {
                    sums.scenery += 1;
                }
                if verbose {
                    let touched = world
                        .collisions()
                        .iter()
                        .filter(|it| it.actor.0 == mover.id);
                    for it in touched {
                        let [x, y, z] = it.point_in_world_m;
                        eprintln!(
                            "{now:.1} {} touches {} at ({x:.2}, {y:.2}, {z:.2}), pushed {:.0?} N s",
                            mover.id,
                            match it.other {
                                Some(other) => format!("actor {}", other.0),
                                None => solids.nearest(it.point_in_world_m),
                            },
                            it.impulse_in_world_ns,
                        );
                    }
                    eprintln!(
                        "{now:.1} collision {} with {near:?}",
                        describe(fleet, mover)
                    );
                }
            }
        }
        if moves {
            if log.standing_secs > STUCK_SECS && verbose {
                eprintln!(
                    "{now:.1} {} goes on after {:.0} s",
                    mover.id, log.standing_secs
                );
            }
            log.standing_secs = 0.0;
        } else {
            let before = log.standing_secs;
            log.standing_secs += PERIOD_SECS;
            if before <= STUCK_SECS && log.standing_secs > STUCK_SECS {
                sums.stuck += 1;
                if verbose {
                    eprintln!("{now:.1} stuck {} at {at:.0?}", describe(fleet, mover));
                }
            }
        }
        log.speeds.push(mover.speed_mps);
        if let [.., a, b, c] = log
            .speeds
            .iter()
            .rev()
            .step_by(4)
            .take(3)
            .collect::<Vec<_>>()[..]
            && log.speeds.len() > 8
        {
            // Two accelerations over 0.2 s each, 0.2 s apart.
            sums.jerks
                .push((((a - b) - (b - c)) / (0.2 * 0.2)).abs() as f32);
        }
        if log.speeds.len() > 64 {
            log.speeds.drain(..32);
        }
        let Some(last) = last.filter(|_| moves) else {
            continue;
        };
        let [x, y] = cell(front);
        let near = (x - 1..=x + 1).flat_map(|x| (y - 1..=y + 1).map(move |y| [x, y]));
        for line in near.filter_map(|cell| lines.get(&cell)).flatten() {
            let ahead = |p: [f64; 2]| {
                (p[0] - line.point[0]) * line.along[0] + (p[1] - line.point[1]) * line.along[1]
            };
            let aside = (front[1] - line.point[1]) * line.along[0]
                - (front[0] - line.point[0]) * line.along[1];
            let crosses = ahead(last) <= 0.0 && ahead(front) > 0.0 && aside.abs() < 1.6;
            let heads = mover.yaw_rad.cos() * line.along[0] + mover.yaw_rad.sin() * line.along[1];
            let is_red = red_since
                .get(&line.signal)
                .is_some_and(|since| now > since + 0.2);
            let driver = fleet.drivers().get(&mover.id);
            let goes_there =
                driver.is_some_and(|d| d.path().legs().iter().any(|leg| leg.lane == line.lane));
            if crosses && heads > 0.7 && is_red && goes_there {
                sums.red_lights += 1;
                if verbose {
                    eprintln!(
                        "{now:.1} red light {} {}",
                        line.signal,
                        describe(fleet, mover)
                    );
                }
            }
        }
    }
}

fn describe(fleet: &Fleet, mover: &consumer_driver::Mover) -> String {
    let driver = fleet.drivers().get(&mover.id);
    format!(
        "{} at ({:.1}, {:.1}) {:.1} m/s {:.1} m long, wait {:?}, blocked by {:?}, refused {:?}, lane {:?}, zones {:?}",
        mover.id,
        mover.position_m[0],
        mover.position_m[1],
        mover.speed_mps,
        2.0 * mover.half_m[0],
        driver.map(|d| d.wait()),
        driver
            .and_then(|d| d.blocked_by())
            .map(|it| (it.id, it.secs)),
        driver.and_then(|d| d.refusal()),
        driver.and_then(|d| d.lane()).map(|lane| lane.to_string()),
        driver.map(|d| d.entries().iter().map(|e| e.zone).collect::<Vec<_>>()),
    )
}

fn report(
    args: &Args,
    map: &str,
    n_vehicles: usize,
    logs: &BTreeMap<u32, Log>,
    mut sums: Sums,
    result: &mut BenchResult,
) {
    let name = map.rsplit('/').next().unwrap_or(map);
    let driven_m: f64 = logs.values().map(|log| log.driven_m).sum();
    let hours = args.minutes / 60.0 * n_vehicles as f64;
    sums.jerks.sort_by(f32::total_cmp);
    sums.ticks_micros.sort_by(f64::total_cmp);
    let ticks = &sums.ticks_micros;
    let share = |n: usize, part: f64| ((n as f64 * part) as usize).min(n.saturating_sub(1));
    let tick = |part: f64| ticks.get(share(ticks.len(), part)).copied().unwrap_or(0.0);
    let jerk = sums.jerks.get(share(sums.jerks.len(), 0.95));
    let figures = [
        ("vehicles", n_vehicles as f64),
        ("walkers", args.walkers as f64),
        ("simulated_min", args.minutes),
        ("seed", args.seed as f64),
        ("collisions", f64::from(sums.collisions)),
        ("scenery_contacts", f64::from(sums.scenery)),
        ("red_lights", f64::from(sums.red_lights)),
        ("stuck", f64::from(sums.stuck)),
        ("mean_kmh", driven_m / 1000.0 / hours.max(1e-9)),
        ("driven_km", driven_m / 1000.0),
        ("jerk_p95_mps3", jerk.copied().map_or(0.0, f64::from)),
        (
            "tick_ms_mean",
            ticks.iter().sum::<f64>() / ticks.len().max(1) as f64 / 1e3,
        ),
        ("tick_ms_p50", tick(0.5) / 1e3),
        ("tick_ms_p99", tick(0.99) / 1e3),
    ];
    sums.strangers_kmh.sort_by(f32::total_cmp);
    let speeds = &sums.strangers_kmh;
    let speed = |part: f64| f64::from(*speeds.get(share(speeds.len(), part)).unwrap_or(&0.0));
    let with_strangers = [
        ("strangers", args.strangers as f64),
        ("strangers_kmh_p90", speed(0.9)),
        ("strangers_kmh_p99", speed(0.99)),
        ("contacts_at_fault", f64::from(sums.at_fault)),
        ("contacts_strangers_fault", f64::from(sums.strangers_fault)),
    ];
    let mut figures = figures.to_vec();
    if args.strangers > 0 {
        figures.extend(with_strangers);
    }
    let text: Vec<String> = figures
        .iter()
        .map(|(name, figure)| format!("{name} {figure:.3}"))
        .collect();
    println!("{name}: {}, controls {:016x}", text.join(", "), sums.hash);
    result.row(name, &figures);
}
