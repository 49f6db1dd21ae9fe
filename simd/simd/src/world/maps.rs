//! Maps by name: generated towns, files of the map folder, paths, and texts that a client stored.
//! The maps that were loaded last are kept.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use anyhow::Context as _;
use launch_cli::wrong_usage;
use schema_frames::command::StoredMap;
use schema_roads::{MAX_TEXT_BYTES, RoadMap};
use sensor_core::scene::SceneAssets;
use simd_town::Town;
use simd_town::imported::{ImportOptions, import};
use simd_world::MapData;

/// Loaded maps that are kept. Going back and forth between two maps costs nothing, and memory stays
/// bounded.
const KEPT: usize = 3;
/// Most texts that clients can store.
const MAX_STORED: usize = 16;
/// Warnings of a file that are logged one by one.
const WARNINGS_SHOWN: usize = 5;
/// Longest name of a map.
const MAX_NAME: usize = 200;

/// A map that is ready to be put into the world.
#[derive(Debug)]
pub struct LoadedMap {
    /// What physics and traffic need.
    pub data: Arc<MapData>,
    /// What sensors need, with episode 0 and without the actors' meshes.
    pub assets: SceneAssets,
}

/// What a loaded map was made from.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Source {
    Town(String),
    File {
        path: PathBuf,
        bytes: u64,
        changed: Option<SystemTime>,
    },
    Stored {
        name: String,
        revision: u64,
    },
    /// A file of a journal.
    Provided {
        name: String,
        revision: u64,
    },
}

/// A map file of a journal.
#[derive(Debug)]
struct Provided {
    revision: u64,
    title: String,
    text: String,
}

/// Where maps come from.
#[derive(Debug)]
pub struct Maps {
    data: PathBuf,
    folder: PathBuf,
    /// The launch file's folder, in which relative paths are looked for too.
    beside: Option<PathBuf>,
    stored: BTreeMap<String, (u64, StoredMap)>,
    /// Files of a journal by what they are asked for as, in place of those on the disk.
    provided: BTreeMap<String, Provided>,
    n_stored: u64,
    kept: Vec<(Source, u64, Arc<LoadedMap>)>,
}

impl Maps {
    /// Maps of the data folder `data`; relative paths may also start in the launch file's folder.
    pub fn new(data: &Path, launch_folder: Option<PathBuf>) -> Maps {
        Maps {
            data: data.to_owned(),
            folder: data.join("maps"),
            beside: launch_folder,
            stored: BTreeMap::new(),
            provided: BTreeMap::new(),
            n_stored: 0,
            kept: Vec::new(),
        }
    }

    /// Names that can be loaded: generated towns, then files of the map folder, then stored texts.
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = Town::all_names().into_iter().map(str::to_owned).collect();
        let further = self
            .in_folder()
            .into_iter()
            .chain(self.stored.keys().cloned());
        for name in further {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }

    /// Names of the `.xodr` files in the map folder, sorted.
    fn in_folder(&self) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(&self.folder) else {
            return Vec::new();
        };
        let name = |entry: std::fs::DirEntry| {
            let path = entry.path();
            (path.extension()? == "xodr").then(|| path.file_stem()?.to_str().map(str::to_owned))?
        };
        let mut names: Vec<String> = entries.take(10_000).flatten().filter_map(name).collect();
        names.sort();
        names
    }

    /// Stores a text, which can then be loaded under its name.
    ///
    /// # Errors
    /// When the name or the text cannot be used.
    pub fn store(&mut self, map: StoredMap) -> anyhow::Result<()> {
        let name = map.name.clone();
        if !is_plain(&name) {
            return Err(wrong_usage(format!(
                "map name {name:?} must be 1 to {MAX_NAME} letters, digits, '-', '_' and '.'"
            )));
        }
        if !self.stored.contains_key(&name) && self.stored.len() >= MAX_STORED {
            return Err(wrong_usage(format!(
                "{MAX_STORED} maps are kept already; use one of their names again"
            )));
        }
        RoadMap::parse(&map.open_drive)
            .map_err(|error| wrong_usage(format!("map {name:?}: {error}")))?;
        self.n_stored += 1;
        self.stored.insert(name, (self.n_stored, map));
        Ok(())
    }

    /// Takes a map file of a journal, which is loaded in place of the one on the disk when `name`
    /// is asked for; the map is then called `title`.
    pub fn provide(&mut self, name: String, title: String, bytes: &[u8]) {
        self.n_stored += 1;
        let provided = Provided {
            revision: self.n_stored,
            title,
            text: String::from_utf8_lossy(bytes).into_owned(),
        };
        self.provided.insert(name, provided);
    }

    /// The text of the file that `name` means; `None` if it means a town or a stored map, which
    /// need no file.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn file_text(&self, name: &str) -> anyhow::Result<Option<String>> {
        match self.find(name)? {
            Source::File { path, bytes, .. } => read_text(&path, bytes).map(Some),
            Source::Provided { name, .. } => Ok(Some(self.provided[&name].text.clone())),
            Source::Town(_) | Source::Stored { .. } => Ok(None),
        }
    }

    /// Whether a client or a journal may ask for this map. Names mean what is in the map folder, links
    /// included, because its user put it there. A path has to end in the data folder or in the
    /// launch file's, wherever links on it lead.
    ///
    /// # Errors
    /// If there is no such map, or its path leads elsewhere.
    pub fn check_asked(&self, name: &str) -> anyhow::Result<()> {
        // Before the disk is looked at, so that nobody learns what else there is.
        if !is_path(name) {
            return Ok(());
        }
        let outside = || {
            wrong_usage(format!(
                "map {name:?} is not an .xodr file in the data folder {}, and clients load no other paths; put it into maps/ there, or hand over its text with store_map",
                self.data.display()
            ))
        };
        let homes: Vec<PathBuf> = [Some(&self.data), self.beside.as_ref()]
            .into_iter()
            .flatten()
            .filter_map(|folder| folder.canonicalize().ok())
            .collect();
        let is_at_home = |path: &Path| {
            path.canonicalize()
                .is_ok_and(|path| homes.iter().any(|home| path.starts_with(home)))
        };
        let is_inside =
            name.ends_with(".xodr") && self.places(name).iter().any(|path| is_at_home(path));
        if !is_inside && !self.provided.contains_key(name) {
            return Err(outside());
        }
        match self.find(name)? {
            Source::File { path, .. } if !is_at_home(&path) => Err(outside()),
            _ => Ok(()),
        }
    }

    /// The map that a name or path means.
    ///
    /// # Errors
    /// When there is none, or it cannot be read.
    pub fn load(&mut self, name: &str, seed: u64) -> anyhow::Result<Arc<LoadedMap>> {
        let source = self.find(name)?;
        if let Some(at) = self
            .kept
            .iter()
            .position(|(kept, of_seed, _)| *kept == source && *of_seed == seed)
        {
            let found = self.kept.remove(at);
            let map = found.2.clone();
            self.kept.push(found);
            return Ok(map);
        }
        let map = Arc::new(self.make(&source, seed)?);
        if self.kept.len() >= KEPT {
            self.kept.remove(0);
        }
        self.kept.push((source, seed, map.clone()));
        Ok(map)
    }

    /// The OpenDRIVE text of a map, unchanged and unchecked.
    ///
    /// # Errors
    /// When there is no such map, or it cannot be read.
    pub fn text(&self, name: &str, seed: u64) -> anyhow::Result<String> {
        Ok(match self.find(name)? {
            Source::Town(name) => Town::open_drive(&name, seed).map_err(wrong_usage)?,
            Source::File { path, bytes, .. } => read_text(&path, bytes)?,
            Source::Stored { name, .. } => self.stored[&name].1.open_drive.clone(),
            Source::Provided { name, .. } => self.provided[&name].text.clone(),
        })
    }

    fn find(&self, name: &str) -> anyhow::Result<Source> {
        if name.is_empty() || name.len() > 4096 || name.contains('\0') {
            return Err(wrong_usage(format!(
                "a map name has {} characters, but must have 1 to 4096 and no NUL",
                name.len()
            )));
        }
        let short = short_name(name);
        if let Some((revision, _)) = self.stored.get(short) {
            return Ok(Source::Stored {
                name: short.to_owned(),
                revision: *revision,
            });
        }
        if let Some(provided) = self.provided.get(name) {
            return Ok(Source::Provided {
                name: name.to_owned(),
                revision: provided.revision,
            });
        }
        let places = self.places(name);
        if let Some((path, file)) = places
            .iter()
            .find_map(|path| Some((path, path.metadata().ok().filter(|file| file.is_file())?)))
        {
            let path = path
                .canonicalize()
                .with_context(|| format!("map file {} cannot be read", path.display()))?;
            return Ok(Source::File {
                path,
                bytes: file.len(),
                changed: file.modified().ok(),
            });
        }
        if is_path(name) {
            return Err(wrong_usage(format!(
                "map file {name:?} not found; looked in {}",
                listed(&places)
            )));
        }
        if Town::all_names().contains(&short) {
            return Ok(Source::Town(short.to_owned()));
        }
        let files = self.in_folder();
        let there = if files.is_empty() {
            "which has no .xodr files".to_owned()
        } else {
            format!("which has {}", files.join(", "))
        };
        Err(wrong_usage(format!(
            "map {name:?} not found; generated towns are {}; put {name}.xodr into the map folder {}, {there}, or give a path",
            Town::all_names().join(", "),
            self.folder.display()
        )))
    }

    /// Where the file that `name` means may be.
    fn places(&self, name: &str) -> Vec<PathBuf> {
        let mut places: Vec<PathBuf> = Vec::new();
        if is_path(name) {
            places.push(name.into());
            places.extend(self.beside.iter().map(|folder| folder.join(name)));
            places.push(self.folder.join(name));
        } else {
            // A name that is none cannot lead out of the folder.
            for plain in [name, short_name(name)] {
                if is_plain(plain) {
                    places.push(self.folder.join(format!("{plain}.xodr")));
                }
            }
        }
        places
    }

    fn make(&self, source: &Source, seed: u64) -> anyhow::Result<LoadedMap> {
        match source {
            Source::Town(name) if Town::LARGE_NAMES.contains(&name.as_str()) => {
                let text = Town::open_drive(name, seed).map_err(wrong_usage)?;
                let mut map = build(name, &text, seed, &ImportOptions::default())?;
                // Our lanes say what our signs say.
                Arc::make_mut(&mut map.data).signs_post_limits = false;
                Ok(map)
            }
            Source::Town(name) => {
                let town = Town::generate(name, seed).map_err(wrong_usage)?;
                let roads = RoadMap::parse(&town.open_drive)
                    .with_context(|| format!("cannot load map {name:?}"))?;
                Ok(LoadedMap {
                    data: Arc::new(MapData::of_town(&town, Arc::new(roads))),
                    assets: town.assets,
                })
            }
            Source::File { path, bytes, .. } => {
                let name = path
                    .file_stem()
                    .map_or_else(|| "map".into(), |stem| stem.to_string_lossy().into_owned());
                let text = read_text(path, *bytes)?;
                build(&name, &text, seed, &ImportOptions::default())
                    .map_err(|error| wrong_usage(format!("{}: {error:#}", path.display())))
            }
            Source::Provided { name, .. } => {
                let Provided { title, text, .. } = &self.provided[name];
                build(title, text, seed, &ImportOptions::default())
                    .map_err(|error| wrong_usage(format!("map {name:?}: {error:#}")))
            }
            Source::Stored { name, .. } => {
                let (_, map) = self
                    .stored
                    .get(name)
                    .expect("a stored map was just found under this name");
                build(name, &map.open_drive, seed, &options_of(map))
                    .map_err(|error| wrong_usage(format!("map {name:?}: {error:#}")))
            }
        }
    }
}

/// The text of a file that is not too long.
fn read_text(path: &Path, bytes: u64) -> anyhow::Result<String> {
    if bytes > MAX_TEXT_BYTES as u64 {
        return Err(wrong_usage(format!(
            "map file {} has {bytes} bytes; at most {MAX_TEXT_BYTES} are read",
            path.display()
        )));
    }
    let raw = launch_cli::files::read_plain(path, MAX_TEXT_BYTES as u64).map_err(|error| {
        wrong_usage(format!(
            "map file {} cannot be read: {error}",
            path.display()
        ))
    })?;
    Ok(String::from_utf8_lossy(&raw).into_owned())
}

/// Builds a map from a text.
fn build(name: &str, text: &str, seed: u64, options: &ImportOptions) -> anyhow::Result<LoadedMap> {
    let roads = RoadMap::parse(text)?;
    let warnings = roads.warnings();
    for warning in warnings.iter().take(WARNINGS_SHOWN) {
        tracing::warn!(map = name, "{warning}");
    }
    if warnings.len() > WARNINGS_SHOWN {
        tracing::warn!(
            map = name,
            "{} further warnings; `gantry map check` lists them",
            warnings.len() - WARNINGS_SHOWN
        );
    }
    let town = import(name, text, &roads, seed, options)?;
    if town.spawn_points.is_empty() {
        anyhow::bail!(
            "no driving lane is long and wide enough for a vehicle; at least one must be 2.4 m wide and a few metres long"
        );
    }
    Ok(LoadedMap {
        data: Arc::new(MapData::of_import(&town, Arc::new(roads))),
        assets: town.assets,
    })
}

fn options_of(map: &StoredMap) -> ImportOptions {
    ImportOptions {
        vertex_distance_m: map.vertex_distance_m,
        wall_height_m: map.wall_height_m.clamp(0.0, 100.0),
        junction_extra_m: map.junction_extra_m,
        visible: map.visible,
        roadside: map.roadside,
    }
}

/// A name without folders and without `_Opt`, CARLA's suffix for a map with switchable layers.
fn short_name(name: &str) -> &str {
    let short = name.rsplit('/').next().unwrap_or(name);
    short.strip_suffix("_Opt").unwrap_or(short)
}

/// Whether a name means a path.
fn is_path(name: &str) -> bool {
    name.ends_with(".xodr") || (name.starts_with(['/', '.']) && !name.starts_with("/Game/"))
}

/// Whether a name cannot be mistaken for a path.
fn is_plain(name: &str) -> bool {
    (1..=MAX_NAME).contains(&name.len())
        && !name.starts_with('.')
        && name
            .chars()
            .all(|c| c.is_alphanumeric() || matches!(c, '-' | '_' | '.' | ' ' | '+'))
}

fn listed(places: &[PathBuf]) -> String {
    let names: Vec<String> = places
        .iter()
        .map(|path| path.display().to_string())
        .collect();
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROAD: &str = r#"<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="one"/><road id="1" length="100" junction="-1">
        <planView><geometry s="0" x="500000" y="5400000" hdg="0" length="100"><line/></geometry></planView>
        <lanes><laneSection s="0"><center><lane id="0" type="none"/></center><right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection></lanes></road></OpenDRIVE>"#;

    fn stored(name: &str) -> StoredMap {
        StoredMap {
            name: name.into(),
            open_drive: ROAD.into(),
            ..StoredMap::default()
        }
    }

    fn folder(name: &str) -> PathBuf {
        let folder =
            std::env::temp_dir().join(format!("gantry-maps-{name}-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("maps")).unwrap();
        folder
    }

    #[test]
    fn a_path_a_file_of_the_folder_and_a_town_are_found_and_kept() {
        let data = folder("find");
        std::fs::write(data.join("maps/mine.xodr"), ROAD).unwrap();
        std::fs::write(data.join("other.xodr"), ROAD).unwrap();
        let mut maps = Maps::new(&data, None);
        assert!(
            maps.names().contains(&"mine".to_owned())
                && maps.names().contains(&"Town02".to_owned())
        );
        let mine = maps.load("mine", 1).unwrap();
        assert_eq!(mine.data.name, "mine");
        // Far from zero all the same: the origin is in its middle.
        assert_eq!(mine.data.origin_m[0], 500_050.0);
        assert!(Arc::ptr_eq(
            &mine,
            &maps.load("/Game/Carla/Maps/mine_Opt", 1).unwrap()
        ));
        assert!(
            !Arc::ptr_eq(&mine, &maps.load("mine", 2).unwrap()),
            "another seed is another world"
        );
        assert_eq!(
            maps.load(data.join("other.xodr").to_str().unwrap(), 1)
                .unwrap()
                .data
                .name,
            "other"
        );
        // A file in the folder takes the place of a town of its name.
        std::fs::write(data.join("maps/Town02.xodr"), ROAD).unwrap();
        assert_eq!(
            maps.load("Town02", 1)
                .unwrap()
                .data
                .roads
                .as_ref()
                .unwrap()
                .lanes()
                .len(),
            1
        );
        // A changed file is read again.
        std::fs::write(
            data.join("maps/mine.xodr"),
            ROAD.replace("\"3.5\"", "\"3.25\""),
        )
        .unwrap();
        assert!(!Arc::ptr_eq(&mine, &maps.load("mine", 1).unwrap()));
        std::fs::remove_dir_all(data).unwrap();
    }

    #[test]
    fn what_cannot_be_loaded_is_said_in_a_sentence() {
        let data = folder("fail");
        let mut maps = Maps::new(&data, None);
        let mut error = |name: &str| maps.load(name, 1).unwrap_err().to_string();
        assert!(
            error("Town99").contains("Town10HD") && error("Town99").contains("map folder"),
            "{}",
            error("Town99")
        );
        assert!(error("nowhere/x.xodr").contains("not found"));
        std::fs::write(data.join("maps/bad.xodr"), "<OpenDRIVE><road").unwrap();
        assert!(error("bad").contains("line 1"), "{}", error("bad"));
        assert!(
            error("/dev/zero").contains("not found"),
            "only plain files are read"
        );
        std::fs::remove_dir_all(data).unwrap();
    }

    #[test]
    fn clients_reach_the_data_folder_and_nothing_else() {
        let (data, launch) = (folder("asked"), folder("asked-launch"));
        let inside = data.join("maps/mine.xodr");
        let outside = data.with_extension("xodr");
        for path in [&inside, &outside, &launch.join("beside.xodr")] {
            std::fs::write(path, ROAD).unwrap();
        }
        let link = data.join("maps/link.xodr");
        std::os::unix::fs::symlink(&outside, &link).unwrap();
        let mut maps = Maps::new(&data, Some(launch.clone()));
        let outside = outside.to_str().unwrap();
        for name in [
            inside.to_str().unwrap(),
            "mine",
            "link",
            "mine.xodr",
            "beside.xodr",
        ] {
            maps.check_asked(name).expect(name);
            maps.load(name, 1).expect(name);
        }
        let leading_out = data
            .join("maps/../..")
            .join(Path::new(outside).file_name().unwrap());
        for name in [
            outside,
            leading_out.to_str().unwrap(),
            link.to_str().unwrap(),
            "/proc/self/environ",
            "/proc/kmsg",
            "./x",
            "/nowhere/x.xodr",
        ] {
            let error = maps.check_asked(name).unwrap_err().to_string();
            assert!(error.contains("store_map"), "{name}: {error}");
        }
        // What is no path cannot become one: its last part is a name in the folder.
        let own = maps.load("mine", 1).unwrap();
        maps.check_asked("a/../../mine").unwrap();
        assert!(Arc::ptr_eq(&own, &maps.load("a/../../mine", 1).unwrap()));
        for name in ["x/../../../etc/passwd", "mine.xodr_Opt"] {
            maps.check_asked(name).expect(name);
            let error = maps.load(name, 1).map(drop).unwrap_err().to_string();
            assert!(error.contains("not found"), "{name}: {error}");
        }
        maps.provide("/its/own.xodr".into(), "own".into(), ROAD.as_bytes());
        maps.check_asked("/its/own.xodr").unwrap();
        std::fs::remove_file(outside).unwrap();
        for folder in [data, launch] {
            std::fs::remove_dir_all(folder).unwrap();
        }
    }

    #[test]
    fn a_text_is_stored_under_a_plain_name_only() {
        let data = folder("store");
        let mut maps = Maps::new(&data, None);
        for name in ["../x", "a/b", "", ".hidden"] {
            assert!(
                maps.store(stored(name))
                    .unwrap_err()
                    .to_string()
                    .contains("map name"),
                "{name}"
            );
        }
        assert!(
            maps.store(StoredMap {
                open_drive: "no".into(),
                ..stored("x")
            })
            .is_err()
        );
        maps.store(stored("OpenDriveMap")).unwrap();
        let first = maps.load("OpenDriveMap", 1).unwrap();
        assert_eq!(first.data.name, "OpenDriveMap");
        maps.store(stored("OpenDriveMap")).unwrap();
        assert!(
            !Arc::ptr_eq(&first, &maps.load("Carla/Maps/OpenDriveMap", 1).unwrap()),
            "the newer text counts"
        );
        std::fs::remove_dir_all(data).unwrap();
    }
}
