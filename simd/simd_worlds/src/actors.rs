//! What moves beside the ego: a car that brakes to a halt, or a person who crosses. Their motion is
//! a script that follows from the seed, not from traffic rules.

use nalgebra::{UnitQuaternion, Vector3};
use schema_frames::WalkerControl;
use schema_types::noise::Noise;
use schema_types::{ActorId, Pose};
use simd_world::{ActorError, World, walker_models};

use crate::route::Route;

/// What a prepared world holds beside the ego.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Other {
    /// Nobody.
    Nobody,
    /// A car without physics, which is moved along the route.
    Lead(ActorId),
    /// A person at the side of the lane; `model_idx` counts in [`walker_models`].
    Person { actor: ActorId, model_idx: usize },
}

/// Its script.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Script {
    Nobody,
    Lead {
        actor: ActorId,
        way_m: f64,
        speed_mps: f64,
        /// Seconds until it brakes.
        left_secs: f64,
        brake_mps2: f64,
    },
    Person {
        actor: ActorId,
        way_m: f64,
        /// It begins to walk when the ego would be there within these seconds.
        begins_secs: f64,
        speed_mps: f32,
        /// Offset at which it stands still; beyond the other side of the lane if it crosses.
        until_m: f64,
        side: f64,
        walks: bool,
    },
}

/// What the ego is told about it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Seen {
    pub way_m: f64,
    pub offset_m: f64,
    /// Along the lane and to the left, m/s.
    pub velocity_mps: [f64; 2],
    pub half_length_m: f64,
}

impl Script {
    /// Draws a script and puts the actor where it begins. `ego_way_m` and `speed_mps` are those of
    /// the ego.
    pub fn begin(
        other: Other,
        world: &mut World,
        route: &Route,
        ego_way_m: f64,
        speed_mps: f64,
        lot: Noise,
    ) -> Result<Script, ActorError> {
        let between = |n, low: f64, high: f64| low + (high - low) * lot.uniform(n);
        match other {
            Other::Nobody => Ok(Script::Nobody),
            Other::Lead(actor) => {
                let way_m = ego_way_m + between(0, 25.0, 45.0);
                world.set_pose(actor, route.pose(way_m, 0.0).into())?;
                Ok(Script::Lead {
                    actor,
                    way_m,
                    speed_mps,
                    left_secs: between(1, 0.5, 5.0),
                    brake_mps2: between(2, 3.0, 7.0),
                })
            }
            Other::Person { actor, model_idx } => {
                let way_m = ego_way_m + between(0, 50.0, 90.0);
                let side = if lot.uniform(1) < 0.5 { -1.0 } else { 1.0 };
                let half_width_m = route.foot_at(way_m).half_width_m;
                let mut place = route.pose(way_m, side * (half_width_m + 1.0));
                place.translation.z += 0.5 * walker_models()[model_idx].shape.height_m + 0.02;
                place.rotation = UnitQuaternion::identity();
                world.set_pose(actor, Pose::from(place))?;
                let stops = lot.uniform(2) < 0.5;
                Ok(Script::Person {
                    actor,
                    way_m,
                    begins_secs: between(3, 2.5, 4.5),
                    speed_mps: between(4, 1.2, 2.4) as f32,
                    until_m: if stops {
                        0.0
                    } else {
                        -side * (half_width_m + 2.0)
                    },
                    side,
                    walks: false,
                })
            }
        }
    }

    /// Before a step: moves what is moved and tells people where to go.
    pub fn step(
        &mut self,
        world: &mut World,
        route: &Route,
        ego: &Seen,
        step_secs: f64,
    ) -> Result<(), ActorError> {
        match self {
            Script::Nobody => Ok(()),
            Script::Lead {
                actor,
                way_m,
                speed_mps,
                left_secs,
                brake_mps2,
            } => {
                *left_secs -= step_secs;
                if *left_secs < 0.0 {
                    *speed_mps = (*speed_mps - *brake_mps2 * step_secs).max(0.0);
                }
                *way_m += *speed_mps * step_secs;
                world.set_pose(*actor, route.pose(*way_m, 0.0).into())
            }
            Script::Person {
                actor,
                way_m,
                begins_secs,
                speed_mps,
                until_m,
                side,
                walks,
            } => {
                let Some(record) = world.record(*actor) else {
                    return Ok(());
                };
                let at_m = Vector3::from(record.world_from_actor.translation_m);
                let offset_m = route.foot(&at_m, route.before(*way_m)).offset_m;
                let gap_m = *way_m - ego.way_m;
                let is_due = gap_m <= *begins_secs * ego.velocity_mps[0].max(1.0);
                let is_there = *side * (offset_m - *until_m) <= 0.0;
                let walk = is_due && !is_there;
                if walk == *walks {
                    return Ok(());
                }
                *walks = walk;
                let direction = route.pose(*way_m, 0.0).rotation * Vector3::new(0.0, -*side, 0.0);
                let control = WalkerControl {
                    direction: direction.map(|x| x as f32).into(),
                    speed_mps: if walk { *speed_mps } else { 0.0 },
                    jump: false,
                };
                world.control_walker(*actor, control)
            }
        }
    }

    /// The obstacle, as it is now.
    pub fn seen(&self, world: &World, route: &Route) -> Option<Seen> {
        let (Script::Lead { actor, way_m, .. } | Script::Person { actor, way_m, .. }) = self else {
            return None;
        };
        let record = world.record(*actor)?;
        let at_m = Vector3::from(record.world_from_actor.translation_m);
        Some(Seen::of(
            route,
            &at_m,
            route.before(*way_m),
            &Vector3::from(record.velocity_in_world_mps),
            f64::from(record.half_box_m[0]),
        ))
    }
}

impl Seen {
    /// Something at a place, beside a route.
    pub fn of(
        route: &Route,
        at_m: &Vector3<f64>,
        near: usize,
        velocity_mps: &Vector3<f64>,
        half_length_m: f64,
    ) -> Seen {
        let foot = route.foot(at_m, near);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -foot.heading_rad);
        let in_lane = turn * velocity_mps;
        Seen {
            way_m: foot.way_m,
            offset_m: foot.offset_m,
            velocity_mps: [in_lane.x, in_lane.y],
            half_length_m,
        }
    }
}
