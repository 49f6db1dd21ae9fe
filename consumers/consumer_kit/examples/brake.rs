//! Drives straight on and stops before whatever `lidar_clusters` finds in the way. One step per
//! tick, in lockstep.
//!
//! `cargo run --release -p consumer_kit --example brake`; `docs/how-to/pipelines.md` explains it.

use std::error::Error;
use std::time::Duration;

use consumer_kit::{FollowedResult, Follower, Steps, Take};
use schema_bus::names::default_domain;
use schema_frames::{ActorKind, Box3d, VehicleControl, VehicleControlRecord};

/// Half of the corridor that must be free, metres.
const HALF_WIDTH_M: f64 = 1.2;
/// From the lidar to the front bumper, metres.
const BUMPER_M: f64 = 2.5;
/// Room that is left before an obstacle, metres.
const ROOM_M: f64 = 3.0;
/// Braking that can be relied on, m/s².
const BRAKING_MPS2: f64 = 4.0;
/// Speed on a free road, m/s.
const CRUISE_MPS: f64 = 8.0;

fn main() -> Result<(), Box<dyn Error>> {
    let mut follower = Follower::open(&default_domain(), "brake")?;
    let mut boxes = FollowedResult::new("clusters/boxes", Take::All);
    let mut controls = follower.bus().control_writer("brake")?;
    let mut steps = Steps::join(&mut follower, "brake", Duration::from_secs(60))?;
    while let Some(world) = steps.next(follower.bus(), Duration::from_secs(60))? {
        let tick = world.header.tick;
        // The boxes of this tick come while the simulator waits for both programs.
        let second = Duration::from_secs(1);
        let Some(found) = boxes.wait_for(follower.bus(), tick, second)? else {
            eprintln!("no boxes of tick {tick} within a second; braking");
            controls.send(tick, &[pedals(&world, 0.0)])?;
            continue;
        };
        let found = found.records::<Box3d>();
        let free_m = free_distance(found.ok_or("clusters/boxes has other records than boxes")?);
        controls.send(tick, &[pedals(&world, free_m)])?;
    }
    Ok(())
}

/// Distance from the bumper to the nearest box in the corridor, metres.
fn free_distance(boxes: &[Box3d]) -> f64 {
    let ahead = boxes.iter().filter(|found| {
        let reach = f64::from(found.half_m[1]) + HALF_WIDTH_M;
        found.pose.translation_m[0] > BUMPER_M && found.pose.translation_m[1].abs() < reach
    });
    ahead
        .map(|found| found.pose.translation_m[0] - f64::from(found.half_m[0]) - BUMPER_M)
        .fold(f64::INFINITY, f64::min)
}

/// Full throttle or brake of the ego vehicle, for `free_m` ahead of it.
fn pedals(world: &consumer_kit::WorldAt, free_m: f64) -> VehicleControlRecord {
    let is_ego = |actor: &&schema_frames::ActorRecord| actor.kind == ActorKind::Vehicle as u16;
    let ego = world.records.iter().find(is_ego);
    let speed = ego.map_or(0.0, |ego| {
        let [x, y, _] = ego.velocity_in_world_mps;
        x.hypot(y)
    });
    let stopping_m = speed * speed / (2.0 * BRAKING_MPS2) + ROOM_M;
    let control = VehicleControl {
        throttle_ratio: if free_m > stopping_m && speed < CRUISE_MPS {
            0.6
        } else {
            0.0
        },
        brake_ratio: if free_m > stopping_m { 0.0 } else { 1.0 },
        ..VehicleControl::default()
    };
    VehicleControlRecord::new(ego.map_or(0, |ego| ego.id), control)
}
