//! Traffic Managers: they run in clients, and this registry tells other clients their hosts.

use std::collections::BTreeMap;
use std::sync::Mutex;

use crate::lock::lock;

/// A Traffic Manager that a client runs.
#[derive(Clone, Debug)]
struct TrafficManager {
    host: String,
    /// Connection that registered it.
    connection: u64,
}

/// All registered Traffic Managers, by their ports.
#[derive(Debug, Default)]
pub struct TrafficManagers(Mutex<BTreeMap<u16, TrafficManager>>);

impl TrafficManagers {
    /// Whether no Traffic Manager is registered.
    pub fn is_empty(&self) -> bool {
        lock(&self.0).is_empty()
    }

    /// The host of the Traffic Manager at this port.
    pub fn host(&self, port: u16) -> Option<String> {
        lock(&self.0).get(&port).map(|manager| manager.host.clone())
    }

    /// Registers a Traffic Manager for as long as its connection lasts; false if the port is taken.
    pub fn add(&self, port: u16, host: &str, connection: u64) -> bool {
        let mut managers = lock(&self.0);
        if managers.contains_key(&port) {
            return false;
        }
        let host = host.to_owned();
        managers.insert(port, TrafficManager { host, connection });
        true
    }

    /// How many Traffic Managers this connection registered.
    pub fn count(&self, connection: u64) -> usize {
        let managers = lock(&self.0);
        let own = |manager: &&TrafficManager| manager.connection == connection;
        managers.values().filter(own).count()
    }

    /// Removes the Traffic Manager at this port; false if there is none.
    pub fn remove(&self, port: u16) -> bool {
        lock(&self.0).remove(&port).is_some()
    }

    /// Removes the Traffic Managers of a connection that has ended.
    pub fn forget(&self, connection: u64) {
        lock(&self.0).retain(|_, manager| manager.connection != connection);
    }
}
