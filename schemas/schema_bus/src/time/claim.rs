//! The right to publish a domain's world, which one process has at a time.

use std::time::{Duration, Instant};

use iceoryx2::prelude::*;
use iceoryx2::service::Service as _;
use iceoryx2::service::builder::event::EventCreateError;
use iceoryx2::service::port_factory::event;

use crate::contract::error::BusError;
use crate::contract::names::CONTROL_OWNER;
use crate::place::iceoryx_error::other_error;
use crate::place::node::{BusNode, Service};
use crate::place::service::settle;

/// Proof that this process publishes the domain's world. The right ends when it is dropped, or when
/// the process ends however it does.
#[derive(Debug)]
pub struct Claim {
    _service: event::PortFactory<Service>,
}

/// How long a claim waits for what a killed owner left, while other processes remove it.
const LEFT_BEHIND: Duration = Duration::from_secs(3);
const LOOK_AGAIN: Duration = Duration::from_millis(10);

impl Claim {
    /// `None` if a living process has the right. That the right's service exists is no proof of one:
    /// of several processes that start after an owner was killed, one removes what it left, and the
    /// others come here meanwhile.
    pub(crate) fn take(node: &BusNode) -> Result<Option<Claim>, BusError> {
        let (full, name) = node.service_name(CONTROL_OWNER)?;
        let deadline = Instant::now() + LEFT_BEHIND;
        loop {
            node.clean_dead_nodes();
            if let Some(claim) = make(node, &full, &name)? {
                return Ok(Some(claim));
            }
            if has_living_owner(node, &full, &name)? || Instant::now() >= deadline {
                return Ok(None);
            }
            std::thread::sleep(LOOK_AGAIN);
        }
    }
}

/// Makes the right's service; `None` if it exists. Of two processes that make it one succeeds.
fn make(node: &BusNode, full: &str, name: &ServiceName) -> Result<Option<Claim>, BusError> {
    settle(node, || {
        match node.iceoryx().service_builder(name).event().create() {
            Ok(service) => Ok(Some(Claim { _service: service })),
            Err(EventCreateError::AlreadyExists) => Ok(None),
            Err(EventCreateError::InsufficientPermissions) => Err(BusError::Permission {
                service: full.to_owned(),
            }),
            Err(e) => Err(other_error("claim", full, &e)),
        }
    })
}

fn has_living_owner(node: &BusNode, full: &str, name: &ServiceName) -> Result<bool, BusError> {
    let details = Service::details(name, node.config(), MessagingPattern::Event)
        .map_err(|e| other_error("look at", full, &e))?;
    let nodes = details
        .and_then(|service| service.dynamic_details)
        .map_or_else(Vec::new, |now| now.nodes);
    // Another user's process cannot be told from a living one.
    let may_live = |state: &NodeState<Service>| {
        matches!(state, NodeState::Alive(_) | NodeState::Inaccessible(_))
    };
    Ok(nodes.iter().any(may_live))
}
