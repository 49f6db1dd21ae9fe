//! Collisions of walkers with vehicles and with each other.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Vector3};
use rapier3d::math::Pose as EnginePose;
use rapier3d::parry::query::contact;
use rapier3d::parry::shape::Cuboid;
use schema_types::{ActorId, Class};

use super::walker::{Fall, Walker};
use crate::physics::{Collision, Physics, narrow, widen};
use crate::vehicles::{Vehicle, Vehicles, chassis_box};

/// Closing speed from which a vehicle knocks over a walker that is not invincible, m/s.
pub const KNOCK_MPS: f64 = 2.0;

/// After a sub-step of the vehicles: lets them run into walkers. Both sides feel the impulse.
pub(super) fn meet_vehicles(
    walkers: &mut BTreeMap<ActorId, Walker>,
    vehicles: &Vehicles,
    physics: &mut Physics,
) {
    // A collision changes speeds and moves walkers, but it moves no vehicle, so the vehicles' poses
    // are looked up once.
    let vehicles: Vec<_> = vehicles
        .by_id
        .iter()
        .map(|(id, vehicle)| (id, vehicle, Nearby::of(vehicle, physics)))
        .collect();
    for (walker_id, walker) in walkers
        .iter_mut()
        .filter(|(_, walker)| walker.collides && !walker.lost)
    {
        for (vehicle_id, vehicle, nearby) in &vehicles {
            if nearby.is_far(walker) {
                continue;
            }
            let Some((impulse_ns, point_m)) = hit(physics, vehicle, &nearby.pose, walker) else {
                continue;
            };
            let (of_vehicle, of_walker) = (
                (**vehicle_id, vehicle.model.class),
                (*walker_id, Class::PEDESTRIANS),
            );
            for (who, whom, impulse_ns) in [
                (of_vehicle, of_walker, -impulse_ns),
                (of_walker, of_vehicle, impulse_ns),
            ] {
                physics.log_contact(Collision {
                    actor: who.0,
                    other: Some(whom.0),
                    other_class: whom.1,
                    impulse_in_world_ns: impulse_ns.into(),
                    point_in_world_m: point_m.into(),
                });
            }
        }
    }
}

/// Pushes walkers that overlap apart, each by half.
pub(super) fn part_walkers(walkers: &mut BTreeMap<ActorId, Walker>) {
    let mut order: Vec<(f64, ActorId)> = walkers
        .iter()
        .filter(|(_, walker)| walker.collides && walker.fall.is_none())
        .map(|(id, w)| (w.feet_m[0], *id))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for i in 0..order.len() {
        for j in i + 1..order.len() {
            if order[j].0 - order[i].0 > 1.0 {
                break;
            }
            part(walkers, order[i].1, order[j].1);
        }
    }
}

fn part(walkers: &mut BTreeMap<ActorId, Walker>, a: ActorId, b: ActorId) {
    let (first, second) = (walkers[&a].standing(), walkers[&b].standing());
    let between = second.feet_m - first.feet_m;
    let (away_m, room_m) = (
        between.xy().norm(),
        0.85 * (first.radius_m + second.radius_m),
    );
    if away_m >= room_m || between.z.abs() > first.height_m.min(second.height_m) {
        return;
    }
    let way = if away_m > 1e-6 {
        Vector3::new(between.x, between.y, 0.0) / away_m
    } else {
        Vector3::x()
    };
    for (id, sign) in [(a, -0.5), (b, 0.5)] {
        if let Some(walker) = walkers.get_mut(&id).filter(|walker| walker.simulated) {
            walker.feet_m =
                (Vector3::from(walker.feet_m) + way * (sign * (room_m - away_m))).into();
        }
    }
}

/// Where a vehicle is, and the distance beyond which it touches nobody.
struct Nearby {
    pose: Isometry3<f64>,
    reach_m: f64,
    rise_m: f64,
}

impl Nearby {
    fn of(vehicle: &Vehicle, physics: &Physics) -> Nearby {
        let half_m = vehicle.model.half_m;
        Nearby {
            pose: vehicle.pose(physics),
            reach_m: half_m[0].hypot(half_m[1]) + 1.0,
            rise_m: 2.0 * half_m[2] + 3.0,
        }
    }

    fn is_far(&self, walker: &Walker) -> bool {
        let apart = Vector3::from(walker.feet_m) - self.pose.translation.vector;
        apart.xy().norm() > self.reach_m || apart.z.abs() > self.rise_m
    }
}

/// Lets a vehicle and a walker that overlap collide. Returns the impulse on the walker, N·s, and
/// the point of contact, if they do.
fn hit(
    physics: &mut Physics,
    vehicle: &Vehicle,
    pose: &Isometry3<f64>,
    walker: &mut Walker,
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let apart = Vector3::from(walker.feet_m) - pose.translation.vector;
    let (centre, half) = chassis_box(vehicle.model);
    let mut at = physics.engine_pose(pose);
    at.translation += at.rotation * centre;
    let mut standing = walker.standing();
    if walker.fall.is_some() {
        standing.height_m = 2.0 * standing.radius_m + 0.02;
    }
    let (body, body_at) = standing.whole_body(physics);
    let touch = contact(&at, &Cuboid::new(half), &body_at, &body, 0.0)
        .ok()
        .flatten()
        .filter(|touch| touch.dist < 0.0)?;
    let normal = widen(touch.normal1);
    let away = Vector3::new(normal.x, normal.y, 0.0).try_normalize(0.2);
    let away = away
        .or_else(|| Vector3::new(apart.x, apart.y, 0.0).try_normalize(1e-6))
        .unwrap_or_else(Vector3::x);
    // First moves the walker out of the bodywork.
    let depth_m = f64::from(-touch.dist);
    walker.feet_m = (Vector3::from(walker.feet_m) + away * depth_m).into();
    let (velocity, spin) = vehicle.velocity(physics);
    let point_mps = velocity + spin.cross(&apart);
    let pushed = Vector3::new(walker.pushed_mps[0], walker.pushed_mps[1], 0.0);
    let walking = if walker.fall.is_some() {
        Vector3::zeros()
    } else {
        walker.wish_mps()
    };
    let closing_mps = (point_mps - pushed - walking).dot(&away);
    if !(closing_mps.is_finite() && closing_mps > 0.0) {
        return None;
    }
    let (own_kg, other_kg) = (walker.model().mass_kg, vehicle.model.mass_kg);
    let impulse_ns = away * (closing_mps * own_kg * other_kg / (own_kg + other_kg));
    let kick = impulse_ns / own_kg;
    walker.pushed_mps = [pushed.x + kick.x, pushed.y + kick.y];
    if !walker.invincible && walker.fall.is_none() && closing_mps > KNOCK_MPS {
        walker.fall = Some(Fall {
            towards: [away.x, away.y],
            angle_rad: 0.0,
        });
    }
    physics.engine.bodies[vehicle.body].apply_impulse(narrow(&-impulse_ns), true);
    let point_m = physics
        .world_pose(&EnginePose::from_translation(touch.point1))
        .translation
        .vector;
    Some((impulse_ns, point_m))
}
