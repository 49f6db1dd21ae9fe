//! The registry of Traffic Managers, which run in clients; other clients ask here for their hosts.

use crate::gateway::Gateway;
use crate::list;
use crate::rpc::call::{Call, Calls};
use crate::wire::requests::{Answer, Outcome};

pub(crate) const CALLS: Calls = &[
    ("is_traffic_manager_running", is_manager_running),
    ("get_traffic_manager_running", running_manager),
    ("add_traffic_manager_running", add_manager),
    ("destroy_traffic_manager", destroy_manager),
];

fn is_manager_running(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let port = call.u16()?;
    let is_running = gateway.traffic_managers.host(port).is_some();
    Ok(Answer::Value(is_running.into()))
}

fn running_manager(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let port = call.u16()?;
    let found = gateway.traffic_managers.host(port);
    Ok(Answer::Value(
        found.map_or_else(|| list!["", 0u16], |host| list![host, port]),
    ))
}

fn add_manager(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let mut pair = call.fields("a Traffic Manager's place")?;
    let (host, port) = (pair.text()?, pair.u16()?);
    let is_new = gateway.traffic_managers.add(port, host, call.connection);
    if is_new {
        tracing::info!(host, port, "a client runs a Traffic Manager");
    }
    Ok(Answer::Value(is_new.into()))
}

fn destroy_manager(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let was_there = gateway.traffic_managers.remove(call.u16()?);
    Ok(Answer::Value(was_there.into()))
}
