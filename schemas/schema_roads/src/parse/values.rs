//! Values that several elements have: lane ids, ends of roads, speeds, outlines.

use roxmltree::Node;

use super::xml::{Reader, tag, text};
use crate::raw::{Corner, End};

/// Most corners of an outline.
const MAX_CORNERS: usize = 1000;

/// A lane id other than 0 that fits into its type.
pub(super) fn lane_id(node: Node, name: &str) -> Option<i8> {
    text(node, name)
        .parse()
        .ok()
        .filter(|id| *id != 0 && *id != i8::MIN)
}

pub(super) fn contact_point(node: Node) -> Option<End> {
    match text(node, "contactPoint") {
        "start" => Some(End::Start),
        "end" => Some(End::Finish),
        _ => None,
    }
}

/// A `<speed>`'s limit in m/s; the inner `None` is "no limit", the outer one "says nothing".
pub(super) fn speed_mps(node: Node) -> Option<Option<f64>> {
    let max = text(node, "max");
    if max == "no limit" {
        return Some(None);
    }
    let value = max
        .parse::<f64>()
        .ok()
        .filter(|v| v.is_finite() && *v > 0.0)?;
    let factor = match text(node, "unit") {
        "mph" => 0.44704,
        "km/h" => 1.0 / 3.6,
        _ => 1.0,
    };
    Some(Some(value * factor))
}

/// Corners of an outline, in the road's coordinates or in those of the object.
pub(super) fn outline_corners(reader: &mut Reader, outline: Node, road_m: f64) -> Vec<Corner> {
    let corner = |reader: &mut Reader, n: Node| {
        let mut at = |name| reader.number(n, name, 0.0);
        match tag(n) {
            "cornerLocal" => Some(Corner::Local {
                u_m: at("u"),
                v_m: at("v"),
                z_m: at("z"),
                height_m: at("height"),
            }),
            "cornerRoad" => Some(Corner::Road {
                s_m: at("s").clamp(0.0, road_m),
                t_m: at("t"),
                dz_m: at("dz"),
                height_m: at("height"),
            }),
            _ => None,
        }
    };
    outline
        .children()
        .filter(Node::is_element)
        .filter_map(|n| corner(reader, n))
        .take(MAX_CORNERS)
        .collect()
}
