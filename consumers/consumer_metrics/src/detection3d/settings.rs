//! What is scored, and how.

use std::collections::BTreeMap;

/// Distances at which centres match, metres.
pub const DISTANCES_M: [f64; 4] = [0.5, 1.0, 2.0, 4.0];

/// What of a box's heading can be told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Heading {
    /// Front and back differ.
    #[default]
    Full,
    /// Front and back are alike, as of a barrier: headings half a turn apart are equal.
    HalfTurn,
    /// It has none, as a traffic cone.
    None,
}

/// How a class is scored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassRule {
    /// Truths and detections count below this distance from the vehicle, metres; `None`: all.
    pub range_m: Option<f64>,
    /// What of its heading can be told.
    pub heading: Heading,
    /// Whether it has a velocity.
    pub velocity: bool,
    /// Whether it has attributes.
    pub attribute: bool,
}

impl Default for ClassRule {
    /// Any distance, a full heading, velocity and attributes.
    fn default() -> Self {
        ClassRule {
            range_m: None,
            heading: Heading::Full,
            velocity: true,
            attribute: true,
        }
    }
}

/// What is scored.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// Classes that count and their rules; empty: all classes, with the default rule.
    pub classes: BTreeMap<u32, ClassRule>,
    /// Whether a class of `classes` without truths counts with precision 0 and errors 1, as
    /// nuScenes has it, instead of being left out.
    pub count_absent: bool,
}

impl Settings {
    pub(super) fn rule(&self, class: u32) -> Option<ClassRule> {
        if self.classes.is_empty() {
            return Some(ClassRule::default());
        }
        self.classes.get(&class).copied()
    }
}
