//! Removes what a process left behind that was killed while it made or removed one of iceoryx2's
//! small files, and what a process left that was killed while it cleaned up.
//!
//! iceoryx2 0.10 makes each such file in two steps: it appears with the permissions of a file in the
//! making, is filled and synced to disk, and gets its final permissions. Files in the making are
//! invisible to iceoryx2's cleaning. A listener's files come before its service knows of it. These
//! stay for good therefore:
//!
//! | Killed while it made | What stays |
//! |---|---|
//! | the tag of a service or port | the dead node: its folder is never empty, so it is never removed |
//! | a service's description | a service that nobody can open or make any more |
//! | its node | the node's folder, or a node that starts for ever |
//! | a listener | the listener's state and socket ([`ports`]) |
//! | a connection | the connection's memory ([`ports`]); without a size, processes that wait for it ([`empty`]) |
//! | nothing, but removed a node | a node without a state file, which counts as being removed for ever |
//! | nothing, but removed a service | a service that is being removed for ever, and that nobody can open or make any more |
//!
//! [`Leftovers::sweep`] removes them. It takes away nothing of a process that may live: a node is dead
//! if nobody holds the lock on its state file, which the kernel keeps, and a service is in the making
//! only as long as a node that may live has its tag, which is made first. Where neither tells, the
//! process must be gone and its files a few seconds old, since processes of another container are
//! not seen. A service whose tag no node has is nobody's; it must have been so for a few seconds, in
//! which a process that lives would have removed it.

mod empty;
mod folders;
mod ports;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use iceoryx2::config::Config;
use iceoryx2::prelude::*;
use iceoryx2::service::internal::ServiceInternal as _;
use nix::fcntl::{Flock, FlockArg};
use parking_lot::Mutex;

pub(crate) use empty::Guard;
use folders::{CERTAIN_AGE, Identity, Place, dead_nodes, entries, identity, in_the_making};

/// A folder that changed longer ago than this changes its time again with its next change.
const CERTAIN_CHANGE: Duration = Duration::from_secs(1);

/// Since when this process has seen that no node has the tag of a service, by the service's file.
static NOBODYS: Mutex<BTreeMap<PathBuf, (Identity, Instant)>> = Mutex::new(BTreeMap::new());

/// What a process remembers from one sweep to the next.
#[derive(Debug, Default)]
pub(crate) struct Leftovers {
    /// When the folder of services had last changed while no service was in the making.
    quiet_since: Mutex<Option<SystemTime>>,
    /// Processes that had nodes when what belongs to ports was last looked at, unless something was
    /// left then whose node is still to be removed.
    looked: Mutex<Option<BTreeSet<u32>>>,
}

/// What iceoryx2's own cleaning came to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cleaned {
    /// There may be dead nodes that it could not remove.
    pub has_dead: bool,
    /// It removed nodes.
    pub has_removed: bool,
}

impl Leftovers {
    /// Removes it. What cannot be removed is left to the next sweep, or to whoever may.
    pub fn sweep(&self, config: &Config, cleaned: Cleaned) {
        let Cleaned { has_dead, .. } = cleaned;
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
        // Others remove nodes, too, iceoryx2 while it opens a service among them.
        let processes = ports::processes(&place);
        let mut looked = self.looked.lock();
        let has_lost = !looked
            .as_ref()
            .is_some_and(|before| before.is_subset(&processes));
        if cleaned.has_removed || has_dead || has_lost {
            *looked = ports::sweep(config, &place).then_some(processes);
        } else if let Some(before) = &mut *looked {
            before.extend(processes);
        }
    }

    fn sweep_services(&self, config: &Config, place: &Place, is_dead: impl Fn(u128) -> bool) {
        let mut quiet_since = self.quiet_since.lock();
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
    let mut seen = NOBODYS.lock();
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
