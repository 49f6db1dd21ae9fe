//! The picture's boxes and arrows, before they have places.

use std::collections::BTreeMap;

use schema_bus::names::about;

use crate::look::census::{Census, Kind, Member, Topic};

/// Topics that one box names; the rest is counted.
const NAMED: usize = 14;

/// Boxes and arrows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Graph {
    /// The domain.
    pub domain: String,
    /// Boxes; their order is their number.
    pub boxes: Vec<Box>,
    /// Arrows.
    pub arrows: Vec<Arrow>,
}

/// A process, or topics with the same ends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Box {
    /// What it stands for.
    pub of: Of,
    /// Lines of its text.
    pub lines: Vec<String>,
    /// Everything that it stands for, for a tooltip.
    pub all: String,
}

/// What a box stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of {
    /// A process.
    Process,
    /// Topics that somebody reads.
    Topics,
    /// Topics that nobody reads.
    Unread,
    /// Topics to the simulator.
    Controls,
}

/// From one box to another, by their numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Arrow {
    pub from: usize,
    pub to: usize,
    pub flow: Flow,
}

/// What an arrow carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Flow {
    /// Samples.
    Data,
    /// Documents, which change rarely.
    Documents,
    /// What goes to the simulator, against the flow of data.
    Control,
}

impl Graph {
    /// The graph of a domain. Unless `all`, topics of the same kind, writers and readers share a
    /// box, and the documents that describe topics of results have none.
    pub fn of(census: &Census, all: bool) -> Graph {
        let mut graph = Graph {
            domain: census.domain.clone(),
            ..Graph::default()
        };
        let mut processes: BTreeMap<&Member, usize> = BTreeMap::new();
        let ends = census
            .topics
            .iter()
            .flat_map(|topic| topic.writers.iter().chain(&topic.readers));
        let mut members: Vec<&Member> = census.processes.iter().chain(ends).collect();
        members.sort();
        members.dedup();
        for member in members {
            let pid = member.pid.map_or("?".into(), |pid| pid.to_string());
            processes.insert(member, graph.boxes.len());
            graph.boxes.push(Box {
                of: Of::Process,
                lines: vec![member.name.clone(), format!("pid {pid}")],
                all: format!("{} (pid {pid})", member.name),
            });
        }
        let descriptions: Vec<String> = census
            .topics
            .iter()
            .filter(|topic| topic.kind == Kind::Results && !all)
            .map(|topic| about(&topic.name))
            .collect();
        let shown = census
            .topics
            .iter()
            .filter(|topic| !descriptions.contains(&topic.name));
        for topics in groups(shown, all) {
            let number = graph.boxes.len();
            graph.boxes.push(Box::of_topics(&topics));
            let first = topics[0];
            let flow = match first.kind {
                Kind::Document => Flow::Documents,
                kind if kind.is_control() => Flow::Control,
                _ => Flow::Data,
            };
            for writer in &first.writers {
                let from = processes[writer];
                graph.arrows.push(Arrow {
                    from,
                    to: number,
                    flow,
                });
            }
            for reader in &first.readers {
                let to = processes[reader];
                graph.arrows.push(Arrow {
                    from: number,
                    to,
                    flow,
                });
            }
        }
        graph
    }
}

/// Topics that share a box.
fn groups<'a>(topics: impl Iterator<Item = &'a Topic>, all: bool) -> Vec<Vec<&'a Topic>> {
    let mut groups: Vec<Vec<&Topic>> = Vec::new();
    for topic in topics {
        let same = |group: &&mut Vec<&Topic>| {
            let first = group[0];
            first.kind == topic.kind
                && first.writers == topic.writers
                && first.readers == topic.readers
        };
        match groups.iter_mut().find(same).filter(|_| !all) {
            Some(group) => group.push(topic),
            None => groups.push(vec![topic]),
        }
    }
    groups
}

impl Box {
    fn of_topics(topics: &[&Topic]) -> Box {
        let first = topics[0];
        let line = |topic: &&Topic| match topic.name.ends_with(&topic.type_name) {
            true => topic.name.clone(),
            false => format!("{} · {}", topic.name, topic.type_name),
        };
        let mut lines: Vec<String> = topics.iter().take(NAMED).map(line).collect();
        if topics.len() > NAMED {
            lines.push(format!("and {} more", topics.len() - NAMED));
        }
        let of = if first.kind.is_control() {
            Of::Controls
        } else if first.readers.is_empty() {
            Of::Unread
        } else {
            Of::Topics
        };
        Box {
            of,
            lines,
            all: topics.iter().map(line).collect::<Vec<_>>().join("\n"),
        }
    }
}
