//! References that lead nowhere: roads, junctions and signals that a file names and does not have.

use std::collections::HashSet;

use roxmltree::Node;

use super::xml::{Reader, child, children, text};
use crate::raw::RawMap;

/// Reports every link of roads, connections and controllers whose other end is not there.
pub(super) fn check(reader: &mut Reader, root: Node, map: &RawMap) {
    let listed: HashSet<&str> = children(root, "road")
        .map(|node| text(node, "id"))
        .collect();
    let junctions: HashSet<&str> = map
        .junctions
        .iter()
        .map(|junction| junction.id.as_str())
        .collect();
    let has_road = |id: &str| listed.contains(id);
    for road in children(root, "road") {
        let Some(link) = child(road, "link") else {
            continue;
        };
        for name in ["predecessor", "successor"] {
            let Some(node) = child(link, name) else {
                continue;
            };
            let id = text(node, "elementId");
            let (kind, there) = match text(node, "elementType") {
                "junction" => ("junction", junctions.contains(id)),
                _ => ("road", has_road(id)),
            };
            if !there && !id.is_empty() {
                reader.error(
                    node,
                    format!(
                        "road \"{}\" has the {name} {kind} \"{id}\", which the file does not have",
                        text(road, "id")
                    ),
                );
            }
        }
        let junction = text(road, "junction");
        if !matches!(junction, "" | "-1") && !junctions.contains(junction) {
            reader.error(
                road,
                format!(
                    "road \"{}\" belongs to junction \"{junction}\", which the file does not have",
                    text(road, "id")
                ),
            );
        }
    }
    for junction in children(root, "junction") {
        for connection in children(junction, "connection") {
            for name in ["incomingRoad", "connectingRoad", "linkedRoad"] {
                let id = text(connection, name);
                if !id.is_empty() && !has_road(id) {
                    let of = text(junction, "id");
                    reader.error(connection, format!("junction \"{of}\" has the {name} \"{id}\", which the file does not have"));
                }
            }
        }
    }
    let signals: HashSet<&str> = map
        .signals
        .iter()
        .map(|signal| signal.id.as_str())
        .collect();
    for controller in children(root, "controller") {
        for control in children(controller, "control") {
            let id = text(control, "signalId");
            if !signals.contains(id) {
                let of = text(controller, "id");
                reader.warn(
                    control,
                    format!(
                        "controller \"{of}\" switches signal \"{id}\", which the file does not have"
                    ),
                );
            }
        }
    }
}
