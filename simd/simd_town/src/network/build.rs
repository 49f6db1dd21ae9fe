//! Lays out a plan: roads cut at junctions, lanes joined, signals placed.

use std::f64::consts::PI;

use super::elevation::Elevation;
use super::model::{Arm, CORNER_RADIUS_M, Control, Junction, Network, Road};
use super::{connect, right_of_way};
use crate::geometry::{Path, wrap};
use crate::plan::{Plan, Profile, Street};

impl Network {
    /// Lays out a plan.
    pub fn build(plan: &Plan) -> Network {
        let course = |s: &Street| {
            s.course.clone().unwrap_or_else(|| {
                Path::rounded(plan.nodes_m[s.from], &s.bends, plan.nodes_m[s.to])
            })
        };
        let whole: Vec<Path> = plan.streets.iter().map(course).collect();
        let mut trims = vec![[0.0; 2]; plan.streets.len()];
        let mut junctions = Vec::new();
        for node in 0..plan.nodes_m.len() {
            let arms = arms_of(plan, &whole, node);
            for (i, arm) in arms.iter().enumerate() {
                let next = arms[(i + 1) % arms.len()];
                let (a, b) = if arms.len() == 2 {
                    (TAPER_M, TAPER_M)
                } else {
                    corner_needs(
                        plan.streets[arm.road].profile,
                        plan.streets[next.road].profile,
                        wrap_turn(next.heading_rad - arm.heading_rad),
                    )
                };
                for (arm, need) in [(arm, a), (&next, b)] {
                    let trim = &mut trims[arm.road][usize::from(!arm.at_start)];
                    *trim = need.max(*trim);
                }
            }
            junctions.push(right_of_way::control(
                Junction {
                    id: 2001 + node as u32,
                    height_m: plan.heights_m[node],
                    arms,
                    control: Control::Lights,
                },
                plan,
            ));
        }
        let roads: Vec<Road> = plan
            .streets
            .iter()
            .zip(&whole)
            .zip(&trims)
            .enumerate()
            .map(|(i, ((street, path), trim))| {
                let (whole_m, path) = (
                    path.length_m(),
                    path.cut(trim[0], path.length_m() - trim[1]),
                );
                let (from_m, to_m) = (plan.heights_m[street.from], plan.heights_m[street.to]);
                // Rises are given as shares of the whole street; the road is what the junctions
                // leave of it.
                let share = |share: f64| (share * whole_m - trim[0]) / path.length_m();
                let rises: Vec<(f64, f64)> = street
                    .rises_m
                    .iter()
                    .map(|&(at, rise_m)| (share(at), rise_m))
                    .collect();
                let elevation = Elevation::between(path.length_m(), from_m, to_m, &rises);
                let bridge = street
                    .bridge_m
                    .map(|(from, to)| (from - trim[0], to - trim[0]));
                let ends = [street.from, street.to];
                let stations = stations(&path, &elevation, bridge);
                Road {
                    id: 1 + i as u32,
                    path,
                    elevation,
                    profile: street.profile,
                    tunnel: street.tunnel,
                    bridge,
                    ends,
                    stations,
                }
            })
            .collect();
        let mut network = Network {
            roads,
            junctions,
            links: Vec::new(),
            signals: Vec::new(),
            stages: Vec::new(),
        };
        for junction in 0..network.junctions.len() {
            let links = connect::links_of(&network, junction);
            network.links.extend(links);
            right_of_way::place_signals(&mut network, junction);
        }
        right_of_way::place_limits(&mut network, plan);
        network
    }
}

/// Stations for a road with this path, elevation and bridge.
fn stations(path: &Path, elevation: &Elevation, bridge: Option<(f64, f64)>) -> Vec<f64> {
    let mut stations = path.stations(16.0);
    for (s, step) in elevation.steps(path.length_m()) {
        stations.retain(|other| (other - s).abs() > 0.35 * step || *other == 0.0);
        stations.push(s);
    }
    stations.sort_by(f64::total_cmp);
    stations.dedup_by(|a, b| (*a - *b).abs() < 0.05);
    if let Some((from, to)) = bridge {
        stations.retain(|s| (s - from).abs() > 0.5 && (s - to).abs() > 0.5);
        stations.extend([from, to]);
        stations.sort_by(f64::total_cmp);
    }
    stations
}

fn wrap_turn(angle_rad: f64) -> f64 {
    angle_rad.rem_euclid(2.0 * PI)
}

fn arms_of(plan: &Plan, whole: &[Path], node: usize) -> Vec<Arm> {
    let mut arms = Vec::new();
    for (road, street) in plan.streets.iter().enumerate() {
        for (at_start, end) in [(true, street.from), (false, street.to)] {
            if end == node {
                let s = if at_start {
                    0.0
                } else {
                    whole[road].length_m()
                };
                let heading_rad = wrap(whole[road].at(s).1 + if at_start { 0.0 } else { PI });
                arms.push(Arm {
                    road,
                    at_start,
                    heading_rad,
                    waits: true,
                    crosswalk: !street.profile.verge,
                });
            }
        }
    }
    arms.sort_by(|a, b| a.heading_rad.total_cmp(&b.heading_rad));
    arms
}

/// How far from the node each of two neighbouring arms must end, the second `angle` to the left of
/// the first.
fn corner_needs(a: Profile, b: Profile, angle: f64) -> (f64, f64) {
    if !(SHARPEST_RAD..2.9).contains(&angle) {
        return (6.0, 6.0);
    }
    if angle < 0.6 {
        // Where a ramp leaves, the junction reaches to where the verges of both roads part.
        let along = |own: f64, other: f64| (other + own * angle.cos()) / angle.sin() + 8.0;
        return (along(a.back_m(), b.back_m()), along(b.back_m(), a.back_m()));
    }
    let tangent = CORNER_RADIUS_M / (0.5 * angle).tan();
    let along = |own: f64, other: f64| (other + own * angle.cos()) / angle.sin() + tangent;
    (along(a.kerb_m(), b.kerb_m()), along(b.kerb_m(), a.kerb_m()))
}

/// Least angle between two arms.
const SHARPEST_RAD: f64 = 0.12;

/// Half the length of a junction in which a motorway only gains or loses a lane.
const TAPER_M: f64 = 35.0;
