//! What the converter of results remembers from one result to the next.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use consumer_kit::items::{BadItems, Chains};
use schema_frames::BytesSchema;

use schema_recording::messages::SchemaText;

/// Converts results; remembers what they answer and what was said about them.
#[derive(Debug, Default)]
pub struct ResultConverter {
    pub(super) chains: Chains,
    pub(super) bad: BadItems,
    /// Topics of tracks that have been in space.
    pub(super) in_space: BTreeSet<String>,
    /// Schemas of topics of bytes as they were decoded; `None` if one cannot be.
    pub(super) schemas: BTreeMap<String, (BytesSchema, Option<Arc<SchemaText>>)>,
}
