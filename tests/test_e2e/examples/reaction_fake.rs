//! Programs that measure the measurer of reaction times: each sees what there is to see by the truth
//! itself, answers after a delay that is known exactly, and writes down when it published.
//!
//! `reaction_fake MODE DELAY_MS LOG`, with one of these modes:
//! `see` publishes the true box of a person as soon as a pixel shows it, `shout` always does, `blind`
//! never does, `fall` is `see` that crashes at its first person and sees after its restart, `later`
//! answers DELAY_MS frames later and not milliseconds; `brake` brakes for what they publish;
//! `states` says which lights and brake lamps it sees.

use std::error::Error;
use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use bytemuck::Zeroable as _;
use consumer_kit::{FollowedResult, Follower, MAX_WAIT, Publisher, Take, WorldAt};
use nalgebra::Translation3;
use schema_bus::names::default_domain;
use schema_bus::{Frame, ResultTopic, mono_now};
use schema_frames::{
    ActorKind, ActorRecord, Box3d, LightState, ResultType, Space, VehicleControl,
    VehicleControlRecord,
};
use schema_types::Pose;

type Outcome = Result<(), Box<dyn Error>>;

const LABELS: &str = "ego/reaction_truth/instance";
const BOXES: &str = "fake/boxes";
/// Brake lamps in a vehicle's record.
const BRAKE_LAMPS: u32 = 8;

fn main() -> Outcome {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [mode, delay, log] = &words[..] else {
        return Err("usage: reaction_fake MODE DELAY_MS LOG".into());
    };
    let delay: u64 = delay.parse()?;
    let log = Log(File::options().create(true).append(true).open(log)?);
    match mode.as_str() {
        "brake" => brake(delay, log),
        "states" => states(),
        _ => see(mode, delay, log),
    }
}

/// One line per publication: what, the tick that it answers, and a moment before and one after it
/// was sent, between which other programs may have had the processor.
struct Log(File);

impl Log {
    fn note(&mut self, what: &str, tick: u64, before: u64) -> Outcome {
        let after = mono_now().0;
        // One write, so that a kill leaves whole lines.
        Ok(self
            .0
            .write_all(format!("{what} {tick} {before} {after}\n").as_bytes())?)
    }
}

/// Sleeps until a moment of the monotonic clock, nanoseconds.
fn sleep_until(nanos: u64) {
    std::thread::sleep(Duration::from_nanos(nanos.saturating_sub(mono_now().0)));
}

fn person(world: &WorldAt) -> Option<&ActorRecord> {
    world
        .records
        .iter()
        .find(|it| it.kind == ActorKind::Walker as u16)
}

fn shows(frame: &Frame, id: u32) -> bool {
    frame.elements::<u32>().is_some_and(|ids| ids.contains(&id))
}

fn see(mode: &str, delay: u64, mut log: Log) -> Outcome {
    let mut follower = Follower::open(&default_domain(), "fake-eye")?;
    let labels = follower.follow(LABELS, Take::All);
    let boxes = Publisher::<Box3d>::open(follower.bus(), BOXES)?;
    let mut waiting: Vec<Vec<Box3d>> = Vec::new();
    loop {
        follower.wait(MAX_WAIT)?;
        while let Some(frame) = follower.take(labels)? {
            let header = *frame.header();
            let Some(world) = follower.world_at(header.tick)? else {
                continue;
            };
            let seen = person(&world).filter(|it| match mode {
                "shout" => true,
                "blind" => false,
                _ => shows(&frame, it.id),
            });
            if seen.is_some() && mode == "fall" && fell_for_the_first_time()? {
                std::process::exit(3);
            }
            let mut found: Vec<Box3d> = seen.map(box_of).into_iter().collect();
            if mode == "later" {
                waiting.push(found);
                if waiting.len() as u64 <= delay {
                    continue;
                }
                // Only as many frames wait as it is late.
                found = waiting.remove(0);
            } else {
                sleep_until(header.published_mono_nanos + delay * 1_000_000);
            }
            let mut list = boxes.loan(found.len())?;
            list.copy_from_slice(&found);
            list.answers(&frame);
            list.header_mut().space = Space::World as u32;
            list.header_mut().world_from_space = Pose::IDENTITY;
            let before = mono_now().0;
            list.send(found.len())?;
            if !found.is_empty() {
                log.note("box", header.tick, before)?;
            }
        }
    }
}

/// Whether this is the first fall; the next program finds a file that says so.
fn fell_for_the_first_time() -> Result<bool, Box<dyn Error>> {
    let mark = Path::new("fell");
    let first = !mark.exists();
    File::create(mark)?;
    Ok(first)
}

fn box_of(person: &ActorRecord) -> Box3d {
    Box3d {
        pose: person.world_from_actor,
        half_m: person.half_box_m,
        velocity_mps: [f32::NAN; 3],
        score: 1.0,
        class: u32::from(person.class),
        ..Box3d::zeroed()
    }
}

fn brake(delay: u64, mut log: Log) -> Outcome {
    let mut follower = Follower::open(&default_domain(), "fake-foot")?;
    let mut boxes = FollowedResult::new(BOXES, Take::All);
    follower.listen(BOXES)?;
    let mut controls = follower.bus().control_writer("foot")?;
    loop {
        follower.wait(MAX_WAIT)?;
        boxes.look(follower.bus())?;
        while let Some(found) = boxes.take()? {
            let header = *found.header();
            let Some(world) = follower.newest_world()? else {
                continue;
            };
            let ego = world
                .records
                .iter()
                .find(|it| it.kind == ActorKind::Vehicle as u16);
            let (Some(ego), true) = (ego, header.n_items > 0) else {
                continue;
            };
            sleep_until(header.published_mono_nanos + delay * 1_000_000);
            let control = VehicleControl {
                brake_ratio: 1.0,
                ..VehicleControl::default()
            };
            let before = mono_now().0;
            controls.send(header.tick, &[VehicleControlRecord::new(ego.id, control)])?;
            log.note("brake", header.tick, before)?;
        }
    }
}

/// Says `red` while it sees a red light, `lamps` while it sees a car's brake lamps, and publishes
/// every car that it sees as a box.
fn states() -> Outcome {
    let mut follower = Follower::open(&default_domain(), "fake-words")?;
    let labels = follower.follow(LABELS, Take::All);
    let words = follower
        .bus()
        .result_publisher("fake/words", &ResultTopic::new(ResultType::Text))?;
    let boxes = Publisher::<Box3d>::open(follower.bus(), BOXES)?;
    loop {
        follower.wait(MAX_WAIT)?;
        while let Some(frame) = follower.take(labels)? {
            let Some(world) = follower.world_at(frame.header().tick)? else {
                continue;
            };
            let is_red = |it: &&ActorRecord| {
                let light = it.traffic_light();
                light.is_some_and(|light| light.state == LightState::Red as u32)
            };
            let is_braking =
                |it: &&ActorRecord| it.vehicle().is_some_and(|car| car.lamps & BRAKE_LAMPS != 0);
            let visible = |it: &&ActorRecord| shows(&frame, it.id);
            let ego = frame.header().parent_id;
            let others = || world.records.iter().filter(|it| it.id != ego);
            let mut said = String::from("I see");
            if others().filter(is_red).any(|it| visible(&it)) {
                said += " red";
            }
            if others().filter(is_braking).any(|it| visible(&it)) {
                said += " lamps";
            }
            let cars = others().filter(|it| it.kind == ActorKind::Vehicle as u16 && visible(it));
            let cars: Vec<Box3d> = cars
                .map(|it| {
                    let up = Translation3::new(0.0, 0.0, f64::from(it.half_box_m[2]));
                    let pose = (it.world_from_actor.isometry() * up).into();
                    Box3d { pose, ..box_of(it) }
                })
                .collect();
            let mut list = boxes.loan(cars.len())?;
            list.copy_from_slice(&cars);
            list.answers(&frame);
            list.header_mut().space = Space::World as u32;
            list.header_mut().world_from_space = Pose::IDENTITY;
            list.send(cars.len())?;
            let mut text = words.loan(said.len())?;
            text.write(said.as_bytes())?;
            text.answers(&frame);
            text.send()?;
        }
    }
}
