//! Measures how the fleet drives: on a town or an OpenDRIVE map, with the daemon's own physics, over
//! simulated time. Prints one JSON line per run: the cost of a tick, collisions, red lights run,
//! vehicles that stood for more than 90 s, mean speed and the 95th percentile of jerk.
//!
//! The last four are measured from positions and light states alone, not from what drivers think.
//!
//! ```sh
//! cargo run --release --example traffic_quality -- --map Town10HD --vehicles 100 --minutes 60
//! ```

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use std::time::Instant;

use clap::Parser;
use consumer_drive::path::distance;
use consumer_drive::{Fleet, Geometry, Settings, Traffic};
use schema_frames::{ActorList, ActorRecord, LightState};
use schema_roads::{LanePosition, RoadMap, SignalKind};
use schema_types::ActorId;
use simd_town::imported::{ImportOptions, import};
use simd_world::{MapData, World, WorldOptions};

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
#[derive(Debug, Parser)]
struct Args {
    /// Name of a built-in town, or an OpenDRIVE file
    #[arg(long, default_value = "Town10HD")]
    map: String,
    /// Vehicles
    #[arg(long, default_value_t = 100)]
    vehicles: usize,
    /// Walkers
    #[arg(long, default_value_t = 0)]
    walkers: usize,
    /// Simulated minutes
    #[arg(long, default_value_t = 5.0)]
    minutes: f64,
    /// Seed of places and choices
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Prints what went wrong where
    #[arg(long)]
    verbose: bool,
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
    point: [f64; 2],
    along: [f64; 2],
}

#[derive(Default)]
struct Sums {
    collisions: u32,
    red_lights: u32,
    stuck: u32,
    jerks: Vec<f32>,
    ticks_micros: Vec<f64>,
    hash: u64,
}

fn load(args: &Args) -> (MapData, Arc<RoadMap>) {
    if args.map.ends_with(".xodr") {
        let text = std::fs::read_to_string(&args.map).expect("the map can be read");
        let roads = RoadMap::parse(&text).expect("the map is OpenDRIVE");
        let options = ImportOptions {
            visible: false,
            ..ImportOptions::default()
        };
        let town = import(&args.map, &text, &roads, 1, &options).expect("the map can be built");
        let roads = Arc::new(roads);
        (MapData::of_import(&town, roads.clone()), roads)
    } else {
        let town = simd_town::Town::generate(&args.map, 1).expect("a town of that name");
        let roads = Arc::new(RoadMap::parse(&town.open_drive).expect("towns are OpenDRIVE"));
        (MapData::of_town(&town, roads.clone()), roads)
    }
}

fn main() {
    let args = Args::parse();
    let (data, roads) = load(&args);
    let mut world = World::new(WorldOptions {
        seed: args.seed,
        ..WorldOptions::default()
    });
    world.load(&data).expect("the map loads");
    world
        .spawn_scenario(None, args.vehicles)
        .expect("vehicles find a place");
    world.spawn_walkers(args.walkers);
    let actors = world.actor_list();
    let lines = lines(&roads);
    let mut fleet = Fleet::new(roads);
    let mut settings = Settings {
        seed: args.seed,
        ..Settings::default()
    };
    let mut logs: BTreeMap<u32, Log> = BTreeMap::new();
    let mut red_since: BTreeMap<String, f64> = BTreeMap::new();
    let mut sums = Sums::default();
    let n_ticks = (args.minutes * 60.0 / PERIOD_SECS) as u64;
    for tick in 1..=n_ticks {
        world.step(PERIOD_NANOS);
        let traffic = Traffic::from_records(
            tick,
            tick * PERIOD_NANOS,
            PERIOD_NANOS,
            world.snapshot_records(),
            &actors,
        );
        if tick % 20 == 1 {
            assign(&mut fleet, &traffic, &actors);
        }
        let start = Instant::now();
        let step = fleet.step(&traffic, &mut settings);
        sums.ticks_micros.push(start.elapsed().as_secs_f64() * 1e6);
        for record in step.controls {
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
        for (id, state) in &traffic.lights {
            if *state == LightState::Red {
                red_since.entry(id.clone()).or_insert(traffic.time_secs);
            } else {
                red_since.remove(id);
            }
        }
        watch(
            &world,
            &fleet,
            &traffic,
            &lines,
            &red_since,
            &mut logs,
            &mut sums,
            args.verbose,
        );
    }
    report(&args, &fleet, &logs, sums);
}

fn assign(fleet: &mut Fleet, traffic: &Traffic, actors: &ActorList) {
    let vehicles = traffic.movers.iter().filter(|m| m.is_vehicle);
    let ids: Vec<u32> = vehicles.map(|m| m.id).collect();
    let attribute = |id: u32, name: &str| {
        let actor = actors.actors.iter().find(|a| a.id == id)?;
        actor.attributes.get(name)?.parse::<f64>().ok()
    };
    fleet.assign(&ids, traffic, |id| {
        Some(Geometry {
            wheelbase_m: attribute(id, "wheelbase_m")?,
            max_steer_rad: attribute(id, "max_steer_rad")?,
        })
    });
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
            lines.entry(cell(point)).or_default().push(Line {
                signal: signal.id.clone(),
                point,
                along: [yaw.cos(), yaw.sin()],
            });
        }
    }
    lines
}

fn cell(point: [f64; 2]) -> [i32; 2] {
    point.map(|x| (x / CELL_M).floor() as i32)
}

#[expect(
    clippy::too_many_arguments,
    reason = "one place where all that is known is looked at"
)]
fn watch(
    world: &World,
    fleet: &Fleet,
    traffic: &Traffic,
    lines: &HashMap<[i32; 2], Vec<Line>>,
    red_since: &BTreeMap<String, f64>,
    logs: &mut BTreeMap<u32, Log>,
    sums: &mut Sums,
    verbose: bool,
) {
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
                sums.collisions += 1;
                if verbose {
                    let near = traffic
                        .movers
                        .iter()
                        .filter(|other| other.id != mover.id && mover.overlaps(other, 0.5));
                    let near: Vec<String> = near.map(|other| describe(fleet, other)).collect();
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
            if crosses && heads > 0.7 && is_red {
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

fn describe(fleet: &Fleet, mover: &consumer_drive::Mover) -> String {
    let driver = fleet.drivers().get(&mover.id);
    format!(
        "{} at ({:.1}, {:.1}) {:.1} m/s {:.1} m long, wait {:?}, blocked by {:?}, lane {:?}, zones {:?}",
        mover.id,
        mover.position_m[0],
        mover.position_m[1],
        mover.speed_mps,
        2.0 * mover.half_m[0],
        driver.map(|d| d.wait()),
        driver.and_then(|d| d.blocked_by()),
        driver.and_then(|d| d.lane()).map(|lane| lane.to_string()),
        driver.map(|d| d.entries().iter().map(|e| e.zone).collect::<Vec<_>>()),
    )
}

fn report(args: &Args, fleet: &Fleet, logs: &BTreeMap<u32, Log>, mut sums: Sums) {
    let driven_m: f64 = logs.values().map(|log| log.driven_m).sum();
    let hours = args.minutes / 60.0 * logs.len() as f64;
    sums.jerks.sort_by(f32::total_cmp);
    sums.ticks_micros.sort_by(f64::total_cmp);
    let share = |list_len: usize, part: f64| ((list_len as f64 * part) as usize).min(list_len - 1);
    let ticks = &sums.ticks_micros;
    println!(
        "{{\"map\":\"{}\",\"vehicles\":{},\"driven\":{},\"minutes\":{},\"seed\":{},\"collisions\":{},\"red_lights\":{},\"stuck\":{},\"mean_kmh\":{:.2},\"km\":{:.1},\"jerk_p95_mps3\":{:.2},\"tick_us_mean\":{:.0},\"tick_us_p50\":{:.0},\"tick_us_p99\":{:.0},\"hash\":\"{:016x}\"}}",
        args.map.rsplit('/').next().unwrap_or(&args.map),
        logs.len(),
        fleet.len(),
        args.minutes,
        args.seed,
        sums.collisions,
        sums.red_lights,
        sums.stuck,
        driven_m / 1000.0 / hours.max(1e-9),
        driven_m / 1000.0,
        sums.jerks
            .get(share(sums.jerks.len().max(1), 0.95))
            .copied()
            .unwrap_or(0.0),
        ticks.iter().sum::<f64>() / ticks.len().max(1) as f64,
        ticks[share(ticks.len(), 0.5)],
        ticks[share(ticks.len(), 0.99)],
        sums.hash,
    );
}
