//! The RPC server: CARLA's calls in, responses out.

use std::sync::Arc;

use consumer_rpc::door::Door;
use consumer_rpc::message;
use consumer_rpc::server::{self, Peer, Service};
use launch_cli::logging::cut;
use schema_frames::StepMode;

use crate::feeds::held_answers::{Did, Moment};
use crate::gateway::Gateway;
use crate::rpc;
use crate::rpc::client_methods;
use crate::wire::fields::{Fields, Structures as _, Wrong};
use crate::wire::msgpack::Value;
use crate::wire::requests::{self, Failure, Outcome, Request, response};

/// Accepts clients for ever.
pub fn serve(door: Door, gateway: &Arc<Gateway>) {
    server::serve(door, gateway);
}

/// Whether one of a batch's commands (lists of a number and its fields) spawns a vehicle.
fn spawns_vehicle(commands: &Value) -> bool {
    let Value::Array(commands) = commands else {
        return false;
    };
    commands.iter().any(|command| {
        let mut wrapped = Fields::new("a batch", std::slice::from_ref(command));
        let variant = wrapped.fields("a command");
        let Ok(mut variant) = variant.and_then(|mut one| one.fields("a command's variant")) else {
            return false;
        };
        let is_spawn = variant.u8().is_ok_and(|kind| kind == 0);
        is_spawn
            && variant
                .fields("a spawn")
                .and_then(|mut spawn| spawn.description())
                .is_ok_and(|what| what.type_id.starts_with("vehicle."))
    })
}

/// What a call did, as far as the client's Traffic Managers care.
fn did(request: &Request, outcome: &Outcome) -> Did {
    if outcome.is_err() {
        return Did::Other;
    }
    let mut args = Fields::new("the arguments", &request.args);
    let mut is_vehicle = || {
        let description = args.description();
        description.is_ok_and(|what| what.type_id.starts_with("vehicle."))
    };
    match request.method.as_str() {
        "get_episode_settings" => Did::Settings,
        "get_vehicle_light_states" => Did::Pass,
        "add_traffic_manager_running" => Did::Manager,
        "load_new_episode" => Did::Load,
        "tick_cue" => Did::Cue,
        "destroy_actor" => Did::Death,
        "spawn_actor" if is_vehicle() => Did::Birth,
        "apply_batch" if request.args.first().is_some_and(spawns_vehicle) => Did::Birth,
        "apply_batch" => Did::Batch,
        _ => Did::Other,
    }
}

impl Gateway {
    fn moment(&self, connection: u64) -> Moment {
        let n_managers = self.traffic_managers.count(connection);
        if n_managers == 0 {
            return Moment::default();
        }
        let known = self.world.known();
        let mode = known.info.as_ref().map(|info| info.mode);
        Moment {
            n_managers,
            is_stepped: mode == Some(StepMode::Stepped),
        }
    }
}

impl Service for Gateway {
    fn serve(&self, peer: Peer, request: message::Request) -> Result<Vec<u8>, Wrong> {
        let request = requests::call(request)?;
        let account = &peer.account;
        let mut outcome = rpc::serve(self, account, &request);
        // Whoever gets an answer may count on all that the connection told before it, also if the
        // gateway knows the answer by itself.
        if !request.is_async
            && client_methods::is_about_world(&request.method)
            && let Err(error) = self.commander.settle()
        {
            outcome = outcome.and(Err(error.into()));
        }
        match &outcome {
            Err(Failure::Unknown(error)) => {
                if let Some(n_unsaid) = account.may_warn() {
                    // The name in it has been cut.
                    tracing::warn!(error, n_unsaid, "unknown call");
                }
            }
            Err(Failure::Refused(error)) if request.is_async => {
                if let Some(n_unsaid) = account.may_warn() {
                    tracing::warn!(
                        method = %cut(&request.method),
                        error = %cut(error),
                        n_unsaid,
                        "refused a call whose answer the client does not read"
                    );
                }
            }
            Err(Failure::Refused(error)) => {
                tracing::debug!(method = %cut(&request.method), error = %cut(error), "refused");
            }
            Ok(_) => {}
        }
        let did = did(&request, &outcome);
        let answer = response(
            request.id,
            request.is_async || client_methods::is_void(&request.method),
            outcome,
        );
        let moment = self.moment(account.number());
        let held = &self.feeds.world_stream().held_answers;
        Ok(held.pass(account, &peer.later, did, moment, answer))
    }

    fn refused(&self, id: u32, method: &str, sentence: &str) -> Vec<u8> {
        response(
            id,
            client_methods::is_void(method),
            Err(Failure::Refused(sentence.to_owned())),
        )
    }

    fn closed(&self, number: u64) {
        Gateway::closed(self, number);
    }
}
