//! Files that clients download: the navigation mesh for their own crowds.

use std::sync::Arc;

use schema_roads::RoadMap;

use crate::gateway::{Answer, Failure, Gateway, Outcome, lock};
use crate::list;
use crate::msgpack::Value;
use crate::navigation;
use crate::rpc::{Call, Calls};

pub(crate) const CALLS: Calls = &[
    ("get_required_files", Gateway::required_files),
    ("request_file", Gateway::request_file),
    ("get_navigation_mesh", Gateway::navigation_mesh),
];

/// The navigation mesh of a map.
#[derive(Clone, Debug, Default)]
pub struct NavigationFile {
    /// OpenDRIVE text that it was made from.
    map: Arc<str>,
    /// Name under which clients keep it; none for a map without pavements.
    name: Option<String>,
    bytes: Arc<Vec<u8>>,
}

impl NavigationFile {
    fn make(map: Arc<str>, map_name: &str) -> NavigationFile {
        let none = NavigationFile {
            map: map.clone(),
            ..Default::default()
        };
        let Ok(roads) = RoadMap::parse(&map) else {
            return none;
        };
        // Roads are left out of a map that is too large with them.
        let Some(bytes) = [true, false]
            .into_iter()
            .find_map(|with_roads| navigation::file(&roads.walkable(with_roads)))
        else {
            return none;
        };
        let short = map_name.rsplit('/').next().unwrap_or(map_name);
        let name = format!("Gantry/{:016x}/Nav/{short}.bin", navigation::hash(&bytes));
        NavigationFile {
            map,
            name: Some(name),
            bytes: bytes.into(),
        }
    }
}

impl Gateway {
    /// The running map's navigation mesh, made when it is first asked for.
    fn navigation(&self) -> Result<NavigationFile, Failure> {
        let name = self.info()?.map;
        let map = self.world.known().map.clone();
        let mut made = lock(&self.navigation);
        if made.map != map {
            *made = NavigationFile::make(map, &name);
        }
        Ok(made.clone())
    }

    fn required_files(&self, call: &mut Call<'_>) -> Outcome {
        let folder = call.text()?;
        if !matches!(folder.trim_matches('/'), "" | "Nav") {
            return Ok(Answer::Value(list![]));
        }
        Ok(Answer::Value(Value::Array(
            self.navigation()?
                .name
                .into_iter()
                .map(Value::from)
                .collect(),
        )))
    }

    fn request_file(&self, call: &mut Call<'_>) -> Outcome {
        let name = call.text()?;
        let navigation = self.navigation()?;
        if navigation.name.as_deref() != Some(name) {
            return Err(Failure::Refused(format!(
                "there is no file {name:?}; get_required_files lists those of the running map"
            )));
        }
        Ok(Answer::Value(Value::Bin(navigation.bytes.to_vec())))
    }

    fn navigation_mesh(&self, _: &mut Call<'_>) -> Outcome {
        Ok(Answer::Value(Value::Bin(self.navigation()?.bytes.to_vec())))
    }
}
