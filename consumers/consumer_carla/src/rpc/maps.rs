//! Calls that list maps and store a map that a client brings along.

use schema_frames::command::StoredMap;
use schema_frames::{Command, CommandReply};

use crate::gateway::Gateway;
use crate::rpc::call::{Call, Calls};
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};

/// CARLA's folder in front of a map's name.
pub(crate) const MAP_FOLDER: &str = "Carla/Maps/";
/// CARLA's suffix of a map in layers.
pub(crate) const LAYERED: &str = "_Opt";
/// CARLA's name of the map of `generate_opendrive_world`.
const GENERATED: &str = "OpenDriveMap";

/// A map's name as scripts see it.
pub(crate) fn carla_map(name: &str) -> String {
    format!("{MAP_FOLDER}{name}")
}

/// Our name of the map that a script or a recording asks for: without folders, file endings and
/// [`LAYERED`], however often they are there. The rest cannot be a path, so a client can load only
/// towns, files of the map folder and the map that it stored.
pub(crate) fn own_map(asked: &str) -> &str {
    let name = asked.rsplit(['/', '\\']).next().unwrap_or(asked);
    let mut name = name.trim_start_matches('.');
    while let Some(shorter) = [".xodr", LAYERED]
        .iter()
        .find_map(|ending| name.strip_suffix(ending))
    {
        name = shorter;
    }
    name
}

/// Whether a script asks for a map in layers.
pub(crate) fn is_layered(asked: &str) -> bool {
    asked
        .strip_suffix(".xodr")
        .unwrap_or(asked)
        .ends_with(LAYERED)
}

pub(crate) const CALLS: Calls = &[
    ("get_available_maps", available_maps),
    ("copy_opendrive_to_file", store_map),
];

fn available_maps(gateway: &Gateway, _: &mut Call<'_>) -> Outcome {
    gateway.info()?;
    match gateway.commander.ask_one(Command::ListMaps)? {
        (CommandReply::Maps { names }, _) => {
            let names: Vec<Value> = names
                .iter()
                .map(|name| Value::from(format!("/Game/{}", carla_map(name)).as_str()))
                .collect();
            Ok(Answer::Value(names.into()))
        }
        (other, _) => Err(Failure::Refused(format!("{other:?} is no list of maps"))),
    }
}

/// Stores a client's OpenDRIVE map; the client then loads it by name. Such a world has no houses
/// and trees, as in CARLA.
fn store_map(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let open_drive = call.text()?.to_owned();
    let mut given = call.fields("the generation parameters")?;
    let (vertex_distance_m, _max_road_length_m, wall_height_m) =
        (given.f64()?, given.f64()?, given.f64()?);
    let (junction_extra_m, _smooth_junctions, visible) =
        (given.f64()?, given.bool()?, given.bool()?);
    gateway.info()?;
    let map = StoredMap {
        name: GENERATED.to_owned(),
        open_drive,
        vertex_distance_m,
        wall_height_m,
        junction_extra_m,
        visible,
        roadside: false,
    };
    gateway.commander.ask_one(Command::StoreMap(map))?;
    Ok(Answer::Void)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_maps_lose_what_carla_puts_round_them_and_everything_that_makes_a_path() {
        for asked in [
            "Town10HD",
            "Carla/Maps/Town10HD",
            "/Game/Carla/Maps/Town10HD_Opt",
            "../../Town10HD",
            "/etc/Town10HD.xodr",
        ] {
            assert_eq!(own_map(asked), "Town10HD");
        }
        assert_eq!((own_map(".."), own_map("/a/.b")), ("", "b"));
        for asked in ["x.xodr_Opt", "x_Opt.xodr_Opt.xodr", "C:\\maps\\x.xodr"] {
            assert_eq!(own_map(asked), "x", "{asked}");
        }
    }
}
