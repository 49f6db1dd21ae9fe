//! `[rig.NAME]`: what sensors are mounted on.

use std::collections::BTreeMap;

use schema_frames::document::BATCH_RIG;
use toml::Value as Toml;

use super::sections::named;
use crate::error::{Errors, OTHER_PLACE};
use crate::fill::{fill_entry, refuse_unknown, table_or_error};
use crate::model::{EGO_RIG, Rig, Scenario};
use crate::tree::{Entry, Table};

pub(super) fn read(
    file: &Table,
    scenario: &Scenario,
    errors: &mut Errors,
) -> BTreeMap<String, Rig> {
    let mut rigs = BTreeMap::from([(EGO_RIG.to_owned(), Rig::Ego)]);
    for (name, entry) in named(file, "rig", errors) {
        let reserved =
            ["world", "control", "free", BATCH_RIG].contains(&name) || name.starts_with("actor_");
        if reserved {
            errors.push(
                entry.key_at,
                format!("[rig.{name}] has a name that the simulator uses itself; choose another"),
            );
        }
        if let Some(rig) = rig(name, entry, scenario, errors) {
            rigs.insert(name.to_owned(), rig);
        }
    }
    rigs
}

fn rig(name: &str, entry: &Entry, scenario: &Scenario, errors: &mut Errors) -> Option<Rig> {
    let path = format!("rig.{name}");
    let table = table_or_error(entry, &path, errors)?;
    refuse_unknown(table, &["vehicle", "pose"], &path, errors);
    let pose = table.get("pose").map(|pose| {
        Rig::Free(fill_entry(
            &Default::default(),
            Some(pose),
            &format!("{path}.pose"),
            &[],
            errors,
        ))
    });
    let Some(vehicle) = table.get("vehicle") else {
        if pose.is_none() {
            errors.push(
                entry.key_at,
                format!("[{path}] says not where it is; give vehicle = \"ego\", vehicle = 0 (another vehicle) or pose"),
            );
        }
        return pose;
    };
    if let Some(pose) = table.get("pose") {
        let message = format!("[{path}] has both vehicle and pose; keep one");
        let mut places = [vehicle.key_at, pose.key_at];
        places.sort();
        let [first, last] = places;
        if first.source == last.source {
            errors.push(vehicle.key_at, message);
        } else {
            let message = format!("{message}: the other is at {OTHER_PLACE}");
            errors.push_pair(last, message, first);
        }
    }
    let n_others = scenario.vehicles;
    match vehicle.node.plain() {
        Toml::String(word) if word == EGO_RIG => Some(Rig::Ego),
        Toml::Integer(idx) if (0..i64::from(n_others)).contains(&idx) => {
            Some(Rig::Other(idx as u32))
        }
        other => {
            let allowed = match n_others {
                0 => "or the index of another vehicle, of which scenario.vehicles has none"
                    .to_owned(),
                n => format!("or 0 to {} (scenario.vehicles is {n})", n - 1),
            };
            errors.push(
                vehicle.node.at,
                format!("{path}.vehicle is {other}, but must be \"ego\" {allowed}"),
            );
            None
        }
    }
}
