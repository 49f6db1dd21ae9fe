//! Hostile texts: mutated maps must give a map or an error, quickly, and every query on the map must return.

mod common;

use std::time::{Duration, Instant};

use schema_roads::{LanePosition, RoadMap};

const NUMBERS: [&str; 12] = ["0", "-1", "1e9", "-1e9", "1e308", "NaN", "inf", "1e-12", "999999", "4294967295", "0.5", "-0.0000001"];

/// One change of the text that keeps it likely to be XML.
fn mutate(text: &mut Vec<u8>, random: &mut fastrand::Rng) {
    let quotes: Vec<usize> = text.iter().enumerate().filter(|(_, b)| **b == b'"').map(|(i, _)| i).collect();
    match random.u32(0..10) {
        // A value becomes a hostile number.
        0..=6 if quotes.len() > 4 => {
            let pair = random.usize(1..quotes.len() / 2) * 2;
            let value = NUMBERS[random.usize(0..NUMBERS.len())].bytes();
            text.splice(quotes[pair] + 1..quotes[pair + 1], value);
        }
        // An element is repeated.
        7 => {
            let tags: Vec<usize> = text.iter().enumerate().filter(|(_, b)| **b == b'<').map(|(i, _)| i).collect();
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
        let _ = (map.pose(at), map.width_m(at), map.speed_limit_mps(at), map.curvature_per_m(at));
        let _ = (map.may_change_left(at), map.may_change_right(at), map.advance(at, 60.0), map.advance(at, -60.0));
        let _ = (map.centreline(lane.key, 20.0).len(), map.boundaries(lane.key, 20.0));
    }
    for x in [-1e12, -30.0, 0.0, 40.0, f64::INFINITY] {
        let _ = map.nearest([x, 3.0, 0.0], |lane| lane.kind.is_drivable());
    }
    let _ = map.mark_lines(50.0).len();
}

#[test]
fn mutated_maps_neither_panic_nor_hang() {
    let spiral = common::RoadText::new(1, 60.0, &common::geometry(0.0, 0.0, 0.0, 0.0, 60.0, r#"<spiral curvStart="0" curvEnd="0.1"/>"#));
    let poly = r#"<paramPoly3 aU="0" bU="40" cU="-4" dU="1" aV="0" bV="0" cV="9" dV="-5" pRange="arcLength"/>"#;
    let cubic = common::RoadText::new(2, 40.0, &common::geometry(0.0, 0.0, 0.0, 0.0, 40.0, poly));
    let poly3 = common::RoadText::new(3, 30.0, &common::geometry(0.0, 0.0, 0.0, 0.0, 30.0, r#"<poly3 a="0" b="0" c="0.02" d="-0.0003"/>"#));
    let seeds = [common::t_junction(), common::document(&[spiral, cubic, poly3], "")];
    let mut random = fastrand::Rng::with_seed(20_261_121);
    let (mut maps, mut slowest) = (0, Duration::ZERO);
    for round in 0..1000 {
        let mut bytes = seeds[round % seeds.len()].clone().into_bytes();
        for _ in 0..random.u32(1..6) {
            mutate(&mut bytes, &mut random);
        }
        let started = Instant::now();
        if let Ok(map) = RoadMap::parse(&String::from_utf8_lossy(&bytes)) {
            use_it(&map);
            maps += 1;
        }
        slowest = slowest.max(started.elapsed());
    }
    assert!(maps > 500, "only {maps} of the mutants were maps");
    assert!(slowest < Duration::from_secs(10), "{slowest:?}");
}

#[test]
fn deep_nesting_and_many_warnings_are_survived() {
    let deep = "<OpenDRIVE>".to_owned() + &"<a>".repeat(5000) + &"</a>".repeat(5000) + "</OpenDRIVE>";
    assert!(RoadMap::parse(&deep).is_err());
    let road = r#"<road id="1" length="x" junction="-1"/>"#.repeat(20_000);
    let text = common::t_junction().replace("<road id=\"1\"", &(road + "<road id=\"1\""));
    let started = Instant::now();
    let map = RoadMap::parse(&text).unwrap();
    assert!(map.warnings().len() <= 101 && map.warnings().last().unwrap().text.contains("further"));
    assert!(started.elapsed() < Duration::from_secs(5));
}
