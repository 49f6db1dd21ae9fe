//! Whose folder iceoryx2's bookkeeping lies in. By default that is one folder for all users of the
//! machine, which belongs to whoever was first; everybody else gets one of their own.
//!
//! A user's own folder is in `XDG_RUNTIME_DIR`, where nobody else can make anything, or beside the
//! default one, where others can take any name in advance: names are numbered, the first free one is
//! made, and all processes of the user find the first that is theirs. Nothing here follows links.

use std::collections::BTreeMap;
use std::fs::Metadata;
use std::io::ErrorKind;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};
use std::sync::Once;

/// End of the names of files in shared memory that all nodes with one prefix share.
const SHARED_BY_NODES: &str = ".global_mgmt";
/// Where iceoryx2's segments lie.
pub(crate) const SHM: &str = "/dev/shm";

/// Where a user's place is looked for.
#[derive(Clone, Debug)]
pub(crate) struct Machine {
    /// Folder of the bookkeeping of all users.
    pub root: PathBuf,
    /// Start of the names of files in shared memory of all users.
    pub prefix: String,
    /// Folder of shared memory.
    pub shm: PathBuf,
    /// Folder that `XDG_RUNTIME_DIR` names.
    pub runtime: Option<PathBuf>,
}

/// A user's own place.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct OwnPlace {
    /// Folder of the bookkeeping.
    pub root: PathBuf,
    /// Start of the names of files in shared memory.
    pub prefix: String,
}

/// Why there is no place that is a user's alone.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PlaceError {
    #[error("cannot make the folder {}: {source}", path.display())]
    Make {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error(
        "{} was made just now, but does not belong to user {user} alone; name another root-path in config/iceoryx2.toml, on a file system that knows users",
        path.display()
    )]
    NotAlone { path: PathBuf, user: u32 },
}

impl Machine {
    /// The place that `user` has instead of that of all; `None` if this can be used. A place that
    /// was used once is used as long as it is there, so that programs which start later meet those
    /// that run.
    ///
    /// # Errors
    /// [`PlaceError`] if none can be made.
    pub fn own_place(&self, user: u32) -> Result<Option<OwnPlace>, PlaceError> {
        let series = self.series(user);
        for series in &series {
            let there = series.there();
            let ours = there.iter().filter(|(_, about)| is_alone(about, user));
            let mut own = ours.map(|(number, _)| series.place(*number));
            if let Some(own) = own.find(|own| !is_taken(&self.shm, &own.prefix, user)) {
                return Ok(Some(own));
            }
        }
        let there = about(&self.root);
        let other = other_user(&self.shm, &self.prefix, user);
        if there.as_ref().is_none_or(|there| is_alone(there, user)) && other.is_none() {
            return Ok(None);
        }
        let mut own = Err(None);
        for series in &series {
            own = series.make(&self.shm, user).map_err(Some);
            if own.is_ok() {
                break;
            }
        }
        let own = own.map_err(|error| error.expect("there is a series beside the root"))?;
        static SAID: Once = Once::new();
        SAID.call_once(|| {
            let of = there.map(|there| there.uid()).or(other).unwrap_or(user);
            tracing::info!(
                "{} or what lies in {} with it belongs to user {of}, so the shared-memory bus of user {user} is in {}",
                self.root.display(),
                self.shm.display(),
                own.root.display()
            );
        });
        Ok(Some(own))
    }

    /// Names for places of `user`, those that nobody can take first.
    fn series(&self, user: u32) -> Vec<Series> {
        let name = self.root.file_name().unwrap_or_default().to_string_lossy();
        let in_folder = |folder: &Path, stem: String| Series {
            folder: folder.into(),
            stem,
            prefix: format!("{}{user}_", self.prefix),
        };
        let runtime = self.runtime.as_deref().filter(|folder| {
            about(folder)
                .is_some_and(|about| is_alone(&about, user) && about.mode() & 0o777 == 0o700)
        });
        let beside = self.root.parent().unwrap_or(Path::new("/"));
        runtime
            .map(|folder| in_folder(folder, name.to_string()))
            .into_iter()
            .chain([in_folder(beside, format!("{name}-{user}"))])
            .collect()
    }
}

/// Numbered names in one folder.
struct Series {
    folder: PathBuf,
    /// The first name; others have `-1`, `-2` and so on behind it.
    stem: String,
    /// The first prefix; others have the number and `_` behind it.
    prefix: String,
}

impl Series {
    fn place(&self, number: u32) -> OwnPlace {
        let (stem, prefix) = (&self.stem, &self.prefix);
        let (name, prefix) = match number {
            0 => (stem.clone(), prefix.clone()),
            number => (format!("{stem}-{number}"), format!("{prefix}{number}_")),
        };
        OwnPlace {
            root: self.folder.join(name),
            prefix,
        }
    }

    /// All that has one of the names, whatever it is.
    fn there(&self) -> BTreeMap<u32, Metadata> {
        let entries = self.folder.read_dir().into_iter().flatten().flatten();
        let numbered = entries.filter_map(|entry| {
            let name = entry.file_name();
            let rest = name.to_str()?.strip_prefix(&self.stem)?;
            let number = match rest.strip_prefix('-') {
                Some(digits) => digits.parse().ok()?,
                None if rest.is_empty() => 0,
                None => return None,
            };
            // Not `-0`, `-01` or `-+1`, which are other names.
            let is_name = self.place(number).root == entry.path();
            is_name.then_some(())?;
            Some((number, about(&entry.path())?))
        });
        numbered.collect()
    }

    /// Makes the first place whose names nobody else has.
    fn make(&self, shm: &Path, user: u32) -> Result<OwnPlace, PlaceError> {
        let there = self.there();
        for number in 0.. {
            let own = self.place(number);
            if there.contains_key(&number) || is_taken(shm, &own.prefix, user) {
                continue;
            }
            let made = std::fs::DirBuilder::new().mode(0o700).create(&own.root);
            let is_ours = about(&own.root).is_some_and(|about| is_alone(&about, user));
            match made {
                // Another process of this user was faster, with the same name.
                Ok(()) | Err(_) if is_ours => return Ok(own),
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Ok(()) => {
                    return Err(PlaceError::NotAlone {
                        path: own.root,
                        user,
                    });
                }
                Err(source) => {
                    return Err(PlaceError::Make {
                        path: own.root,
                        source,
                    });
                }
            }
        }
        unreachable!("no file system has so many names")
    }
}

/// What is there by this name, links not followed.
fn about(path: &Path) -> Option<Metadata> {
    std::fs::symlink_metadata(path).ok()
}

/// Whether this is a folder that `user` owns and nobody else can write to.
fn is_alone(about: &Metadata, user: u32) -> bool {
    about.is_dir() && about.uid() == user && about.mode() & 0o022 == 0
}

/// Another user whose nodes share the file that all nodes with this prefix share, for example in
/// another container.
fn other_user(shm: &Path, prefix: &str, user: u32) -> Option<u32> {
    owners(shm, prefix).into_iter().find(|owner| *owner != user)
}

/// Whether another user has made that file, and not this one too.
fn is_taken(shm: &Path, prefix: &str, user: u32) -> bool {
    let owners = owners(shm, prefix);
    !owners.is_empty() && !owners.contains(&user)
}

/// Owners of the files that all nodes with this prefix share.
fn owners(shm: &Path, prefix: &str) -> Vec<u32> {
    let entries = shm.read_dir().into_iter().flatten().flatten();
    let owners = entries.filter_map(|entry| {
        let name = entry.file_name();
        let name = name.to_str()?;
        let rest = name.strip_prefix(prefix)?.strip_suffix(SHARED_BY_NODES)?;
        // Behind a prefix of a user's own there is a number and one more underscore.
        let is_longer = rest
            .split_once('_')
            .is_some_and(|(number, rest)| number.parse::<u32>().is_ok() && rest.contains('_'));
        let owner = entry.metadata().ok()?.uid();
        (!is_longer).then_some(owner)
    });
    owners.collect()
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt as _, chown, symlink};

    use super::*;

    struct Place {
        folder: tempfile::TempDir,
        user: u32,
        machine: Machine,
    }

    impl Place {
        fn new() -> Place {
            let folder = tempfile::tempdir().unwrap();
            std::fs::create_dir(folder.path().join("shm")).unwrap();
            let machine = Machine {
                root: folder.path().join("iceoryx2"),
                prefix: "iox2_".to_owned(),
                shm: folder.path().join("shm"),
                runtime: None,
            };
            let user = nix::unistd::geteuid().as_raw();
            Place {
                folder,
                user,
                machine,
            }
        }

        fn path(&self, name: &str) -> PathBuf {
            self.folder.path().join(name)
        }

        /// The folder and the prefix that processes of this user take, if not those of all.
        fn taken(&self) -> Option<(PathBuf, String)> {
            let own = self.machine.own_place(self.user).unwrap()?;
            Some((own.root, own.prefix))
        }

        fn own(&self) -> Option<(PathBuf, String)> {
            let user = self.user;
            let root = self.path(&format!("iceoryx2-{user}"));
            Some((root, format!("iox2_{user}_")))
        }

        fn numbered(&self, number: u32) -> Option<(PathBuf, String)> {
            let user = self.user;
            let root = self.path(&format!("iceoryx2-{user}-{number}"));
            Some((root, format!("iox2_{user}_{number}_")))
        }

        /// A folder that others can write to, which is as good as another user's.
        fn foreign(&self, name: &str) {
            self.folder_of(name, 0o777);
        }

        fn folder_of(&self, name: &str, mode: u32) {
            let path = self.path(name);
            std::fs::create_dir_all(&path).unwrap();
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
        }
    }

    #[test]
    fn a_folder_that_is_ours_alone_is_used_and_one_that_is_not_is_left() {
        let place = Place::new();
        assert_eq!(place.taken(), None, "it can be made");
        place.folder_of("iceoryx2", 0o750);
        assert_eq!(place.taken(), None);
        place.foreign("iceoryx2");
        assert_eq!(place.taken(), place.own());
        place.folder_of("iceoryx2", 0o750);
        assert_eq!(place.taken(), place.own(), "programs meet");
        std::fs::remove_dir(place.own().unwrap().0).unwrap();
        std::fs::remove_dir(place.path("iceoryx2")).unwrap();
        symlink("/", place.path("iceoryx2")).unwrap();
        assert_eq!(place.taken(), place.own(), "a link is nobody's");
    }

    #[test]
    fn names_that_another_user_has_taken_are_passed_over() {
        let place = Place::new();
        let user = place.user;
        place.foreign("iceoryx2");
        place.foreign(&format!("iceoryx2-{user}"));
        symlink("/", place.path(&format!("iceoryx2-{user}-1"))).unwrap();
        std::fs::write(place.path(&format!("iceoryx2-{user}-2")), "").unwrap();
        assert_eq!(place.taken(), place.numbered(3));
        let mode = about(&place.numbered(3).unwrap().0).unwrap().mode();
        assert_eq!(mode & 0o777, 0o700);
        // Whoever comes later finds it, whatever becomes of the names before it.
        std::fs::remove_file(place.path(&format!("iceoryx2-{user}-2"))).unwrap();
        std::fs::remove_dir(place.path("iceoryx2")).unwrap();
        assert_eq!(place.taken(), place.numbered(3));
        // Names that are none of the series are nothing to it.
        for name in ["-01", "-x", "0", "-4294967296"] {
            place.folder_of(&format!("iceoryx2-{user}{name}"), 0o700);
        }
        assert_eq!(place.taken(), place.numbered(3));
    }

    #[test]
    fn the_runtime_folder_comes_first_if_it_is_this_users_alone() {
        let mut place = Place::new();
        place.foreign("iceoryx2");
        place.machine.runtime = Some(place.path("run"));
        let prefix = format!("iox2_{}_", place.user);
        let inside = Some((place.path("run/iceoryx2"), prefix));
        place.folder_of("run", 0o700);
        assert_eq!(place.taken(), inside);
        place.folder_of("run", 0o755);
        assert_eq!(place.taken(), place.own(), "it must be closed to others");
        std::fs::remove_dir(place.own().unwrap().0).unwrap();
        place.folder_of("run", 0o700);
        assert_eq!(place.taken(), inside);
        symlink(place.path("run"), place.path("link")).unwrap();
        place.machine.runtime = Some(place.path("link"));
        assert_eq!(place.taken(), place.own(), "links are not followed");
        place.machine.runtime = Some(place.path("nowhere"));
        assert_eq!(place.taken(), place.own());
    }

    #[test]
    fn a_place_that_cannot_be_made_is_an_error_with_its_path() {
        let place = Place::new();
        place.foreign("iceoryx2");
        // To a user that is not ours, what this process makes is somebody else's.
        let error = place.machine.own_place(place.user + 1).unwrap_err();
        assert!(matches!(error, PlaceError::NotAlone { .. }), "{error}");
        assert!(error.to_string().contains("root-path"), "{error}");
        let nowhere = Machine {
            root: place.path("nowhere/iceoryx2"),
            ..place.machine.clone()
        };
        let shared = place.path("shm/iox2_9204dd_node.0_10_0.global_mgmt");
        std::fs::write(&shared, b"").unwrap();
        let error = nowhere.own_place(place.user + 1).unwrap_err();
        let path = format!("nowhere/iceoryx2-{}", place.user + 1);
        assert!(error.to_string().contains(&path), "{error}");
    }

    #[test]
    fn another_users_nodes_in_the_same_shared_memory_are_seen() {
        let place = Place::new();
        let user = place.user;
        let shared = place.path("shm/iox2_9204dd_node.0_10_0.global_mgmt");
        std::fs::write(&shared, b"").unwrap();
        let of_7 = place.path("shm/iox2_7_9204dd_node.0_10_0.global_mgmt");
        std::fs::write(of_7, b"").unwrap();
        assert_eq!(place.taken(), None, "it is ours");
        if chown(&shared, Some(user + 1), None).is_err() {
            return; // Only root can give files away.
        }
        assert_eq!(place.taken(), place.own());
        // A name there can be taken in advance, too.
        let own = format!("shm/iox2_{user}_9204dd_node.0_10_0.global_mgmt");
        std::fs::write(place.path(&own), b"").unwrap();
        assert_eq!(place.taken(), place.own(), "it is ours");
        chown(place.path(&own), Some(user + 1), None).unwrap();
        assert_eq!(place.taken(), place.numbered(1));
    }
}
