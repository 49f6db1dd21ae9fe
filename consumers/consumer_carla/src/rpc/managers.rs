//! The registry of Traffic Managers, which run in clients or as processes of their own; clients ask
//! here for their hosts.

use consumer_rpc::place::Place;
use launch_cli::logging::cut;

use crate::gateway::Gateway;
use crate::list;
use crate::rpc::call::{Call, Calls};
use crate::state::served_manager;
use crate::state::traffic_managers::ManagerError;
use crate::wire::requests::{Answer, Failure, Outcome};

pub(crate) const CALLS: Calls = &[
    ("is_traffic_manager_running", is_manager_running),
    ("get_traffic_manager_running", running_manager),
    ("add_traffic_manager_running", add_manager),
    ("destroy_traffic_manager", destroy_manager),
];

fn is_manager_running(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let port = call.u16()?;
    Ok(Answer::Value(place(gateway, port).is_some().into()))
}

fn running_manager(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let port = call.u16()?;
    let found = place(gateway, port);
    Ok(Answer::Value(found.map_or_else(
        || list!["", 0u16],
        |place| list![place.host, place.port],
    )))
}

/// Where the Traffic Manager of this port listens: one that a client runs, or else a process on this
/// domain.
fn place(gateway: &Gateway, port: u16) -> Option<Place> {
    let of_client = gateway.traffic_managers.host(port);
    let of_client = of_client.map(|host| Place { host, port });
    of_client.or_else(|| {
        let served = served_manager::find(gateway.feeds.bus()?, port)?;
        gateway.feeds.world_stream().lost_managers.watch(&served);
        Some(served)
    })
}

fn add_manager(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let mut pair = call.fields("a Traffic Manager's place")?;
    let (host, port) = (pair.text()?, pair.u16()?);
    let is_new = gateway.traffic_managers.add(port, host, call.account)?;
    if is_new && let Some(n_unsaid) = call.account.may_warn() {
        let host = cut(host);
        tracing::info!(host = %host, port, n_unsaid, "a client runs a Traffic Manager");
    }
    Ok(Answer::Value(is_new.into()))
}

impl From<ManagerError> for Failure {
    fn from(error: ManagerError) -> Self {
        Failure::Refused(error.to_string())
    }
}

fn destroy_manager(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let port = call.u16()?;
    let was_own = gateway.traffic_managers.remove(port, call.connection);
    if !was_own
        && gateway.traffic_managers.host(port).is_some()
        && let Some(n_unsaid) = call.account.may_warn()
    {
        tracing::warn!(
            port,
            n_unsaid,
            "a client asked to remove the Traffic Manager of another one, which stays"
        );
    }
    Ok(Answer::Value(was_own.into()))
}
