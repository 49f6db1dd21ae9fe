//! Right of way: which arms of a junction wait, and the lights and signs that say so.

use std::f64::consts::PI;

use super::model::{Arm, Control, Junction, Network, STOP_M, Signal, SignalKind, Stage};
use crate::geometry::wrap;
use crate::plan::Plan;

/// Decides which arms wait, and at what. An arm on which no traffic arrives does not wait.
pub(super) fn control(junction: Junction, plan: &Plan) -> Junction {
    let mut junction = rules(junction, plan);
    for arm in &mut junction.arms {
        arm.waits &= !(plan.streets[arm.road].profile.one_way && arm.at_start);
    }
    junction
}

/// Ramps give way to the motorway unless they get a lane of their own. Traffic lights stand where
/// four arms or a main road meet, and at every junction of a dense centre. Elsewhere the stem of
/// the T waits.
fn rules(mut junction: Junction, plan: &Plan) -> Junction {
    let arms = &mut junction.arms;
    let motorway = |arm: &&Arm| plan.streets[arm.road].profile.motorway;
    if arms.iter().filter(motorway).count() == 2 && arms.len() <= 3 {
        let lanes = |leaving: bool| {
            arms.iter()
                .filter(motorway)
                .find(|arm| arm.at_start == leaving)
                .map(|arm| plan.streets[arm.road].profile.n_lanes)
        };
        let merges = lanes(true) <= lanes(false);
        arms.iter_mut()
            .for_each(|arm| arm.waits = merges && !plan.streets[arm.road].profile.motorway);
        junction.control = Control::Yield;
        return junction;
    }
    if arms.len() > 3
        || plan.all_lights
        || arms.iter().any(|arm| plan.streets[arm.road].profile.main)
    {
        return junction;
    }
    let straightness = |i: usize| {
        let (a, b) = (arms[(i + 1) % 3].heading_rad, arms[(i + 2) % 3].heading_rad);
        PI - wrap(a - b).abs()
    };
    let stem = (0..3)
        .min_by(|&a, &b| straightness(a).total_cmp(&straightness(b)))
        .expect("a junction has three arms");
    for (i, arm) in arms.iter_mut().enumerate() {
        arm.waits = i == stem;
        arm.crosswalk &= i == stem;
    }
    let circle = junction
        .arms
        .iter()
        .any(|arm| plan.streets[arm.road].profile.one_way);
    junction.control = if !circle && junction.id.is_multiple_of(3) {
        Control::Stop
    } else {
        Control::Yield
    };
    junction
}

pub(super) fn place_signals(network: &mut Network, junction_idx: usize) {
    let junction = network.junctions[junction_idx].clone();
    let first = network.signals.len();
    for arm in junction.arms.iter().filter(|arm| arm.waits) {
        let side = network.roads[arm.road].profile.kerb_m() + 0.6;
        network.signals.push(Signal {
            id: 1 + network.signals.len() as u32,
            kind: match junction.control {
                Control::Lights => SignalKind::Light,
                Control::Yield => SignalKind::Yield,
                Control::Stop => SignalKind::Stop,
            },
            road: arm.road,
            against: arm.at_start,
            s_m: network.arm_station(arm, STOP_M),
            t_m: if arm.at_start { side } else { -side },
            pole_s_m: network.arm_station(arm, 4.6),
            junction: Some(junction_idx),
        });
    }
    if junction.control != Control::Lights {
        return;
    }
    // Opposite arms are green together only where four narrow arms meet. On wider roads, traffic
    // that turns left would meet two lanes of oncoming traffic, and cars that wait in the middle of
    // the junction for each other's gaps would lock it. At a T, half of an arm's traffic turns
    // left.
    let waiting: Vec<usize> = (0..junction.arms.len())
        .filter(|&i| junction.arms[i].waits)
        .collect();
    let mut done = vec![false; waiting.len()];
    for i in 0..waiting.len() {
        if done[i] {
            continue;
        }
        let arm = |k: usize| &junction.arms[waiting[k]];
        let is_narrow = |k: usize| network.roads[arm(k).road].profile.n_lanes == 1;
        let opposite = (i + 1..waiting.len()).find(|&k| {
            !done[k]
                && waiting.len() > 3
                && is_narrow(i)
                && is_narrow(k)
                && wrap(arm(k).heading_rad - arm(i).heading_rad).abs() > 2.4
        });
        let members: Vec<usize> = std::iter::once(i).chain(opposite).collect();
        members.iter().for_each(|&k| done[k] = true);
        let id = 1 + network.stages.len() as u32;
        network.stages.push(Stage {
            id,
            junction: junction_idx,
            signals: members.into_iter().map(|k| first + k).collect(),
        });
    }
}

pub(super) fn place_limits(network: &mut Network, plan: &Plan) {
    for road in 0..network.roads.len() {
        let (length, profile) = (
            network.roads[road].path.length_m(),
            network.roads[road].profile,
        );
        for against in [false, true]
            .into_iter()
            .filter(|&against| !(against && profile.one_way))
        {
            let side = profile.kerb_m() + 0.6;
            if length < plan.limits_from_m {
                continue;
            }
            let s_m = if against { length - 14.0 } else { 14.0 };
            network.signals.push(Signal {
                id: 1 + network.signals.len() as u32,
                kind: SignalKind::Limit(profile.speed_kmh),
                road,
                against,
                s_m,
                t_m: if against { side } else { -side },
                pole_s_m: s_m,
                junction: None,
            });
        }
    }
}
