//! Follows a document: opens it when it appears and returns it when it has changed.

use schema_bus::{Bus, BusError, Document, DocumentReader};

use crate::followed::Search;

/// `world/info`, `world/map`, `world/actors` or `world/catalogue`, followed across restarts.
#[derive(Debug)]
pub struct FollowedDocument {
    name: String,
    reader: Option<DocumentReader>,
    pub(crate) search: Search,
    newest: Option<Document>,
}

impl FollowedDocument {
    /// Follows the document of this name; it need not exist yet.
    pub fn new(name: impl Into<String>) -> Self {
        FollowedDocument {
            name: name.into(),
            reader: None,
            search: Search::default(),
            newest: None,
        }
    }

    /// Follows a document that need not ever exist: nothing is logged while it is missing.
    pub fn optional(name: impl Into<String>) -> Self {
        FollowedDocument {
            search: Search::of_optional(),
            ..FollowedDocument::new(name)
        }
    }

    /// Name of the document.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Opens it if it exists; returns whether it is open. Looks at most five times a second.
    ///
    /// # Errors
    /// What waiting cannot heal.
    pub fn look(&mut self, bus: &Bus) -> Result<bool, BusError> {
        if self.reader.is_none() {
            self.reader = self
                .search
                .open(bus, &self.name, || bus.document_reader(&self.name))?;
        }
        Ok(self.reader.is_some())
    }

    /// Whether it was found.
    pub fn found(&self) -> bool {
        self.reader.is_some()
    }

    /// The newest document, if it has changed since the last call.
    ///
    /// # Errors
    /// What waiting cannot heal, and [`BusError::BadSample`] for a document that breaks the
    /// contract.
    pub fn changed(&mut self, bus: &Bus) -> Result<Option<&Document>, BusError> {
        self.look(bus)?;
        let Some(reader) = &mut self.reader else {
            return Ok(None);
        };
        match reader.latest()? {
            Some(document) => Ok(Some(self.newest.insert(document))),
            None => Ok(None),
        }
    }

    /// The newest document seen so far.
    pub fn newest(&self) -> Option<&Document> {
        self.newest.as_ref()
    }
}
