//! What is prepared once for all members: the town, routes on it, and a world per kind of episode.

use std::collections::BTreeMap;
use std::sync::Arc;

use schema_frames::{Command, PhysicsAction, VehicleControl};
use schema_roads::LaneKey;
use schema_types::noise::Noise;
use schema_types::{ActorId, Pose};
use simd_town::Town;
use simd_world::{Checkpoint, MapData, World, WorldOptions, walker_models};

use crate::actors::Other;
use crate::error::CourseError;
use crate::route::Route;
use crate::task::{Rules, Task};

/// Seed of the town, as everywhere.
const TOWN_SEED: u64 = 1;
/// Routes to draw from.
const N_ROUTES: usize = 64;
/// Lots that are drawn for them.
const N_LOTS: u64 = 20_000;
/// An episode begins within these first metres of its route.
pub(crate) const STARTS_M: f64 = 60.0;
/// Length of a route beyond what the fastest start could need, metres.
const SPARE_M: f64 = 150.0;
/// Narrower lanes are left out: half the width, metres.
const LEAST_HALF_WIDTH_M: f64 = 1.4;
/// Steps in which a prepared world comes to rest.
const REST_STEPS: usize = 40;
/// Where others wait in a prepared world, metres from the start of the first route.
const OTHER_AT_M: f64 = 40.0;
/// Random streams.
const ROUTES: u64 = 0x726f_7574;
const LEAD_TYPE: &str = "vehicle.audi.tt";

/// A world that episodes of one kind begin from.
pub(crate) struct Prepared {
    pub checkpoint: Checkpoint,
    pub other: Other,
}

/// A task in its town.
pub struct Course {
    pub(crate) task: Task,
    pub(crate) routes: Vec<Route>,
    /// Nobody, a lead, a person; the last two only where the rules have them.
    pub(crate) prepared: Vec<Prepared>,
    pub(crate) ego: ActorId,
    pub(crate) resting: World,
}

impl Course {
    /// Prepares a task; `seed` is that of the routes.
    ///
    /// # Errors
    /// [`CourseError`].
    pub fn new(task: Task, seed: u64) -> Result<Course, CourseError> {
        let town = Town::generate(&task.town, TOWN_SEED)?;
        let map = Arc::new(MapData::from(&town));
        let mut world = World::new(WorldOptions::default());
        world.load_shared(&map)?;
        let routes = draw_routes(&task, &world, seed)?;
        let first = &routes[0];
        let place: Pose = first.pose(0.0, 0.0).into();
        let ego = world.spawn(&task.vehicle, place, None, "ego_vehicle", &BTreeMap::new())?;
        let brake = VehicleControl {
            brake_ratio: 1.0,
            ..VehicleControl::default()
        };
        world.set_control(ego, brake)?;
        let nanos = u64::from(task.tick_ms) * 1_000_000;
        let rest = |mut world: World, other| {
            (0..REST_STEPS).for_each(|_| world.step(nanos));
            let checkpoint = world.checkpoint(0);
            Prepared { checkpoint, other }
        };
        let mut prepared = vec![rest(world.clone(), Other::Nobody)];
        if matches!(task.rules, Rules::EmergencyBrake(_)) {
            let there: Pose = first.pose(OTHER_AT_M, 0.0).into();
            let mut with_lead = world.clone();
            let lead = with_lead.spawn(LEAD_TYPE, there, None, "lead", &BTreeMap::new())?;
            with_lead.apply(&Command::Physics {
                actor_id: lead.0,
                action: PhysicsAction::SetSimulated { enabled: false },
            });
            prepared.push(rest(with_lead, Other::Lead(lead)));
            let mut with_person = world.clone();
            let model_idx = 0;
            let type_id = &walker_models()[model_idx].type_id;
            let mut standing = there;
            standing.translation_m[2] += 1.0;
            let actor = with_person.spawn(type_id, standing, None, "person", &BTreeMap::new())?;
            prepared.push(rest(with_person, Other::Person { actor, model_idx }));
        }
        Ok(Course {
            task,
            routes,
            prepared,
            ego,
            resting: world,
        })
    }

    /// The task.
    pub fn task(&self) -> &Task {
        &self.task
    }
}

fn draw_routes(task: &Task, world: &World, seed: u64) -> Result<Vec<Route>, CourseError> {
    let straight = matches!(task.rules, Rules::EmergencyBrake(_));
    let fastest_mps = match straight {
        true => task.start.speed_mps[1],
        false => 1.5 * task.start.speed_mps[1],
    };
    let reach_m = fastest_mps * f64::from(task.limit_steps) * task.step_secs();
    let length_m = STARTS_M + reach_m + SPARE_M;
    let refuse = || CourseError::NoRoute {
        town: task.town.clone(),
        task: task.name.clone(),
        needed: format!(
            "{}way of {length_m:.0} m",
            if straight { "straight " } else { "" }
        ),
    };
    let roads = world.roads().ok_or_else(refuse)?;
    let lanes = roads.lanes().iter();
    let starts: Vec<LaneKey> = lanes
        .filter(|lane| lane.kind.is_drivable() && lane.junction.is_none())
        .map(|lane| lane.key)
        .collect();
    let mut routes = Vec::new();
    for lot in 0..N_LOTS {
        let noise = Noise::new(seed, ROUTES, lot);
        let Some(start) = (noise.bits(0) as usize)
            .checked_rem(starts.len())
            .map(|idx| starts[idx])
        else {
            break;
        };
        let branches = Noise::new(seed, ROUTES + 1, lot);
        let Some(route) = Route::along(roads, start, length_m, branches) else {
            continue;
        };
        let is_wide = route.least_half_width_m() >= LEAST_HALF_WIDTH_M;
        let is_fit = !straight || route.greatest_turn_rad(STARTS_M + 200.0) < 0.1;
        if is_wide && is_fit {
            routes.push(route);
        }
        if routes.len() == N_ROUTES {
            break;
        }
    }
    match routes.is_empty() {
        true => Err(refuse()),
        false => Ok(routes),
    }
}
