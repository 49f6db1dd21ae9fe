//! What the event camera costs the processor, for `gantry bench tick --profile`.

use schema_stages::Stage;

/// Following brightness and sorting events, on whatever threads it is done.
pub(super) static EVENTS: Stage = Stage::new("events");
