//! Vehicles that the measured fleet does not know: each keeps the right of way that the rules give
//! it, at a speed of its own, and brakes for nobody who owes it that.
//!
//! They are driven by a fleet of their own, so that they follow lanes, lights and signs. Where they
//! have priority they do not see what crosses their way or comes towards them; turning left, or where
//! a sign or nothing gives them priority, they look out as usual.

use std::collections::BTreeSet;
use std::sync::Arc;

use consumer_driver::plane::wrap;
use consumer_driver::{Driver, Fleet, Geometry, Mover, Settings, SpeedRule, Traffic};
use schema_frames::VehicleControlRecord;
use schema_roads::{RoadMap, SignalKind};

/// Ways that cross at a greater angle are those of traffic that crosses or comes towards it.
const CROSSING_RAD: f64 = 0.8;
/// A vehicle slower than this already stands in the way and is no matter of priority, m/s.
const STANDING_MPS: f64 = 1.0;
/// How far ahead a junction is looked for, metres: what 130 km/h need to stop, and more.
const AHEAD_M: f64 = 200.0;
/// A way that bends further to the left turns left and waits for oncoming traffic.
const LEFT_RAD: f64 = 0.5;

/// All strangers.
pub struct Strangers {
    roads: Arc<RoadMap>,
    fleet: Fleet,
    settings: Settings,
    ids: Vec<u32>,
    /// Junctions some of whose ways have a sign or a light.
    ruled: BTreeSet<u32>,
}

impl Strangers {
    /// Drives these vehicles, the n-th at the n-th of `speeds_kmh`, beginning anew after the last.
    pub fn new(roads: &Arc<RoadMap>, ids: &[u32], speeds_kmh: &[f64], seed: u64) -> Strangers {
        let mut settings = Settings {
            seed: seed ^ 0x5eed,
            ..Settings::default()
        };
        for (id, kmh) in ids.iter().zip(speeds_kmh.iter().cycle()) {
            let own = settings.vehicle_mut(*id);
            own.speed = SpeedRule::Desired(kmh / 3.6);
            own.changes_lanes = false;
        }
        let stops = roads.signals().iter().filter(|signal| rules(signal.kind));
        Strangers {
            ruled: stops.filter_map(|signal| signal.junction).collect(),
            roads: roads.clone(),
            fleet: Fleet::new(roads.clone()),
            settings,
            ids: ids.to_vec(),
        }
    }

    pub fn ids(&self) -> &[u32] {
        &self.ids
    }

    pub fn assign(&mut self, traffic: &Traffic, geometry: impl Fn(u32) -> Option<Geometry>) {
        self.fleet.assign(&self.ids, traffic, geometry);
    }

    /// Their controls in this tick.
    pub fn step(&mut self, traffic: &Traffic) -> Vec<VehicleControlRecord> {
        for id in &self.ids {
            let (Some(me), Some(driver)) = (traffic.mover(*id), self.fleet.drivers().get(id))
            else {
                continue;
            };
            let crosses = |other: &&Mover| {
                other.is_vehicle
                    && wrap(other.yaw_rad - me.yaw_rad).abs() > CROSSING_RAD
                    && other.speed_mps.abs() > STANDING_MPS
            };
            let unseen: BTreeSet<u32> = match self.has_priority(driver) {
                true => (traffic.movers.iter().filter(crosses))
                    .map(|it| it.id)
                    .collect(),
                false => BTreeSet::new(),
            };
            self.settings.vehicle_mut(*id).ignored = unseen;
        }
        self.fleet.step(traffic, &mut self.settings).controls
    }

    /// Whether everybody else has to wait for it at the junction that it is in or comes to.
    fn has_priority(&self, driver: &Driver) -> bool {
        let here_m = driver.foot().arc_m;
        let mut entries = driver.entries().iter();
        let Some(entry) = entries.find(|it| it.arc_m[1] > here_m) else {
            return true;
        };
        if entry.arc_m[0] > here_m + AHEAD_M {
            return true;
        }
        let turns_left = entry.turn_rad > LEFT_RAD;
        let mut legs = driver.path().legs().iter();
        let is_ruled = legs.any(|leg| {
            let is_inside = leg.arc_m[0] < entry.arc_m[1] && leg.arc_m[1] > entry.arc_m[0];
            let junction = self.roads.lanes()[leg.lane as usize].junction;
            is_inside && junction.is_some_and(|junction| self.ruled.contains(&junction))
        });
        !turns_left && entry.sign.is_none() && (entry.has_light || is_ruled)
    }
}

/// Whether a signal says who goes first.
fn rules(kind: SignalKind) -> bool {
    matches!(
        kind,
        SignalKind::TrafficLight | SignalKind::Stop | SignalKind::Yield
    )
}
