//! One `<road>`: links, plan view, profiles, sections.

use roxmltree::Node;

use super::lane;
use super::values::{contact_point, speed_mps};
use super::xml::{Reader, child, children, tag, text};
use crate::curve::{Geometry, ParamCurve, Shape, Spiral};
use crate::lateral::{Lateral, ShapeRecord};
use crate::profile::{Cubic, Profile};
use crate::raw::{Road, RoadLink};

/// Longest road that is read, metres.
const MAX_ROAD_M: f64 = 1.0e6;

/// The road, or nothing if it has no usable geometry or lanes.
pub(super) fn read(reader: &mut Reader, node: Node, number: u32) -> Option<Road> {
    let id = text(node, "id");
    let plan = plan_view(reader, node);
    let Some(last) = plan.last() else {
        reader.error(
            node,
            format!("road \"{id}\" has no usable geometry; it is left out"),
        );
        return None;
    };
    let drawn_m = last.s_m + last.length_m;
    let length_m = reader
        .optional_number(node, "length")
        .filter(|l| *l > 0.0)
        .unwrap_or(drawn_m);
    if length_m > MAX_ROAD_M || drawn_m > MAX_ROAD_M {
        reader.error(
            node,
            format!(
                "road \"{id}\" is longer than {} km; it is left out",
                MAX_ROAD_M / 1000.0
            ),
        );
        return None;
    }
    if (length_m - drawn_m).abs() > 0.1 {
        reader.warn(node, format!("road \"{id}\" is {length_m} m long but its geometry {drawn_m} m; the geometry goes on as it ends"));
    }
    let lanes = child(node, "lanes");
    let sections = lanes
        .map(|l| lane::sections(reader, l, length_m))
        .unwrap_or_default();
    if sections.is_empty() {
        reader.error(
            node,
            format!("road \"{id}\" has no lane section; it is left out"),
        );
        return None;
    }
    let link = child(node, "link");
    Some(Road {
        id: id.to_owned(),
        number,
        length_m,
        junction: Some(text(node, "junction"))
            .filter(|j| !j.is_empty() && *j != "-1")
            .map(str::to_owned),
        left_hand_traffic: text(node, "rule") == "LHT",
        predecessor: link.and_then(|l| road_link(child(l, "predecessor")?)),
        successor: link.and_then(|l| road_link(child(l, "successor")?)),
        plan,
        elevation: profile(reader, child(node, "elevationProfile"), "elevation"),
        superelevation: profile(reader, child(node, "lateralProfile"), "superelevation"),
        lateral: lateral(reader, child(node, "lateralProfile")),
        lane_offset: profile(reader, lanes, "laneOffset"),
        sections,
        speeds: type_speeds(reader, node),
    })
}

fn road_link(node: Node) -> Option<RoadLink> {
    let id = text(node, "elementId").to_owned();
    if id.is_empty() {
        return None;
    }
    Some(match text(node, "elementType") {
        "junction" => RoadLink::Junction { id },
        _ => RoadLink::Road {
            id,
            contact: contact_point(node),
        },
    })
}

fn profile(reader: &mut Reader, parent: Option<Node>, name: &'static str) -> Profile {
    let cubic = |reader: &mut Reader, n: Node| Cubic {
        s_m: reader.number(n, "s", 0.0),
        coefficients: reader.coefficients(n, ["a", "b", "c", "d"]),
    };
    Profile::new(
        parent
            .into_iter()
            .flat_map(|p| children(p, name))
            .map(|n| cubic(reader, n))
            .collect(),
    )
}

/// `<shape>` (1.5) and `<crossfall>` (up to 1.4) of a `<lateralProfile>`.
fn lateral(reader: &mut Reader, node: Option<Node>) -> Lateral {
    let Some(node) = node else {
        return Lateral::default();
    };
    let shape = |reader: &mut Reader, n: Node| ShapeRecord {
        s_m: reader.number(n, "s", 0.0),
        t_m: reader.number(n, "t", 0.0),
        coefficients: reader.coefficients(n, ["a", "b", "c", "d"]),
    };
    let shapes = children(node, "shape").map(|n| shape(reader, n)).collect();
    let mut fall = |side: &str| {
        let on_side =
            |n: &Node| text(*n, "side") == side || !matches!(text(*n, "side"), "left" | "right");
        let cubic = |reader: &mut Reader, n: Node| Cubic {
            s_m: reader.number(n, "s", 0.0),
            coefficients: reader.coefficients(n, ["a", "b", "c", "d"]),
        };
        Profile::new(
            children(node, "crossfall")
                .filter(on_side)
                .map(|n| cubic(reader, n))
                .collect(),
        )
    };
    let crossfall = [fall("right"), fall("left")];
    Lateral::new(shapes, crossfall)
}

fn type_speeds(reader: &mut Reader, node: Node) -> Vec<(f64, Option<f64>)> {
    let mut speeds: Vec<_> = children(node, "type")
        .filter_map(|kind| {
            Some((
                reader.number(kind, "s", 0.0),
                speed_mps(child(kind, "speed")?)?,
            ))
        })
        .collect();
    speeds.sort_by(|a, b| a.0.total_cmp(&b.0));
    speeds
}

fn plan_view(reader: &mut Reader, node: Node) -> Vec<Geometry> {
    let mut plan: Vec<Geometry> = child(node, "planView")
        .into_iter()
        .flat_map(|p| children(p, "geometry"))
        .filter_map(|g| geometry(reader, g))
        .collect();
    plan.sort_by(|a, b| a.s_m.total_cmp(&b.s_m));
    plan
}

fn geometry(reader: &mut Reader, node: Node) -> Option<Geometry> {
    let s_m = reader.number(node, "s", 0.0);
    let length_m = reader.number(node, "length", 0.0);
    if !(1e-9..=MAX_ROAD_M).contains(&length_m) || !(0.0..=MAX_ROAD_M).contains(&s_m) {
        if length_m != 0.0 {
            reader.error(
                node,
                format!("a geometry at s = {s_m} m is {length_m} m long; it is left out"),
            );
        }
        return None;
    }
    let mut at = |name| reader.number(node, name, 0.0);
    let (x_m, y_m, heading_rad) = (at("x"), at("y"), at("hdg"));
    let shape = shape(reader, node, length_m);
    Some(Geometry {
        s_m,
        x_m,
        y_m,
        heading_rad,
        length_m,
        shape,
    })
}

fn shape(reader: &mut Reader, node: Node, length_m: f64) -> Shape {
    const LINE: Shape = Shape::Arc {
        curvature_per_m: 0.0,
    };
    let Some(kind) = node
        .children()
        .find(|c| matches!(tag(*c), "line" | "arc" | "spiral" | "poly3" | "paramPoly3"))
    else {
        reader.error(
            node,
            "a geometry is none of line, arc, spiral, poly3 and paramPoly3; it is read as a line",
        );
        return LINE;
    };
    let curve = match tag(kind) {
        "arc" => {
            return Shape::Arc {
                curvature_per_m: reader.number(kind, "curvature", 0.0),
            };
        }
        "spiral" => {
            let start_per_m = reader.number(kind, "curvStart", 0.0);
            let end = reader.number(kind, "curvEnd", 0.0);
            return Shape::Spiral(Spiral::new(start_per_m, end, length_m));
        }
        "poly3" => ParamCurve::cubic(reader.coefficients(kind, ["a", "b", "c", "d"]), length_m),
        "paramPoly3" => {
            let u = reader.coefficients(kind, ["aU", "bU", "cU", "dU"]);
            let v = reader.coefficients(kind, ["aV", "bV", "cV", "dV"]);
            let by_length = text(kind, "pRange").eq_ignore_ascii_case("arcLength");
            ParamCurve::new(u, v, if by_length { length_m } else { 1.0 }, length_m)
        }
        _ => return LINE,
    };
    curve.map(Shape::Param).unwrap_or_else(|| {
        reader.error(
            kind,
            format!("this <{}> has no length; it is read as a line", tag(kind)),
        );
        LINE
    })
}
