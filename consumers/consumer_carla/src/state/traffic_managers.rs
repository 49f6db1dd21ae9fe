//! Traffic Managers: they run in clients, and this registry tells other clients their hosts.

use std::collections::BTreeMap;

use consumer_rpc::budget::{Account, Holding, OverBudget};
use parking_lot::Mutex;

/// Longest name of a host, bytes (RFC 1035).
pub const MAX_HOST_BYTES: usize = 253;
/// Most Traffic Managers that are registered.
pub const MAX_TRAFFIC_MANAGERS: usize = 1024;
/// What a registration costs its connection, bytes: clients run one or two.
const COST: usize = 1 << 20;

/// Why a Traffic Manager is not registered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ManagerError {
    /// The host's name is too long for one.
    #[error(
        "the host of a Traffic Manager has {n_bytes} bytes, but may have 1 to {MAX_HOST_BYTES}"
    )]
    Host {
        /// Its length.
        n_bytes: usize,
    },
    /// There are too many.
    #[error(
        "{MAX_TRAFFIC_MANAGERS} Traffic Managers are registered, and no more are taken; end some of their clients"
    )]
    Full,
    /// The connection has registered too many.
    #[error(transparent)]
    OverBudget(#[from] OverBudget),
}

/// A Traffic Manager that a client runs.
#[derive(Debug)]
struct TrafficManager {
    host: String,
    /// Connection that registered it.
    connection: u64,
    _cost: Holding,
}

/// All registered Traffic Managers, by their ports.
#[derive(Debug, Default)]
pub struct TrafficManagers(Mutex<BTreeMap<u16, TrafficManager>>);

impl TrafficManagers {
    /// Whether no Traffic Manager is registered.
    pub fn is_empty(&self) -> bool {
        self.0.lock().is_empty()
    }

    /// The host of the Traffic Manager at this port.
    pub fn host(&self, port: u16) -> Option<String> {
        self.0.lock().get(&port).map(|manager| manager.host.clone())
    }

    /// Registers a Traffic Manager for as long as its connection lasts; false if the port is taken.
    ///
    /// # Errors
    /// [`ManagerError`].
    pub fn add(&self, port: u16, host: &str, account: &Account) -> Result<bool, ManagerError> {
        let n_bytes = host.len();
        if !(1..=MAX_HOST_BYTES).contains(&n_bytes) {
            return Err(ManagerError::Host { n_bytes });
        }
        let mut managers = self.0.lock();
        if managers.contains_key(&port) {
            return Ok(false);
        }
        if managers.len() >= MAX_TRAFFIC_MANAGERS {
            return Err(ManagerError::Full);
        }
        let manager = TrafficManager {
            host: host.to_owned(),
            connection: account.number(),
            _cost: account.hold(COST)?,
        };
        managers.insert(port, manager);
        Ok(true)
    }

    /// How many Traffic Managers this connection registered.
    pub fn count(&self, connection: u64) -> usize {
        let managers = self.0.lock();
        let own = |manager: &&TrafficManager| manager.connection == connection;
        managers.values().filter(own).count()
    }

    /// Removes the Traffic Manager at this port; false if this connection has registered none there.
    /// Those of a connection that has ended are gone already.
    pub fn remove(&self, port: u16, connection: u64) -> bool {
        let mut managers = self.0.lock();
        let is_own = |manager: &TrafficManager| manager.connection == connection;
        managers.get(&port).is_some_and(is_own) && managers.remove(&port).is_some()
    }

    /// Removes the Traffic Managers of a connection that has ended.
    pub fn forget(&self, connection: u64) {
        self.0
            .lock()
            .retain(|_, manager| manager.connection != connection);
    }
}
