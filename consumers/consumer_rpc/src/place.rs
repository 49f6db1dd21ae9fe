//! Where a Traffic Manager that is a process of its own listens. It says so in a document on the
//! bus, and gateways of its domain pass it on to their clients.

use serde::{Deserialize, Serialize};

/// An address that clients can connect to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Place {
    /// Name or number of the host.
    pub host: String,
    /// Port on that host; it may differ from the one that clients asked for.
    pub port: u16,
}

/// Topic of the document for the Traffic Manager that clients look for at `port`.
pub fn topic(port: u16) -> String {
    format!("control/traffic_manager/{port}")
}
