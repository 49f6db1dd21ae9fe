//! Which lanes lead where through a junction.

use std::f64::consts::PI;

use super::model::{Arm, Link, Network};
use crate::geometry::{Path, left, unit, wrap};

#[derive(Clone, Copy, PartialEq)]
enum Turn {
    Left,
    Straight,
    Right,
}

/// OpenDRIVE id of the lane with this index (0 is beside the middle) that enters or leaves a
/// junction on this arm.
fn lane_id(arm: &Arm, lane: usize, entering: bool) -> i32 {
    let id = lane as i32 + 1;
    if arm.at_start == entering { id } else { -id }
}

/// Number of lanes that enter (or leave) a junction on an arm.
fn n_lanes(network: &Network, arm: &Arm, entering: bool) -> usize {
    let profile = &network.roads[arm.road].profile;
    if profile.one_way && arm.at_start == entering {
        0
    } else {
        profile.n_lanes
    }
}

pub(super) fn links_of(network: &Network, junction_idx: usize) -> Vec<Link> {
    let junction = &network.junctions[junction_idx];
    // Lanes that enter the junction on an arm, and lanes that leave it there.
    let lanes = |arm: usize, entering: bool| n_lanes(network, &junction.arms[arm], entering);
    let motorway = |arm: usize| network.roads[junction.arms[arm].road].profile.motorway;
    let turn = |from: usize, to: usize| {
        let angle = wrap(junction.arms[to].heading_rad - junction.arms[from].heading_rad - PI);
        if angle.abs() < 0.6 {
            Turn::Straight
        } else if angle > 0.0 {
            Turn::Left
        } else {
            Turn::Right
        }
    };
    let mut ways: Vec<Way> = Vec::new();
    let n = junction.arms.len();
    let pairs: Vec<(usize, usize)> = (0..n)
        .flat_map(|a| (0..n).map(move |b| (a, b)))
        .filter(|&(a, b)| a != b && lanes(a, true) > 0 && lanes(b, false) > 0)
        .collect();
    for &(a, b) in &pairs {
        let (n_in, n_out) = (lanes(a, true), lanes(b, false));
        match turn(a, b) {
            Turn::Right => ways.push(Way::new(a, n_in - 1, b, n_out - 1)),
            Turn::Left => ways.push(Way::new(a, 0, b, 0)),
            // Lanes of a motorway begin and end on the right.
            Turn::Straight if motorway(a) && motorway(b) => {
                ways.extend((0..n_in.min(n_out)).map(|k| Way::new(a, k, b, k)))
            }
            Turn::Straight => ways
                .extend((0..n_in.min(n_out)).map(|k| Way::new(a, n_in - 1 - k, b, n_out - 1 - k))),
        }
    }
    // Lanes that nothing reaches or that lead nowhere are connected in the straightest way that
    // exists.
    let rank = |a: usize, b: usize| match turn(a, b) {
        Turn::Straight => 0,
        Turn::Left => 1,
        Turn::Right => 2,
    };
    for arm in 0..n {
        for lane in 0..lanes(arm, true) {
            if !ways.iter().any(|w| w.arm_in == arm && w.lane_in == lane) {
                let to = (0..n)
                    .filter(|&b| b != arm && lanes(b, false) > 0)
                    .min_by_key(|&b| rank(arm, b))
                    .expect("two arms");
                ways.push(Way::new(arm, lane, to, lane.min(lanes(to, false) - 1)));
            }
        }
        for lane in 0..lanes(arm, false) {
            if !ways.iter().any(|w| w.arm_out == arm && w.lane_out == lane) {
                let from = (0..n)
                    .filter(|&a| a != arm && lanes(a, true) > 0)
                    .min_by_key(|&a| rank(a, arm))
                    .expect("two arms");
                ways.push(Way::new(from, lane.min(lanes(from, true) - 1), arm, lane));
            }
        }
    }
    ways.sort();
    ways.dedup();
    // Ids of connecting roads follow those of the streets.
    let first_id = (network.roads.len() as u32 + 1).max(1001) + network.links.len() as u32;
    ways.iter()
        .enumerate()
        .map(|(i, &way)| link(network, junction_idx, first_id + i as u32, way))
        .collect()
}

/// A way over a junction, from a lane of one arm to a lane of another.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Way {
    arm_in: usize,
    lane_in: usize,
    arm_out: usize,
    lane_out: usize,
}

impl Way {
    fn new(arm_in: usize, lane_in: usize, arm_out: usize, lane_out: usize) -> Way {
        Way {
            arm_in,
            lane_in,
            arm_out,
            lane_out,
        }
    }
}

fn link(network: &Network, junction: usize, id: u32, way: Way) -> Link {
    let Way {
        arm_in: a,
        lane_in,
        arm_out: b,
        lane_out,
    } = way;
    let arms = &network.junctions[junction].arms;
    let profile = |arm: usize| network.roads[arms[arm].road].profile;
    // In driving direction the traffic keeps right of the reference line, so lane k's left edge is
    // k lanes to the right.
    let (p_in, out_heading) = network.arm_end(&arms[a]);
    let heading_in = wrap(out_heading + PI);
    let from = (
        p_in - left(unit(heading_in)) * profile(a).lane_left_m(lane_in),
        heading_in,
    );
    let (p_out, heading_out) = network.arm_end(&arms[b]);
    let to = (
        p_out - left(unit(heading_out)) * profile(b).lane_left_m(lane_out),
        heading_out,
    );
    Link {
        id,
        junction,
        from: (a, lane_id(&arms[a], lane_in, true)),
        to: (b, lane_id(&arms[b], lane_out, false)),
        path: Path::connect(from, to, f64::INFINITY),
        width_m: (profile(a).lane_m, profile(b).lane_m),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::plans;

    #[test]
    fn connecting_roads_meet_their_lanes() {
        for plan in (0..20).flat_map(plans) {
            let network = Network::build(&plan);
            for link in &network.links {
                let arms = &network.junctions[link.junction].arms;
                for (at, (arm, lane), entering) in [
                    (0.0, link.from, true),
                    (link.path.length_m(), link.to, false),
                ] {
                    let arm = &arms[arm];
                    let road = &network.roads[arm.road];
                    let s = if arm.at_start {
                        0.0
                    } else {
                        road.path.length_m()
                    };
                    let inner = road.profile.lane_left_m(lane.unsigned_abs() as usize - 1)
                        * f64::from(lane.signum());
                    let edge = road.path.beside(s, inner);
                    let heading = road.path.at(s).1 + if lane > 0 { PI } else { 0.0 };
                    let (p, h) = link.path.at(at);
                    assert!(
                        (p - edge).norm() < 1e-3,
                        "{} road {} entering {entering}",
                        plan.name,
                        link.id
                    );
                    assert!(
                        wrap(h - heading).abs() < 1e-3,
                        "{} road {} entering {entering}",
                        plan.name,
                        link.id
                    );
                }
                let motorway = arms
                    .iter()
                    .any(|arm| network.roads[arm.road].profile.motorway);
                let longest_m = if motorway { 140.0 } else { 60.0 };
                assert!(
                    link.path.length_m() < longest_m,
                    "{} road {} is {} m",
                    plan.name,
                    link.id,
                    link.path.length_m()
                );
                for segment in &link.path.segments {
                    assert!(
                        segment.curvature_per_m.abs() < 1.0 / 4.5,
                        "{} road {} bends too much",
                        plan.name,
                        link.id
                    );
                }
            }
        }
    }

    #[test]
    fn every_lane_end_continues() {
        for plan in plans(1) {
            let network = Network::build(&plan);
            for (j, junction) in network.junctions.iter().enumerate() {
                for (a, arm) in junction.arms.iter().enumerate() {
                    for lane in 0..network.roads[arm.road].profile.n_lanes {
                        let exists = |entering: bool| n_lanes(&network, arm, entering) > 0;
                        let ways = |entering: bool| {
                            let id = lane_id(arm, lane, entering);
                            network
                                .links
                                .iter()
                                .filter(|l| {
                                    l.junction == j
                                        && if entering {
                                            l.from == (a, id)
                                        } else {
                                            l.to == (a, id)
                                        }
                                })
                                .count()
                        };
                        assert!(
                            [true, false]
                                .into_iter()
                                .all(|entering| ways(entering) > 0 || !exists(entering)),
                            "junction {} arm {a} lane {lane}",
                            junction.id
                        );
                    }
                }
            }
        }
    }
}
