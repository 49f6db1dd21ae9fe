//! Compares how we read a map with how CARLA's client reads it.
//!
//! The client has peculiarities that do not count as differences:
//!
//! - It follows a polynomial curve by the curve's own length. Where the file states another length,
//!   it ends beside the end of the record.
//! - For the heading of a lane that widens, it takes lanes on a bend to be as long as the road's
//!   reference line.
//! - It ignores superelevation, shape and lane heights, so such heights are not compared.
//! - A lane whose road does not name its junction ends there for the client, linked to itself.
//! - Lights above a lane are moved aside by 25 cm, signs on one by some metres until they are off it.
//! - Direct junctions are newer than its reader, which misses some of their connections.

use std::collections::{BTreeMap, BTreeSet};

use schema_roads::{JunctionKind, LaneKey, LaneKind, LanePosition, RoadMap};
use serde_json::json;

use super::client::{Client, Key, View};

/// Greatest distance between two readings of a place, on level and on tilted roads, metres.
const PLACE_M: (f64, f64) = (0.01, 0.02);
/// Greatest difference of a width, metres.
const WIDTH_M: f64 = 0.01;
/// Greatest difference of a heading for all but one in a thousand places, degrees.
const HEADING_DEG: f64 = 1.0;
/// How far the client moves lights aside (0.25 m), with a margin, metres.
const LANDMARK_M: f64 = 0.27;
/// How far it moves signs that stand on a lane, at most, metres.
const MOVED_M: f64 = 12.0;
/// Either reader may assign places this near to a section's end to the next section, metres.
const END_M: f64 = 1e-3;

/// The result of a comparison.
#[derive(Debug, Default)]
pub struct Comparison {
    findings: Vec<Finding>,
}

/// One thing that was compared.
#[derive(Debug)]
pub struct Finding {
    /// Whether both read it alike, or differ only where they may.
    pub agrees: bool,
    /// What was found.
    pub text: String,
}

impl Comparison {
    fn add(&mut self, agrees: bool, text: String) {
        self.findings.push(Finding { agrees, text });
    }

    /// Adds something worth knowing that is no difference.
    fn note(&mut self, text: String) {
        self.add(true, text);
    }

    /// Whether anything differs that should not.
    pub fn differs(&self) -> bool {
        self.findings.iter().any(|finding| !finding.agrees)
    }

    /// Everything that was compared.
    pub fn findings(&self) -> &[Finding] {
        &self.findings
    }

    /// One object.
    pub fn as_json(&self) -> serde_json::Value {
        let findings: Vec<_> = self
            .findings
            .iter()
            .map(|finding| json!({"agrees": finding.agrees, "text": finding.text}))
            .collect();
        json!({"agrees": !self.differs(), "findings": findings})
    }
}

/// Compares a map with what the client makes of its text.
pub fn compare(client: &Client, map: &RoadMap, text: &str) -> Comparison {
    let mut comparison = Comparison::default();
    match client.view(text) {
        Err(error) => comparison.note(format!("not compared: {error}")),
        Ok(View {
            ended_early: Some(how),
            ..
        }) => {
            comparison.note(format!("not compared: the client's own reader {how} on this file; it is read here all the same"));
        }
        Ok(view) => {
            waypoints(&mut comparison, map, &view);
            lanes_beside(&mut comparison, map, &view);
            topology(&mut comparison, map, &view);
            landmarks(&mut comparison, map, &view);
            nearest(&mut comparison, map, &view);
        }
    }
    comparison
}

fn lane_of(map: &RoadMap, key: Key) -> Option<&schema_roads::Lane> {
    map.lane(LaneKey {
        road: key.0,
        section: key.1,
        lane: key.2.try_into().ok()?,
    })
}

fn degrees_between(a: f64, b: f64) -> f64 {
    ((a - b + 180.0).rem_euclid(360.0) - 180.0).abs()
}

fn waypoints(out: &mut Comparison, map: &RoadMap, view: &View) {
    let mut tilted = false;
    let mismatch_m = map.length_mismatch_m();
    let (mut missing, mut at_ends, mut junctions, mut changes) = (0, 0, 0, 0);
    let (mut worst_m, mut sum_m, mut n, mut worst_width_m) = (0.0f64, 0.0, 0usize, 0.0f64);
    let mut headings = Vec::new();
    let mut worst_at = ((0, 0, 0), 0.0);
    for waypoint in &view.waypoints {
        let Some(lane) = lane_of(map, waypoint.lane) else {
            missing += 1;
            continue;
        };
        let at = LanePosition::new(lane.key, lane.s_at_station_m(waypoint.s));
        let Some(pose) = map.pose(at) else { continue };
        let is_tilted = map.is_tilted(lane.key);
        tilted |= is_tilted;
        let to_theirs = |p: [f64; 3]| {
            let dz = if is_tilted {
                0.0
            } else {
                p[2] - waypoint.at[2]
            };
            (p[0] - waypoint.at[0])
                .hypot(p[1] + waypoint.at[1])
                .hypot(dz)
        };
        let mut distance = to_theirs(pose.translation.vector.into());
        if distance > PLACE_M.0 {
            // Along the road the client is off by as much as the file's lengths are wrong. In a
            // sharp bend this moves the place far to the side.
            let along = (-10..=10).filter_map(|i| {
                let at = LanePosition::new(
                    lane.key,
                    (at.s_m + f64::from(i) / 10.0 * mismatch_m).clamp(0.0, lane.length_m),
                );
                Some(to_theirs(map.pose(at)?.translation.vector.into()))
            });
            distance = along.fold(distance, f64::min);
        }
        if at.s_m.min(lane.length_m - at.s_m) < END_M && distance > PLACE_M.0 {
            at_ends += 1;
            continue;
        }
        if distance > worst_m {
            worst_at = (waypoint.lane, waypoint.s);
        }
        (worst_m, sum_m, n) = (worst_m.max(distance), sum_m + distance, n + 1);
        headings.push(degrees_between(
            pose.rotation.euler_angles().2.to_degrees(),
            -waypoint.yaw,
        ));
        worst_width_m = worst_width_m.max((map.width_m(at) - waypoint.width).abs());
        junctions += usize::from(lane.junction.map(i64::from) != waypoint.junction);
        // 1 is right, 2 is left; the client does not ask whether there is a lane to change to.
        let (left, right) = (map.may_change_left(at), map.may_change_right(at));
        changes +=
            usize::from((left && waypoint.change & 2 == 0) || (right && waypoint.change & 1 == 0));
    }
    out.add(
        missing == 0,
        format!("{} waypoints, {missing} on lanes that are not here, {at_ends} at ends of sections left out", view.waypoints.len()),
    );
    if let Some(lane) = view.lost.first() {
        out.note(format!(
                "the client gives no place to {} waypoints, the first on road {} lane {}; they are left out",
                view.lost.len(),
                lane.0,
                lane.2
            ),
        );
    }
    if n == 0 {
        return;
    }
    let most = if tilted { PLACE_M.1 } else { PLACE_M.0 } + mismatch_m;
    let mut heights = if tilted {
        " (tilted roads in plan)".to_owned()
    } else {
        String::new()
    };
    if mismatch_m > 1e-3 {
        heights += &format!(
            "; the file states lengths up to {:.1} mm off those of its curves, which the client walks as they are",
            mismatch_m * 1e3
        );
    }
    out.add(
        worst_m < most,
        format!(
            "places differ by {:.3} mm at most (lane {:?}, s {:.2} m), {:.4} mm on average{heights}",
            worst_m * 1e3,
            worst_at.0,
            worst_at.1,
            sum_m / n as f64 * 1e3
        ),
    );
    headings.sort_by(f64::total_cmp);
    let nearly_all = headings[(0.999 * (n - 1) as f64) as usize];
    out.add(
        nearly_all < HEADING_DEG,
        format!(
            "headings: 99.9 % within {nearly_all:.4}°, the largest {:.3}°",
            headings[n - 1]
        ),
    );
    out.add(
        worst_width_m < WIDTH_M,
        format!("widths differ by {:.3} mm at most", worst_width_m * 1e3),
    );
    out.add(
        changes == 0,
        format!("{changes} lane changes allowed here that the client forbids; {junctions} waypoints of another junction"),
    );
}

/// Whether the client's lane type means the same as ours.
fn same_kind(kind: LaneKind, theirs: &str) -> bool {
    use LaneKind as K;
    match kind {
        K::Driving => matches!(theirs, "Driving" | "Entry" | "Exit" | "OnRamp" | "OffRamp"),
        K::Bidirectional => theirs == "Bidirectional",
        K::Shoulder => theirs == "Shoulder",
        K::Border => theirs == "Border",
        K::Stop => theirs == "Stop",
        K::Parking => theirs == "Parking",
        K::Biking => theirs == "Biking",
        K::Sidewalk => theirs == "Sidewalk",
        K::Median => theirs == "Median",
        K::Restricted => theirs == "Restricted",
        K::Rail => matches!(theirs, "Rail" | "Tram"),
        // Types that the client's list lacks, most of them because they are newer.
        K::Kerb | K::Bus | K::Taxi | K::Other => !matches!(theirs, "Driving" | "Sidewalk"),
    }
}

fn lanes_beside(out: &mut Comparison, map: &RoadMap, view: &View) {
    let (mut worst_m, mut kinds, mut missing) = (0.0f64, BTreeMap::<String, usize>::new(), 0);
    for beside in &view.beside {
        let Some(lane) = lane_of(map, beside.lane) else {
            missing += 1;
            continue;
        };
        let s_m = lane.s_at_station_m(beside.s);
        if s_m.min(lane.length_m - s_m) > END_M {
            worst_m =
                worst_m.max((map.width_m(LanePosition::new(lane.key, s_m)) - beside.width).abs());
        }
        // The client reads a type that it does not know as NONE.
        if !same_kind(lane.kind, &beside.kind) && beside.kind != "NONE" {
            *kinds
                .entry(format!("{:?} here is {} there", lane.kind, beside.kind))
                .or_default() += 1;
        }
    }
    let examples: Vec<String> = kinds
        .iter()
        .take(3)
        .map(|(what, n)| format!("{what} ({n})"))
        .collect();
    let good = worst_m < WIDTH_M && kinds.is_empty() && missing == 0;
    let text = if examples.is_empty() {
        "types agree".to_owned()
    } else {
        examples.join(", ")
    };
    out.add(
        good,
        format!(
            "{} lanes beside: widths differ by {:.3} mm at most, {text}",
            view.beside.len(),
            worst_m * 1e3
        ),
    );
}

fn topology(out: &mut Comparison, map: &RoadMap, view: &View) {
    let key = |k: LaneKey| (k.road, k.section, i32::from(k.lane));
    let is_driven = |k: &Key| lane_of(map, *k).is_some_and(|lane| lane.kind.is_drivable());
    let mut ours = BTreeSet::new();
    for lane in map.lanes().iter().filter(|lane| lane.kind.is_drivable()) {
        ours.extend(
            map.successors(lane.key)
                .iter()
                .map(|next| (key(lane.key), key(*next)))
                .filter(|(_, next)| is_driven(next)),
        );
    }
    let theirs: BTreeSet<(Key, Key)> = view
        .edges
        .iter()
        .copied()
        .filter(|(_, to)| is_driven(to))
        .collect();
    let ends: BTreeSet<Key> = theirs
        .iter()
        .filter(|(a, b)| a == b)
        .map(|(a, _)| *a)
        .collect();
    let theirs: BTreeSet<(Key, Key)> = theirs
        .into_iter()
        .filter(|(a, b)| a != b || ours.contains(&(*a, *b)))
        .collect();
    let only_theirs: Vec<_> = theirs.difference(&ours).collect();
    let only_ours: Vec<_> = ours
        .difference(&theirs)
        .filter(|(a, _)| !ends.contains(a))
        .collect();
    let direct = map
        .junctions()
        .any(|junction| junction.kind == JunctionKind::Direct);
    let go_on = ends
        .iter()
        .filter(|end| ours.iter().any(|(a, _)| a == *end))
        .count();
    let named = |list: &[&(Key, Key)]| match list.first() {
        Some((a, b)) => format!(
            " (the first from road {} section {} lane {} to road {} section {} lane {})",
            a.0, a.1, a.2, b.0, b.1, b.2
        ),
        None => String::new(),
    };
    out.add(
        only_theirs.is_empty() && (direct || only_ours.is_empty()),
        format!(
            "{} lane links agree, {} only there{}, {} only here{}; {go_on} lanes end for the client alone",
            ours.intersection(&theirs).count(),
            only_theirs.len(),
            named(&only_theirs),
            only_ours.len(),
            named(&only_ours)
        ),
    );
}

fn landmarks(out: &mut Comparison, map: &RoadMap, view: &View) {
    let signals: BTreeMap<&str, &schema_roads::Signal> = map
        .signals()
        .iter()
        .map(|signal| (signal.id.as_str(), signal))
        .collect();
    let (mut n, mut moved, mut worst_m) = (0, 0, 0.0f64);
    let (mut missing, mut values) = (BTreeSet::new(), 0);
    for landmark in &view.landmarks {
        let Some(signal) = signals.get(landmark.id.as_str()) else {
            missing.insert(landmark.id.clone());
            continue;
        };
        let p = signal.pose.translation.vector;
        let away_m = (p.x - landmark.at[0]).hypot(p.y + landmark.at[1]);
        n += 1;
        if away_m > LANDMARK_M && away_m < MOVED_M && is_on_lane(map, [p.x, p.y, p.z]) {
            moved += 1;
        } else {
            worst_m = worst_m.max(away_m);
        }
        let limits_differ = landmark.kind == "274"
            && signal
                .value
                .is_some_and(|value| (value - landmark.value).abs() > 1e-6);
        values += usize::from(limits_differ || landmark.kind != signal.type_code);
    }
    let lost = missing
        .iter()
        .next()
        .map_or(String::new(), |id| format!(" (the first is {id:?})"));
    out.add(
        missing.is_empty() && values == 0 && worst_m < LANDMARK_M,
        format!(
            "{n} landmarks agree within {:.2} mm, {moved} moved off lanes there, {} missing here{lost}, {values} of another type or value",
            worst_m * 1e3,
            missing.len()
        ),
    );
}

/// Whether a place is on a lane, or a little beside it.
fn is_on_lane(map: &RoadMap, at: [f64; 3]) -> bool {
    let is_road = |lane: &schema_roads::Lane| {
        lane.kind.is_drivable() || lane.kind == LaneKind::Shoulder || lane.kind == LaneKind::Parking
    };
    map.nearest(at, is_road)
        .is_some_and(|place| place.offset_m.abs() < 0.5 * map.width_m(place) + 0.5)
}

fn nearest(out: &mut Comparison, map: &RoadMap, view: &View) {
    let (mut same, mut other, mut farther) = (0, 0, 0);
    let mut first = String::new();
    for asked in &view.nearest {
        let point = [asked.point[0], -asked.point[1], asked.point[2]];
        let found = map.nearest(point, |lane| lane.kind.is_drivable());
        let Some((at, lane)) = found.and_then(|at| Some((at, map.lane(at.lane)?))) else {
            farther += 1;
            continue;
        };
        let key = (at.lane.road, at.lane.section, i32::from(at.lane.lane));
        if key == asked.lane && (lane.station_m(at.s_m) - asked.s).abs() < 0.05 {
            same += 1;
            continue;
        }
        // The client projects without the tilt, and follows curves by their own length where the
        // file states another.
        let slack_m = if map.is_tilted(at.lane) { 0.1 } else { 0.02 } + map.length_mismatch_m();
        let theirs_m = (asked.at[0] - asked.point[0]).hypot(asked.at[1] - asked.point[1]);
        if at.offset_m.abs() <= theirs_m + slack_m {
            other += 1;
            continue;
        }
        farther += 1;
        if first.is_empty() {
            first = format!(
                " (the first is ({:.2}, {:.2}): {:.3} m to lane {key:?} here, {theirs_m:.3} m to lane {:?} there)",
                point[0],
                point[1],
                at.offset_m.abs(),
                asked.lane
            );
        }
    }
    let stumbles = match view.stumbles.first() {
        Some([x, y, _]) => format!(
            "; the client's own search fails at {} places, the first ({x:.1}, {:.1})",
            view.stumbles.len(),
            -y
        ),
        None => String::new(),
    };
    out.add(
        farther == 0,
        format!(
            "nearest lane: {same} the same, {other} others as near (lanes overlap), {farther} farther than the client's{first}{stumbles}"
        ),
    );
}
