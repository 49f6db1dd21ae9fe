//! The registry of Traffic Managers: they run in clients, and clients ask here where.

use crate::gateway::{Answer, Gateway, Outcome, lock};
use crate::list;
use crate::rpc::{Call, Calls};

pub(crate) const CALLS: Calls = &[
    ("is_traffic_manager_running", Gateway::is_manager_running),
    ("get_traffic_manager_running", Gateway::running_manager),
    ("add_traffic_manager_running", Gateway::add_manager),
    ("destroy_traffic_manager", Gateway::destroy_manager),
];

/// A Traffic Manager that a client runs.
#[derive(Clone, Debug)]
pub(crate) struct TrafficManager {
    host: String,
    /// Connection that registered it.
    pub connection: u64,
}

impl Gateway {
    fn is_manager_running(&self, call: &mut Call<'_>) -> Outcome {
        let port = call.u16()?;
        Ok(Answer::Value(
            lock(&self.traffic_managers).contains_key(&port).into(),
        ))
    }

    fn running_manager(&self, call: &mut Call<'_>) -> Outcome {
        let port = call.u16()?;
        let found = lock(&self.traffic_managers)
            .get(&port)
            .map(|manager| list![manager.host.as_str(), port]);
        Ok(Answer::Value(found.unwrap_or_else(|| list!["", 0u16])))
    }

    fn add_manager(&self, call: &mut Call<'_>) -> Outcome {
        let mut pair = call.fields("a Traffic Manager's place")?;
        let (host, port) = (pair.text()?.to_owned(), pair.u16()?);
        let mut managers = lock(&self.traffic_managers);
        if managers.contains_key(&port) {
            return Ok(Answer::Value(false.into()));
        }
        tracing::info!(host, port, "a client runs a Traffic Manager");
        managers.insert(
            port,
            TrafficManager {
                host,
                connection: call.connection,
            },
        );
        Ok(Answer::Value(true.into()))
    }

    fn destroy_manager(&self, call: &mut Call<'_>) -> Outcome {
        let port = call.u16()?;
        Ok(Answer::Value(
            lock(&self.traffic_managers).remove(&port).is_some().into(),
        ))
    }
}
