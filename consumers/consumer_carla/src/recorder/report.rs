//! Reports about recordings, in the form of CARLA's texts.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::recorder::file::Recording;
use crate::recorder::report_details::details;
use crate::recorder::text::{ROOM, centimetres, round};
use crate::wire::description::Description;

fn opening(recording: &Recording) -> String {
    format!(
        "Version: {}\nMap: {}\nDate: {}\n\n",
        recording.head.version, recording.head.map, recording.head.date
    )
}

fn closing(out: &mut String, recording: &Recording) {
    write!(
        out,
        "\nFrames: {}\nDuration: {} seconds\n",
        recording.frames.len(),
        round(recording.duration_secs())
    )
    .expect(ROOM);
}

/// CARLA's number of a family of actors.
fn family(type_id: &str) -> u8 {
    match type_id {
        "traffic.traffic_light" => 3,
        _ if type_id.starts_with("vehicle.") => 1,
        _ if type_id.starts_with("walker.") => 2,
        _ => 0,
    }
}

/// `show_recorder_file_info`: frames in which actors appear, disappear or touch; with `all` every
/// frame and all its packets.
pub fn info(recording: &Recording, all: bool) -> String {
    let (mut out, names) = (opening(recording), recording.names());
    let mut n_collisions = 0;
    for (idx, frame) in recording.frames.iter().enumerate() {
        let has_events =
            !(frame.born.is_empty() && frame.gone.is_empty() && frame.collisions.is_empty());
        if !has_events && !all && idx != 0 {
            continue;
        }
        writeln!(
            out,
            "Frame {} at {} seconds",
            idx + 1,
            round(frame.elapsed_secs)
        )
        .expect(ROOM);
        for born in &frame.born {
            let type_id = born.description.type_id.as_str();
            writeln!(
                out,
                " Create {}: {type_id} ({}) at {}",
                born.id,
                family(type_id),
                centimetres(born.at.location_m)
            )
            .expect(ROOM);
            for attribute in &born.description.attributes {
                writeln!(out, "  {} = {}", attribute.name, attribute.value).expect(ROOM);
            }
        }
        frame
            .gone
            .iter()
            .for_each(|id| writeln!(out, " Destroy {id}").expect(ROOM));
        for born in frame.born.iter().filter(|born| born.parent != 0) {
            writeln!(out, " Parenting {} with {} (parent)", born.id, born.parent).expect(ROOM);
        }
        let hero = |id: &u32| if is_hero(&names, *id) { " (hero) " } else { "" };
        for (a, b) in &frame.collisions {
            writeln!(
                out,
                " Collision id {n_collisions} between {a}{} with {b}{}",
                hero(a),
                hero(b)
            )
            .expect(ROOM);
            n_collisions += 1;
        }
        if all {
            details(&mut out, frame);
        }
    }
    closing(&mut out, recording);
    out
}

/// CARLA's letter of an actor's kind: vehicle, walker, traffic light, other.
fn letter(names: &BTreeMap<u32, &Description>, id: u32) -> char {
    ['o', 'v', 'w', 't'][usize::from(names.get(&id).map_or(0, |who| family(&who.type_id)))]
}

fn is_hero(names: &BTreeMap<u32, &Description>, id: u32) -> bool {
    names
        .get(&id)
        .is_some_and(|who| who.attribute("role_name") == Some("hero"))
}

/// Whether an actor is of the kind that a letter asks for; `h` is a hero, `a` is any actor.
fn is_of(names: &BTreeMap<u32, &Description>, id: u32, asked: char) -> bool {
    asked == 'a' || letter(names, id) == asked || asked == 'h' && is_hero(names, id)
}

/// `show_recorder_collisions`: collisions between actors of two kinds, in either order.
pub fn collisions(recording: &Recording, first: char, second: char) -> String {
    let names = recording.names();
    let name = |id: u32| names.get(&id).map_or("", |who| who.type_id.as_str());
    let mut out = opening(recording);
    writeln!(
        out,
        "{:>8}  {:5} {:>6} {:35} {:>6} {:35}",
        "Time", "Types", "Id", "Actor 1", "Id", "Actor 2"
    )
    .expect(ROOM);
    for frame in &recording.frames {
        for (a, b) in &frame.collisions {
            let fits = |x: u32, y: u32| is_of(&names, x, first) && is_of(&names, y, second);
            let (a, b) = match (fits(*a, *b), fits(*b, *a)) {
                (true, _) => (*a, *b),
                (false, true) => (*b, *a),
                _ => continue,
            };
            let kinds = format!(" {} {} ", letter(&names, a), letter(&names, b));
            writeln!(
                out,
                "{:>8.0}  {kinds:5} {a:>6} {:35} {b:>6} {:35}",
                frame.elapsed_secs,
                name(a),
                name(b)
            )
            .expect(ROOM);
        }
    }
    closing(&mut out, recording);
    out
}

/// `show_recorder_actors_blocked`: vehicles and walkers that moved less than `min_distance` cm for
/// at least `min_secs`.
pub fn blocked(recording: &Recording, min_secs: f64, min_distance_cm: f64) -> String {
    let names = recording.names();
    let mut out = opening(recording);
    writeln!(
        out,
        "{:>8} {:>6} {:35} {:>10}",
        "Time", "Id", "Actor", "Duration"
    )
    .expect(ROOM);
    let mut found: Vec<(f64, u32, f64)> = Vec::new();
    let mut since: BTreeMap<u32, (f64, [f64; 3])> = BTreeMap::new();
    for frame in &recording.frames {
        for (id, at) in frame
            .poses
            .iter()
            .filter(|(id, _)| matches!(letter(&names, **id), 'v' | 'w'))
        {
            let (start, place) = *since
                .entry(*id)
                .or_insert((frame.elapsed_secs, at.location_m));
            let moved_m = (0..3)
                .map(|i| (at.location_m[i] - place[i]).powi(2))
                .sum::<f64>()
                .sqrt();
            if moved_m * 100.0 >= min_distance_cm {
                found.extend(
                    Some((start, *id, frame.elapsed_secs - start))
                        .filter(|(_, _, length)| *length >= min_secs),
                );
                since.insert(*id, (frame.elapsed_secs, at.location_m));
            }
        }
        for id in &frame.gone {
            if let Some((start, _)) = since.remove(id) {
                found.extend(
                    Some((start, *id, frame.elapsed_secs - start))
                        .filter(|(_, _, length)| *length >= min_secs),
                );
            }
        }
    }
    let end = recording.duration_secs();
    found.extend(
        since
            .into_iter()
            .map(|(id, (start, _))| (start, id, end - start))
            .filter(|(_, _, length)| *length >= min_secs),
    );
    found.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.1.cmp(&b.1)));
    for (start, id, length) in found {
        let name = names.get(&id).map_or("", |who| who.type_id.as_str());
        writeln!(out, "{start:>8.0} {id:>6} {name:35} {length:>10.0}").expect(ROOM);
    }
    closing(&mut out, recording);
    out
}
