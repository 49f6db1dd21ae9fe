//! Reports about recordings, in the form of CARLA's texts. A recording is read frame by frame.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io::BufRead;

use crate::recorder::file::{Cast, Reader};
use crate::recorder::frame::{Frame, Head, Origin};
use crate::recorder::read_error::ReadError;
use crate::recorder::report_details::details;
use crate::recorder::text::{ROOM, centimetres, seconds};

/// Longest text, bytes. Clients get it in one message.
const MAX_TEXT: usize = 512 << 20;
/// Room that the report about actors that stood still needs for each.
const ROW_BYTES: usize = 96;

fn opening(head: &Head) -> String {
    format!(
        "Version: {}\nMap: {}\nDate: {}\n\n",
        head.version, head.map, head.date
    )
}

/// The end of a report, for the last frame.
fn closing<R: BufRead>(out: &mut String, reader: &Reader<R>, (number, secs): (u64, f64)) {
    let secs = seconds(reader.head().origin, secs);
    write!(out, "\nFrames: {number}\nDuration: {secs} seconds\n").expect(ROOM);
    if reader.is_cut() {
        out.push_str("The file ends within a frame, which is left out.\n");
    }
}

fn within_limit(n_bytes: usize) -> Result<(), ReadError> {
    if n_bytes > MAX_TEXT {
        return Err(ReadError::LongText { max: MAX_TEXT });
    }
    Ok(())
}

/// `show_recorder_file_info`: frames in which actors appear, disappear or touch; with `all` every
/// frame and all its packets.
///
/// # Errors
/// If the file is damaged or the text would be too long.
pub fn info<R: BufRead>(reader: &mut Reader<R>, all: bool) -> Result<String, ReadError> {
    let head = reader.head().clone();
    let (mut out, mut cast, mut last) = (opening(&head), Cast::default(), (0, 0.0));
    while let Some(frame) = reader.next_frame()? {
        cast.note(&frame)?;
        let has_events = !(frame.born.is_empty()
            && frame.gone.is_empty()
            && frame.attached.is_empty()
            && frame.collisions.is_empty());
        if has_events || all || last.0 == 0 {
            let secs = seconds(head.origin, frame.elapsed_secs);
            writeln!(out, "Frame {} at {secs} seconds", frame.number).expect(ROOM);
            events(&mut out, &frame, &cast);
            if all {
                details(&mut out, &frame, head.origin);
            }
        }
        last = (frame.number, frame.elapsed_secs);
        within_limit(out.len())?;
    }
    closing(&mut out, reader, last);
    Ok(out)
}

/// Appends actors that appear and disappear, and collisions.
fn events(out: &mut String, frame: &Frame, cast: &Cast) {
    for born in &frame.born {
        writeln!(
            out,
            " Create {}: {} ({}) at {}",
            born.id,
            born.description.type_id,
            born.family,
            centimetres(born.at.location_m)
        )
        .expect(ROOM);
        for attribute in &born.description.attributes {
            writeln!(out, "  {} = {}", attribute.name, attribute.value).expect(ROOM);
        }
    }
    for id in &frame.gone {
        writeln!(out, " Destroy {id}").expect(ROOM);
    }
    let with_parent = frame.born.iter().filter(|born| born.parent != 0);
    let attached = with_parent.map(|born| (born.id, born.parent));
    for (id, parent) in attached.chain(frame.attached.iter().copied()) {
        writeln!(out, " Parenting {id} with {parent} (parent)").expect(ROOM);
    }
    let hero = |id: u32| if cast.is_hero(id) { " (hero) " } else { "" };
    for collision in &frame.collisions {
        let (number, (a, b)) = (collision.number, collision.actors);
        let (hero_a, hero_b) = (hero(a), hero(b));
        writeln!(
            out,
            " Collision id {number} between {a}{hero_a} with {b}{hero_b}"
        )
        .expect(ROOM);
    }
}

/// CARLA's letter of an actor's kind: vehicle, walker, traffic light, other.
fn letter(cast: &Cast, id: u32) -> char {
    match cast.get(id).map(|born| born.family) {
        Some(1) => 'v',
        Some(2) => 'w',
        Some(3) => 't',
        _ => 'o',
    }
}

/// Whether an actor is of the kind that a letter asks for; `h` is a hero, `a` is any actor.
fn is_of(cast: &Cast, id: u32, asked: char) -> bool {
    asked == 'a' || letter(cast, id) == asked || asked == 'h' && cast.is_hero(id)
}

/// `show_recorder_collisions`: collisions between actors of two kinds. In CARLA's recordings the
/// first of two is the one whose sensor noticed it; in Gantry's they are in no order.
///
/// # Errors
/// If the file is damaged or the text would be too long.
pub fn collisions<R: BufRead>(
    reader: &mut Reader<R>,
    first: char,
    second: char,
) -> Result<String, ReadError> {
    let head = reader.head().clone();
    let (mut out, mut cast, mut last) = (opening(&head), Cast::default(), (0, 0.0));
    let mut before: BTreeSet<(u32, u32)> = BTreeSet::new();
    writeln!(
        out,
        "{:>8}  {:5} {:>6} {:35} {:>6} {:35}",
        "Time", "Types", "Id", "Actor 1", "Id", "Actor 2"
    )
    .expect(ROOM);
    while let Some(frame) = reader.next_frame()? {
        cast.note(&frame)?;
        let mut touching = BTreeSet::new();
        for collision in &frame.collisions {
            let (a, b) = collision.actors;
            let is_asked = |x: u32, y: u32| is_of(&cast, x, first) && is_of(&cast, y, second);
            let (a, b) = match (is_asked(a, b), is_asked(b, a)) {
                (true, _) => (a, b),
                (false, true) if head.origin == Origin::Gantry => (b, a),
                _ => continue,
            };
            // CARLA repeats a collision in every frame in which the two touch, and in one frame.
            if !touching.insert((a, b)) || before.contains(&(a, b)) {
                continue;
            }
            let kinds = format!(" {} {} ", letter(&cast, a), letter(&cast, b));
            writeln!(
                out,
                "{:>8.0}  {kinds:5} {a:>6} {:35} {b:>6} {:35}",
                frame.elapsed_secs,
                cast.type_of(a),
                cast.type_of(b)
            )
            .expect(ROOM);
        }
        before = touching;
        last = (frame.number, frame.elapsed_secs);
        within_limit(out.len())?;
    }
    closing(&mut out, reader, last);
    Ok(out)
}

/// `show_recorder_actors_blocked`: vehicles and walkers that moved less than `min_distance` cm for
/// at least `min_secs`.
///
/// # Errors
/// If the file is damaged or the text would be too long.
pub fn blocked<R: BufRead>(
    reader: &mut Reader<R>,
    min_secs: f64,
    min_distance_cm: f64,
) -> Result<String, ReadError> {
    let (mut cast, mut last) = (Cast::default(), (0, 0.0));
    let mut found: Vec<(f64, u32, f64)> = Vec::new();
    let mut since: BTreeMap<u32, (f64, [f64; 3])> = BTreeMap::new();
    let is_long = |(_, _, length): &(f64, u32, f64)| *length >= min_secs;
    while let Some(frame) = reader.next_frame()? {
        cast.note(&frame)?;
        for (id, at) in frame
            .poses
            .iter()
            .filter(|(id, _)| matches!(letter(&cast, **id), 'v' | 'w'))
        {
            let (start, place) = *since
                .entry(*id)
                .or_insert((frame.elapsed_secs, at.location_m));
            let moved_m = (0..3)
                .map(|i| (at.location_m[i] - place[i]).powi(2))
                .sum::<f64>()
                .sqrt();
            if moved_m * 100.0 >= min_distance_cm {
                found.extend(Some((start, *id, frame.elapsed_secs - start)).filter(is_long));
                since.insert(*id, (frame.elapsed_secs, at.location_m));
            }
        }
        for id in &frame.gone {
            if let Some((start, _)) = since.remove(id) {
                found.extend(Some((start, *id, frame.elapsed_secs - start)).filter(is_long));
            }
        }
        last = (frame.number, frame.elapsed_secs);
        within_limit(found.len() * ROW_BYTES)?;
    }
    let to_the_end = since
        .into_iter()
        .map(|(id, (start, _))| (start, id, last.1 - start));
    found.extend(to_the_end.filter(is_long));
    found.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.1.cmp(&b.1)));
    let mut out = opening(reader.head());
    writeln!(
        out,
        "{:>8} {:>6} {:35} {:>10}",
        "Time", "Id", "Actor", "Duration"
    )
    .expect(ROOM);
    for (start, id, length) in found {
        let name = cast.type_of(id);
        writeln!(out, "{start:>8.0} {id:>6} {name:35} {length:>10.0}").expect(ROOM);
    }
    closing(&mut out, reader, last);
    Ok(out)
}
