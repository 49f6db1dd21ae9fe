//! Which traffic lights take turns with each other.
//!
//! As CARLA does it: the controllers of a junction are a group and are green one after another; a
//! light belongs to the first controller that names it. A light that no controller names takes a
//! turn of its own among those of its junction (CARLA lets it change by itself there).

use std::collections::{HashMap, HashSet};

use crate::map::RoadMap;
use crate::signals::SignalKind;

/// The lights of one junction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LightGroup {
    /// The junction; `None` for lights that belong to none.
    pub junction: Option<u32>,
    /// Lights that are green together, as indices into [`RoadMap::signals`]; the turns follow each
    /// other.
    pub turns: Vec<Vec<usize>>,
}

impl RoadMap {
    /// The traffic lights in groups, by rising junction; those of no junction come first, one
    /// controller to a group.
    pub fn light_groups(&self) -> Vec<LightGroup> {
        let lights: Vec<usize> = (0..self.signals().len())
            .filter(|idx| self.signals()[*idx].kind == SignalKind::TrafficLight)
            .collect();
        let mut by_id: HashMap<&str, Vec<usize>> = HashMap::new();
        for idx in &lights {
            by_id
                .entry(self.signals()[*idx].id.as_str())
                .or_default()
                .push(*idx);
        }
        let mut taken: HashSet<usize> = HashSet::new();
        let mut turns: Vec<(Option<u32>, u32, Vec<usize>)> = Vec::new();
        for controller in self.controllers() {
            let named = controller.signals.iter();
            let mut members: Vec<usize> = named
                .filter_map(|id| by_id.get(id.as_str()))
                .flatten()
                .copied()
                .filter(|idx| taken.insert(*idx))
                .collect();
            members.sort_unstable();
            if !members.is_empty() {
                turns.push((controller.junction, controller.sequence, members));
            }
        }
        for idx in lights.into_iter().filter(|idx| !taken.contains(idx)) {
            turns.push((self.signals()[idx].junction, u32::MAX, vec![idx]));
        }
        turns.sort_by_key(|(junction, sequence, _)| (*junction, *sequence));
        let mut groups: Vec<LightGroup> = Vec::new();
        for (junction, _, lights) in turns {
            match groups.last_mut() {
                Some(last) if junction.is_some() && last.junction == junction => {
                    last.turns.push(lights);
                }
                _ => groups.push(LightGroup {
                    junction,
                    turns: vec![lights],
                }),
            }
        }
        groups
    }
}
