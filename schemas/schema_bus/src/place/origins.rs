//! The processes behind the ports of one service, found by the ports' ids.

use std::sync::Arc;

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::prelude::*;

use crate::contract::origin::Origin;
use crate::contract::wire::OnBus;
use crate::place::node::Service;
use crate::place::service::Slices;

/// The ports of one service by their ids, looked up again when an unknown one appears.
#[derive(Debug, Default)]
pub(crate) struct Origins {
    known: Vec<(u128, Arc<Origin>)>,
}

impl Origins {
    /// The process behind the port `id`. `list` calls its argument with id, node and name of every
    /// port that the service has now.
    pub fn of(
        &mut self,
        id: u128,
        list: impl FnOnce(&mut dyn FnMut(u128, UniqueNodeId, &str)),
    ) -> Arc<Origin> {
        if let Some(origin) = self.find(id) {
            return origin;
        }
        let mut now = Vec::new();
        list(&mut |id, node, port| {
            let origin = self
                .find(id)
                .unwrap_or_else(|| Arc::new(Origin::new(pid_of(node), port)));
            now.push((id, origin));
        });
        self.known = now;
        self.find(id).unwrap_or_default()
    }

    /// The process that publishes under `id`.
    pub fn of_writer<H: OnBus>(&mut self, id: u128, service: &Slices<H>) -> Arc<Origin> {
        self.of(id, |see| {
            service.dynamic_config().list_publishers(|details| {
                see(
                    details.publisher_id.value(),
                    details.node_id,
                    details.publisher_name.as_str(),
                );
                CallbackProgression::Continue
            });
        })
    }

    fn find(&self, id: u128) -> Option<Arc<Origin>> {
        let known = self.known.iter().find(|(known, _)| *known == id);
        known.map(|(_, origin)| origin.clone())
    }
}

/// The process that owns a node; `None` if that cannot be read any more.
pub(crate) fn pid_of(node: UniqueNodeId) -> Option<u32> {
    let pid = node.pid::<Service>().ok()?;
    u32::try_from(pid.value()).ok()
}
