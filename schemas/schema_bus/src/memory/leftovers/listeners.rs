//! Listeners of processes that were killed while they made them.
//!
//! A listener has a state in shared memory and a socket. Both are made before its service knows of the
//! listener, and iceoryx2 removes those alone of which a service knows.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use iceoryx2::config::Config;

use super::folders::{Place, entries, is_missing, process_of};

/// Where iceoryx2 keeps shared memory on Linux.
const SHARED_MEMORY: &str = "/dev/shm";
/// What iceoryx2-cal adds to the name of a listener's socket for its state.
const STATE_SUFFIX: &str = "_mgmt";

/// Removes the listeners of processes that have no node any more: the node is made before the first
/// listener, and removed after the last. Returns whether no listener is left that may become one.
pub(super) fn sweep(config: &Config, place: &Place) -> bool {
    let socket_suffix = config.global.service.event_connection_suffix.to_string();
    let suffix = format!("{socket_suffix}{STATE_SUFFIX}");
    let found: Vec<(PathBuf, u128)> = entries(Path::new(SHARED_MEMORY))
        .filter_map(|entry| {
            // Between the prefix and the id is a hash of what the memory holds.
            let within = place.name_within(&entry, &suffix)?;
            let (_, id) = within.rsplit_once('_')?;
            Some((entry.path(), id.parse().ok()?))
        })
        .collect();
    // After the listeners, so that none is of a node that was made since.
    let processes: BTreeSet<u32> = place.node_ids().into_keys().map(process_of).collect();
    let mut is_done = true;
    for (path, id) in found {
        let process = process_of(id);
        if processes.contains(&process) {
            is_done &= !is_missing(Path::new(&format!("/proc/{process}")));
            continue;
        }
        let socket = format!("{}{id}{socket_suffix}", place.prefix);
        let root = PathBuf::from(config.global.root_path().to_string());
        let _ = std::fs::remove_file(root.join(socket));
        let _ = std::fs::remove_file(path);
    }
    is_done
}
