//! Objects of a road: one by one, repeated, with outlines.

use roxmltree::Node;

use super::signal::is_sign;
use super::values::outline_corners;
use super::xml::{Reader, child, children, text};
use crate::raw::{RawMap, RawObject};

/// Most objects of a map, repetitions counted.
const MAX_OBJECTS: usize = 50_000;
/// Most corners of all objects together; one without an outline counts for eight.
const MAX_CORNERS: usize = 500_000;
/// Most repetitions of one object.
const MAX_REPEATS: usize = 5_000;
/// Length of the pieces that an unbroken repetition is cut into, metres.
const PIECE_M: f64 = 2.0;
/// Largest object, metres.
const MAX_SIZE_M: f64 = 2_000.0;

/// Adds the objects of road number `road` to the map, other than crosswalks and signs.
pub(super) fn read(reader: &mut Reader, node: Node, road: usize, length_m: f64, map: &mut RawMap) {
    let Some(objects) = child(node, "objects") else {
        return;
    };
    let is_other = |n: &Node| text(*n, "type") != "crosswalk" && !is_sign(*n);
    for n in children(objects, "object").filter(is_other) {
        if map.objects.len() >= MAX_OBJECTS {
            reader.warn(
                n,
                format!("the map has more than {MAX_OBJECTS} objects; the others are left out"),
            );
            return;
        }
        let object = object(reader, n, road, length_m);
        let room = |used: usize| MAX_CORNERS.saturating_sub(used) / cost(&object);
        let mut repeated = false;
        for repeat in children(n, "repeat").take(64) {
            repeated = true;
            let most =
                room(map.n_object_corners).min(MAX_OBJECTS.saturating_sub(map.objects.len()));
            let pieces = repeats(reader, repeat, &object, length_m, most);
            map.n_object_corners += cost(&object) * pieces.len();
            map.objects.extend(pieces);
        }
        if !repeated && room(map.n_object_corners) > 0 {
            map.n_object_corners += cost(&object);
            map.objects.push(object.clone());
        }
        if room(map.n_object_corners) == 0 {
            reader
                .warn(n, format!("the outlines of the map's objects have more than {MAX_CORNERS} corners; what does not fit is left out"));
        }
    }
}

/// Corners that an object counts for against the limit.
fn cost(object: &RawObject) -> usize {
    object.corners.len().max(8)
}

fn size(reader: &mut Reader, node: Node, name: &str) -> f64 {
    reader.number(node, name, 0.0).clamp(0.0, MAX_SIZE_M)
}

fn object(reader: &mut Reader, node: Node, road: usize, length_m: f64) -> RawObject {
    let outline = child(node, "outline").or_else(|| child(child(node, "outlines")?, "outline"));
    RawObject {
        id: text(node, "id").to_owned(),
        name: text(node, "name").to_owned(),
        kind: text(node, "type").to_owned(),
        road,
        s_m: reader.number(node, "s", 0.0).clamp(0.0, length_m),
        t_m: reader.number(node, "t", 0.0),
        z_offset_m: reader.number(node, "zOffset", 0.0),
        heading_rad: reader.number(node, "hdg", 0.0)
            + if text(node, "orientation") == "-" && !reader.by_road_runner {
                std::f64::consts::PI
            } else {
                0.0
            },
        length_m: size(reader, node, "length"),
        width_m: size(reader, node, "width"),
        height_m: size(reader, node, "height"),
        radius_m: size(reader, node, "radius"),
        corners: outline
            .map(|outline| outline_corners(reader, outline, length_m))
            .unwrap_or_default(),
    }
}

/// One object per distance, or pieces that touch if no distance is given; at most `most`.
fn repeats(
    reader: &mut Reader,
    node: Node,
    object: &RawObject,
    road_m: f64,
    most: usize,
) -> Vec<RawObject> {
    let from_m = reader.number(node, "s", 0.0).clamp(0.0, road_m);
    let length_m = reader
        .number(node, "length", 0.0)
        .clamp(0.0, road_m - from_m);
    let distance_m = reader.number(node, "distance", 0.0);
    let unbroken = distance_m < 0.05;
    let step_m = if unbroken { PIECE_M } else { distance_m };
    let n = if unbroken {
        (length_m / step_m).ceil().max(1.0)
    } else {
        (length_m / step_m + 1e-9).floor() + 1.0
    };
    // Repetitions of an outline cost as much as its corners.
    let n = (n as usize)
        .min(MAX_REPEATS / (1 + object.corners.len() / 8))
        .min(most);
    let step_m = if unbroken {
        length_m / n.max(1) as f64
    } else {
        step_m
    };
    let mut range = |name: &str, fallback: f64| {
        let from = reader
            .optional_number(node, &format!("{name}Start"))
            .unwrap_or(fallback);
        (
            from,
            reader
                .optional_number(node, &format!("{name}End"))
                .unwrap_or(from),
        )
    };
    let (t, z) = (range("t", object.t_m), range("zOffset", object.z_offset_m));
    let (width, height) = (
        range("width", object.width_m),
        range("height", object.height_m),
    );
    let piece = |i: usize| {
        let s_m = from_m + (i as f64 + if unbroken { 0.5 } else { 0.0 }) * step_m;
        let share = if length_m > 0.0 {
            (s_m - from_m) / length_m
        } else {
            0.0
        };
        let at = |(from, to): (f64, f64)| from + share * (to - from);
        RawObject {
            s_m,
            t_m: at(t),
            z_offset_m: at(z),
            width_m: at(width).clamp(0.0, MAX_SIZE_M),
            height_m: at(height).clamp(0.0, MAX_SIZE_M),
            length_m: if unbroken { step_m } else { object.length_m },
            ..object.clone()
        }
    };
    (0..n).map(piece).collect()
}
