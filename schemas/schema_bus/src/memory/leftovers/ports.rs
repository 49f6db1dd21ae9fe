//! Shared memory and sockets of ports whose processes are gone.
//!
//! A listener has a state in shared memory and a socket. Both are made before its service knows of the
//! listener, and iceoryx2 removes those alone of which a service knows. A connection belongs to two
//! ports; iceoryx2 removes it once both have been noted in it and both are gone, so one that was never
//! noted in it by a process that was killed stays.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use iceoryx2::config::Config;

use super::folders::{Place, entries, is_missing, process_of};

/// Where iceoryx2 keeps shared memory on Linux.
pub(super) const SHARED_MEMORY: &str = "/dev/shm";
/// What iceoryx2-cal adds to the name of a listener's socket for its state.
const STATE_SUFFIX: &str = "_mgmt";

/// A file of a port, or of two.
struct OfPorts {
    path: PathBuf,
    /// The sending and the receiving port of a connection, or a listener alone.
    ids: Vec<u128>,
    socket: Option<PathBuf>,
}

/// Removes what belongs to ports of processes that have no node any more: the node is made before the
/// first port, and removed after the last. Returns whether nothing is left that may come to be so.
pub(super) fn sweep(config: &Config, place: &Place) -> bool {
    let found = of_ports(config, place);
    // After the files, so that none is of a node that was made since.
    let processes = processes(place);
    let mut is_done = true;
    for file in found {
        let has_node = |id: &u128| processes.contains(&process_of(*id));
        if file.ids.iter().all(has_node) {
            let is_gone = |id: &u128| is_missing(Path::new(&format!("/proc/{}", process_of(*id))));
            is_done &= !file.ids.iter().any(is_gone);
            continue;
        }
        if let Some(socket) = file.socket {
            let _ = std::fs::remove_file(socket);
        }
        let _ = std::fs::remove_file(file.path);
    }
    is_done
}

/// Processes that have nodes.
pub(super) fn processes(place: &Place) -> BTreeSet<u32> {
    place.node_ids().into_keys().map(process_of).collect()
}

/// The ids at the end of the name of a file in shared memory: those of ports, if it is of ports.
/// Before them stand the prefix and a hash of what the memory holds.
pub(super) fn ids_within(within: &str, n_ids: usize) -> Option<Vec<u128>> {
    let mut words = within.rsplitn(n_ids + 1, '_');
    let ids = words.by_ref().take(n_ids).map(|word| word.parse().ok());
    let ids = ids.collect::<Option<Vec<u128>>>()?;
    words.next().is_some().then_some(ids)
}

fn of_ports(config: &Config, place: &Place) -> Vec<OfPorts> {
    let service = &config.global.service;
    let socket_suffix = service.event_connection_suffix.to_string();
    let state_suffix = format!("{socket_suffix}{STATE_SUFFIX}");
    let connection_suffix = service.connection_suffix.to_string();
    let root = PathBuf::from(config.global.root_path().to_string());
    let of = |entry: std::fs::DirEntry| {
        let path = entry.path();
        if let Some(within) = place.name_within(&entry, &state_suffix) {
            let ids = ids_within(&within, 1)?;
            let socket = format!("{}{}{socket_suffix}", place.prefix, ids[0]);
            return Some(OfPorts {
                path,
                ids,
                socket: Some(root.join(socket)),
            });
        }
        let within = place.name_within(&entry, &connection_suffix)?;
        Some(OfPorts {
            path,
            ids: ids_within(&within, 2)?,
            socket: None,
        })
    };
    entries(Path::new(SHARED_MEMORY)).filter_map(of).collect()
}
