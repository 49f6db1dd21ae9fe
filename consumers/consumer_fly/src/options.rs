//! Which simulator is flown in.

use schema_bus::BusOptions;

/// Where to fly.
#[derive(Clone, Debug)]
pub struct Options {
    /// First segment of the service names.
    pub domain: String,
    /// Where iceoryx2 keeps its files.
    pub bus: BusOptions,
}
