//! The lane graph: which lane leads to which.
//!
//! Every contact of two lane ends is visited once; the driving directions decide in which direction
//! traffic passes it, if in any.

use std::collections::HashMap;

use crate::lane::{Lane, LaneKey};
use crate::raw::{End, RawLane, RawMap, Road, RoadLink};

/// Lanes of the map by rising key, without links.
pub(crate) fn lanes(map: &RawMap) -> Vec<Lane> {
    let numbers = map.junction_numbers();
    let mut lanes = Vec::new();
    for (road_idx, road) in map.roads.iter().enumerate() {
        let junction = road.junction_number(&numbers);
        for (section_idx, section) in road.sections.iter().enumerate() {
            for raw in section.left.iter().chain(&section.right) {
                lanes.push(Lane {
                    key: LaneKey {
                        road: road.number,
                        section: section_idx as u16,
                        lane: raw.id,
                    },
                    kind: raw.kind,
                    length_m: section.end_m - section.start_m,
                    junction,
                    forward: (raw.id < 0) != (road.left_hand_traffic != raw.reversed),
                    section_start_m: section.start_m,
                    left: None,
                    right: None,
                    successors: Vec::new(),
                    predecessors: Vec::new(),
                    road_idx: road_idx as u32,
                });
            }
        }
    }
    lanes.sort_by_key(|lane| lane.key);
    lanes
}

/// Index of a lane in the sorted list.
pub(crate) fn find(lanes: &[Lane], key: LaneKey) -> Option<usize> {
    lanes.binary_search_by_key(&key, |lane| lane.key).ok()
}

/// Links lanes with each other and with their neighbours.
pub(crate) fn link(map: &RawMap, lanes: &mut [Lane]) {
    neighbours(lanes);
    let mut linker = Linker {
        roads: map.roads.iter().map(|r| (r.id.as_str(), r)).collect(),
        lanes,
    };
    for road in &map.roads {
        linker.within(road);
        linker.road_ends(road);
    }
    linker.junctions(map);
    for lane in lanes {
        for list in [&mut lane.successors, &mut lane.predecessors] {
            list.sort();
            list.dedup();
        }
    }
}

fn neighbours(lanes: &mut [Lane]) {
    for idx in 0..lanes.len() {
        let Lane { key, forward, .. } = lanes[idx];
        let side = |step: i8| {
            let id = key
                .lane
                .checked_add(step)
                .filter(|id| id.signum() == key.lane.signum())?;
            let other = find(lanes, LaneKey { lane: id, ..key })?;
            (lanes[other].forward == forward).then_some(lanes[other].key)
        };
        // Ids rise to the left of the road's s.
        let (greater, smaller) = (side(1), side(-1));
        (lanes[idx].left, lanes[idx].right) = if forward {
            (greater, smaller)
        } else {
            (smaller, greater)
        };
    }
}

struct Linker<'m, 'l> {
    roads: HashMap<&'m str, &'m Road>,
    lanes: &'l mut [Lane],
}

impl<'m> Linker<'m, '_> {
    /// Links two lane ends that touch: traffic passes from the lane that ends there, in driving
    /// direction, to the one that begins there.
    fn touch(&mut self, a: LaneKey, a_end: End, b: LaneKey, b_end: End) {
        let (Some(a_idx), Some(b_idx)) = (find(self.lanes, a), find(self.lanes, b)) else {
            return;
        };
        let leaves = |lane: &Lane, end: End| lane.forward == (end == End::Finish);
        match (
            leaves(&self.lanes[a_idx], a_end),
            leaves(&self.lanes[b_idx], b_end),
        ) {
            (true, false) => self.edge(a_idx, b_idx),
            (false, true) => self.edge(b_idx, a_idx),
            _ => {}
        }
    }

    fn edge(&mut self, from: usize, to: usize) {
        let (from_key, to_key) = (self.lanes[from].key, self.lanes[to].key);
        self.lanes[from].successors.push(to_key);
        self.lanes[to].predecessors.push(from_key);
    }

    /// Links between the sections of one road.
    fn within(&mut self, road: &Road) {
        for (idx, pair) in road.sections.windows(2).enumerate() {
            let key = |section: usize, lane: i8| LaneKey {
                road: road.number,
                section: section as u16,
                lane,
            };
            for lane in pair[0].left.iter().chain(&pair[0].right) {
                for to in &lane.successors {
                    self.touch(
                        key(idx, lane.id),
                        End::Finish,
                        key(idx + 1, *to),
                        End::Start,
                    );
                }
            }
            for lane in pair[1].left.iter().chain(&pair[1].right) {
                for from in &lane.predecessors {
                    self.touch(
                        key(idx, *from),
                        End::Finish,
                        key(idx + 1, lane.id),
                        End::Start,
                    );
                }
            }
        }
    }

    /// Links from this road's ends to other roads.
    fn road_ends(&mut self, road: &Road) {
        for (end, link) in [
            (End::Start, &road.predecessor),
            (End::Finish, &road.successor),
        ] {
            let Some(RoadLink::Road { id, contact }) = link else {
                continue;
            };
            let Some(other) = self.roads.get(id.as_str()).copied() else {
                continue;
            };
            let Some(contact) = contact.or_else(|| linked_end(other, &road.id)) else {
                continue;
            };
            for lane in lanes_at(road, end) {
                for to in if end == End::Start {
                    &lane.predecessors
                } else {
                    &lane.successors
                } {
                    self.touch(
                        end_key(road, end, lane.id),
                        end,
                        end_key(other, contact, *to),
                        contact,
                    );
                }
            }
        }
    }

    fn junctions(&mut self, map: &RawMap) {
        for junction in &map.junctions {
            for connection in &junction.connections {
                let (Some(incoming), Some(connecting)) = (
                    self.roads.get(connection.incoming.as_str()).copied(),
                    self.roads.get(connection.connecting.as_str()).copied(),
                ) else {
                    continue;
                };
                let Some(end) =
                    incoming_end(incoming, connecting, connection.contact, &junction.id)
                else {
                    continue;
                };
                for (from, to) in &connection.lane_links {
                    let to = end_key(connecting, connection.contact, *to);
                    self.touch(end_key(incoming, end, *from), end, to, connection.contact);
                }
            }
        }
    }
}

fn lanes_at(road: &Road, end: End) -> impl Iterator<Item = &RawLane> {
    let section = if end == End::Start {
        road.sections.first()
    } else {
        road.sections.last()
    };
    section
        .into_iter()
        .flat_map(|s| s.left.iter().chain(&s.right))
}

fn end_key(road: &Road, end: End, lane: i8) -> LaneKey {
    let section = if end == End::Start {
        0
    } else {
        road.sections.len() - 1
    };
    LaneKey {
        road: road.number,
        section: section as u16,
        lane,
    }
}

/// The end of `road` whose link names the road `id`, if exactly one does.
fn linked_end(road: &Road, id: &str) -> Option<End> {
    let names = |link: &Option<RoadLink>| matches!(link, Some(RoadLink::Road { id: other, .. }) if other == id);
    match (names(&road.predecessor), names(&road.successor)) {
        (true, false) => Some(End::Start),
        (false, true) => Some(End::Finish),
        _ => None,
    }
}

/// The end of the incoming road that meets the `contact` end of `connecting`: the one that the
/// connecting road names, or else the one that leads into the junction.
fn incoming_end(incoming: &Road, connecting: &Road, contact: End, junction: &str) -> Option<End> {
    let back = if contact == End::Start {
        &connecting.predecessor
    } else {
        &connecting.successor
    };
    if let Some(RoadLink::Road {
        id,
        contact: Some(end),
    }) = back
        && *id == incoming.id
    {
        return Some(*end);
    }
    let is_here =
        |link: &Option<RoadLink>| matches!(link, Some(RoadLink::Junction { id }) if id == junction);
    match (is_here(&incoming.predecessor), is_here(&incoming.successor)) {
        (true, false) => Some(End::Start),
        (false, true) => Some(End::Finish),
        _ => None,
    }
}

/// Number of the junction a road's end leads into.
pub(crate) fn junction_at(map: &RawMap, road: &Road, end: End) -> Option<u32> {
    let link = if end == End::Start {
        &road.predecessor
    } else {
        &road.successor
    };
    let Some(RoadLink::Junction { id }) = link else {
        return None;
    };
    map.junctions.iter().find(|j| j.id == *id).map(|j| j.number)
}
