//! The network as OpenDRIVE 1.6 text, elements in the order that strict readers want.

use std::f64::consts::PI;
use std::fmt::Write;

use super::elevation::Elevation;
use super::lane_lines;
use super::lane_lines::LaneLine;
use super::model::{CROSSWALK_M, Junction, KERB_HEIGHT_M, Link, Network, Road, Signal, SignalKind};
use crate::geometry::Path;
use crate::plan::{Edge, Plan, Profile};

macro_rules! line {
    ($out:expr, $($arg:tt)*) => {
        writeln!($out, $($arg)*).expect("writing to a string does not fail")
    };
}

/// The whole text.
pub fn write(plan: &Plan, network: &Network) -> String {
    let mut out = String::with_capacity(1 << 20);
    line!(out, r#"<?xml version="1.0" encoding="UTF-8"?>"#);
    line!(out, "<OpenDRIVE>");
    header(&mut out, plan);
    for (i, road) in network.roads.iter().enumerate() {
        street(&mut out, network, i, road);
    }
    for link in &network.links {
        connecting_road(&mut out, network, link);
    }
    for stage in &network.stages {
        line!(
            out,
            r#"  <controller name="ctrl{0}" id="{0}" sequence="0">"#,
            stage.id
        );
        for &signal in &stage.signals {
            line!(
                out,
                r#"    <control signalId="{}" type="0"/>"#,
                network.signals[signal].id
            );
        }
        line!(out, "  </controller>");
    }
    for (i, each) in network.junctions.iter().enumerate() {
        junction(&mut out, network, i, each);
    }
    line!(out, "</OpenDRIVE>");
    out
}

fn header(out: &mut String, plan: &Plan) {
    let xs = plan.nodes_m.iter().map(|p| p.x);
    let ys = plan.nodes_m.iter().map(|p| p.y);
    line!(
        out,
        r#"  <header revMajor="1" revMinor="6" name="{}" version="1" date="2026-01-01T00:00:00" north="{}" south="{}" east="{}" west="{}" vendor="Gantry">"#,
        plan.name,
        ys.clone().fold(f64::MIN, f64::max) + 20.0,
        ys.fold(f64::MAX, f64::min) - 20.0,
        xs.clone().fold(f64::MIN, f64::max) + 20.0,
        xs.fold(f64::MAX, f64::min) - 20.0,
    );
    let (lat, lon) = plan.lat_lon_deg;
    line!(
        out,
        "    <geoReference><![CDATA[+proj=tmerc +lat_0={lat} +lon_0={lon} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +vunits=m +no_defs]]></geoReference>"
    );
    line!(out, "  </header>");
}

/// Kind of road by its speed limit.
fn kind(speed_kmh: u32) -> &'static str {
    match speed_kmh {
        ..=65 => "town",
        66..=85 => "rural",
        _ => "motorway",
    }
}

fn plan_view(out: &mut String, path: &Path, elevation: &Elevation) {
    line!(out, "    <planView>");
    let mut s = 0.0;
    for segment in &path.segments {
        let (p, h) = (segment.start_m, segment.heading_rad);
        let shape = if segment.curvature_per_m == 0.0 {
            "<line/>".to_owned()
        } else {
            format!(r#"<arc curvature="{}"/>"#, segment.curvature_per_m)
        };
        line!(
            out,
            r#"      <geometry s="{s}" x="{}" y="{}" hdg="{h}" length="{}">{shape}</geometry>"#,
            p.x,
            p.y,
            segment.length_m
        );
        s += segment.length_m;
    }
    line!(out, "    </planView>");
    let pieces: Vec<String> = (elevation.pieces.iter())
        .map(|p| {
            format!(
                r#"<elevation s="{}" a="{}" b="0" c="{}" d="{}"/>"#,
                p.s_m,
                p.a_m,
                p.c,
                p.d + 0.0
            )
        })
        .collect();
    line!(
        out,
        "    <elevationProfile>{}</elevationProfile>",
        pieces.concat()
    );
    line!(out, "    <lateralProfile/>");
}

fn street(out: &mut String, network: &Network, idx: usize, road: &Road) {
    line!(
        out,
        r#"  <road name="Street {0}" length="{1}" id="{0}" junction="-1" rule="RHT">"#,
        road.id,
        road.path.length_m()
    );
    let junction_id = |end: usize| network.junctions[road.ends[end]].id;
    line!(out, "    <link>");
    line!(
        out,
        r#"      <predecessor elementType="junction" elementId="{}"/>"#,
        junction_id(0)
    );
    line!(
        out,
        r#"      <successor elementType="junction" elementId="{}"/>"#,
        junction_id(1)
    );
    line!(out, "    </link>");
    line!(
        out,
        r#"    <type s="0" type="{}"><speed max="{}" unit="km/h"/></type>"#,
        kind(road.profile.speed_kmh),
        road.profile.speed_kmh
    );
    plan_view(out, &road.path, &road.elevation);
    lanes(out, &road.profile);
    crosswalks(out, network, idx, road);
    let signals: Vec<&Signal> = network
        .signals
        .iter()
        .filter(|signal| signal.road == idx)
        .collect();
    line!(out, "    <signals>");
    for each in signals {
        signal(out, each, &road.profile);
    }
    line!(out, "    </signals>");
    line!(out, "  </road>");
}

/// Kind, width and outer mark (type, colour, lane change) of the lanes of one side, from the middle
/// outwards.
/// A lane as OpenDRIVE describes it.
#[derive(Clone, Copy)]
struct LaneText {
    kind: &'static str,
    width: f64,
    /// Its outer mark, and who may cross it.
    mark: &'static str,
    change: &'static str,
}

fn side(profile: &Profile, driving: bool) -> Vec<LaneText> {
    let mut lanes = Vec::new();
    for k in 1..=if driving { profile.n_lanes } else { 0 } {
        let (mark, change) = if k < profile.n_lanes {
            ("broken", "both")
        } else {
            ("solid", "none")
        };
        lanes.push(LaneText {
            kind: "driving",
            width: profile.lane_m,
            mark,
            change,
        });
    }
    let edge = match profile.edge {
        Edge::Gutter => "shoulder",
        Edge::Parking => "parking",
    };
    lanes.push(LaneText {
        kind: edge,
        width: profile.edge_m,
        mark: "curb",
        change: "none",
    });
    lanes.push(LaneText {
        kind: if profile.verge { "border" } else { "sidewalk" },
        width: profile.pavement_m,
        mark: "none",
        change: "none",
    });
    lanes
}

fn lane(out: &mut String, id: i32, lane: LaneText, speed_kmh: u32) {
    let LaneText {
        kind,
        width,
        mark,
        change,
    } = lane;
    line!(
        out,
        r#"          <lane id="{id}" type="{kind}" level="false">"#
    );
    line!(
        out,
        r#"            <width sOffset="0" a="{width}" b="0" c="0" d="0"/>"#
    );
    line!(
        out,
        r#"            <roadMark sOffset="0" type="{mark}" weight="standard" color="white" material="standard" width="0.12" laneChange="{change}"/>"#
    );
    if kind == "driving" {
        line!(
            out,
            r#"            <speed sOffset="0" max="{speed_kmh}" unit="km/h"/>"#
        );
    }
    if kind == "sidewalk" || kind == "border" {
        line!(
            out,
            r#"            <height sOffset="0" inner="{KERB_HEIGHT_M}" outer="{KERB_HEIGHT_M}"/>"#
        );
    }
    line!(out, "          </lane>");
}

fn lanes(out: &mut String, profile: &Profile) {
    let (left_side, side) = (side(profile, !profile.one_way), side(profile, true));
    line!(out, r#"    <lanes>"#);
    if profile.one_way {
        line!(
            out,
            r#"      <laneOffset s="0" a="{}" b="0" c="0" d="0"/>"#,
            profile.driving_m()
        );
    }
    line!(out, r#"      <laneSection s="0">"#);
    line!(out, "        <left>");
    for (i, &each) in left_side.iter().enumerate().rev() {
        lane(out, i as i32 + 1, each, profile.speed_kmh);
    }
    line!(out, "        </left>");
    let mark = match (profile.one_way, profile.main) {
        (true, _) => "solid",
        (false, true) => "solid solid",
        (false, false) => "broken",
    };
    // Overtaking may cross the broken centre line, but the map must not call that a lane change:
    // route planners would turn round there.
    line!(
        out,
        r#"        <center><lane id="0" type="none" level="false">"#
    );
    line!(
        out,
        r#"            <roadMark sOffset="0" type="{mark}" weight="standard" color="yellow" material="standard" width="0.12" laneChange="none"/>"#
    );
    line!(out, "        </lane></center>");
    line!(out, "        <right>");
    for (i, &each) in side.iter().enumerate() {
        lane(out, -(i as i32) - 1, each, profile.speed_kmh);
    }
    line!(out, "        </right>");
    line!(out, "      </laneSection>");
    line!(out, "    </lanes>");
}

fn crosswalks(out: &mut String, network: &Network, idx: usize, road: &Road) {
    line!(out, "    <objects>");
    for end in [0, 1] {
        let junction = &network.junctions[road.ends[end]];
        let Some(arm) = junction
            .arms
            .iter()
            .find(|arm| arm.road == idx && arm.at_start == (end == 0) && arm.crosswalk)
        else {
            continue;
        };
        let (length, half_width) = (CROSSWALK_M.1 - CROSSWALK_M.0, road.profile.kerb_m());
        let s = network.arm_station(arm, 0.5 * (CROSSWALK_M.0 + CROSSWALK_M.1));
        line!(
            out,
            r#"      <object id="{}" name="Crosswalk" type="crosswalk" s="{s}" t="0" zOffset="0" hdg="0" pitch="0" roll="0" orientation="none" length="{length}" width="{}">"#,
            10 * road.id as usize + end,
            2.0 * half_width
        );
        line!(out, "        <outline>");
        let (u, v) = (0.5 * length, half_width);
        for (u, v) in [(-u, -v), (u, -v), (u, v), (-u, v), (-u, -v)] {
            line!(out, r#"          <cornerLocal u="{u}" v="{v}" z="0"/>"#);
        }
        line!(out, "        </outline>");
        line!(out, "      </object>");
    }
    line!(out, "    </objects>");
}

fn signal(out: &mut String, signal: &Signal, profile: &Profile) {
    let limit;
    let (name, dynamic, kind, value, height, z) = match signal.kind {
        SignalKind::Light => ("TrafficLight", "yes", "1000001", "-1", 1.0, 2.6),
        SignalKind::Stop => ("Stop", "no", "206", "-1", 0.8, 2.2),
        SignalKind::Yield => ("Yield", "no", "205", "-1", 0.8, 2.2),
        SignalKind::Limit(kmh) => {
            limit = kmh.to_string();
            ("SpeedLimit", "no", "274", limit.as_str(), 0.7, 2.2)
        }
    };
    let unit = if matches!(signal.kind, SignalKind::Limit(_)) {
        r#" unit="km/h""#
    } else {
        ""
    };
    line!(
        out,
        r#"      <signal s="{}" t="{}" id="{}" name="{name}_{}" dynamic="{dynamic}" orientation="{}" zOffset="{z}" country="OpenDRIVE" type="{kind}" subtype="-1" value="{value}"{unit} height="{height}" width="0.4" hOffset="0" pitch="0" roll="0" text="">"#,
        signal.s_m,
        signal.t_m,
        signal.id,
        signal.id,
        if signal.against { "-" } else { "+" },
    );
    let outermost = profile.n_lanes as i32;
    let (from, to) = if signal.against {
        (1, outermost)
    } else {
        (-outermost, -1)
    };
    line!(
        out,
        r#"        <validity fromLane="{from}" toLane="{to}"/>"#
    );
    line!(out, "      </signal>");
}

/// Speed of a connecting road, km/h in steps of five. The side force in the turn stays below 0.45
/// of the weight, which is brisk and half of what tyres hold on a dry road. A bend of less than a
/// quarter of a right angle does not count as a turn.
fn turn_kmh(path: &Path) -> u32 {
    const SIDE_FRICTION: f64 = 0.45;
    let turns = path
        .segments
        .iter()
        .filter(|segment| (segment.curvature_per_m * segment.length_m).abs() > PI / 8.0);
    let sharpest_per_m = turns
        .map(|segment| segment.curvature_per_m.abs())
        .fold(1e-4, f64::max);
    let kmh = 3.6 * (SIDE_FRICTION * 9.81 / sharpest_per_m).sqrt();
    5 * (kmh / 5.0).max(3.0) as u32
}

/// The mark at an edge of a connecting lane.
fn connecting_mark(line: Option<LaneLine>) -> &'static str {
    match line {
        None => {
            r#"<roadMark sOffset="0" type="none" weight="standard" color="standard" material="standard" width="0" laneChange="none"/>"#
        }
        Some(LaneLine::Solid) => {
            r#"<roadMark sOffset="0" type="solid" weight="standard" color="white" material="standard" width="0.12" laneChange="none"/>"#
        }
        Some(LaneLine::Broken) => {
            r#"<roadMark sOffset="0" type="broken" weight="standard" color="white" material="standard" width="0.12" laneChange="both"/>"#
        }
    }
}

fn connecting_road(out: &mut String, network: &Network, link: &Link) {
    let junction = &network.junctions[link.junction];
    let length = link.path.length_m();
    line!(
        out,
        r#"  <road name="" length="{length}" id="{}" junction="{}" rule="RHT">"#,
        link.id,
        junction.id
    );
    let (from, to) = (&junction.arms[link.from.0], &junction.arms[link.to.0]);
    let contact = |at_start: bool| if at_start { "start" } else { "end" };
    line!(out, "    <link>");
    for (which, arm) in [("predecessor", from), ("successor", to)] {
        let road = &network.roads[arm.road];
        line!(
            out,
            r#"      <{which} elementType="road" elementId="{}" contactPoint="{}"/>"#,
            road.id,
            contact(arm.at_start)
        );
    }
    line!(out, "    </link>");
    let roads_kmh = network.roads[from.road]
        .profile
        .speed_kmh
        .min(network.roads[to.road].profile.speed_kmh);
    let speed = roads_kmh.min(turn_kmh(&link.path));
    line!(
        out,
        r#"    <type s="0" type="{}"><speed max="{speed}" unit="km/h"/></type>"#,
        kind(speed)
    );
    plan_view(
        out,
        &link.path,
        &Elevation::between(length, junction.height_m, junction.height_m, &[]),
    );
    let (a, change) = (link.width_m.0, link.width_m.1 - link.width_m.0);
    let (c, d) = (
        3.0 * change / length.powi(2),
        -2.0 * change / length.powi(3),
    );
    line!(out, r#"    <lanes>"#);
    line!(out, r#"      <laneSection s="0">"#);
    line!(
        out,
        r#"        <center><lane id="0" type="none" level="false">"#
    );
    let [left, right] = lane_lines::lines(network, link).map(connecting_mark);
    line!(out, "            {left}");
    line!(out, "        </lane></center>");
    line!(out, "        <right>");
    line!(
        out,
        r#"          <lane id="-1" type="driving" level="false">"#
    );
    line!(
        out,
        r#"            <link><predecessor id="{}"/><successor id="{}"/></link>"#,
        link.from.1,
        link.to.1
    );
    line!(
        out,
        r#"            <width sOffset="0" a="{a}" b="0" c="{c}" d="{d}"/>"#
    );
    line!(out, "            {right}");
    line!(
        out,
        r#"            <speed sOffset="0" max="{speed}" unit="km/h"/>"#
    );
    line!(out, "          </lane>");
    line!(out, "        </right>");
    line!(out, "      </laneSection>");
    line!(out, "    </lanes>");
    line!(out, "    <objects/>");
    line!(out, "    <signals>");
    let guards = network.signals.iter().filter(|s| {
        s.junction == Some(link.junction) && s.road == from.road && s.against == from.at_start
    });
    for signal in guards.filter(|s| s.kind == SignalKind::Light) {
        line!(
            out,
            r#"      <signalReference s="0" t="{}" id="{}" orientation="+">"#,
            -signal.t_m.abs(),
            signal.id
        );
        line!(out, r#"        <validity fromLane="-1" toLane="-1"/>"#);
        line!(out, "      </signalReference>");
    }
    line!(out, "    </signals>");
    line!(out, "  </road>");
}

fn junction(out: &mut String, network: &Network, idx: usize, junction: &Junction) {
    line!(
        out,
        r#"  <junction id="{}" name="junction{}">"#,
        junction.id,
        junction.id
    );
    for (i, link) in network
        .links
        .iter()
        .filter(|link| link.junction == idx)
        .enumerate()
    {
        let incoming = network.roads[junction.arms[link.from.0].road].id;
        line!(
            out,
            r#"    <connection id="{i}" incomingRoad="{incoming}" connectingRoad="{}" contactPoint="start">"#,
            link.id
        );
        line!(out, r#"      <laneLink from="{}" to="-1"/>"#, link.from.1);
        line!(out, "    </connection>");
    }
    for (sequence, stage) in network
        .stages
        .iter()
        .filter(|stage| stage.junction == idx)
        .enumerate()
    {
        line!(
            out,
            r#"    <controller id="{}" type="0" sequence="{sequence}"/>"#,
            stage.id
        );
    }
    line!(out, "  </junction>");
}
