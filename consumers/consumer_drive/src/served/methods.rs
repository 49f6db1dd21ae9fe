//! The methods of CARLA's Traffic Manager: a table from names to the functions that serve them.
//!
//! Where client and server of CARLA 0.9.16 call a method by different names, both stand in the
//! table.

use std::time::Duration;

use consumer_driver::parameters::{RoadOption, SpeedRule, VehicleParameters};
use consumer_driver::plane::Side;
use consumer_rpc::fields::{Fields, Wrong};
use consumer_rpc::list;
use consumer_rpc::msgpack::Value;
use schema_frames::Command;

use crate::desk::Desk;
use crate::requests::Counter;

/// The function that serves a method.
pub(crate) type Run = fn(&Counter, &mut Fields<'_>) -> Result<Value, Wrong>;

/// How long a call waits until it counts. Clients wait 2 s for an answer, and a session that reads a
/// large map may take longer; what was asked then counts a little later.
const PATIENCE: Duration = Duration::from_millis(1500);

/// Most points of a path and most decisions of a route.
const MAX_ITEMS: usize = 100_000;

/// km/h in m/s.
const KMH: f64 = 1.0 / 3.6;

const METHODS: &[(&str, Run)] = &[
    ("health_check_remote_TM", |_, _| nothing()),
    ("register_vehicle", register),
    ("unregister_vehicle", unregister),
    ("set_percentage_speed_difference", |counter, args| {
        one(counter, args, |args| {
            let percent = args.f64()?.min(100.0);
            Ok(move |own: &mut VehicleParameters| own.speed = SpeedRule::Difference(percent))
        })
    }),
    ("set_global_percentage_speed_difference", |counter, args| {
        let percent = args.f64()?.min(100.0);
        change(counter, move |desk| {
            desk.parameters_mut().speed_difference_percent = percent
        });
        nothing()
    }),
    ("set_desired_speed", |counter, args| {
        one(counter, args, |args| {
            let speed_mps = args.f64()?.max(0.0) * KMH;
            Ok(move |own: &mut VehicleParameters| own.speed = SpeedRule::Desired(speed_mps))
        })
    }),
    ("set_lane_offset", |counter, args| {
        one(counter, args, |args| {
            let left_m = -args.f64()?;
            Ok(move |own: &mut VehicleParameters| own.lane_offset_m = Some(left_m))
        })
    }),
    ("set_global_lane_offset", |counter, args| {
        let left_m = -args.f64()?;
        change(counter, move |desk| {
            desk.parameters_mut().lane_offset_m = left_m
        });
        nothing()
    }),
    ("update_vehicle_lights", |counter, args| {
        one(counter, args, |args| {
            let updates = args.bool()?;
            Ok(move |own: &mut VehicleParameters| own.updates_lights = Some(updates))
        })
    }),
    ("set_collision_detection", collision_detection),
    ("set_force_lane_change", |counter, args| {
        one(counter, args, |args| {
            let side = if args.bool()? {
                Side::Right
            } else {
                Side::Left
            };
            Ok(move |own: &mut VehicleParameters| own.forced_lane_change = Some(side))
        })
    }),
    ("set_auto_lane_change", |counter, args| {
        one(counter, args, |args| {
            let changes = args.bool()?;
            Ok(move |own: &mut VehicleParameters| own.changes_lanes = changes)
        })
    }),
    ("set_distance_to_leading_vehicle", |counter, args| {
        one(counter, args, |args| {
            let gap_m = args.f64()?.max(0.0);
            Ok(move |own: &mut VehicleParameters| own.distance_to_leader_m = Some(gap_m))
        })
    }),
    ("set_global_distance_to_leading_vehicle", |counter, args| {
        let gap_m = args.f64()?.max(0.0);
        change(counter, move |desk| {
            desk.parameters_mut().distance_to_leader_m = gap_m
        });
        nothing()
    }),
    ("set_percentage_running_light", |counter, args| {
        percentage(counter, args, |own| &mut own.ignore_lights_percent)
    }),
    ("set_percentage_running_sign", |counter, args| {
        percentage(counter, args, |own| &mut own.ignore_signs_percent)
    }),
    ("set_percentage_ignore_walkers", |counter, args| {
        percentage(counter, args, |own| &mut own.ignore_walkers_percent)
    }),
    ("set_percentage_ignore_vehicles", |counter, args| {
        percentage(counter, args, |own| &mut own.ignore_vehicles_percent)
    }),
    ("keep_slow_lane_rule_percentage", keep_right),
    ("set_percentage_keep_slow_lane_rule", keep_right),
    ("random_left_lanechange_percentage", random_left),
    ("set_percentage_random_left_lanechange", random_left),
    ("random_right_lanechange_percentage", random_right),
    ("set_percentage_random_right_lanechange", random_right),
    ("set_hybrid_physics_mode", |counter, args| {
        let is_hybrid = args.bool()?;
        change(counter, move |desk| {
            desk.switch(|switches| switches.is_hybrid = is_hybrid)
        });
        nothing()
    }),
    ("set_hybrid_physics_radius", |counter, args| {
        let radius_m = args.f64()?.max(0.0);
        change(counter, move |desk| {
            desk.switch(|switches| switches.hybrid_radius_m = radius_m)
        });
        nothing()
    }),
    ("set_osm_mode", |counter, args| {
        let is_on = args.bool()?;
        change(counter, move |desk| {
            desk.parameters_mut().removes_at_dead_ends = is_on
        });
        nothing()
    }),
    ("set_path", |counter, args| {
        let id = actor(args)?;
        set_path(counter, id, args)
    }),
    ("update_custom_path", |counter, args| {
        let id = args.u32()?;
        set_path(counter, id, args)
    }),
    ("remove_custom_path", |counter, args| {
        let id = args.u32()?;
        change(counter, move |desk| {
            desk.vehicle_mut(id).custom_path_m.clear()
        });
        nothing()
    }),
    ("set_imported_route", |counter, args| {
        let id = actor(args)?;
        set_route(counter, id, args)
    }),
    ("update_imported_route", |counter, args| {
        let id = args.u32()?;
        set_route(counter, id, args)
    }),
    ("remove_imported_route", |counter, args| {
        let id = args.u32()?;
        change(counter, move |desk| desk.vehicle_mut(id).route.clear());
        nothing()
    }),
    ("set_respawn_dormant_vehicles", |counter, args| {
        let respawns = args.bool()?;
        change(counter, move |desk| {
            desk.switch(|switches| switches.respawns = respawns)
        });
        nothing()
    }),
    (
        "set_boundaries_respawn_dormant_vehicles",
        |counter, args| {
            let (least, greatest) = (args.f64()?.max(0.0), args.f64()?);
            change(counter, move |desk| {
                desk.switch(|switches| switches.respawn_m = [least, greatest.max(least)])
            });
            nothing()
        },
    ),
    ("get_next_action", |counter, args| {
        Ok(actions(counter, args)?
            .into_iter()
            .next()
            .unwrap_or(list![]))
    }),
    ("get_all_actions", |counter, args| {
        Ok(Value::Array(actions(counter, args)?))
    }),
    ("set_synchronous_mode", |counter, args| {
        let is_on = args.bool()?;
        change(counter, move |desk| desk.set_lockstep(is_on));
        nothing()
    }),
    // A step waits for the controls however long they take, so that runs repeat.
    ("set_synchronous_mode_timeout_in_milisecond", |_, args| {
        args.f64().map(|_| Value::Nil)
    }),
    ("set_random_device_seed", |counter, args| {
        let seed = args.uint(u64::MAX)?;
        change(counter, move |desk| {
            desk.set_seed(seed);
            // As CARLA's does, so that runs with the same seed begin with the same lights.
            desk.command(Command::ResetTrafficLights { actor_id: None });
        });
        nothing()
    }),
    ("synchronous_tick", |_, _| Ok(true.into())),
    ("shut_down", |counter, _| {
        change(counter, Desk::reset);
        nothing()
    }),
];

/// The function that serves a method.
pub(crate) fn find(name: &str) -> Option<Run> {
    let entry = METHODS.iter().find(|(method, _)| *method == name);
    entry.map(|(_, run)| *run)
}

/// Changes the desk; returns when the change counts, or has waited long.
pub(crate) fn change(counter: &Counter, change: impl FnOnce(&mut Desk) + Send + 'static) {
    counter.ask(change, PATIENCE);
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

fn register(counter: &Counter, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    let ids = actors(args)?;
    change(counter, move |desk| desk.register(&ids));
    nothing()
}

fn unregister(counter: &Counter, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    let ids = actors(args)?;
    change(counter, move |desk| desk.unregister(&ids));
    nothing()
}

/// Changes what holds for the vehicle that is the first argument.
fn one<'v, C>(
    counter: &Counter,
    args: &mut Fields<'v>,
    read: impl FnOnce(&mut Fields<'v>) -> Result<C, Wrong>,
) -> Result<Value, Wrong>
where
    C: FnOnce(&mut VehicleParameters) + Send + 'static,
{
    let id = actor(args)?;
    let set = read(args)?;
    change(counter, move |desk| set(desk.vehicle_mut(id)));
    nothing()
}

fn percentage(
    counter: &Counter,
    args: &mut Fields<'_>,
    field: fn(&mut VehicleParameters) -> &mut f64,
) -> Result<Value, Wrong> {
    one(counter, args, |args| {
        let percent = args.f64()?.clamp(0.0, 100.0);
        Ok(move |own: &mut VehicleParameters| *field(own) = percent)
    })
}

fn keep_right(counter: &Counter, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    percentage(counter, args, |own| &mut own.keep_right_percent)
}

fn random_left(counter: &Counter, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    percentage(counter, args, |own| &mut own.random_left_percent)
}

fn random_right(counter: &Counter, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    percentage(counter, args, |own| &mut own.random_right_percent)
}

fn collision_detection(counter: &Counter, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    let (id, other, detects) = (actor(args)?, actor(args)?, args.bool()?);
    change(counter, move |desk| {
        let ignored = &mut desk.vehicle_mut(id).ignored;
        if detects {
            ignored.remove(&other);
        } else {
            ignored.insert(other);
        }
    });
    nothing()
}

fn set_path(counter: &Counter, id: u32, args: &mut Fields<'_>) -> Result<Value, Wrong> {
    let items = args.list()?;
    within("a path", items.len())?;
    let mut points = Fields::new("a path", items);
    let path: Vec<[f64; 3]> = items
        .iter()
        .map(|_| points.vector().map(|[x, y, z]| [x, -y, z]))
        .collect::<Result<_, _>>()?;
    change(counter, move |desk| {
        desk.vehicle_mut(id).custom_path_m = path
    });
    nothing()
}

fn set_route(counter: &Counter, id: u32, args: &mut Fields<'_>) -> Result<Value, Wrong> {
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
    change(counter, move |desk| desk.vehicle_mut(id).route = route);
    nothing()
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
fn actions(counter: &Counter, args: &mut Fields<'_>) -> Result<Vec<Value>, Wrong> {
    let id = args.u32()?;
    let ahead = counter
        .ask(move |desk| desk.actions(id), PATIENCE)
        .unwrap_or_default();
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
