//! Lines that a carriageway has inside a junction. Both the map's text and the paint are made from
//! them.

use super::model::{Link, Network};

/// A line along a connecting lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LaneLine {
    /// Without gaps: not to be crossed.
    Solid,
    /// With gaps: lanes may be changed.
    Broken,
}

/// Lines at the left and right edge of a connecting lane. Only a motorway that goes on past ramps,
/// or gains or loses a lane, has them; elsewhere nothing is painted inside a junction.
pub fn lines(network: &Network, link: &Link) -> [Option<LaneLine>; 2] {
    let junction = &network.junctions[link.junction];
    let profile = |arm: usize| &network.roads[junction.arms[arm].road].profile;
    if !(profile(link.from.0).motorway && profile(link.to.0).motorway) {
        return [None; 2];
    }
    let lanes = [link.from.1, link.to.1].map(|lane| lane.unsigned_abs() as usize);
    let left = match lanes {
        [1, 1] => Some(LaneLine::Solid),
        [from, to] if from == to => Some(LaneLine::Broken),
        _ => None,
    };
    let is_outermost = lanes == [profile(link.from.0).n_lanes, profile(link.to.0).n_lanes];
    // Beside a ramp the right edge is where cars leave and arrive.
    let right = (junction.arms.len() == 2 && is_outermost).then_some(LaneLine::Solid);
    [left, right]
}
