//! Which process has a port on the bus, so that a sentence about a broken sample can name it.

use std::sync::Arc;

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::prelude::*;

use crate::node::Service;
use crate::service::Slices;
use crate::wire::OnBus;

/// The process behind a port. Shown, it reads `process 4242 (python3)`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Origin {
    /// Id of the process; `None` if the port has been removed since.
    pub pid: Option<u32>,
    /// Name of its program as the kernel has it; empty if the process has ended or belongs to
    /// another container.
    pub program: String,
    /// Name of the port; empty if it was given none. Writers on `control/ack` are called as their
    /// participant.
    pub port: String,
}

impl Origin {
    pub(crate) fn new(node: UniqueNodeId, port: &str) -> Origin {
        let pid = node
            .pid::<Service>()
            .ok()
            .and_then(|pid| u32::try_from(pid.value()).ok());
        let program = pid.and_then(|pid| std::fs::read_to_string(format!("/proc/{pid}/comm")).ok());
        Origin {
            pid,
            program: program.unwrap_or_default().trim().to_owned(),
            port: port.to_owned(),
        }
    }

    /// Whether the process is stopped by a signal or a debugger. `false` if it has ended or cannot
    /// be looked at.
    pub fn is_stopped(&self) -> bool {
        let stat = self
            .pid
            .and_then(|pid| std::fs::read_to_string(format!("/proc/{pid}/stat")).ok());
        // The state is the first letter after the program's name, which stands in brackets and may
        // hold brackets itself.
        stat.as_deref()
            .and_then(|stat| stat.rsplit_once(") "))
            .is_some_and(|(_, rest)| rest.starts_with(['T', 't']))
    }
}

impl std::fmt::Display for Origin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.pid {
            None => f.write_str("a process that has closed its port"),
            Some(pid) if self.program.is_empty() => write!(f, "process {pid}"),
            Some(pid) => write!(f, "process {pid} ({})", self.program),
        }
    }
}

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
                .unwrap_or_else(|| Arc::new(Origin::new(node, port)));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_named_by_number_and_program() {
        let mut origin = Origin {
            pid: Some(4242),
            program: "python3".into(),
            port: "planner".into(),
        };
        assert_eq!(origin.to_string(), "process 4242 (python3)");
        origin.program.clear();
        assert_eq!(origin.to_string(), "process 4242");
        assert_eq!(
            Origin::default().to_string(),
            "a process that has closed its port"
        );
    }

    #[test]
    fn this_process_runs_and_a_missing_one_is_not_stopped() {
        let this = Origin {
            pid: Some(std::process::id()),
            ..Origin::default()
        };
        assert!(!this.is_stopped() && !Origin::default().is_stopped());
    }
}
