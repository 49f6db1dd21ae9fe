//! What keeps traffic going besides driving: vehicles far from heroes move without physics or come
//! back near them, and those that cannot go on are removed.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use schema_frames::{Command, PhysicsAction};
use schema_types::Pose;
use schema_types::noise::Noise;

use crate::driver::{Driver, TickView, View, Wait};
use crate::lanes::network::Network;
use crate::plane::distance;
use crate::traffic::Mover;

/// A vehicle that stands for so long without a red light is removed, seconds.
const STUCK_SECS: f64 = 90.0;
/// The same before a red light, seconds.
const STUCK_AT_LIGHT_SECS: f64 = 180.0;
/// Time between two removals of stuck vehicles, seconds.
const REMOVE_EVERY_SECS: f64 = 10.0;
/// A vehicle at the end of a road is removed after this, seconds.
const DEAD_END_SECS: f64 = 3.0;
/// Time between two vehicles that come back, seconds.
const RESPAWN_EVERY_SECS: f64 = 0.5;
/// Places that are tried for one.
const RESPAWN_TRIES: u64 = 8;
/// Room that it needs, metres.
const RESPAWN_ROOM_M: f64 = 18.0;
/// A vehicle keeps physics up to this far beyond the radius, so that it does not switch all the
/// time, metres.
const HYSTERESIS_M: f64 = 5.0;
/// Hardest braking without physics, m/s².
const GLIDE_BRAKE_MPS2: f64 = 8.0;
/// Stream of the places where vehicles come back.
const PLACES: u64 = 0x70_6c_61_63_65;

/// When what was done last.
#[derive(Clone, Debug, Default)]
pub(crate) struct Upkeep {
    /// Vehicles that are driven no longer and get physics back.
    released: Vec<u32>,
    removed_at_secs: Option<f64>,
    respawned_at_secs: Option<f64>,
    n_respawned: u64,
}

impl Upkeep {
    /// Gives physics back to a vehicle in the next tick.
    pub fn release(&mut self, id: u32) {
        self.released.push(id);
    }

    /// Moves a vehicle without physics if it is far from every hero; returns whether it did.
    pub fn moves(
        &mut self,
        driver: &mut Driver,
        me: &Mover,
        view: View,
        heroes: &[[f64; 2]],
        commands: &mut Vec<Command>,
    ) -> bool {
        let radius_m = view.rules.common.hybrid_radius_m;
        let is_far = radius_m.is_some_and(|radius| {
            let reach = radius + if driver.glides { 0.0 } else { HYSTERESIS_M };
            !me.is_hero && heroes.iter().all(|at| distance(*at, me.middle()) > reach)
        });
        if is_far != driver.glides {
            driver.glides = is_far;
            commands.push(simulated(me.id, !is_far));
            if !is_far {
                commands.push(Command::SetVelocity {
                    actor_id: me.id,
                    velocity_in_world_mps: [me.velocity_mps[0], me.velocity_mps[1], 0.0],
                });
            }
        }
        if is_far {
            commands.push(glide(driver, me, view));
        }
        is_far
    }

    /// Removes and brings back vehicles.
    pub fn tend(
        &mut self,
        net: &Network,
        drivers: &BTreeMap<u32, Driver>,
        tick: &TickView<'_>,
        heroes: &[[f64; 2]],
        commands: &mut Vec<Command>,
    ) {
        let (traffic, common) = (tick.traffic, &tick.settings.common);
        commands.extend(self.released.drain(..).map(|id| simulated(id, true)));
        let now = traffic.time_secs;
        let is_due = |last: Option<f64>, every: f64| last.is_none_or(|last| now >= last + every);
        let removable = |id: &u32| traffic.mover(*id).is_some_and(|me| !me.is_hero);
        if common.removes_at_dead_ends {
            let at_end = drivers.iter().filter(|(id, driver)| {
                driver.wait() == Wait::End && driver.standing_secs > DEAD_END_SECS && removable(id)
            });
            let ids: Vec<u32> = at_end.map(|(id, _)| *id).collect();
            commands.extend(
                ids.into_iter()
                    .map(|actor_id| Command::Destroy { actor_id }),
            );
        }
        if common.removes_stuck && is_due(self.removed_at_secs, REMOVE_EVERY_SECS) {
            let stuck = drivers.iter().find(|(id, driver)| {
                let patience = match driver.wait() {
                    Wait::Light => STUCK_AT_LIGHT_SECS,
                    _ => STUCK_SECS,
                };
                driver.standing_secs > patience && removable(id)
            });
            if let Some((id, driver)) = stuck {
                tracing::info!(
                    vehicle = id,
                    secs = driver.standing_secs,
                    "removed a stuck vehicle"
                );
                commands.push(Command::Destroy { actor_id: *id });
                self.removed_at_secs = Some(now);
            }
        }
        if let Some(bounds_m) = common.respawn_m
            && let Some(hero) = heroes.first()
            && is_due(self.respawned_at_secs, RESPAWN_EVERY_SECS)
        {
            let far = |me: &&Mover| {
                me.is_vehicle
                    && !me.is_hero
                    && drivers.contains_key(&me.id)
                    && heroes
                        .iter()
                        .all(|at| distance(*at, me.middle()) > bounds_m[1])
            };
            if let Some(me) = traffic.movers.iter().find(far)
                && let Some(pose) = self.place_near(net, tick, *hero, bounds_m)
            {
                commands.push(Command::SetPose {
                    actor_id: me.id,
                    pose: pose.into(),
                });
                commands.push(Command::SetVelocity {
                    actor_id: me.id,
                    velocity_in_world_mps: [0.0; 3],
                });
                self.respawned_at_secs = Some(now);
            }
        }
    }

    /// A free place on a lane at a distance from a hero.
    fn place_near(
        &mut self,
        net: &Network,
        tick: &TickView<'_>,
        hero_m: [f64; 2],
        bounds_m: [f64; 2],
    ) -> Option<Pose> {
        let traffic = tick.traffic;
        let height_m = traffic
            .movers
            .iter()
            .find(|mover| mover.is_hero)
            .map_or(0.0, |hero| hero.position_m[2]);
        for _ in 0..RESPAWN_TRIES {
            self.n_respawned += 1;
            let chance = Noise::new(tick.settings.seed, self.n_respawned, PLACES);
            let distance_m = bounds_m[0] + (bounds_m[1] - bounds_m[0]) * chance.uniform(0);
            let (sin, cos) = (std::f64::consts::TAU * chance.uniform(1)).sin_cos();
            let aim = [
                hero_m[0] + cos * distance_m,
                hero_m[1] + sin * distance_m,
                height_m,
            ];
            let at = net.map().nearest(aim, |lane| {
                lane.kind.is_drivable() && lane.junction.is_none()
            })?;
            let at = schema_roads::LanePosition::new(at.lane, at.s_m);
            let pose = net.map().pose(at)?;
            let place = [pose.translation.x, pose.translation.y];
            let is_within = (bounds_m[0]..=bounds_m[1]).contains(&distance(place, hero_m));
            let low = place.map(|x| x - RESPAWN_ROOM_M);
            let high = place.map(|x| x + RESPAWN_ROOM_M);
            let is_free = tick
                .grid
                .within(low, high)
                .all(|idx| distance(traffic.movers[idx as usize].middle(), place) > RESPAWN_ROOM_M);
            if is_within && is_free {
                return Some(Pose::from(pose));
            }
        }
        None
    }
}

fn simulated(actor_id: u32, enabled: bool) -> Command {
    Command::Physics {
        actor_id,
        action: PhysicsAction::SetSimulated { enabled },
    }
}

/// The next pose along the path.
fn glide(driver: &mut Driver, me: &Mover, view: View) -> Command {
    let dt = view.traffic.period_secs;
    let accel = driver.glide_accel(me, view).max(-GLIDE_BRAKE_MPS2);
    let speed = (me.speed_mps.max(0.0) + accel * dt).max(0.0);
    let arc_m = (driver.foot().arc_m + speed * dt).min(driver.path().end().arc_m - 0.1);
    let (at, ahead) = (driver.path().at(arc_m), driver.path().at(arc_m + 1.0));
    let slope = ((ahead.height_m - at.height_m) / (ahead.arc_m - at.arc_m).max(0.2)).atan();
    let [x, y] = at.position_m;
    let pose = Isometry3::from_parts(
        Translation3::new(x, y, at.height_m),
        UnitQuaternion::from_euler_angles(0.0, -slope, at.heading_rad),
    );
    Command::SetPose {
        actor_id: me.id,
        pose: Pose::from(pose).into(),
    }
}
