//! Reading an OpenDRIVE text into records. What cannot be used is left out with a warning.

mod lane;
mod links;
mod object;
mod road;
mod signal;
mod values;
mod vocabulary;
pub(crate) mod xml;

use std::collections::{HashMap, HashSet};

use roxmltree::Node;

use crate::error::MapError;
use crate::raw::{Connection, End, Junction, JunctionKind, RawController, RawMap};
use values::{contact_point, lane_id};
use xml::{Reader, child, children, text};

/// Total length of all reference lines that is read, metres.
const MAX_TOTAL_LENGTH_M: f64 = 5.0e6;

/// Reads the text.
pub(crate) fn parse(source: &str) -> Result<RawMap, MapError> {
    let doc = xml::document(source)?;
    let root = doc.root_element();
    if xml::tag(root) != "OpenDRIVE" {
        return Err(MapError::NotOpenDrive(
            xml::tag(root).chars().take(60).collect(),
        ));
    }
    let mut reader = Reader::new(&doc);
    let header = child(root, "header");
    reader.by_road_runner = header.is_some_and(is_by_road_runner);
    let mut map = RawMap {
        name: header.map_or("", |h| text(h, "name")).to_owned(),
        revision: header.and_then(|header| revision(&mut reader, header)),
        geo_reference: header
            .and_then(|h| child(h, "geoReference"))
            .and_then(|node| geo_reference(&mut reader, node)),
        roads: Vec::new(),
        junctions: Vec::new(),
        signals: Vec::new(),
        references: Vec::new(),
        controllers: children(root, "controller").map(controller).collect(),
        crosswalks: Vec::new(),
        objects: Vec::new(),
        n_object_corners: 0,
        warnings: Vec::new(),
    };
    read_roads(&mut reader, root, &mut map)?;
    read_junctions(&mut reader, root, &mut map);
    links::check(&mut reader, root, &map);
    vocabulary::check(&mut reader, root);
    map.warnings = reader.into_warnings();
    Ok(map)
}

/// Whether a header says that RoadRunner wrote the file.
fn is_by_road_runner(header: Node) -> bool {
    text(header, "vendor") == "VectorZero"
        || child(header, "userData")
            .and_then(|data| child(data, "vectorScene"))
            .is_some_and(|scene| text(scene, "program") == "RoadRunner")
}

/// Revision of the format that the file states.
fn revision(reader: &mut Reader, header: Node) -> Option<(u32, u32)> {
    let revision = (
        text(header, "revMajor").parse().ok()?,
        text(header, "revMinor").parse().ok()?,
    );
    if !(1..=8).contains(&revision.1) || revision.0 != 1 {
        reader.warn(
            header,
            format!(
                "the file says it is OpenDRIVE {}.{}; 1.1 to 1.8 are known",
                revision.0, revision.1
            ),
        );
    }
    Some(revision)
}

fn read_roads(reader: &mut Reader, root: Node, map: &mut RawMap) -> Result<(), MapError> {
    let mut numbers = Numbers::new(children(root, "road").map(|node| text(node, "id")));
    let mut seen = HashSet::new();
    let mut total_m = 0.0;
    for node in children(root, "road") {
        let id = text(node, "id");
        if !seen.insert(id) {
            reader.error(
                node,
                format!("a second road has the id \"{id}\"; it is left out"),
            );
            continue;
        }
        let Some(road) = road::read(reader, node, numbers.of(id)) else {
            continue;
        };
        total_m += road.length_m;
        if total_m > MAX_TOTAL_LENGTH_M {
            return Err(MapError::TooLarge(format!(
                "the roads are longer than {} km altogether",
                MAX_TOTAL_LENGTH_M / 1000.0
            )));
        }
        let idx = map.roads.len();
        signal::read(reader, node, idx, road.length_m, map);
        object::read(reader, node, idx, road.length_m, map);
        map.roads.push(road);
    }
    if map.roads.is_empty() {
        Err(MapError::Empty)
    } else {
        Ok(())
    }
}

fn read_junctions(reader: &mut Reader, root: Node, map: &mut RawMap) {
    let mut numbers = Numbers::new(children(root, "junction").map(|node| text(node, "id")));
    let mut seen = HashSet::new();
    for node in children(root, "junction") {
        let id = text(node, "id");
        if !seen.insert(id) {
            reader.error(
                node,
                format!("a second junction has the id \"{id}\"; it is left out"),
            );
            continue;
        }
        map.junctions.push(Junction {
            id: id.to_owned(),
            number: numbers.of(id),
            kind: junction_kind(reader, node),
            connections: children(node, "connection")
                .filter_map(|c| connection(reader, c))
                .collect(),
            controllers: children(node, "controller")
                .map(|c| {
                    (
                        text(c, "id").to_owned(),
                        text(c, "sequence").parse().unwrap_or(u32::MAX),
                    )
                })
                .collect(),
        });
    }
}

fn junction_kind(reader: &mut Reader, node: Node) -> JunctionKind {
    match text(node, "type") {
        "direct" => JunctionKind::Direct,
        "virtual" => {
            let id = text(node, "id");
            reader.warn(
                node,
                format!("junction \"{id}\" is virtual: its main road goes on, and ways that branch off within it are not linked"),
            );
            JunctionKind::Virtual
        }
        "crossing" => JunctionKind::Crossing,
        _ => JunctionKind::Common,
    }
}

fn connection(reader: &mut Reader, node: Node) -> Option<Connection> {
    let incoming = text(node, "incomingRoad");
    let connecting = Some(text(node, "connectingRoad"))
        .filter(|id| !id.is_empty())
        .unwrap_or_else(|| text(node, "linkedRoad"));
    if incoming.is_empty() || connecting.is_empty() {
        reader.error(
            node,
            "a <connection> names no incoming or no connecting road; it is left out",
        );
        return None;
    }
    let lane_links = children(node, "laneLink")
        .filter_map(|link| lane_id(link, "from").zip(lane_id(link, "to")))
        .collect();
    let contact = contact_point(node).unwrap_or(End::Start);
    Some(Connection {
        incoming: incoming.to_owned(),
        connecting: connecting.to_owned(),
        contact,
        lane_links,
    })
}

fn controller(node: Node) -> RawController {
    RawController {
        id: text(node, "id").to_owned(),
        name: text(node, "name").to_owned(),
        signals: children(node, "control")
            .map(|c| text(c, "signalId").to_owned())
            .collect(),
    }
}

/// Latitude and longitude of the origin in a PROJ string, degrees.
fn geo_reference(reader: &mut Reader, node: Node) -> Option<(f64, f64)> {
    let text: String = node.children().filter_map(|c| c.text()).collect();
    let value = |key: &str| {
        let word = text
            .split_whitespace()
            .find_map(|word| word.strip_prefix(key)?.strip_prefix('='))?;
        word.parse::<f64>().ok().filter(|x| x.is_finite())
    };
    match (value("+lat_0"), value("+lon_0")) {
        (Some(lat), Some(lon)) if lat.abs() <= 90.0 && lon.abs() <= 360.0 => Some((lat, lon)),
        _ => {
            reader.warn(node, "<geoReference> has no usable +lat_0 and +lon_0; latitude 42° and longitude 2° are taken");
            None
        }
    }
}

/// Numbers for ids: the id itself if it is a number, or else a number above all such ids.
struct Numbers {
    next: u32,
    given: HashMap<String, u32>,
}

impl Numbers {
    fn new<'a>(ids: impl Iterator<Item = &'a str>) -> Self {
        let largest = ids.filter_map(plain_number).max();
        Numbers {
            next: largest.map_or(0, |n| n.saturating_add(1)),
            given: HashMap::new(),
        }
    }

    fn of(&mut self, id: &str) -> u32 {
        if let Some(number) = plain_number(id) {
            return number;
        }
        *self.given.entry(id.to_owned()).or_insert_with(|| {
            let number = self.next;
            self.next = self.next.saturating_add(1);
            number
        })
    }
}

/// The number that an id spells, if it is spelt canonically and leaves room for numbers above it.
fn plain_number(id: &str) -> Option<u32> {
    id.parse::<u32>()
        .ok()
        .filter(|n| *n < 1 << 31 && n.to_string() == id)
}
