//! The report on one map, as text and as JSON.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::Duration;

use schema_roads::{JunctionKind, LaneKind, RoadMap, Severity, SignalKind, Warning};
use serde_json::json;

use super::compare::Comparison;

/// What a map holds.
#[derive(Debug)]
pub struct Contents {
    revision: Option<(u32, u32)>,
    n_roads: usize,
    length_m: f64,
    /// Lanes by kind.
    lanes: BTreeMap<String, usize>,
    /// Junctions by kind.
    junctions: BTreeMap<String, usize>,
    n_lights: usize,
    /// Groups of lights that take turns.
    n_light_groups: usize,
    n_stops: usize,
    n_yields: usize,
    n_limits: usize,
    n_signals: usize,
    n_controllers: usize,
    n_crosswalks: usize,
    n_objects: usize,
    /// Length of all driving lanes.
    lanes_m: f64,
    /// Places where vehicles may be put.
    pub n_spawn_points: usize,
    geo_reference_deg: Option<(f64, f64)>,
    took: Duration,
}

impl Contents {
    /// Counts what a map holds.
    pub fn of(map: &RoadMap, took: Duration) -> Contents {
        let mut lanes = BTreeMap::new();
        map.lanes().iter().for_each(|lane| {
            *lanes
                .entry(format!("{:?}", lane.kind).to_lowercase())
                .or_default() += 1
        });
        let mut junctions = BTreeMap::new();
        for junction in map.junctions() {
            let kind = match junction.kind {
                JunctionKind::Common => "common",
                JunctionKind::Direct => "direct",
                JunctionKind::Virtual => "virtual",
                JunctionKind::Crossing => "crossing",
            };
            *junctions.entry(kind.to_owned()).or_default() += 1;
        }
        let n_of = |kind| map.signals().iter().filter(|s| s.kind == kind).count();
        Contents {
            n_light_groups: map.light_groups().len(),
            n_stops: n_of(SignalKind::Stop),
            n_yields: n_of(SignalKind::Yield),
            n_limits: n_of(SignalKind::SpeedLimit),
            lanes_m: map
                .lanes()
                .iter()
                .filter(|lane| lane.kind == LaneKind::Driving)
                .map(|lane| lane.length_m)
                .sum(),
            n_spawn_points: map.spawn_points().len(),
            revision: map.revision(),
            n_roads: map.roads().count(),
            length_m: map.roads().map(|road| road.length_m).sum(),
            lanes,
            junctions,
            n_lights: n_of(SignalKind::TrafficLight),
            n_signals: map.signals().len(),
            n_controllers: map.controllers().len(),
            n_crosswalks: map.crosswalks().len(),
            n_objects: map.objects().len(),
            geo_reference_deg: map.has_geo_reference().then(|| map.geo_reference()),
            took,
        }
    }

    fn sentence(&self) -> String {
        let revision = self.revision.map_or(
            "OpenDRIVE without a revision".to_owned(),
            |(major, minor)| format!("OpenDRIVE {major}.{minor}"),
        );
        let by_kind = |counts: &BTreeMap<String, usize>| {
            let words: Vec<String> = counts
                .iter()
                .map(|(kind, n)| format!("{n} {kind}"))
                .collect();
            if words.is_empty() {
                String::new()
            } else {
                format!(" ({})", words.join(", "))
            }
        };
        let place = self
            .geo_reference_deg
            .map_or("no geoReference".to_owned(), |(lat, lon)| {
                format!("at {lat:.5}°, {lon:.5}°")
            });
        format!(
            "{revision}, {} roads, {:.2} km, {} lanes{}, {} junctions{}, {} signals ({} lights), {} controllers, {} crosswalks, {} objects, {place}; read in {:.0} ms",
            self.n_roads,
            self.length_m / 1000.0,
            self.lanes.values().sum::<usize>(),
            by_kind(&self.lanes),
            self.junctions.values().sum::<usize>(),
            by_kind(&self.junctions),
            self.n_signals,
            self.n_lights,
            self.n_controllers,
            self.n_crosswalks,
            self.n_objects,
            self.took.as_secs_f64() * 1e3,
        )
    }

    /// What a map that is imported brings.
    pub fn import_sentence(&self) -> String {
        format!(
            "{} roads, {:.1} km ({:.1} km of driving lanes), {} junctions, {} lights in {} groups, {} stop signs, {} yield signs, {} speed limits, {} crosswalks, {} spawn points",
            self.n_roads,
            self.length_m / 1000.0,
            self.lanes_m / 1000.0,
            self.junctions.values().sum::<usize>(),
            self.n_lights,
            self.n_light_groups,
            self.n_stops,
            self.n_yields,
            self.n_limits,
            self.n_crosswalks,
            self.n_spawn_points,
        )
    }

    /// One object.
    pub fn as_json(&self) -> serde_json::Value {
        json!({
            "driving_lanes_m": self.lanes_m, "light_groups": self.n_light_groups, "stop_signs": self.n_stops, "yield_signs": self.n_yields,
            "speed_limits": self.n_limits, "spawn_points": self.n_spawn_points,
            "revision": self.revision.map(|(major, minor)| format!("{major}.{minor}")), "roads": self.n_roads, "length_m": self.length_m,
            "lanes": self.lanes, "junctions": self.junctions, "signals": self.n_signals, "lights": self.n_lights,
            "controllers": self.n_controllers, "crosswalks": self.n_crosswalks, "objects": self.n_objects,
            "geo_reference_deg": self.geo_reference_deg, "read_secs": self.took.as_secs_f64(),
        })
    }
}

/// Everything about one map.
#[derive(Debug)]
pub struct Report {
    /// The map as the user named it.
    pub name: String,
    /// Why it cannot be read.
    pub error: Option<String>,
    /// What is unusual or broken in it.
    pub warnings: Vec<Warning>,
    /// What a map holds.
    pub contents: Option<Contents>,
    /// The comparison with CARLA's client, if there was one.
    pub comparison: Option<Comparison>,
}

impl Report {
    /// A map that cannot be read.
    pub fn failed(name: String, error: String) -> Report {
        Report {
            name,
            error: Some(error),
            warnings: Vec::new(),
            contents: None,
            comparison: None,
        }
    }

    /// Whether the file lacks something that a map needs.
    pub fn is_broken(&self) -> bool {
        self.error.is_some()
            || self
                .warnings
                .iter()
                .any(|warning| warning.severity == Severity::Error)
    }

    /// Whether CARLA's client reads something differently that it should read alike.
    pub fn differs(&self) -> bool {
        self.comparison.as_ref().is_some_and(Comparison::differs)
    }

    /// The report as text. Its first line says whether the map is sound.
    pub fn as_text(&self, max_warnings: usize) -> String {
        let verdict = if self.is_broken() {
            "broken"
        } else if self.differs() {
            "differs"
        } else {
            "ok"
        };
        let mut text = format!("{verdict:<8}{}", self.name);
        // Writing to a String cannot fail.
        let _ = match (&self.contents, &self.error) {
            (Some(contents), _) => writeln!(text, ": {}", contents.sentence()),
            (None, error) => writeln!(text, ": {}", error.as_deref().unwrap_or("cannot be read")),
        };
        let shown = max_warnings.min(self.warnings.len());
        let mut ordered: Vec<&Warning> = self.warnings.iter().collect();
        ordered.sort_by_key(|warning| std::cmp::Reverse(warning.severity));
        for warning in &ordered[..shown] {
            let word = if warning.severity == Severity::Error {
                "error"
            } else {
                "warning"
            };
            let _ = writeln!(text, "        {word}: {warning}");
        }
        if shown < self.warnings.len() {
            let _ = writeln!(
                text,
                "        {} more; --all prints them",
                self.warnings.len() - shown
            );
        }
        if let Some(comparison) = &self.comparison {
            for finding in comparison.findings() {
                let _ = writeln!(
                    text,
                    "        carla{} {}",
                    if finding.agrees { ":" } else { " differs:" },
                    finding.text
                );
            }
        }
        text
    }

    /// One object.
    pub fn as_json(&self) -> serde_json::Value {
        let warnings: Vec<_> = self
            .warnings
            .iter()
            .map(|w| json!({"error": w.severity == Severity::Error, "line": w.line, "column": w.column, "text": w.text}))
            .collect();
        json!({
            "map": self.name, "sound": !self.is_broken(), "error": self.error, "warnings": warnings,
            "contents": self.contents.as_ref().map(Contents::as_json), "carla": self.comparison.as_ref().map(Comparison::as_json),
        })
    }
}
