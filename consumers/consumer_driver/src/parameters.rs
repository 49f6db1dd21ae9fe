//! What may be set about driving, for all vehicles and for single ones: the parameters of CARLA's
//! Traffic Manager in SI units, with positive offsets to the left.
//!
//! A vehicle's own value is taken before the one for all vehicles. Values that no driver could use
//! are brought into their range where they are used, so that a setting never stops the traffic of
//! others.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::plane::Side;

/// What holds for all vehicles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// How much slower than the limit to drive, percent of the limit; negative is faster.
    pub speed_difference_percent: f64,
    /// Gap to a vehicle ahead in standstill, metres.
    pub distance_to_leader_m: f64,
    /// Offset from the middle of the lane, metres, positive to the left.
    pub lane_offset_m: f64,
    /// Whether drivers switch brake lamps, blinkers, low beam and fog lamps.
    pub updates_lights: bool,
    /// Radius around heroes within which vehicles obey physics, metres; `None`: everywhere.
    pub hybrid_radius_m: Option<f64>,
    /// Least and greatest distance from a hero at which vehicles that are far from every hero
    /// appear again, metres; `None`: they stay where they are.
    pub respawn_m: Option<[f64; 2]>,
    /// Whether vehicles that come to the end of a road are removed.
    pub removes_at_dead_ends: bool,
    /// Whether vehicles that stood for long without a reason are removed.
    pub removes_stuck: bool,
    /// Whether it is dark, wet or foggy, for vehicles whose lamps are updated.
    pub surroundings: Surroundings,
}

impl Default for Parameters {
    fn default() -> Self {
        Parameters {
            speed_difference_percent: 0.0,
            distance_to_leader_m: 2.0,
            lane_offset_m: 0.0,
            updates_lights: true,
            hybrid_radius_m: None,
            respawn_m: None,
            removes_at_dead_ends: false,
            removes_stuck: false,
            surroundings: Surroundings::default(),
        }
    }
}

/// What the weather asks of lamps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Surroundings {
    /// Whether low beams are needed.
    pub dark: bool,
    /// Whether fog lamps are needed.
    pub foggy: bool,
}

/// How fast to drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum SpeedRule {
    /// As all vehicles.
    #[default]
    Common,
    /// Slower than the limit by this share of it, percent; negative is faster.
    Difference(f64),
    /// This speed whatever the limit, m/s.
    Desired(f64),
}

/// A decision on the way: CARLA's `RoadOption`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RoadOption {
    /// Turn left at the next junction.
    Left,
    /// Turn right at the next junction.
    Right,
    /// Go straight on at the next junction.
    Straight,
    /// Follow the lane.
    LaneFollow,
    /// Change to the lane on the left.
    ChangeLaneLeft,
    /// Change to the lane on the right.
    ChangeLaneRight,
}

/// What holds for one vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VehicleParameters {
    /// How fast to drive.
    pub speed: SpeedRule,
    /// Gap to a vehicle ahead in standstill, metres.
    pub distance_to_leader_m: Option<f64>,
    /// Offset from the middle of the lane, metres, positive to the left.
    pub lane_offset_m: Option<f64>,
    /// Share of traffic lights that it ignores, percent.
    pub ignore_lights_percent: f64,
    /// Share of stop and yield signs that it ignores, percent.
    pub ignore_signs_percent: f64,
    /// Share of vehicles that it ignores, percent.
    pub ignore_vehicles_percent: f64,
    /// Share of walkers that it ignores, percent.
    pub ignore_walkers_percent: f64,
    /// Whether it changes lanes by itself.
    pub changes_lanes: bool,
    /// A change of lanes to make at the next chance; taken away when it begins.
    pub forced_lane_change: Option<Side>,
    /// Chance that it changes to the left without need, percent.
    pub random_left_percent: f64,
    /// Chance that it changes to the right without need, percent.
    pub random_right_percent: f64,
    /// Share of its thoughts about another lane in which it keeps to the right, percent.
    pub keep_right_percent: f64,
    /// Actors that it neither sees nor avoids.
    pub ignored: BTreeSet<u32>,
    /// Places to drive to one after the other, world, metres; taken away as they are reached.
    pub custom_path_m: Vec<[f64; 3]>,
    /// Decisions to take one after the other; taken away as they are carried out.
    pub route: Vec<RoadOption>,
    /// Whether its lamps are updated.
    pub updates_lights: Option<bool>,
}

impl Default for VehicleParameters {
    fn default() -> Self {
        VehicleParameters {
            speed: SpeedRule::Common,
            distance_to_leader_m: None,
            lane_offset_m: None,
            ignore_lights_percent: 0.0,
            ignore_signs_percent: 0.0,
            ignore_vehicles_percent: 0.0,
            ignore_walkers_percent: 0.0,
            changes_lanes: true,
            forced_lane_change: None,
            random_left_percent: 0.0,
            random_right_percent: 0.0,
            keep_right_percent: 0.0,
            ignored: BTreeSet::new(),
            custom_path_m: Vec::new(),
            route: Vec::new(),
            updates_lights: None,
        }
    }
}

/// All that is set: for all vehicles, for single ones, and the seed of their choices.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// What holds for all vehicles.
    pub common: Parameters,
    /// What holds for single vehicles, by id; those that are not named have the defaults.
    pub vehicles: BTreeMap<u32, VehicleParameters>,
    /// Decides every choice of every driver.
    pub seed: u64,
}

impl Settings {
    /// What a driver reads; `plain` is taken where nothing is set for its vehicle.
    pub(crate) fn rules<'p>(&'p self, id: u32, plain: &'p VehicleParameters) -> Rules<'p> {
        Rules {
            common: &self.common,
            own: self.vehicles.get(&id).unwrap_or(plain),
        }
    }

    /// What holds for a vehicle, to be changed.
    pub fn vehicle_mut(&mut self, id: u32) -> &mut VehicleParameters {
        self.vehicles.entry(id).or_default()
    }
}

/// A decision ahead of a vehicle, and where it is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Action {
    /// The decision.
    pub option: RoadOption,
    /// Where, world, metres.
    pub position_m: [f64; 3],
    /// Direction of travel there, radians.
    pub heading_rad: f64,
}

/// Both sets of parameters, as one driver reads them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules<'p> {
    pub common: &'p Parameters,
    pub own: &'p VehicleParameters,
}

impl Rules<'_> {
    /// Speed to drive where the limit is `limit_mps`, m/s.
    pub fn speed_mps(&self, limit_mps: f64) -> f64 {
        let share = |percent: f64| (1.0 - percent / 100.0).clamp(0.0, 10.0);
        match self.own.speed {
            SpeedRule::Desired(speed_mps) => speed_mps.clamp(0.0, 100.0),
            SpeedRule::Difference(percent) => share(percent) * limit_mps,
            SpeedRule::Common => share(self.common.speed_difference_percent) * limit_mps,
        }
    }

    /// Gap to a vehicle ahead in standstill, metres.
    pub fn standing_gap_m(&self) -> f64 {
        let gap = self
            .own
            .distance_to_leader_m
            .unwrap_or(self.common.distance_to_leader_m);
        gap.clamp(0.5, 100.0)
    }

    /// Offset from the middle of the lane, metres, positive to the left.
    pub fn lane_offset_m(&self) -> f64 {
        let offset = self.own.lane_offset_m.unwrap_or(self.common.lane_offset_m);
        offset.clamp(-5.0, 5.0)
    }

    /// Whether its lamps are updated.
    pub fn updates_lights(&self) -> bool {
        self.own
            .updates_lights
            .unwrap_or(self.common.updates_lights)
    }
}
