//! Version of the contract, and where a reader finds it before it opens anything.

/// Version of every layout in this crate. A reader refuses any other.
pub const SCHEMA_VERSION: u16 = 1;

/// Service attribute that carries [`SCHEMA_VERSION`], so that a reader can refuse before it opens a
/// service.
pub const SCHEMA_ATTRIBUTE: &str = "gantry.schema";
