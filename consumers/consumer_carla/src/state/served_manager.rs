//! The Traffic Manager that runs as a process of its own on this domain, if one does.

use std::time::{Duration, Instant};

use consumer_rpc::place::{Place, topic};
use schema_bus::{Bus, BusError};

/// How long its notice may take: it is sent between two looks of the process at its work.
const PATIENCE: Duration = Duration::from_secs(2);
/// Between two looks for the notice.
const POLL: Duration = Duration::from_millis(2);

/// Where the Traffic Manager listens that clients look for at `port`; `None` if no living process
/// serves that port.
pub fn find(bus: &Bus, port: u16) -> Option<Place> {
    match look(bus, port) {
        Ok(found) => found,
        Err(error) => {
            tracing::warn!(port, %error, "cannot tell whether a Traffic Manager runs on this domain");
            None
        }
    }
}

fn look(bus: &Bus, port: u16) -> Result<Option<Place>, BusError> {
    let name = topic(port);
    if !bus.exists(&name) || !bus.publisher_alive(&name)? {
        return Ok(None);
    }
    let mut reader = bus.document_reader(&name)?;
    let deadline = Instant::now() + PATIENCE;
    loop {
        if let Some(document) = reader.latest()? {
            return document.json().map(Some);
        }
        if Instant::now() >= deadline {
            return Ok(None);
        }
        std::thread::sleep(POLL);
    }
}
