//! The navigation mesh of the running map, as a file that clients download for their own crowds.

use std::sync::Arc;

use parking_lot::Mutex;
use schema_roads::RoadMap;

use crate::wire::navigation_mesh;

/// The navigation mesh of a map.
#[derive(Clone, Debug, Default)]
pub struct NavigationFile {
    /// The OpenDRIVE text that it was made from.
    map: Arc<str>,
    /// The name under which clients keep the file; `None` for a map without pavements.
    pub name: Option<String>,
    /// The file's bytes.
    pub bytes: Arc<Vec<u8>>,
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
        // A mesh that is too large with the roads is made without them.
        let Some(bytes) = [true, false]
            .into_iter()
            .find_map(|with_roads| navigation_mesh::file(&roads.walkable(with_roads)))
        else {
            return none;
        };
        let short = map_name.rsplit('/').next().unwrap_or(map_name);
        let name = format!(
            "Gantry/{:016x}/Nav/{short}.bin",
            navigation_mesh::hash(&bytes)
        );
        NavigationFile {
            map,
            name: Some(name),
            bytes: bytes.into(),
        }
    }
}

/// The navigation mesh of the running map, made when it is first asked for.
#[derive(Debug, Default)]
pub struct NavigationFiles(Mutex<NavigationFile>);

impl NavigationFiles {
    /// The file of a map, given its OpenDRIVE text and its name.
    pub fn of(&self, map: Arc<str>, map_name: &str) -> NavigationFile {
        let mut made = self.0.lock();
        if made.map != map {
            *made = NavigationFile::make(map, map_name);
        }
        made.clone()
    }
}
