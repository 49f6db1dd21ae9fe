//! What is put on the road for a trial, and where: numbers drawn from the seed, in the road's own
//! space, whose x axis runs from the ego's start along its lane and whose y axis points to the left.

use anyhow::Context as _;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schema_frames::{ActorInfo, ActorRecord, Catalogue};
use schema_types::noise::Noise;
use serde::{Deserialize, Serialize};

use super::suite::{Kind, KindSettings, Side, Suite};

/// From the middle of the ego's lane to that of the next one if a suite says nothing, metres.
const LANE_M: f64 = 3.6;
/// Room between the van and the person behind it, metres.
const BEHIND_VAN_M: f64 = 0.9;
/// How far inside of the van's near side the person waits, metres: so far that the view ends at the
/// van's high sides and not at its bonnet.
const INSIDE_VAN_M: f64 = 1.0;
/// Height above the road at which vehicles are put down, metres.
const DROP_M: f64 = 0.3;
/// People that step out.
const PEOPLE: [&str; 6] = [
    "walker.pedestrian.0001",
    "walker.pedestrian.0004",
    "walker.pedestrian.0007",
    "walker.pedestrian.0015",
    "walker.pedestrian.0020",
    "walker.pedestrian.0026",
];
/// Cars that cut in or brake.
const CARS: [&str; 4] = [
    "vehicle.tesla.model3",
    "vehicle.audi.etron",
    "vehicle.nissan.patrol",
    "vehicle.lincoln.mkz_2020",
];
/// What hides the person.
const VAN: &str = "vehicle.mercedes.sprinter";

/// The numbers of one trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// What happens.
    pub kind: Kind,
    /// Number of the trial among those of its kind, from 0.
    pub number: u32,
    /// Wait after the settling, simulated seconds.
    pub wait_s: f64,
    /// Distance from the ego's origin at the command, metres.
    pub distance_m: f64,
    /// Speed of the obstacle, m/s.
    pub speed_mps: f64,
    /// How hard the car ahead brakes, 0 to 1.
    pub brake_ratio: f64,
    /// 1: it comes from the left; −1: from the right.
    pub side: f64,
    /// Catalogue id of the obstacle; empty for a traffic light.
    pub type_id: String,
}

impl Plan {
    /// Draws the numbers of a trial, which depend on the seed, the kind and the number alone.
    pub fn draw(suite: &Suite, kind: Kind, number: u32) -> Plan {
        let stream = Kind::ALL.iter().position(|it| *it == kind).unwrap_or(0) as u64;
        let noise = Noise::new(suite.seed, stream, u64::from(number));
        let within =
            |sample: u64, [low, high]: [f64; 2]| low + (high - low) * noise.uniform(sample);
        let none = KindSettings::default();
        let settings = suite.kind.get(&kind).unwrap_or(&none);
        let one_of =
            |names: &[&str]| names[(noise.bits(5) % names.len() as u64) as usize].to_owned();
        let type_id = settings.type_id.clone().unwrap_or_else(|| match kind {
            Kind::PedestrianStepsOut => one_of(&PEOPLE),
            Kind::CutIn | Kind::LeadBrakes => one_of(&CARS),
            Kind::LightTurnsRed => String::new(),
        });
        let side = match settings.side {
            Side::Left => 1.0,
            Side::Right => -1.0,
            Side::Both if noise.bits(4) & 1 == 0 => 1.0,
            Side::Both => -1.0,
        };
        Plan {
            kind,
            number,
            wait_s: within(0, suite.wait_s),
            distance_m: within(1, settings.distance(kind)),
            speed_mps: within(2, settings.speed(kind, suite.speed_mps)),
            brake_ratio: within(3, settings.brake_ratio.unwrap_or([0.6, 1.0])),
            side,
            type_id,
        }
    }
}

/// The road: level and straight ahead of the ego's start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Road {
    /// Its space in the world.
    pub world_from_road: Isometry3<f64>,
}

impl Road {
    /// The road ahead of a vehicle that stands on it.
    pub fn ahead_of(vehicle: &ActorRecord) -> Road {
        let pose = &vehicle.world_from_actor;
        Road {
            world_from_road: Isometry3::from_parts(
                Translation3::from(pose.translation_m),
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.yaw_rad()),
            ),
        }
    }

    /// A level pose on it, `yaw_rad` counter-clockwise from its direction.
    pub fn at(&self, x_m: f64, y_m: f64, z_m: f64, yaw_rad: f64) -> Isometry3<f64> {
        self.world_from_road * Isometry3::new(Vector3::new(x_m, y_m, z_m), Vector3::z() * yaw_rad)
    }

    /// A velocity along it, in the world, m/s.
    pub fn velocity(&self, mps: f64) -> [f64; 3] {
        (self.world_from_road.rotation * Vector3::new(mps, 0.0, 0.0)).into()
    }

    /// Pose of an actor in the road's space.
    pub fn of(&self, actor: &ActorRecord) -> Isometry3<f64> {
        self.world_from_road.inverse() * actor.world_from_actor.isometry()
    }
}

/// An actor to be spawned for a trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Prop {
    /// Catalogue id.
    pub type_id: String,
    /// Where, in the world.
    pub pose: Isometry3<f64>,
    /// Whether it is the obstacle; else it hides it.
    pub is_obstacle: bool,
    /// Speed along the road to begin with, m/s.
    pub speed_mps: f64,
}

/// The actors of a trial, the obstacle last. `ego_mps` is the ego's speed and `until_go_secs` the
/// time from the beginning to the command.
///
/// # Errors
/// If the catalogue lacks what a suite names.
pub fn props(
    plan: &Plan,
    suite: &Suite,
    road: &Road,
    catalogue: &Catalogue,
    until_go_secs: f64,
) -> anyhow::Result<Vec<Prop>> {
    let none = KindSettings::default();
    let settings = suite.kind.get(&plan.kind).unwrap_or(&none);
    let half = |type_id: &str| {
        catalogue
            .entries
            .iter()
            .find(|entry| entry.type_id == type_id)
            .map(|entry| entry.body_box.half_m.map(f64::from))
            .with_context(|| format!("the simulator has no actor {type_id:?}"))
    };
    let lane_m = settings.lane_m.unwrap_or(LANE_M);
    let ego_x = suite.speed_mps * until_go_secs;
    let obstacle = |pose: Isometry3<f64>, speed_mps: f64| Prop {
        type_id: plan.type_id.clone(),
        pose,
        is_obstacle: true,
        speed_mps,
    };
    match plan.kind {
        Kind::LightTurnsRed => Ok(Vec::new()),
        Kind::PedestrianStepsOut => {
            let van = settings.occluder.as_deref().unwrap_or(VAN);
            let ([van_x, van_y, _], [_, _, person_z]) = (half(van)?, half(&plan.type_id)?);
            let at_x = ego_x + plan.distance_m;
            let at_y = plan.side * (lane_m - van_y + INSIDE_VAN_M);
            // It faces the road.
            let yaw_rad = -plan.side * std::f64::consts::FRAC_PI_2;
            Ok(vec![
                Prop {
                    type_id: van.to_owned(),
                    pose: road.at(at_x - BEHIND_VAN_M - van_x, plan.side * lane_m, DROP_M, 0.0),
                    is_obstacle: false,
                    speed_mps: 0.0,
                },
                obstacle(road.at(at_x, at_y, person_z + 0.05, yaw_rad), 0.0),
            ])
        }
        Kind::CutIn => {
            half(&plan.type_id)?;
            let at_x = ego_x + plan.distance_m - plan.speed_mps * until_go_secs;
            Ok(vec![obstacle(
                road.at(at_x, plan.side * lane_m, DROP_M, 0.0),
                plan.speed_mps,
            )])
        }
        Kind::LeadBrakes => {
            half(&plan.type_id)?;
            Ok(vec![obstacle(
                road.at(plan.distance_m, 0.0, DROP_M, 0.0),
                suite.speed_mps,
            )])
        }
    }
}

/// A traffic light that holds on the ego's lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Its actor id.
    pub id: u32,
    /// Where one stops for it, metres along the road.
    pub stop_x_m: f64,
}

/// The nearest light ahead of the ego's start whose stop box lies on its lane.
pub fn light_ahead(road: &Road, lights: &[(&ActorInfo, &ActorRecord)]) -> Option<Light> {
    let mut found: Option<Light> = None;
    for (info, record) in lights {
        let Some(trigger) = info.trigger_box else {
            continue;
        };
        let road_from_box =
            road.of(record) * Isometry3::from(Translation3::from(trigger.centre_m.map(f64::from)));
        let across = road_from_box
            .rotation
            .to_rotation_matrix()
            .matrix()
            .row(1)
            .abs();
        let extent_m = (across * Vector3::from(trigger.half_m.map(f64::from)))[0];
        let at = road_from_box.translation.vector;
        if at.x > 0.0 && at.y.abs() <= extent_m && found.is_none_or(|it| at.x < it.stop_x_m) {
            found = Some(Light {
                id: record.id,
                stop_x_m: at.x,
            });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use schema_frames::document::{BodyBox, CatalogueEntry};
    use schema_types::Pose;

    use super::*;

    fn suite() -> Suite {
        toml::from_str(
            "version = 1\nlaunch = []\nroad_m = 100\ntruth = { sensor = \"front\" }\nstage = []\n\
             [kind.pedestrian_steps_out]\ndistance_m = [15, 30]\n[kind.cut_in]\nside = \"left\"\n",
        )
        .unwrap()
    }

    fn catalogue() -> Catalogue {
        let entry = |type_id: &str, half_m: [f32; 3]| CatalogueEntry {
            type_id: type_id.into(),
            kind: String::new(),
            class: 0,
            body_box: BodyBox {
                centre_m: [0.0; 3],
                half_m,
            },
            attributes: Default::default(),
            recommended: Default::default(),
        };
        let people = PEOPLE.map(|it| entry(it, [0.2, 0.25, 0.9]));
        let cars = CARS.map(|it| entry(it, [2.4, 1.0, 0.8]));
        Catalogue {
            entries: people
                .into_iter()
                .chain(cars)
                .chain([entry(VAN, [3.0, 1.0, 1.3])])
                .collect(),
        }
    }

    #[test]
    fn trials_differ_lie_within_their_ranges_and_come_again_with_the_seed() {
        let suite = suite();
        let draw = |number| Plan::draw(&suite, Kind::PedestrianStepsOut, number);
        let plans: Vec<Plan> = (0..200).map(draw).collect();
        assert_eq!(plans[7], draw(7));
        for plan in &plans {
            assert!((15.0..=30.0).contains(&plan.distance_m), "{plan:?}");
            assert!((0.5..=1.5).contains(&plan.wait_s), "{plan:?}");
        }
        let mean = plans.iter().map(|it| it.distance_m).sum::<f64>() / 200.0;
        assert!((mean - 22.5).abs() < 1.0, "{mean}");
        let left = plans.iter().filter(|it| it.side > 0.0).count();
        assert!((70..=130).contains(&left), "{left}");
        assert!((0..50).all(|n| Plan::draw(&suite, Kind::CutIn, n).side == 1.0));
    }

    #[test]
    fn the_van_hides_the_person_from_the_ego_at_the_command() {
        let suite = suite();
        let road = Road {
            world_from_road: Pose::from_xyz_yaw(5.0, -3.0, 0.2, 0.7).isometry(),
        };
        for number in 0..100 {
            let plan = Plan::draw(&suite, Kind::PedestrianStepsOut, number);
            let props = props(&plan, &suite, &road, &catalogue(), 1.5).unwrap();
            let in_ego = |prop: &Prop| {
                let at = road.world_from_road.inverse() * prop.pose;
                at.translation.vector - Vector3::new(suite.speed_mps * 1.5, 0.0, 0.0)
            };
            let (van, person) = (in_ego(&props[0]), in_ego(&props[1]));
            assert!((person.x - plan.distance_m).abs() < 1e-9);
            // The ray past the van's near side, 1.5 m before its far end where its bonnet begins, at
            // the person's distance.
            let corner = (van.x + 1.5, van.y.abs() - 1.0);
            let edge = corner.1 * person.x / corner.0;
            assert!(person.y.abs() - 0.25 > edge, "{number}: {person:?} {edge}");
            assert!(person.x > van.x + 3.0 && person.y * van.y > 0.0);
        }
    }

    #[test]
    fn the_car_that_cuts_in_is_as_far_ahead_as_planned_at_the_command() {
        let suite = suite();
        let road = Road {
            world_from_road: Isometry3::identity(),
        };
        let plan = Plan::draw(&suite, Kind::CutIn, 3);
        let car = &props(&plan, &suite, &road, &catalogue(), 2.0).unwrap()[0];
        let at_go = car.pose.translation.x + 2.0 * car.speed_mps;
        assert!((at_go - 2.0 * suite.speed_mps - plan.distance_m).abs() < 1e-9);
        assert_eq!(car.pose.translation.y, LANE_M);
        let missing = props(&plan, &suite, &road, &Catalogue::default(), 2.0)
            .unwrap_err()
            .to_string();
        assert!(missing.contains(&plan.type_id), "{missing}");
    }

    #[test]
    fn the_light_is_the_nearest_one_whose_stop_box_lies_on_the_lane() {
        let info = |id: u32| ActorInfo {
            id,
            type_id: String::new(),
            kind: "traffic_light".into(),
            role: String::new(),
            parent_id: 0,
            mount: None,
            body_box: BodyBox {
                centre_m: [0.0; 3],
                half_m: [0.0; 3],
            },
            trigger_box: Some(BodyBox {
                centre_m: [0.0, 4.0, 0.0],
                half_m: [1.0, 3.0, 1.0],
            }),
            attributes: Default::default(),
            topics: Vec::new(),
        };
        let at = |id: u32, x: f64, y: f64| ActorRecord {
            id,
            world_from_actor: Pose::from_xyz_yaw(x, y, 0.0, 0.0),
            ..bytemuck::Zeroable::zeroed()
        };
        let infos = [info(1), info(2), info(3), info(4)];
        // Behind; off the lane; far; near.
        let records = [
            at(1, -5.0, -4.0),
            at(2, 20.0, 4.0),
            at(3, 80.0, -4.0),
            at(4, 50.0, -5.0),
        ];
        let lights: Vec<_> = infos.iter().zip(&records).collect();
        let road = Road {
            world_from_road: Isometry3::identity(),
        };
        let found = light_ahead(&road, &lights).unwrap();
        assert_eq!((found.id, found.stop_x_m), (4, 50.0));
        assert_eq!(light_ahead(&road, &lights[..2]), None);
    }
}
