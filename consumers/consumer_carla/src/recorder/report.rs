//! What is said about recordings, in the form of CARLA's texts.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::file::{Recording, VERSION};
use crate::fields::Description;

const ROOM: &str = "a text always has room";

fn opening(recording: &Recording) -> String {
    format!("Version: {VERSION}\nMap: {}\nDate: {}\n\n", recording.head.map, recording.head.date)
}

fn closing(out: &mut String, recording: &Recording) {
    write!(out, "\nFrames: {}\nDuration: {:.3} seconds\n", recording.frames.len(), recording.duration_secs()).expect(ROOM);
}

/// `show_recorder_file_info`: frames in which something comes, goes or touches; every frame with all its packets if `all`.
pub fn info(recording: &Recording, all: bool) -> String {
    let mut out = opening(recording);
    for (idx, frame) in recording.frames.iter().enumerate() {
        let has_events = !(frame.born.is_empty() && frame.gone.is_empty() && frame.collisions.is_empty());
        if !has_events && !all && idx != 0 {
            continue;
        }
        writeln!(out, "Frame {} at {:.3} seconds", idx + 1, frame.elapsed_secs).expect(ROOM);
        for born in &frame.born {
            let [x, y, z] = born.at.location_m;
            writeln!(out, " Create {}: {} at ({x:.2}, {y:.2}, {z:.2})", born.id, born.description.type_id).expect(ROOM);
            for attribute in &born.description.attributes {
                writeln!(out, "  {} = {}", attribute.name, attribute.value).expect(ROOM);
            }
            if born.parent != 0 {
                writeln!(out, " Parenting {} with {} (parent)", born.id, born.parent).expect(ROOM);
            }
        }
        frame.gone.iter().for_each(|id| writeln!(out, " Destroy {id}").expect(ROOM));
        for (a, b) in &frame.collisions {
            writeln!(out, " Collision between {a} and {b}").expect(ROOM);
        }
        if all {
            details(&mut out, recording, idx);
        }
    }
    closing(&mut out, recording);
    out
}

fn details(out: &mut String, recording: &Recording, idx: usize) {
    let frame = &recording.frames[idx];
    writeln!(out, " Positions: {}", frame.poses.len()).expect(ROOM);
    for (id, at) in &frame.poses {
        let ([x, y, z], [pitch, yaw, roll]) = (at.location_m, at.rotation_deg);
        writeln!(out, "  Id: {id} Location: ({x:.3}, {y:.3}, {z:.3}) Rotation: ({pitch:.2}, {yaw:.2}, {roll:.2})").expect(ROOM);
    }
    writeln!(out, " State traffic lights: {}", frame.lights.len()).expect(ROOM);
    for (id, (state, frozen)) in &frame.lights {
        writeln!(out, "  Id: {id} state: {state} frozen: {}", u8::from(*frozen)).expect(ROOM);
    }
    writeln!(out, " Vehicle animations: {}", frame.pedals.len()).expect(ROOM);
    for (id, p) in &frame.pedals {
        let hand_brake = u8::from(p.hand_brake);
        writeln!(
            out,
            "  Id: {id} Steering: {:.3} Throttle: {:.3} Brake: {:.3} Handbrake: {hand_brake} Gear: {}",
            p.steer, p.throttle, p.brake, p.gear
        )
        .expect(ROOM);
    }
}

/// CARLA's letter of what an actor is: hero, vehicle, walker, traffic light, other.
fn letter(names: &BTreeMap<u32, &Description>, id: u32) -> char {
    match names.get(&id) {
        Some(who) if who.attribute("role_name") == Some("hero") => 'h',
        Some(who) if who.type_id.starts_with("vehicle.") => 'v',
        Some(who) if who.type_id.starts_with("walker.") => 'w',
        Some(who) if who.type_id == "traffic.traffic_light" => 't',
        _ => 'o',
    }
}

/// Whether an actor is of the kind a letter asks for; heroes are vehicles too, and `a` is any.
fn is_of(names: &BTreeMap<u32, &Description>, id: u32, asked: char) -> bool {
    let own = letter(names, id);
    asked == 'a' || own == asked || (asked == 'v' && own == 'h')
}

/// `show_recorder_collisions`: between actors of two kinds, in either order.
pub fn collisions(recording: &Recording, first: char, second: char) -> String {
    let names = recording.names();
    let name = |id: u32| names.get(&id).map_or("", |who| who.type_id.as_str());
    let mut out = opening(recording);
    writeln!(out, "{:>8}  {:5} {:>6} {:35} {:>6} {:35}", "Time", "Types", "Id", "Actor 1", "Id", "Actor 2").expect(ROOM);
    for frame in &recording.frames {
        for (a, b) in &frame.collisions {
            let fits = |x: u32, y: u32| is_of(&names, x, first) && is_of(&names, y, second);
            let (a, b) = match (fits(*a, *b), fits(*b, *a)) {
                (true, _) => (*a, *b),
                (false, true) => (*b, *a),
                _ => continue,
            };
            let kinds = format!(" {} {} ", letter(&names, a), letter(&names, b));
            writeln!(out, "{:>8.2}  {kinds:5} {a:>6} {:35} {b:>6} {:35}", frame.elapsed_secs, name(a), name(b)).expect(ROOM);
        }
    }
    closing(&mut out, recording);
    out
}

/// `show_recorder_actors_blocked`: vehicles and walkers that moved less than `min_distance` cm for at least `min_secs`.
pub fn blocked(recording: &Recording, min_secs: f64, min_distance_cm: f64) -> String {
    let names = recording.names();
    let mut out = opening(recording);
    writeln!(out, "{:>8} {:>6} {:35} {:>10}", "Time", "Id", "Actor", "Duration").expect(ROOM);
    let mut found: Vec<(f64, u32, f64)> = Vec::new();
    let mut since: BTreeMap<u32, (f64, [f64; 3])> = BTreeMap::new();
    for frame in &recording.frames {
        for (id, at) in frame.poses.iter().filter(|(id, _)| matches!(letter(&names, **id), 'h' | 'v' | 'w')) {
            let (start, place) = *since.entry(*id).or_insert((frame.elapsed_secs, at.location_m));
            let moved_m = (0..3).map(|i| (at.location_m[i] - place[i]).powi(2)).sum::<f64>().sqrt();
            if moved_m * 100.0 >= min_distance_cm {
                found.extend(Some((start, *id, frame.elapsed_secs - start)).filter(|(_, _, length)| *length >= min_secs));
                since.insert(*id, (frame.elapsed_secs, at.location_m));
            }
        }
        for id in &frame.gone {
            if let Some((start, _)) = since.remove(id) {
                found.extend(Some((start, *id, frame.elapsed_secs - start)).filter(|(_, _, length)| *length >= min_secs));
            }
        }
    }
    let end = recording.duration_secs();
    found.extend(since.into_iter().map(|(id, (start, _))| (start, id, end - start)).filter(|(_, _, length)| *length >= min_secs));
    found.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.1.cmp(&b.1)));
    for (start, id, length) in found {
        let name = names.get(&id).map_or("", |who| who.type_id.as_str());
        writeln!(out, "{start:>8.2} {id:>6} {name:35} {length:>10.2}").expect(ROOM);
    }
    closing(&mut out, recording);
    out
}
