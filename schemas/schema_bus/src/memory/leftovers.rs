//! Removes what a process left behind that was killed while it made or removed one of iceoryx2's
//! small files, and what a process left that was killed while it cleaned up.
//!
//! iceoryx2 0.10 makes each such file in two steps: it appears with the permissions of a file in the
//! making, is filled and synced to disk, and gets its final permissions. Files in the making are
//! invisible to iceoryx2's cleaning. Four things stay for good therefore:
//!
//! | Killed while it made | What stays |
//! |---|---|
//! | the tag of a service or port | the dead node: its folder is never empty, so it is never removed |
//! | a service's description | a service that nobody can open or make any more |
//! | its node | the node's folder, or a node that starts for ever |
//! | nothing, but removed a node | a node without a state file, which counts as being removed for ever |
//! | nothing, but removed a service | a service that is being removed for ever, and that nobody can open or make any more |
//!
//! [`Leftovers::sweep`] removes them. It takes away nothing of a process that may live: a node is dead
//! if nobody holds the lock on its state file, which the kernel keeps, and a service is in the making
//! only as long as a node that may live has its tag, which is made first. Where neither tells, the
//! process must be gone and its files a few seconds old, since processes of another container are
//! not seen. A service whose tag no node has is nobody's; it must have been so for a few seconds, in
//! which a process that lives would have removed it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{DirEntry, File};
use std::io;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use iceoryx2::config::Config;
use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::*;
use iceoryx2::service::internal::ServiceInternal as _;
use nix::fcntl::{Flock, FlockArg};

/// Permissions of a static file in the making, `static_storage::file` of iceoryx2-cal.
const IN_THE_MAKING: u32 = 0o600;
/// Permissions of a node's context in the making, `process_state` of iceoryx2-bb-posix.
const CONTEXT_IN_THE_MAKING: u32 = 0o200;
/// Ends of the names of a node's three files, behind its id and the suffix of its state file. Their
/// order is that in which they are removed.
const STATE_FILES: [&str; 3] = ["", "_owner_lock", "_context"];
/// How old the files of a process must be that is gone as far as can be seen from here.
const CERTAIN_AGE: Duration = Duration::from_secs(5);
/// A folder that changed longer ago than this changes its time again with its next change.
const CERTAIN_CHANGE: Duration = Duration::from_secs(1);

/// What tells a file from another one of the same name.
type Identity = (u64, i64, i64);

/// Since when this process has seen that no node has the tag of a service, by the service's file.
static NOBODYS: Mutex<BTreeMap<PathBuf, (Identity, Instant)>> = Mutex::new(BTreeMap::new());

/// What a process remembers from one sweep to the next.
#[derive(Debug, Default)]
pub(crate) struct Leftovers {
    /// When the folder of services had last changed while no service was in the making.
    quiet_since: Mutex<Option<SystemTime>>,
}

impl Leftovers {
    /// Removes it. `has_dead` says that there may be dead nodes that iceoryx2 could not remove.
    /// What cannot be removed is left to the next sweep, or to whoever may.
    pub fn sweep(&self, config: &Config, has_dead: bool) {
        let place = Place::new(config);
        // One process at a time; the others have nothing to do then.
        let Ok(folder) = File::open(&place.nodes) else {
            return;
        };
        let Ok(_turn) = Flock::lock(folder, FlockArg::LockExclusiveNonblock) else {
            return;
        };
        let dead = std::cell::OnceCell::new();
        let is_dead = |id: u128| dead.get_or_init(|| dead_nodes(config)).contains(&id);
        for (id, has_state) in place.node_ids() {
            if place.is_removed(id)
                || (has_dead && has_state && is_dead(id))
                || (!place.is_complete(id) && place.is_certainly_gone(id))
            {
                place.remove_node(id);
            }
        }
        self.sweep_services(config, &place, is_dead);
    }

    fn sweep_services(&self, config: &Config, place: &Place, is_dead: impl Fn(u128) -> bool) {
        let mut quiet_since = self
            .quiet_since
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let changed = std::fs::metadata(&place.services).and_then(|about| about.modified());
        let Ok(changed) = changed else {
            return;
        };
        if *quiet_since == Some(changed) {
            return;
        }
        let mut is_quiet = changed.elapsed().is_ok_and(|age| age > CERTAIN_CHANGE);
        let tagged = std::cell::OnceCell::new();
        let mut nobodys = BTreeMap::new();
        for entry in entries(&place.services) {
            let Some(hash) = place.name_within(&entry, &place.service_suffix) else {
                continue;
            };
            let path = entry.path();
            let Some(before) = in_the_making(&path) else {
                let tagged = tagged.get_or_init(|| place.tagged_services());
                // A service that was made since has its tag by now.
                if !tagged.contains(&hash)
                    && place.nodes_with_tag(&hash).is_empty()
                    && let Some(identity) = identity(&path)
                {
                    nobodys.insert(path, (hash, identity));
                    is_quiet = false;
                }
                continue;
            };
            let makers = place.nodes_with_tag(&hash);
            if makers.into_iter().all(&is_dead) && in_the_making(&path) == Some(before) {
                let _ = std::fs::remove_file(&path);
            }
            is_quiet = false;
        }
        for (path, hash) in nobodys_for_long(&place.services, nobodys) {
            remove_service(config, &path, &hash);
        }
        *quiet_since = is_quiet.then_some(changed);
    }
}

/// Of the services in `folder` that are nobody's now, the files and hashes of those that have been so
/// for long enough. The others are remembered.
fn nobodys_for_long(
    folder: &Path,
    now: BTreeMap<PathBuf, (String, Identity)>,
) -> Vec<(PathBuf, String)> {
    let mut seen = NOBODYS.lock().unwrap_or_else(PoisonError::into_inner);
    seen.retain(|path, (identity, _)| {
        let is_still = now.get(path).is_some_and(|(_, it)| it == identity);
        is_still || !path.starts_with(folder)
    });
    let mut for_long = Vec::new();
    for (path, (hash, identity)) in now {
        let (_, since) = seen
            .entry(path.clone())
            .or_insert_with(|| (identity, Instant::now()));
        if since.elapsed() > CERTAIN_AGE {
            for_long.push((path, hash));
        }
    }
    for_long
}

/// Removes a service that is nobody's.
fn remove_service(config: &Config, path: &Path, hash: &str) {
    let mut found = None;
    // What cannot be listed has lost all but its description.
    let _ = ipc_threadsafe::Service::list(config, |details| {
        let is_it = details.static_details.service_hash().as_str() == hash;
        found = is_it.then_some(details.static_details);
        match is_it {
            true => CallbackProgression::Stop,
            false => CallbackProgression::Continue,
        }
    });
    if let Some(about) = found {
        // SAFETY: no process uses the service: whoever does has a node with its tag, which is made
        // before the service is opened and removed after it is closed, and no node has had it for
        // `CERTAIN_AGE`.
        let _ = unsafe { ipc_threadsafe::Service::__internal_remove_service(&about, config) };
    }
    let _ = std::fs::remove_file(path);
}

/// iceoryx2's folders and the names in them.
struct Place {
    nodes: PathBuf,
    services: PathBuf,
    prefix: String,
    state_suffix: String,
    details_suffix: String,
    tag_suffix: String,
    service_suffix: String,
}

impl Place {
    fn new(config: &Config) -> Place {
        let global = &config.global;
        Place {
            nodes: PathBuf::from(global.node_dir().to_string()),
            services: PathBuf::from(global.service_dir().to_string()),
            prefix: global.prefix.to_string(),
            state_suffix: global.node.monitor_suffix.to_string(),
            details_suffix: global.node.static_config_suffix.to_string(),
            tag_suffix: global.node.service_tag_suffix.to_string(),
            service_suffix: global.service.static_config_storage_suffix.to_string(),
        }
    }

    /// What stands between the prefix and `suffix` in a file's name.
    fn name_within(&self, entry: &DirEntry, suffix: &str) -> Option<String> {
        let name = entry.file_name();
        let rest = name.to_str()?.strip_prefix(&self.prefix)?;
        Some(rest.strip_suffix(suffix)?.to_owned())
    }

    fn folder(&self, id: u128) -> PathBuf {
        self.nodes.join(id.to_string())
    }

    /// One of a node's three files.
    fn state_file(&self, id: u128, end: &str) -> PathBuf {
        self.nodes
            .join(format!("{}{id}{}{end}", self.prefix, self.state_suffix))
    }

    /// All nodes of which a folder or file is there, and whether the state file is.
    fn node_ids(&self) -> BTreeMap<u128, bool> {
        let mut ids = BTreeMap::new();
        for entry in entries(&self.nodes) {
            let by_folder = entry
                .file_name()
                .to_str()
                .and_then(|name| name.parse().ok());
            if let Some(id) = by_folder {
                ids.entry(id).or_insert(false);
                continue;
            }
            for end in STATE_FILES {
                let suffix = format!("{}{end}", self.state_suffix);
                let id = self.name_within(&entry, &suffix);
                if let Some(id) = id.and_then(|id| id.parse().ok()) {
                    *ids.entry(id).or_insert(false) |= end.is_empty();
                }
            }
        }
        ids
    }

    /// Whether the node's context is final and its state file is gone: it had been made, and was
    /// being removed. The order of the two looks counts.
    fn is_removed(&self, id: u128) -> bool {
        self.is_complete(id) && is_missing(&self.state_file(id, ""))
    }

    /// Whether the node was made to its end.
    fn is_complete(&self, id: u128) -> bool {
        mode(&self.state_file(id, "_context")).is_some_and(|mode| mode != CONTEXT_IN_THE_MAKING)
    }

    /// Whether the process of a node is gone as far as can be seen from here, and nothing of the node
    /// has changed for a while. The process is part of the node's id.
    fn is_certainly_gone(&self, id: u128) -> bool {
        let [.., p0, p1, p2, p3, _, _, _, _] = id.to_ne_bytes();
        let pid = u32::from_ne_bytes([p0, p1, p2, p3]);
        if Path::new(&format!("/proc/{pid}")).exists() {
            return false;
        }
        let files = STATE_FILES.map(|end| self.state_file(id, end));
        let mut found = files.into_iter().chain([self.folder(id)]);
        found.all(|path| {
            let changed = std::fs::metadata(path).and_then(|about| about.modified());
            match changed {
                Ok(changed) => changed.elapsed().is_ok_and(|age| age > CERTAIN_AGE),
                Err(error) => error.kind() == io::ErrorKind::NotFound,
            }
        })
    }

    /// Removes what iceoryx2 cannot of a node that is dead. A folder with the node's details is left
    /// to iceoryx2 as long as somebody can find it: these say what the node had open.
    fn remove_node(&self, id: u128) {
        let folder = self.folder(id);
        let is_found = self.is_complete(id) && !is_missing(&self.state_file(id, ""));
        let mut keeps_details = false;
        for entry in entries(&folder) {
            // Processes with another prefix may keep their nodes in the same folder.
            if self.name_within(&entry, "").is_none() {
                return;
            }
            if in_the_making(&entry.path()).is_some() || !is_found {
                let _ = std::fs::remove_file(entry.path());
            } else {
                keeps_details |= self.name_within(&entry, &self.details_suffix).is_some();
            }
        }
        if keeps_details {
            return;
        }
        match std::fs::remove_dir(&folder) {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(_) => return,
        }
        for end in STATE_FILES {
            let _ = std::fs::remove_file(self.state_file(id, end));
        }
    }

    /// Hashes of the services of which any node has the tag.
    fn tagged_services(&self) -> BTreeSet<String> {
        let mut tagged = BTreeSet::new();
        for id in self.node_ids().into_keys() {
            let folder = self.folder(id);
            let tags = entries(&folder);
            tagged.extend(tags.filter_map(|entry| self.name_within(&entry, &self.tag_suffix)));
        }
        tagged
    }

    fn nodes_with_tag(&self, hash: &str) -> Vec<u128> {
        let tag = format!("{}{hash}{}", self.prefix, self.tag_suffix);
        let has_it = |id: &u128| !is_missing(&self.folder(*id).join(&tag));
        self.node_ids().into_keys().filter(has_it).collect()
    }
}

/// Nodes whose processes do not hold the locks on their state files any more.
fn dead_nodes(config: &Config) -> BTreeSet<u128> {
    let mut dead = BTreeSet::new();
    // A folder of nodes that cannot be read means that none is known to be dead.
    let _ = Node::<ipc_threadsafe::Service>::list(config, |state| {
        if let NodeState::Dead(view) = state {
            dead.insert(view.id().value());
        }
        CallbackProgression::Continue
    });
    dead
}

fn entries(folder: &Path) -> impl Iterator<Item = DirEntry> {
    std::fs::read_dir(folder).into_iter().flatten().flatten()
}

fn mode(path: &Path) -> Option<u32> {
    let about = std::fs::symlink_metadata(path).ok()?;
    Some(about.permissions().mode() & 0o777)
}

fn is_missing(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_err_and(|error| error.kind() == io::ErrorKind::NotFound)
}

/// `None` if the file is gone.
fn identity(path: &Path) -> Option<Identity> {
    let about = std::fs::symlink_metadata(path).ok()?;
    Some((about.ino(), about.ctime(), about.ctime_nsec()))
}

/// The identity of a file in the making; `None` if it is final or gone.
fn in_the_making(path: &Path) -> Option<Identity> {
    let about = std::fs::symlink_metadata(path).ok()?;
    let is_it = about.is_file() && about.mode() & 0o777 == IN_THE_MAKING;
    is_it.then(|| (about.ino(), about.ctime(), about.ctime_nsec()))
}
