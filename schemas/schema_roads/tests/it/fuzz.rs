//! Hostile texts: mutated maps must give a map or an error, and every query on the map must return.

use crate::common;

use schema_roads::{LanePosition, RoadMap};

const NUMBERS: [&str; 12] = [
    "0",
    "-1",
    "1e9",
    "-1e9",
    "1e308",
    "NaN",
    "inf",
    "1e-12",
    "999999",
    "4294967295",
    "0.5",
    "-0.0000001",
];

/// One change of the text that keeps it likely to be XML.
fn mutate(text: &mut Vec<u8>, random: &mut fastrand::Rng) {
    let quotes: Vec<usize> = text
        .iter()
        .enumerate()
        .filter(|(_, b)| **b == b'"')
        .map(|(i, _)| i)
        .collect();
    match random.u32(0..10) {
        // A value becomes a hostile number.
        0..=6 if quotes.len() > 4 => {
            let pair = random.usize(1..quotes.len() / 2) * 2;
            let value = NUMBERS[random.usize(0..NUMBERS.len())].bytes();
            text.splice(quotes[pair] + 1..quotes[pair + 1], value);
        }
        // An element is repeated.
        7 => {
            let tags: Vec<usize> = text
                .iter()
                .enumerate()
                .filter(|(_, b)| **b == b'<')
                .map(|(i, _)| i)
                .collect();
            let from = tags[random.usize(0..tags.len())];
            if let Some(len) = text[from..].iter().position(|b| *b == b'>')
                && text[from + len - 1] == b'/'
            {
                let copy = text[from..=from + len].to_vec();
                text.splice(from..from, copy);
            }
        }
        // Bytes change or go.
        8 => {
            let at = random.usize(0..text.len());
            text[at] = random.u8(32..127);
        }
        _ => {
            let at = random.usize(0..text.len());
            text.remove(at);
        }
    }
}

fn use_it(map: &RoadMap) {
    for lane in map.lanes().iter().take(30) {
        let at = LanePosition::new(lane.key, 0.4 * lane.length_m);
        let _ = (
            map.pose(at),
            map.width_m(at),
            map.speed_limit_mps(at),
            map.curvature_per_m(at),
        );
        let _ = (
            map.may_change_left(at),
            map.may_change_right(at),
            map.advance(at, 60.0),
            map.advance(at, -60.0),
        );
        let _ = (
            map.centreline(lane.key, 20.0).len(),
            map.boundaries(lane.key, 20.0),
        );
    }
    for x in [-1e12, -30.0, 0.0, 40.0, f64::INFINITY] {
        let _ = map.nearest([x, 3.0, 0.0], |lane| lane.kind.is_drivable());
    }
    let _ = map.mark_lines(50.0).len();
}

#[test]
fn mutated_maps_neither_panic_nor_hang() {
    let spiral = common::RoadText::new(
        1,
        60.0,
        &common::geometry(
            0.0,
            0.0,
            0.0,
            0.0,
            60.0,
            r#"<spiral curvStart="0" curvEnd="0.1"/>"#,
        ),
    );
    let poly = r#"<paramPoly3 aU="0" bU="40" cU="-4" dU="1" aV="0" bV="0" cV="9" dV="-5" pRange="arcLength"/>"#;
    let cubic = common::RoadText::new(2, 40.0, &common::geometry(0.0, 0.0, 0.0, 0.0, 40.0, poly));
    let poly3 = common::RoadText::new(
        3,
        30.0,
        &common::geometry(
            0.0,
            0.0,
            0.0,
            0.0,
            30.0,
            r#"<poly3 a="0" b="0" c="0.02" d="-0.0003"/>"#,
        ),
    );
    let seeds = [
        common::t_junction(),
        common::document(&[spiral, cubic, poly3], ""),
    ];
    let mut random = fastrand::Rng::with_seed(20_261_121);
    let mut maps = 0;
    for round in 0..1000 {
        let mut bytes = seeds[round % seeds.len()].clone().into_bytes();
        for _ in 0..random.u32(1..6) {
            mutate(&mut bytes, &mut random);
        }
        if let Ok(map) = RoadMap::parse(&String::from_utf8_lossy(&bytes)) {
            use_it(&map);
            maps += 1;
        }
    }
    assert!(maps > 500, "only {maps} of the mutants were maps");
}

#[test]
fn deep_nesting_and_many_warnings_are_survived() {
    let deep =
        "<OpenDRIVE>".to_owned() + &"<a>".repeat(5000) + &"</a>".repeat(5000) + "</OpenDRIVE>";
    assert!(RoadMap::parse(&deep).is_err());
    let road = r#"<road id="1" length="x" junction="-1"/>"#.repeat(20_000);
    let text = common::t_junction().replace("<road id=\"1\"", &(road + "<road id=\"1\""));
    let map = RoadMap::parse(&text).unwrap();
    assert!(map.warnings().len() <= 101 && map.warnings().last().unwrap().text.contains("further"));
}

/// Everything the format has, once: what the mutator has not seen it cannot break.
fn rich() -> String {
    let mut road = common::RoadText::new(
        1,
        80.0,
        &common::geometry(0.0, 0.0, 0.0, 0.0, 80.0, r#"<arc curvature="0.01"/>"#),
    );
    road.profiles = r#"<elevationProfile><elevation s="0" a="1" b="0.02" c="0" d="0"/></elevationProfile><lateralProfile>
        <superelevation s="0" a="0.02" b="0.001" c="0" d="0"/><crossfall side="left" s="0" a="0.02" b="0" c="0" d="0"/>
        <shape s="0" t="-4" a="0" b="0.01" c="0" d="0"/><shape s="40" t="-4" a="0.1" b="0" c="0.001" d="0"/></lateralProfile>"#
        .into();
    road.lanes = r#"<laneOffset s="0" a="0.5" b="0" c="0.001" d="0"/><laneSection s="0"><left><lane id="1" type="sidewalk"><border sOffset="0" a="3" b="0" c="0" d="0"/>
        <height sOffset="0" inner="0.1" outer="0.12"/></lane></left><center><lane id="0" type="none"><roadMark sOffset="0" type="solid broken" color="yellow" width="0.1">
        <type name="solid broken" width="0.1"><line length="3" space="6" tOffset="0.1" sOffset="1" rule="none" width="0.1"/></type></roadMark></lane></center>
        <right><lane id="-1" type="driving"><link><successor id="-1"/></link><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection>
        <laneSection s="30"><center><lane id="0" type="none"/></center><right><lane id="-1" type="driving"><link><predecessor id="-1"/></link>
        <width sOffset="0" a="3.5" b="0.01" c="0" d="0"/><speed sOffset="0" max="50" unit="mph"/></lane></right></laneSection>"#
        .into();
    road.signals = r#"<objects><object id="1" type="crosswalk" s="20" t="0" hdg="0" length="3" width="8"><outline><cornerLocal u="-2" v="-4" z="0"/>
        <cornerLocal u="2" v="-4" z="0"/><cornerRoad s="22" t="4" dz="0" height="1"/></outline></object><object id="2" type="barrier" s="0" t="-6" length="2" width="0.3" height="1">
        <repeat s="5" length="60" distance="0" tStart="-6" tEnd="-7" heightStart="1" heightEnd="2"/></object><object id="3" type="tree" s="9" t="9" radius="1" height="5">
        <repeat s="0" length="70" distance="7"/></object></objects><signals><signal id="9" s="70" t="-5" dynamic="yes" orientation="+" type="1000001" value="-1"/></signals>"#
        .into();
    common::document(
        &[road],
        r#"<controller id="1"><control signalId="9"/></controller><junction id="4" type="virtual" mainRoad="1" sStart="3" sEnd="9"/>"#,
    )
}

/// Surfaces, objects and paint of mutated maps stay within the number of points that was asked for.
#[test]
fn surfaces_of_mutated_maps_stay_within_their_bounds() {
    let seeds = [rich(), common::t_junction()];
    let mut random = fastrand::Rng::with_seed(77);
    let steps = schema_roads::SurfaceSteps {
        max_points: 400,
        ..Default::default()
    };
    let (mut maps, mut too_large) = (0, 0);
    for round in 0..3000 {
        let mut bytes = seeds[round % seeds.len()].clone().into_bytes();
        for _ in 0..random.u32(1..5) {
            mutate(&mut bytes, &mut random);
        }
        let Ok(map) = RoadMap::parse(&String::from_utf8_lossy(&bytes)) else {
            continue;
        };
        maps += 1;
        match map.surfaces(&steps) {
            Ok(surfaces) => {
                let points: usize = surfaces
                    .iter()
                    .flat_map(|s| &s.lanes)
                    .map(|lane| lane.points_m.len())
                    .sum();
                assert!(points <= 400, "{points}");
                assert!(surfaces.iter().all(
                    |s| s.stations_m.len() >= 2 && s.stations_m.windows(2).all(|w| w[0] < w[1])
                ));
            }
            Err(_) => too_large += 1,
        }
        assert!(map.objects().len() <= 50_000 && map.warnings().len() <= 101);
    }
    assert!(
        maps > 1500 && too_large > 10,
        "{maps} maps, {too_large} too large"
    );
}
