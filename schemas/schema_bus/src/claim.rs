//! The right to publish a domain's world, which one process has at a time.

use iceoryx2::service::builder::event::EventCreateError;
use iceoryx2::service::port_factory::event;

use crate::error::BusError;
use crate::iceoryx_error::other_error;
use crate::names::CONTROL_OWNER;
use crate::node::{BusNode, Service};
use crate::service::settle;

/// Proof that this process publishes the domain's world. The right ends when it is dropped, or when
/// the process ends however it does.
#[derive(Debug)]
pub struct Claim {
    _service: event::PortFactory<Service>,
}

impl Claim {
    /// `None` if a living process has the right.
    pub(crate) fn take(node: &BusNode) -> Result<Option<Claim>, BusError> {
        let (full, name) = node.service_name(CONTROL_OWNER)?;
        node.clean_dead_nodes();
        // Making a service that exists fails, and of two processes that make it one succeeds.
        settle(
            || match node.iceoryx().service_builder(&name).event().create() {
                Ok(service) => Ok(Some(Claim { _service: service })),
                Err(EventCreateError::AlreadyExists) => Ok(None),
                Err(EventCreateError::InsufficientPermissions) => Err(BusError::Permission {
                    service: full.clone(),
                }),
                Err(e) => Err(other_error("claim", &full, &e)),
            },
        )
    }
}
