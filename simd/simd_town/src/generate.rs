//! Generating the towns that have a plan.

use schema_roads::RoadMap;

use crate::imported::{ImportOptions, import};
use crate::meshes::signals;
use crate::network::{Network, guide, open_drive, spawn_points};
use crate::plan::{Plan, plan_of};
use crate::town::{Town, TownError};
use crate::{assembly, plan};

impl Town {
    /// Towns of ordinary size, with scenery by blocks. `_Opt` behind a name is the same town.
    pub const NAMES: [&'static str; 11] = plan::NAMES;
    /// Large towns: hundreds of kilometres of roads, whose scenery is grown along them as that of an
    /// imported map.
    pub const LARGE_NAMES: [&'static str; 3] = plan::LARGE_NAMES;

    /// All names that [`Town::generate`] knows, in their order.
    pub fn all_names() -> Vec<&'static str> {
        plan::all_names()
    }

    /// The OpenDRIVE text of the town of this name and seed, without its scenery.
    ///
    /// # Errors
    /// [`TownError::Unknown`].
    pub fn open_drive(name: &str, seed: u64) -> Result<String, TownError> {
        let (plan, network) = network_of(name, seed)?;
        Ok(open_drive::write(&plan, &network))
    }

    /// The town of this name and seed. `Carla/Maps/` in front and `_Opt` behind the name change
    /// nothing.
    pub fn generate(name: &str, seed: u64) -> Result<Town, TownError> {
        let (plan, network) = network_of(name, seed)?;
        let short = plan.name.as_str();
        if Town::LARGE_NAMES.contains(&short) {
            let text = open_drive::write(&plan, &network);
            let roads = RoadMap::parse(&text).expect("a text that was just written");
            return import(short, &text, &roads, seed, &ImportOptions::default());
        }
        let scenery = assembly::build(&plan, &network, seed);
        let open_drive = open_drive::write(&plan, &network);
        let mut spawn_points = spawn_points(&network);
        if short == "Town10HD" {
            guide::number(&mut spawn_points, &open_drive);
        }
        Ok(Town {
            name: short.to_owned(),
            open_drive,
            spawn_points,
            assets: scenery.assets,
            objects: scenery.objects,
            lamps: scenery.lamps,
            lights: scenery.lights,
            light_head: signals::light_head(),
            collision: scenery.collision,
            origin_m: [0.0; 3],
        })
    }
}

/// Plan and streets of the town of this name.
fn network_of(name: &str, seed: u64) -> Result<(Plan, Network), TownError> {
    let short = name.rsplit('/').next().unwrap_or(name);
    let short = short.strip_suffix("_Opt").unwrap_or(short);
    let plan = plan_of(short, seed).ok_or_else(|| TownError::Unknown {
        name: name.to_owned(),
    })?;
    let network = Network::build(&plan);
    Ok((plan, network))
}
