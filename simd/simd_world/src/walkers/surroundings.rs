//! What walkers need of the rest of the world to take a step.

use schema_roads::RoadMap;

use crate::physics::Physics;
use crate::signals::TrafficLights;
use crate::vehicles::Vehicles;

/// The world around the walkers.
pub(crate) struct Surroundings<'w> {
    pub physics: &'w Physics,
    pub vehicles: &'w Vehicles,
    pub lights: &'w TrafficLights,
    pub roads: Option<&'w RoadMap>,
    /// Seed of the strollers' ways.
    pub seed: u64,
    /// Height of the map's origin, metres.
    pub origin_z_m: f64,
}
