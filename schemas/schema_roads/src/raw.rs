//! What an OpenDRIVE text says, before links are resolved.

use std::collections::HashMap;

use crate::curve::Geometry;
use crate::error::Warning;
use crate::lane::LaneKind;
use crate::lateral::{LaneHeight, Lateral};
use crate::marks::MarkRecord;
use crate::profile::Profile;

/// An end of a road or section.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum End {
    Start,
    Finish,
}

/// What a road's end is joined to.
#[derive(Clone, Debug)]
pub(crate) enum RoadLink {
    Road { id: String, contact: Option<End> },
    Junction { id: String },
}

/// Extent of a lane across the road.
#[derive(Clone, Debug)]
pub(crate) enum Extent {
    Width(Profile),
    /// Absolute lateral position of the outer edge before the lane offset.
    Border(Profile),
}

/// One lane of one section.
#[derive(Clone, Debug)]
pub(crate) struct RawLane {
    pub id: i8,
    pub kind: LaneKind,
    pub extent: Extent,
    /// Whether traffic is reversed (`direction="reversed"` of OpenDRIVE 1.8).
    pub reversed: bool,
    pub predecessors: Vec<i8>,
    pub successors: Vec<i8>,
    /// Speed limits: (sOffset, m/s or no limit).
    pub speeds: Vec<(f64, Option<f64>)>,
    /// Height over the road, by rising sOffset.
    pub heights: Vec<LaneHeight>,
    /// Marks on the outer edge, by rising sOffset.
    pub marks: Vec<MarkRecord>,
}

/// A lane section.
#[derive(Clone, Debug)]
pub(crate) struct Section {
    pub start_m: f64,
    pub end_m: f64,
    /// Lanes 1, 2, … outwards.
    pub left: Vec<RawLane>,
    /// Lanes −1, −2, … outwards.
    pub right: Vec<RawLane>,
    pub centre_marks: Vec<MarkRecord>,
}

/// A road.
#[derive(Clone, Debug)]
pub(crate) struct Road {
    pub id: String,
    pub number: u32,
    pub length_m: f64,
    pub junction: Option<String>,
    pub left_hand_traffic: bool,
    pub predecessor: Option<RoadLink>,
    pub successor: Option<RoadLink>,
    pub plan: Vec<Geometry>,
    pub elevation: Profile,
    pub superelevation: Profile,
    pub lateral: Lateral,
    pub lane_offset: Profile,
    pub sections: Vec<Section>,
    /// Speed limits by road type: (s, m/s or no limit).
    pub speeds: Vec<(f64, Option<f64>)>,
}

/// A connection in a junction.
#[derive(Clone, Debug)]
pub(crate) struct Connection {
    pub incoming: String,
    pub connecting: String,
    pub contact: End,
    pub lane_links: Vec<(i8, i8)>,
}

/// How the roads of a junction meet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum JunctionKind {
    /// By connecting roads.
    #[default]
    Common,
    /// Lane to lane, without connecting roads.
    Direct,
    /// On a main road that continues through it.
    Virtual,
    /// Roads that cross without meeting.
    Crossing,
}

/// A junction.
#[derive(Clone, Debug)]
pub(crate) struct Junction {
    pub id: String,
    pub number: u32,
    pub kind: JunctionKind,
    pub connections: Vec<Connection>,
    /// Controller ids and their place in the junction's sequence.
    pub controllers: Vec<(String, u32)>,
}

/// One place at which a signal applies.
#[derive(Clone, Debug)]
pub(crate) struct Placement {
    pub road: usize,
    pub s_m: f64,
    pub t_m: f64,
    /// `Some(true)` for traffic along rising s, `Some(false)` against, `None` for both.
    pub along: Option<bool>,
    /// Lane ranges; empty means every lane of that direction.
    pub validity: Vec<(i8, i8)>,
}

/// A signal.
#[derive(Clone, Debug)]
pub(crate) struct RawSignal {
    pub id: String,
    pub name: String,
    pub dynamic: bool,
    pub kind: String,
    pub subtype: String,
    pub country: String,
    pub value: Option<f64>,
    pub unit: String,
    pub text: String,
    pub z_offset_m: f64,
    pub heading_offset_rad: f64,
    pub width_m: f64,
    pub height_m: f64,
    pub placement: Placement,
}

/// A controller.
#[derive(Clone, Debug)]
pub(crate) struct RawController {
    pub id: String,
    pub name: String,
    pub signals: Vec<String>,
}

/// Corner of an object's outline.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Corner {
    Road {
        s_m: f64,
        t_m: f64,
        dz_m: f64,
        height_m: f64,
    },
    Local {
        u_m: f64,
        v_m: f64,
        z_m: f64,
        height_m: f64,
    },
}

/// A crosswalk object.
#[derive(Clone, Debug)]
pub(crate) struct RawCrosswalk {
    pub id: String,
    pub road: usize,
    pub s_m: f64,
    pub t_m: f64,
    pub z_offset_m: f64,
    pub heading_rad: f64,
    pub corners: Vec<Corner>,
}

/// Any other object.
#[derive(Clone, Debug)]
pub(crate) struct RawObject {
    pub id: String,
    pub name: String,
    pub kind: String,
    pub road: usize,
    pub s_m: f64,
    pub t_m: f64,
    pub z_offset_m: f64,
    pub heading_rad: f64,
    pub length_m: f64,
    pub width_m: f64,
    pub height_m: f64,
    pub radius_m: f64,
    pub corners: Vec<Corner>,
}

/// The whole text.
#[derive(Clone, Debug)]
pub(crate) struct RawMap {
    pub name: String,
    pub revision: Option<(u32, u32)>,
    pub geo_reference: Option<(f64, f64)>,
    pub roads: Vec<Road>,
    pub junctions: Vec<Junction>,
    pub signals: Vec<RawSignal>,
    /// Signal id and a further place at which it applies.
    pub references: Vec<(String, Placement)>,
    pub controllers: Vec<RawController>,
    pub crosswalks: Vec<RawCrosswalk>,
    pub objects: Vec<RawObject>,
    /// Number of corners of all outlines, as it is counted against the limit.
    pub n_object_corners: usize,
    pub warnings: Vec<Warning>,
}

impl Placement {
    /// Whether it applies to the lane. No ranges mean every lane.
    pub fn is_valid_for(&self, lane: i8) -> bool {
        self.validity.is_empty()
            || self
                .validity
                .iter()
                .any(|(from, to)| (*from..=*to).contains(&lane))
    }
}

impl RawMap {
    /// Numbers of the junctions by their ids.
    pub fn junction_numbers(&self) -> HashMap<&str, u32> {
        self.junctions
            .iter()
            .map(|junction| (junction.id.as_str(), junction.number))
            .collect()
    }
}

impl Road {
    /// Number of the junction that it belongs to; `u32::MAX` for a junction that the file lacks.
    pub fn junction_number(&self, numbers: &HashMap<&str, u32>) -> Option<u32> {
        self.junction
            .as_deref()
            .map(|id| numbers.get(id).copied().unwrap_or(u32::MAX))
    }
}
