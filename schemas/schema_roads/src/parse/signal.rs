//! Signals, references to signals, and crosswalks of a road.

use roxmltree::Node;

use super::values::outline_corners;
use super::xml::{Reader, child, children, text};
use crate::raw::{Placement, RawCrosswalk, RawMap, RawSignal};

/// Most crosswalks of a map.
const MAX_CROSSWALKS: usize = 20_000;

/// Adds what stands along road number `road` to the map.
pub(super) fn read(reader: &mut Reader, node: Node, road: usize, length_m: f64, map: &mut RawMap) {
    if let Some(signals) = child(node, "signals") {
        for n in children(signals, "signal") {
            if let Some(signal) = signal(reader, n, road, length_m) {
                map.signals.push(signal);
            }
        }
        for n in children(signals, "signalReference") {
            if let Some(placement) = placement(reader, n, road, length_m) {
                map.references.push((text(n, "id").to_owned(), placement));
            }
        }
    }
    if let Some(objects) = child(node, "objects") {
        let room = MAX_CROSSWALKS.saturating_sub(map.crosswalks.len());
        let walks = children(objects, "object")
            .filter(|n| text(*n, "type") == "crosswalk")
            .take(room);
        map.crosswalks
            .extend(walks.filter_map(|n| crosswalk(reader, n, road, length_m)));
    }
}

fn placement(reader: &mut Reader, node: Node, road: usize, length_m: f64) -> Option<Placement> {
    let s_m = reader.number(node, "s", 0.0);
    if !(-1.0..=length_m + 1.0).contains(&s_m) {
        reader.error(
            node,
            format!(
                "signal \"{}\" stands at s = {s_m} m, off its road of {length_m} m; it is left out",
                text(node, "id")
            ),
        );
        return None;
    }
    let along = match text(node, "orientation") {
        "+" => Some(true),
        "-" => Some(false),
        _ => None,
    };
    let range = |v: Node| {
        let (from, to) = (
            text(v, "fromLane").parse::<i8>().ok()?,
            text(v, "toLane").parse::<i8>().ok()?,
        );
        Some((from.min(to), from.max(to)))
    };
    let validity = children(node, "validity")
        .filter_map(range)
        .take(64)
        .collect();
    Some(Placement {
        road,
        s_m: s_m.clamp(0.0, length_m),
        t_m: reader.number(node, "t", 0.0),
        along,
        validity,
    })
}

fn signal(reader: &mut Reader, node: Node, road: usize, length_m: f64) -> Option<RawSignal> {
    Some(RawSignal {
        id: text(node, "id").to_owned(),
        name: text(node, "name").to_owned(),
        dynamic: text(node, "dynamic") == "yes",
        kind: text(node, "type").to_owned(),
        subtype: text(node, "subtype").to_owned(),
        country: text(node, "country").to_owned(),
        value: text(node, "value")
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite()),
        unit: text(node, "unit").to_owned(),
        text: text(node, "text").to_owned(),
        z_offset_m: reader.number(node, "zOffset", 0.0),
        heading_offset_rad: reader.number(node, "hOffset", 0.0),
        width_m: reader.number(node, "width", 0.0),
        height_m: reader.number(node, "height", 0.0),
        placement: placement(reader, node, road, length_m)?,
    })
}

fn crosswalk(reader: &mut Reader, node: Node, road: usize, length_m: f64) -> Option<RawCrosswalk> {
    let outline = child(node, "outline").or_else(|| child(child(node, "outlines")?, "outline"))?;
    let corners = outline_corners(reader, outline, length_m);
    let mut at = |name| reader.number(node, name, 0.0);
    (corners.len() >= 3).then(|| RawCrosswalk {
        id: text(node, "id").to_owned(),
        road,
        s_m: at("s").clamp(0.0, length_m),
        t_m: at("t"),
        z_offset_m: at("zOffset"),
        heading_rad: at("hdg"),
        corners,
    })
}
