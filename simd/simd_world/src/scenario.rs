//! Fills a map with traffic: the ego, other vehicles and strollers, at places drawn by lot.

use std::collections::BTreeMap;
use std::sync::Arc;

use schema_roads::walkable::Pavements;
use schema_types::noise::Noise;
use schema_types::{ActorId, Pose};

use crate::errors::SpawnError;
use crate::vehicles::{VehicleModel, color_text, vehicle_models};
use crate::walkers::draw_candidate;
use crate::world::World;

/// Random stream of the scenario: no other use of the seed has this number.
const STREAM: u64 = 0x5ce7_a210;

/// Which ego vehicle to spawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EgoSpawn<'s> {
    /// Catalogue id.
    pub type_id: &'s str,
    /// Index of the preferred spawn point; if it is taken, the following ones are tried in order.
    pub spawn_idx: usize,
}

/// The vehicles that were put on the map.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scenario {
    /// The vehicle with role `ego_vehicle`; `None` if none was asked for.
    pub ego: Option<ActorId>,
    /// Vehicles with role `autopilot`; fewer than asked for if the map has too few free spawn
    /// points.
    pub others: Vec<ActorId>,
}

impl World {
    /// Puts the ego, if one is asked for, at a spawn point and then `n_vehicles` others at the
    /// remaining points; their places, kinds and colours follow from the seed.
    ///
    /// # Errors
    /// If the ego can be put nowhere. A taken place is no error: the ego, like the others, moves on
    /// to the next one.
    pub fn spawn_scenario(
        &mut self,
        ego: Option<EgoSpawn<'_>>,
        n_vehicles: usize,
    ) -> Result<Scenario, SpawnError> {
        let points = self.map.spawn_points.clone();
        let ego = ego.map(|ego| self.spawn_ego(&points, ego)).transpose()?;
        let noise = Noise::new(self.options.seed, STREAM, 0);
        let is_free = |idx: &usize| ego.is_none_or(|(_, ego_idx)| *idx != ego_idx);
        let mut order: Vec<usize> = (0..points.len()).filter(is_free).collect();
        order.sort_by_key(|idx| (noise.bits(*idx as u64), *idx));
        let mut others = Vec::new();
        for idx in order {
            if others.len() == n_vehicles {
                break;
            }
            let draw = Noise::new(self.options.seed, STREAM, 1 + others.len() as u64);
            let model = pick_model(draw);
            let color = model.colors[(draw.bits(2) % model.colors.len() as u64) as usize];
            let attributes = BTreeMap::from([("color".to_owned(), color_text(color))]);
            match self.spawn(model.type_id, points[idx], None, "autopilot", &attributes) {
                Ok(actor) => others.push(actor),
                Err(error) => tracing::debug!(spawn_point = idx, %error, "spawn point is not free"),
            }
        }
        if others.len() < n_vehicles {
            tracing::warn!(
                asked = n_vehicles,
                placed = others.len(),
                "fewer vehicles than asked for: the map has too few free spawn points"
            );
        }
        Ok(Scenario {
            ego: ego.map(|(actor, _)| actor),
            others,
        })
    }

    /// Puts `n` strollers on pavements, fewer if the map has no room. Their kinds and places follow
    /// from the seed.
    pub fn spawn_walkers(&mut self, n: usize) -> Vec<ActorId> {
        let Some(roads) = self.roads.clone().filter(|_| n > 0) else {
            return Vec::new();
        };
        let ground = Arc::new(Pavements::new(&roads, false));
        let mut crowd = Vec::new();
        for attempt in 0..4 * n as u64 {
            let candidate = draw_candidate(&ground, self.options.seed, attempt);
            let Some(candidate) = candidate.filter(|_| crowd.len() < n) else {
                break;
            };
            let type_id = &candidate.model.type_id;
            let spawned = self.spawn(
                type_id,
                candidate.pose,
                None,
                "pedestrian",
                &BTreeMap::new(),
            );
            if let Ok(actor) = spawned {
                self.walkers.crowd.add(actor, candidate.speed_mps);
                crowd.push(actor);
            }
        }
        self.walkers.crowd.ground = Some(ground);
        crowd
    }

    /// Spawns the ego; returns it and the index of its spawn point.
    fn spawn_ego(
        &mut self,
        points: &[Pose],
        ego: EgoSpawn<'_>,
    ) -> Result<(ActorId, usize), SpawnError> {
        let mut result = Err(SpawnError::SpawnPoint {
            idx: ego.spawn_idx,
            map: self.map.name.clone(),
            n_points: points.len(),
        });
        let before = if ego.spawn_idx < points.len() {
            0..ego.spawn_idx
        } else {
            0..0
        };
        for idx in (ego.spawn_idx..points.len()).chain(before) {
            result = self
                .spawn(
                    ego.type_id,
                    points[idx],
                    None,
                    "ego_vehicle",
                    &BTreeMap::new(),
                )
                .map(|actor| (actor, idx));
            if !matches!(result, Err(SpawnError::Occupied { .. })) {
                break;
            }
        }
        result
    }
}

/// Largest half length and half width of vehicles that pass a town's junctions without swinging
/// into the next lane, metres.
const FITS_HALF_M: [f64; 2] = [3.5, 1.35];

/// Draws a model: mostly cars, some vans, and now and then a motorcycle or a lorry or bus that fits
/// the lanes.
fn pick_model(draw: Noise) -> &'static VehicleModel {
    let base_type = match draw.bits(0) % 100 {
        0..74 => "car",
        74..86 => "van",
        86..92 => "truck",
        92..95 => "bus",
        _ => "motorcycle",
    };
    let fits = |model: &&VehicleModel| {
        model.half_m[0] <= FITS_HALF_M[0] && model.half_m[1] <= FITS_HALF_M[1]
    };
    let of = |kind: &str| {
        vehicle_models()
            .iter()
            .filter(|model| model.base_type == kind)
            .filter(fits)
            .collect::<Vec<_>>()
    };
    let of_type = Some(of(base_type))
        .filter(|list| !list.is_empty())
        .unwrap_or_else(|| of("car"));
    of_type[(draw.bits(1) % of_type.len() as u64) as usize]
}
