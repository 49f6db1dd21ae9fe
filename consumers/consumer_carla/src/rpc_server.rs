//! The RPC server: CARLA's calls in, responses out.

use std::net::TcpListener;
use std::sync::Arc;

use consumer_rpc::message;
use consumer_rpc::server::{self, Peer, Service};

use crate::gateway::Gateway;
use crate::rpc;
use crate::rpc::client_methods;
use crate::wire::fields::Wrong;
use crate::wire::requests::{self, Failure, response};

/// Accepts clients for ever.
pub fn serve(listener: &TcpListener, gateway: &Arc<Gateway>) {
    server::serve(listener, gateway);
}

impl Service for Gateway {
    fn serve(&self, peer: Peer, request: message::Request) -> Result<Vec<u8>, Wrong> {
        let request = requests::call(request)?;
        let outcome = rpc::serve(self, peer.number, &request);
        match &outcome {
            Err(Failure::Unknown(error)) => tracing::warn!(error, "unknown call"),
            Err(Failure::Refused(error)) if request.is_async => {
                tracing::warn!(
                    method = request.method,
                    error,
                    "refused a call whose answer the client does not read"
                )
            }
            Err(Failure::Refused(error)) => {
                tracing::debug!(method = request.method, error, "refused")
            }
            Ok(_) => {}
        }
        Ok(response(
            request.id,
            request.is_async || client_methods::is_void(&request.method),
            outcome,
        ))
    }

    fn panicked(&self, id: u32, method: &str) -> Vec<u8> {
        let error = format!("{method} failed inside the gateway, whose log says where");
        response(id, client_methods::is_void(method), Err(Failure::Refused(error)))
    }

    fn closed(&self, number: u64) {
        Gateway::closed(self, number);
    }
}
