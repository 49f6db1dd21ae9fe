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
        for n in children(objects, "object").filter(|n| is_sign(*n)) {
            if let Some(signal) = sign(reader, n, road, length_m) {
                map.signals.push(signal);
            }
        }
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
        "+" => Some(!reader.by_road_runner),
        "-" => Some(reader.by_road_runner),
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

/// Heading of a signal relative to what its orientation says.
fn heading_offset(reader: &mut Reader, node: Node, name: &str, placement: &Placement) -> f64 {
    let stated_rad = reader.number(node, name, 0.0);
    if reader.by_road_runner && placement.along == Some(false) {
        stated_rad + std::f64::consts::PI
    } else {
        stated_rad
    }
}

/// The speed limit that an object of RoadRunner means, as CARLA reads it: `Speed_30`, `speed_60`,
/// `Speed_STATIC_90`. CARLA takes the number as km/h, though it calls the unit mph.
fn speed_of(name: &str) -> Option<&str> {
    let number = name
        .strip_prefix("Speed_")
        .or_else(|| name.strip_prefix("speed_"))?;
    let number = number.strip_prefix("STATIC_").unwrap_or(number);
    number
        .parse::<f64>()
        .is_ok_and(|kmh| kmh.is_finite() && kmh > 0.0)
        .then_some(number)
}

/// Whether an object is a sign that is read as a signal.
pub(super) fn is_sign(node: Node) -> bool {
    speed_of(text(node, "name")).is_some()
}

/// The sign that an object means.
fn sign(reader: &mut Reader, node: Node, road: usize, length_m: f64) -> Option<RawSignal> {
    let number = speed_of(text(node, "name"))?;
    let placement = placement(reader, node, road, length_m)?;
    Some(RawSignal {
        id: text(node, "id").to_owned(),
        name: text(node, "name").to_owned(),
        dynamic: false,
        kind: "274".to_owned(),
        subtype: number.to_owned(),
        country: "OpenDRIVE".to_owned(),
        value: number.parse().ok(),
        unit: "mph".to_owned(),
        text: number.to_owned(),
        z_offset_m: reader.number(node, "zOffset", 0.0),
        heading_offset_rad: heading_offset(reader, node, "hdg", &placement),
        width_m: reader.number(node, "width", 0.0),
        height_m: reader.number(node, "height", 0.0),
        placement,
    })
}

fn signal(reader: &mut Reader, node: Node, road: usize, length_m: f64) -> Option<RawSignal> {
    let placement = placement(reader, node, road, length_m)?;
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
        heading_offset_rad: heading_offset(reader, node, "hOffset", &placement),
        width_m: reader.number(node, "width", 0.0),
        height_m: reader.number(node, "height", 0.0),
        placement,
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
