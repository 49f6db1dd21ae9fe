//! Lane sections: lanes with widths, links, speeds and marks.

use roxmltree::Node;

use super::values::{lane_id, speed_mps};
use super::xml::{Reader, child, children, text};
use crate::lane::LaneKind;
use crate::lateral::LaneHeight;
use crate::marks::{MarkColour, MarkKind, MarkRecord, MarkStripe};
use crate::profile::{Cubic, Profile};
use crate::raw::{Extent, RawLane, Section};

/// Most sections of a road (a section's number is a `u16`).
const MAX_SECTIONS: usize = u16::MAX as usize;

/// Greatest height of a lane over its road, metres.
const MAX_LANE_HEIGHT_M: f64 = 10.0;
/// Most lines of one mark.
const MAX_LINES: usize = 16;
/// Widest line and greatest distance from its lane's edge, metres.
const MAX_MARK_M: f64 = 10.0;
/// Shortest dash, metres.
const MIN_DASH_M: f64 = 0.05;

/// Sections by rising start; stretches under a tenth of a millimetre are left out.
pub(super) fn sections(reader: &mut Reader, lanes: Node, road_length_m: f64) -> Vec<Section> {
    let mut list: Vec<(f64, Node)> = children(lanes, "laneSection")
        .map(|n| (reader.number(n, "s", 0.0), n))
        .collect();
    list.retain(|(s, node)| {
        let inside = (0.0..road_length_m).contains(s);
        if !inside {
            reader.error(
                *node,
                format!("a lane section begins at {s} m, which is not on its road; it is left out"),
            );
        }
        inside
    });
    list.sort_by(|a, b| a.0.total_cmp(&b.0));
    list.truncate(MAX_SECTIONS);
    let starts: Vec<f64> = list
        .iter()
        .map(|(s, _)| *s)
        .chain([road_length_m])
        .collect();
    let mut sections = Vec::with_capacity(list.len());
    for (idx, (_, node)) in list.iter().enumerate() {
        // The first section always reaches back to the road's start.
        let start_m = if sections.is_empty() {
            0.0
        } else {
            starts[idx]
        };
        if starts[idx + 1] - start_m > 1e-4 {
            sections.push(section(reader, *node, start_m, starts[idx + 1]));
        }
    }
    sections
}

fn section(reader: &mut Reader, node: Node, start_m: f64, end_m: f64) -> Section {
    let mut side = |name: &'static str, sign: i8| {
        let mut lanes: Vec<RawLane> = child(node, name)
            .into_iter()
            .flat_map(|s| children(s, "lane"))
            .filter_map(|l| lane(reader, l, sign))
            .collect();
        lanes.sort_by_key(|lane| lane.id.abs());
        lanes.dedup_by_key(|lane| lane.id);
        lanes
    };
    let (left, right) = (side("left", 1), side("right", -1));
    let centre = child(node, "center").and_then(|c| child(c, "lane"));
    let centre_marks = centre.map(|c| marks(reader, c)).unwrap_or_default();
    Section {
        start_m,
        end_m,
        left,
        right,
        centre_marks,
    }
}

fn lane(reader: &mut Reader, node: Node, sign: i8) -> Option<RawLane> {
    let Some(id) = lane_id(node, "id").filter(|id| id.signum() == sign) else {
        let shown: String = text(node, "id").chars().take(20).collect();
        reader.error(
            node,
            format!(
                "a lane has the id \"{shown}\", which does not belong on this side; it is left out"
            ),
        );
        return None;
    };
    let link = child(node, "link");
    let linked = |name| {
        link.into_iter()
            .flat_map(|l| children(l, name))
            .filter_map(|n| lane_id(n, "id"))
            .take(16)
            .collect::<Vec<_>>()
    };
    let mut speeds: Vec<_> = children(node, "speed")
        .filter_map(|s| Some((reader.number(s, "sOffset", 0.0), speed_mps(s)?)))
        .collect();
    speeds.sort_by(|a, b| a.0.total_cmp(&b.0));
    Some(RawLane {
        id,
        kind: LaneKind::from_text(text(node, "type")),
        extent: extent(reader, node),
        reversed: text(node, "direction") == "reversed",
        predecessors: linked("predecessor"),
        successors: linked("successor"),
        speeds,
        heights: heights(reader, node),
        marks: marks(reader, node),
    })
}

fn extent(reader: &mut Reader, node: Node) -> Extent {
    let mut records = |name: &'static str| {
        let cubic = |reader: &mut Reader, n: Node| Cubic {
            s_m: reader.number(n, "sOffset", 0.0),
            coefficients: reader.coefficients(n, ["a", "b", "c", "d"]),
        };
        Profile::new(children(node, name).map(|n| cubic(reader, n)).collect())
    };
    let width = records("width");
    if !width.is_empty() {
        return Extent::Width(width);
    }
    let border = records("border");
    if border.is_empty() {
        Extent::Width(border)
    } else {
        Extent::Border(border)
    }
}

fn heights(reader: &mut Reader, node: Node) -> Vec<LaneHeight> {
    let height = |reader: &mut Reader, n: Node| LaneHeight {
        s_offset_m: reader.number(n, "sOffset", 0.0),
        inner_m: reader
            .number(n, "inner", 0.0)
            .clamp(-MAX_LANE_HEIGHT_M, MAX_LANE_HEIGHT_M),
        outer_m: reader
            .number(n, "outer", 0.0)
            .clamp(-MAX_LANE_HEIGHT_M, MAX_LANE_HEIGHT_M),
    };
    let mut heights: Vec<LaneHeight> = children(node, "height")
        .map(|n| height(reader, n))
        .collect();
    heights.sort_by(|a, b| a.s_offset_m.total_cmp(&b.s_offset_m));
    heights
}

fn marks(reader: &mut Reader, node: Node) -> Vec<MarkRecord> {
    let mut marks: Vec<MarkRecord> = children(node, "roadMark")
        .map(|n| mark(reader, n))
        .collect();
    marks.sort_by(|a, b| a.s_offset_m.total_cmp(&b.s_offset_m));
    marks
}

fn mark(reader: &mut Reader, node: Node) -> MarkRecord {
    let kind = MarkKind::from_text(text(node, "type"));
    let (to_greater, to_smaller) = match text(node, "laneChange") {
        "increase" => (true, false),
        "decrease" => (false, true),
        "both" => (true, true),
        "none" => (false, false),
        // Not stated: broken lines may be crossed, continuous ones not.
        _ => {
            let free = matches!(
                kind,
                MarkKind::Broken | MarkKind::BrokenBroken | MarkKind::None | MarkKind::BottsDots
            );
            (free, free)
        }
    };
    MarkRecord {
        s_offset_m: reader.number(node, "sOffset", 0.0),
        kind,
        colour: MarkColour::from_text(text(node, "color")),
        width_m: reader.number(node, "width", 0.12).clamp(0.0, 10.0),
        lines: lines(reader, node),
        to_greater,
        to_smaller,
    }
}

/// The lines of a mark's own `<type>`.
fn lines(reader: &mut Reader, mark: Node) -> Vec<MarkStripe> {
    let Some(kind) = child(mark, "type") else {
        return Vec::new();
    };
    let line = |reader: &mut Reader, n: Node| {
        let mut at = |name| reader.number(n, name, 0.0);
        let (length_m, space_m, s_offset_m, t_offset_m) =
            (at("length"), at("space"), at("sOffset"), at("tOffset"));
        let width_m = reader
            .optional_number(n, "width")
            .or_else(|| reader.optional_number(kind, "width"))
            .unwrap_or(0.12);
        let broken = length_m > 0.0 && space_m > 0.0;
        MarkStripe {
            length_m: if broken {
                length_m.max(MIN_DASH_M)
            } else {
                0.0
            },
            space_m: if broken { space_m } else { 0.0 },
            s_offset_m: s_offset_m.max(0.0),
            t_offset_m: t_offset_m.clamp(-MAX_MARK_M, MAX_MARK_M),
            width_m: width_m.clamp(0.01, MAX_MARK_M),
            colour: MarkColour::from_text(if n.has_attribute("color") {
                text(n, "color")
            } else {
                text(mark, "color")
            }),
        }
    };
    children(kind, "line")
        .take(MAX_LINES)
        .map(|n| line(reader, n))
        .collect()
}
