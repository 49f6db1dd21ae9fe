//! iceoryx2's folders, whose their files are, and in which state.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::DirEntry;
use std::io;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::*;

/// Permissions of a static file in the making, `static_storage::file` of iceoryx2-cal.
const IN_THE_MAKING: u32 = 0o600;
/// Permissions of a node's context in the making, `process_state` of iceoryx2-bb-posix.
const CONTEXT_IN_THE_MAKING: u32 = 0o200;
/// Ends of the names of a node's three files, behind its id and the suffix of its state file. Their
/// order is that in which they are removed.
const STATE_FILES: [&str; 3] = ["", "_owner_lock", "_context"];
/// How old the files of a process must be that is gone as far as can be seen from here.
pub(super) const CERTAIN_AGE: Duration = Duration::from_secs(5);

/// What tells a file from another one of the same name.
pub(super) type Identity = (u64, i64, i64);

/// iceoryx2's folders and the names in them.
pub(super) struct Place {
    pub nodes: PathBuf,
    pub services: PathBuf,
    pub prefix: String,
    pub state_suffix: String,
    pub details_suffix: String,
    pub tag_suffix: String,
    pub service_suffix: String,
}

impl Place {
    pub fn new(config: &Config) -> Place {
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
    pub fn name_within(&self, entry: &DirEntry, suffix: &str) -> Option<String> {
        let name = entry.file_name();
        let rest = name.to_str()?.strip_prefix(&self.prefix)?;
        Some(rest.strip_suffix(suffix)?.to_owned())
    }

    pub fn folder(&self, id: u128) -> PathBuf {
        self.nodes.join(id.to_string())
    }

    /// One of a node's three files.
    pub fn state_file(&self, id: u128, end: &str) -> PathBuf {
        self.nodes
            .join(format!("{}{id}{}{end}", self.prefix, self.state_suffix))
    }

    /// All nodes of which a folder or file is there, and whether the state file is.
    pub fn node_ids(&self) -> BTreeMap<u128, bool> {
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
    pub fn is_removed(&self, id: u128) -> bool {
        self.is_complete(id) && is_missing(&self.state_file(id, ""))
    }

    /// Whether the node was made to its end.
    pub fn is_complete(&self, id: u128) -> bool {
        mode(&self.state_file(id, "_context")).is_some_and(|mode| mode != CONTEXT_IN_THE_MAKING)
    }

    /// Whether the process of a node is gone as far as can be seen from here, and nothing of the node
    /// has changed for a while. The process is part of the node's id.
    pub fn is_certainly_gone(&self, id: u128) -> bool {
        if !is_missing(Path::new(&format!("/proc/{}", process_of(id)))) {
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
    pub fn remove_node(&self, id: u128) {
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
    pub fn tagged_services(&self) -> BTreeSet<String> {
        let mut tagged = BTreeSet::new();
        for id in self.node_ids().into_keys() {
            let folder = self.folder(id);
            let tags = entries(&folder);
            tagged.extend(tags.filter_map(|entry| self.name_within(&entry, &self.tag_suffix)));
        }
        tagged
    }

    pub fn nodes_with_tag(&self, hash: &str) -> Vec<u128> {
        let tag = format!("{}{hash}{}", self.prefix, self.tag_suffix);
        let has_it = |id: &u128| !is_missing(&self.folder(*id).join(&tag));
        self.node_ids().into_keys().filter(has_it).collect()
    }
}

/// The process that made a node or port, by its id.
pub(super) fn process_of(id: u128) -> u32 {
    let [.., p0, p1, p2, p3, _, _, _, _] = id.to_ne_bytes();
    u32::from_ne_bytes([p0, p1, p2, p3])
}

pub(super) fn entries(folder: &Path) -> impl Iterator<Item = DirEntry> {
    std::fs::read_dir(folder).into_iter().flatten().flatten()
}

pub(super) fn mode(path: &Path) -> Option<u32> {
    let about = std::fs::symlink_metadata(path).ok()?;
    Some(about.permissions().mode() & 0o777)
}

pub(super) fn is_missing(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_err_and(|error| error.kind() == io::ErrorKind::NotFound)
}

/// The identity of a file in the making; `None` if it is final or gone.
pub(super) fn in_the_making(path: &Path) -> Option<Identity> {
    let about = std::fs::symlink_metadata(path).ok()?;
    let is_it = about.is_file() && about.mode() & 0o777 == IN_THE_MAKING;
    is_it.then(|| (about.ino(), about.ctime(), about.ctime_nsec()))
}

/// Nodes whose processes do not hold the locks on their state files any more.
pub(super) fn dead_nodes(config: &Config) -> BTreeSet<u128> {
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

/// `None` if the file is gone.
pub(super) fn identity(path: &Path) -> Option<Identity> {
    let about = std::fs::symlink_metadata(path).ok()?;
    Some((about.ino(), about.ctime(), about.ctime_nsec()))
}
