//! The methods of CARLA's Traffic Manager: a table from names to the functions that serve them.
//!
//! Where client and server of CARLA 0.9.16 call a method by different names, both stand in the
//! table.

use std::sync::Arc;
use std::time::Duration;

use consumer_driver::parameters::{RoadOption, SpeedRule, VehicleParameters};
use consumer_driver::plane::Side;
use consumer_rpc::budget::{Account, Share};
use consumer_rpc::fields::{Fields, Wrong};
use consumer_rpc::list;
use consumer_rpc::msgpack::Value;
use schema_frames::Command;

use crate::desk::{Desk, Setting};
use crate::requests::Counter;

/// Who calls.
pub(crate) struct Client<'c> {
    /// Where the session is asked.
    pub counter: &'c Counter,
    /// What the connection owns.
    pub account: &'c Account,
    /// The request's part of it, until the session has run it.
    pub request: Arc<Share>,
    /// The method's name in the table.
    pub method: &'static str,
}

/// The function that serves a method.
pub(crate) type Run = fn(&Client<'_>, &mut Fields<'_>) -> Result<Value, Wrong>;

/// What a setting of a vehicle costs its connection beside its items, bytes.
const SETTING_BYTES: usize = 128;
/// What a point of a path costs.
const POINT_BYTES: usize = size_of::<[f64; 3]>();

/// How long a call waits until it counts. Clients wait 2 s for an answer, and a session that reads a
/// large map may take longer; what was asked then counts a little later.
pub(crate) const PATIENCE: Duration = Duration::from_millis(1500);

/// Most points of a path and most decisions of a route.
const MAX_ITEMS: usize = 100_000;

/// km/h in m/s.
const KMH: f64 = 1.0 / 3.6;

const METHODS: &[(&str, Run)] = &[
    ("health_check_remote_TM", |_, _| nothing()),
    ("register_vehicle", register),
    ("unregister_vehicle", unregister),
    ("set_percentage_speed_difference", |client, args| {
        one(client, args, |args| {
            let percent = args.f64()?.min(100.0);
            Ok(move |own: &mut VehicleParameters| own.speed = SpeedRule::Difference(percent))
        })
    }),
    ("set_global_percentage_speed_difference", |client, args| {
        let percent = args.f64()?.min(100.0);
        change(client, move |desk| {
            desk.parameters_mut().speed_difference_percent = percent
        })
    }),
    ("set_desired_speed", |client, args| {
        one(client, args, |args| {
            let speed_mps = args.f64()?.max(0.0) * KMH;
            Ok(move |own: &mut VehicleParameters| own.speed = SpeedRule::Desired(speed_mps))
        })
    }),
    ("set_lane_offset", |client, args| {
        one(client, args, |args| {
            let left_m = -args.f64()?;
            Ok(move |own: &mut VehicleParameters| own.lane_offset_m = Some(left_m))
        })
    }),
    ("set_global_lane_offset", |client, args| {
        let left_m = -args.f64()?;
        change(client, move |desk| {
            desk.parameters_mut().lane_offset_m = left_m
        })
    }),
    ("update_vehicle_lights", |client, args| {
        one(client, args, |args| {
            let updates = args.bool()?;
            Ok(move |own: &mut VehicleParameters| own.updates_lights = Some(updates))
        })
    }),
    ("set_collision_detection", collision_detection),
    ("set_force_lane_change", |client, args| {
        one(client, args, |args| {
            let side = if args.bool()? {
                Side::Right
            } else {
                Side::Left
            };
            Ok(move |own: &mut VehicleParameters| own.forced_lane_change = Some(side))
        })
    }),
    ("set_auto_lane_change", |client, args| {
        one(client, args, |args| {
            let changes = args.bool()?;
            Ok(move |own: &mut VehicleParameters| own.changes_lanes = changes)
        })
    }),
    ("set_distance_to_leading_vehicle", |client, args| {
        one(client, args, |args| {
            let gap_m = args.f64()?.max(0.0);
            Ok(move |own: &mut VehicleParameters| own.distance_to_leader_m = Some(gap_m))
        })
    }),
    ("set_global_distance_to_leading_vehicle", |client, args| {
        let gap_m = args.f64()?.max(0.0);
        change(client, move |desk| {
            desk.parameters_mut().distance_to_leader_m = gap_m
        })
    }),
    ("set_percentage_running_light", |client, args| {
        percentage(client, args, |own| &mut own.ignore_lights_percent)
    }),
    ("set_percentage_running_sign", |client, args| {
        percentage(client, args, |own| &mut own.ignore_signs_percent)
    }),
    ("set_percentage_ignore_walkers", |client, args| {
        percentage(client, args, |own| &mut own.ignore_walkers_percent)
    }),
    ("set_percentage_ignore_vehicles", |client, args| {
        percentage(client, args, |own| &mut own.ignore_vehicles_percent)
    }),
    ("keep_slow_lane_rule_percentage", keep_right),
    ("set_percentage_keep_slow_lane_rule", keep_right),
    ("random_left_lanechange_percentage", random_left),
    ("set_percentage_random_left_lanechange", random_left),
    ("random_right_lanechange_percentage", random_right),
    ("set_percentage_random_right_lanechange", random_right),
    ("set_hybrid_physics_mode", |client, args| {
        let is_hybrid = args.bool()?;
        change(client, move |desk| {
            desk.switch(|switches| switches.is_hybrid = is_hybrid)
        })
    }),
    ("set_hybrid_physics_radius", |client, args| {
        let radius_m = args.f64()?.max(0.0);
        change(client, move |desk| {
            desk.switch(|switches| switches.hybrid_radius_m = radius_m)
        })
    }),
    ("set_osm_mode", |client, args| {
        let is_on = args.bool()?;
        change(client, move |desk| {
            desk.parameters_mut().removes_at_dead_ends = is_on
        })
    }),
    ("set_path", |client, args| {
        let id = actor(args)?;
        set_path(client, id, args)
    }),
    ("update_custom_path", |client, args| {
        let id = args.u32()?;
        set_path(client, id, args)
    }),
    ("remove_custom_path", |client, args| {
        let id = args.u32()?;
        vehicle(client, id, 0, 0, |own| own.custom_path_m.clear())
    }),
    ("set_imported_route", |client, args| {
        let id = actor(args)?;
        set_route(client, id, args)
    }),
    ("update_imported_route", |client, args| {
        let id = args.u32()?;
        set_route(client, id, args)
    }),
    ("remove_imported_route", |client, args| {
        let id = args.u32()?;
        vehicle(client, id, 0, 0, |own| own.route.clear())
    }),
    ("set_respawn_dormant_vehicles", |client, args| {
        let respawns = args.bool()?;
        change(client, move |desk| {
            desk.switch(|switches| switches.respawns = respawns)
        })
    }),
    ("set_boundaries_respawn_dormant_vehicles", |client, args| {
        let (least, greatest) = (args.f64()?.max(0.0), args.f64()?);
        change(client, move |desk| {
            desk.switch(|switches| switches.respawn_m = [least, greatest.max(least)])
        })
    }),
    ("get_next_action", |client, args| {
        Ok(actions(client, args)?.into_iter().next().unwrap_or(list![]))
    }),
    ("get_all_actions", |client, args| {
        Ok(Value::Array(actions(client, args)?))
    }),
    ("set_synchronous_mode", |client, args| {
        let is_on = args.bool()?;
        change(client, move |desk| desk.set_lockstep(is_on))
    }),
    // A step waits for the controls however long they take, so that runs repeat.
    ("set_synchronous_mode_timeout_in_milisecond", |_, args| {
        args.f64().map(|_| Value::Nil)
    }),
    ("set_random_device_seed", |client, args| {
        let seed = args.uint(u64::MAX)?;
        change(client, move |desk| {
            desk.set_seed(seed);
            // As CARLA's does, so that runs with the same seed begin with the same lights.
            desk.command(Command::ResetTrafficLights { actor_id: None });
        })
    }),
    ("synchronous_tick", |_, _| Ok(true.into())),
    ("shut_down", |client, _| change(client, Desk::reset)),
];

/// A method's name, and the function that serves it.
pub(crate) fn find(name: &str) -> Option<(&'static str, Run)> {
    METHODS.iter().find(|(method, _)| *method == name).copied()
}

/// Changes the desk; returns when the change counts, or has waited long.
fn change(
    client: &Client<'_>,
    change: impl FnOnce(&mut Desk) + Send + 'static,
) -> Result<Value, Wrong> {
    ask(client, change)?;
    nothing()
}

/// Asks the desk; `None` if that takes long. The request is charged until the session has run it.
fn ask<R: Send + 'static>(
    client: &Client<'_>,
    question: impl FnOnce(&mut Desk) -> R + Send + 'static,
) -> Result<Option<R>, Wrong> {
    let request = client.request.clone();
    let question = move |desk: &mut Desk| {
        let answer = question(desk);
        drop(request);
        answer
    };
    let asked = client.counter.ask(question, PATIENCE);
    asked.map_err(|error| Wrong::Value(error.to_string()))
}

/// Changes what holds for a vehicle, and about `other` if the method sets something for a pair. The
/// setting has `n_bytes` and is charged until it is set anew or the vehicle is gone.
fn vehicle(
    client: &Client<'_>,
    id: u32,
    other: u32,
    n_bytes: usize,
    set: impl FnOnce(&mut VehicleParameters) + Send + 'static,
) -> Result<Value, Wrong> {
    let cost = client.account.hold(SETTING_BYTES + n_bytes);
    let setting = Setting {
        vehicle: id,
        method: client.method,
        other,
        cost: cost.map_err(|error| Wrong::Value(error.to_string()))?,
    };
    match ask(client, move |desk| desk.set_vehicle(setting, set))? {
        Some(Err(error)) => Err(Wrong::Value(error.to_string())),
        Some(Ok(())) | None => nothing(),
    }
}

/// Nothing, as methods without a result return it.
fn nothing() -> Result<Value, Wrong> {
    Ok(Value::Nil)
}

/// Names of the methods that are served.
pub fn names() -> impl Iterator<Item = &'static str> {
    METHODS.iter().map(|(name, _)| *name)
}

/// The id of an actor, of whose description nothing else matters here.
fn actor(args: &mut Fields<'_>) -> Result<u32, Wrong> {
    args.fields("an actor")?.u32()
}

fn actors(args: &mut Fields<'_>) -> Result<Vec<u32>, Wrong> {
    let mut each = args.each("an actor")?;
    each.iter_mut().map(Fields::u32).collect()
}

fn register(client: &Client<'_>, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    let ids = actors(args)?;
    change(client, move |desk| desk.register(&ids))
}

fn unregister(client: &Client<'_>, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    let ids = actors(args)?;
    change(client, move |desk| desk.unregister(&ids))
}

/// Changes what holds for the vehicle that is the first argument.
fn one<'v, C>(
    client: &Client<'_>,
    args: &mut Fields<'v>,
    read: impl FnOnce(&mut Fields<'v>) -> Result<C, Wrong>,
) -> Result<Value, Wrong>
where
    C: FnOnce(&mut VehicleParameters) + Send + 'static,
{
    let id = actor(args)?;
    let set = read(args)?;
    vehicle(client, id, 0, 0, set)
}

fn percentage(
    client: &Client<'_>,
    args: &mut Fields<'_>,
    field: fn(&mut VehicleParameters) -> &mut f64,
) -> Result<Value, Wrong> {
    one(client, args, |args| {
        let percent = args.f64()?.clamp(0.0, 100.0);
        Ok(move |own: &mut VehicleParameters| *field(own) = percent)
    })
}

fn keep_right(client: &Client<'_>, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    percentage(client, args, |own| &mut own.keep_right_percent)
}

fn random_left(client: &Client<'_>, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    percentage(client, args, |own| &mut own.random_left_percent)
}

fn random_right(client: &Client<'_>, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    percentage(client, args, |own| &mut own.random_right_percent)
}

fn collision_detection(client: &Client<'_>, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    let (id, other, detects) = (actor(args)?, actor(args)?, args.bool()?);
    vehicle(client, id, other, 0, move |own| {
        if detects {
            own.ignored.remove(&other);
        } else {
            own.ignored.insert(other);
        }
    })
}

fn set_path(client: &Client<'_>, id: u32, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    let items = args.list()?;
    within("a path", items.len())?;
    let mut points = Fields::new("a path", items);
    let path: Vec<[f64; 3]> = items
        .iter()
        .map(|_| points.vector().map(|[x, y, z]| [x, -y, z]))
        .collect::<Result<_, _>>()?;
    let n_bytes = path.len() * POINT_BYTES;
    vehicle(client, id, 0, n_bytes, |own| own.custom_path_m = path)
}

fn set_route(client: &Client<'_>, id: u32, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    let codes: Vec<u8> = match args.value()? {
        Value::Bin(codes) => codes.clone(),
        Value::Array(items) => {
            let mut codes = Fields::new("a route", items);
            items.iter().map(|_| codes.u8()).collect::<Result<_, _>>()?
        }
        other => {
            return Err(Wrong::Value(format!(
                "a route is {}, but must be bytes",
                other.kind()
            )));
        }
    };
    within("a route", codes.len())?;
    let route: Vec<RoadOption> = codes
        .into_iter()
        .map(|code| {
            option(code).ok_or_else(|| {
                Wrong::Value(format!(
                    "a decision of a route is {code}, but must be 1 to 6: left, right, straight, lane follow, change left, change right"
                ))
            })
        })
        .collect::<Result<_, _>>()?;
    let n_bytes = route.len();
    vehicle(client, id, 0, n_bytes, |own| own.route = route)
}

fn within(what: &str, n_items: usize) -> Result<(), Wrong> {
    if n_items > MAX_ITEMS {
        return Err(Wrong::Value(format!(
            "{what} has {n_items} items, but may have {MAX_ITEMS}"
        )));
    }
    Ok(())
}

const OPTIONS: [RoadOption; 6] = [
    RoadOption::Left,
    RoadOption::Right,
    RoadOption::Straight,
    RoadOption::LaneFollow,
    RoadOption::ChangeLaneLeft,
    RoadOption::ChangeLaneRight,
];

/// The decision that CARLA writes as this number.
fn option(code: u8) -> Option<RoadOption> {
    OPTIONS.get(usize::from(code).checked_sub(1)?).copied()
}

/// The decisions ahead of a vehicle: number, place and rotation.
fn actions(client: &Client<'_>, args: &mut Fields<'_>) -> Result<Vec<Value>, Wrong> {
    let id = args.u32()?;
    let ahead = ask(client, move |desk| desk.actions(id))?.unwrap_or_default();
    let written = ahead.iter().map(|action| {
        let code = OPTIONS.iter().position(|option| *option == action.option);
        let [x, y, z] = action.position_m.map(|metres| metres as f32);
        let yaw_deg = -action.heading_rad.to_degrees() as f32;
        list![
            code.map_or(0u8, |idx| idx as u8 + 1),
            list![list![x, -y, z], list![0.0f32, yaw_deg, 0.0f32]]
        ]
    });
    Ok(written.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decisions_have_the_numbers_of_the_client() {
        assert_eq!(option(1), Some(RoadOption::Left));
        assert_eq!(option(6), Some(RoadOption::ChangeLaneRight));
        assert_eq!((option(0), option(7)), (None, None));
    }

    #[test]
    fn no_method_stands_twice() {
        let mut all: Vec<&str> = names().collect();
        let n = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), n);
    }
}
