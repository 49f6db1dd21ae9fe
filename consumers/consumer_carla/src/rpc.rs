//! The calls: a table from methods to the functions that serve them.
//!
//! There is one module per area. Each has a table `CALLS` of method names and functions, and
//! [`AREAS`] lists the tables.
//!
//! To add a call, write `fn name(gateway: &Gateway, call: &mut Call<'_>) -> Outcome` in the area's
//! module, add `("name", name)` to its `CALLS`, and say in its row of `docs/reference/carla-compatibility.md`
//! what it does; a test compares the two. To add an area, add a module here and its line in
//! [`AREAS`]. Commands of a batch work the same way: their tables are called `BATCH`, and [`batch`]
//! lists them.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use consumer_rpc::budget::Account;
use consumer_rpc::message;

use crate::gateway::Gateway;
use crate::rpc::call::{Call, Calls, Run};
use crate::stages;
use crate::wire::requests::{Failure, Outcome, Request};

pub mod accepted;
pub mod actors;
pub mod batch;
pub mod batch_item;
pub mod bones;
pub mod call;
pub mod client_methods;
pub mod drawing;
pub mod files;
pub mod managers;
pub mod maps;
pub mod physics;
pub mod queries;
pub mod recorder;
pub mod scenery;
pub mod session;
pub mod spawning;
pub mod traffic_lights;
pub mod vehicles;
pub mod walkers;
pub mod weather;

/// The tables of all areas.
const AREAS: &[Calls] = &[
    session::CALLS,
    files::CALLS,
    maps::CALLS,
    weather::CALLS,
    scenery::CALLS,
    actors::CALLS,
    spawning::CALLS,
    vehicles::CALLS,
    walkers::CALLS,
    bones::CALLS,
    physics::CALLS,
    traffic_lights::CALLS,
    queries::CALLS,
    drawing::CALLS,
    recorder::CALLS,
    batch::CALLS,
    managers::CALLS,
    accepted::CALLS,
];

fn served() -> &'static BTreeMap<&'static str, Run> {
    static SERVED: OnceLock<BTreeMap<&'static str, Run>> = OnceLock::new();
    SERVED.get_or_init(|| AREAS.iter().copied().flatten().copied().collect())
}

/// Names of the methods that this gateway serves.
pub fn methods() -> impl Iterator<Item = &'static str> {
    served().keys().copied()
}

/// Runs one call of the connection that `account` belongs to.
///
/// # Errors
/// [`Failure`].
pub fn serve(gateway: &Gateway, account: &Account, request: &Request) -> Outcome {
    let _span = stages::CALLS.span();
    let method = request.method.as_str();
    let Some(run) = served().get(method) else {
        return Err(match client_methods::is_known(method) {
            true => Failure::Refused(format!(
                "{method}: gantry-carla cannot do this; docs/reference/carla-compatibility.md lists what works"
            )),
            false => {
                let n_args = request.args.len() + 1;
                Failure::Unknown(message::unknown(method, n_args))
            }
        });
    };
    let mut call = Call::new(request, account);
    run(gateway, &mut call).map_err(|failure| match failure {
        Failure::Refused(error) => Failure::Refused(format!("{}: {error}", call.method)),
        unknown => unknown,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_served_method_is_served_once_and_one_that_clients_know() {
        let n_listed: usize = AREAS.iter().map(|calls| calls.len()).sum();
        assert_eq!(served().len(), n_listed, "a method stands in two tables");
        for method in methods() {
            assert!(
                client_methods::is_known(method),
                "{method} is no method of the client"
            );
        }
    }
}
