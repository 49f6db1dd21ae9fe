//! Prints a map as JSON lines and answers questions from standard input, for comparison with another implementation.
//!
//! `roads_dump MAP.xodr` prints one line per lane and per signal, then answers each input line with one line:
//! `at ROAD SECTION LANE STATION` (pose, width, limit and permissions there) and `near X Y Z` (nearest driving lane).

use std::io::{BufRead, Write};

use schema_roads::{LaneKey, LanePosition, RoadMap};
use serde_json::{Value, json};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: roads_dump MAP.xodr")?;
    let bytes = std::fs::read(&path).map_err(|error| format!("{path} cannot be read: {error}"))?;
    let map = RoadMap::parse(&String::from_utf8_lossy(&bytes))?;
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    for warning in map.warnings() {
        eprintln!("{path}: {warning}");
    }
    for lane in map.lanes() {
        writeln!(
            out,
            "{}",
            json!({"lane": key(lane.key), "kind": format!("{:?}", lane.kind), "drivable": lane.kind.is_drivable(), "length": lane.length_m,
                "start": lane.section_start_m, "forward": lane.forward, "junction": lane.junction,
                "successors": map.successors(lane.key).iter().map(|k| key(*k)).collect::<Vec<_>>()})
        )?;
    }
    for signal in map.signals() {
        let p = signal.pose.translation.vector;
        let stops: Vec<Value> = signal.stops.iter().map(|stop| json!([key(stop.lane), key(stop.stop.lane), stop.stop.s_m])).collect();
        writeln!(out, "{}", json!({"signal": signal.id, "type": signal.type_code, "at": [p.x, p.y, p.z], "stops": stops}))?;
    }
    writeln!(out, "{}", json!({"ready": true, "geo": map.geo_reference(), "crosswalks": map.crosswalks().len()}))?;
    out.flush()?;
    for line in std::io::stdin().lock().lines() {
        writeln!(out, "{}", answer(&map, &line?))?;
        out.flush()?;
    }
    Ok(())
}

fn key(key: LaneKey) -> Value {
    json!([key.road, key.section, key.lane])
}

fn answer(map: &RoadMap, line: &str) -> Value {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words[..] {
        ["at", road, section, lane, station] => at(map, [road, section, lane], station).unwrap_or(Value::Null),
        ["near", x, y, z] => near(map, [x, y, z]).unwrap_or(Value::Null),
        _ => Value::Null,
    }
}

fn at(map: &RoadMap, words: [&str; 3], station: &str) -> Option<Value> {
    let [road, section, lane] = words;
    let lane = map.lane(LaneKey { road: road.parse().ok()?, section: section.parse().ok()?, lane: lane.parse().ok()? })?;
    let at = LanePosition::new(lane.key, lane.s_at_station_m(station.parse().ok()?));
    let pose = map.pose(at)?;
    let p = pose.translation.vector;
    let yaw = pose.rotation.euler_angles().2;
    Some(json!({"p": [p.x, p.y, p.z], "yaw": yaw, "width": map.width_m(at), "limit": map.speed_limit_mps(at),
        "change": [map.may_change_left(at), map.may_change_right(at)]}))
}

fn near(map: &RoadMap, words: [&str; 3]) -> Option<Value> {
    let mut point = [0.0; 3];
    for (value, word) in point.iter_mut().zip(words) {
        *value = word.parse().ok()?;
    }
    let at = map.nearest(point, |lane| lane.kind.is_drivable())?;
    let lane = map.lane(at.lane)?;
    Some(json!({"lane": key(at.lane), "station": lane.station_m(at.s_m), "offset": at.offset_m}))
}
