//! What the launcher needs from the bus: whether a topic has a writer, what the daemon says, the
//! topics of the launch file, and cleaning up after processes that were killed.

use anyhow::Context as _;
use schema_bus::{DocumentReader, ResultService, ResultTopic, SnapshotReader};

/// The launcher's connection to the bus.
pub struct Bus {
    bus: schema_bus::Bus,
}

impl Bus {
    /// Joins the domain.
    pub fn open(domain: &str) -> anyhow::Result<Self> {
        let bus = schema_bus::Bus::open(domain, "gantry")
            .context("the bus is not usable; `gantry doctor` says more")?;
        Ok(Bus { bus })
    }

    /// Whether a living process publishes `topic` (without the domain).
    pub fn has_writer(&self, topic: &str) -> bool {
        let topics = self.bus.topics().unwrap_or_default();
        topics
            .iter()
            .any(|found| found.name == topic && found.publishers > 0)
    }

    /// A reader of a document, if there is one.
    pub fn document(&self, name: &str) -> Option<DocumentReader> {
        self.bus
            .exists(name)
            .then(|| self.bus.document_reader(name).ok())
            .flatten()
    }

    /// A reader of snapshots, if there are any.
    pub fn snapshots(&self) -> Option<SnapshotReader> {
        self.bus
            .exists(schema_bus::names::WORLD_SNAPSHOT)
            .then(|| self.bus.snapshot_reader().ok())
            .flatten()
    }

    /// Names under which living processes acknowledge ticks.
    pub fn acknowledgers(&self) -> Vec<String> {
        let services = self.bus.services().unwrap_or_default();
        services
            .into_iter()
            .filter(|service| service.carries_acks())
            .flat_map(|service| service.writers)
            .map(|writer| writer.name)
            .collect()
    }

    /// Whether a topic exists.
    pub fn exists(&self, topic: &str) -> bool {
        self.bus.exists(topic)
    }

    /// Makes a topic of results, which lasts as long as what is returned.
    ///
    /// # Errors
    /// If it exists with another type.
    pub fn hold_topic(&self, name: &str, topic: &ResultTopic) -> anyhow::Result<ResultService> {
        Ok(self.bus.result_service(name, topic)?)
    }

    /// Whether a daemon of this domain runs already.
    pub fn daemon_alive(&self) -> anyhow::Result<bool> {
        Ok(self.bus.daemon_alive()?)
    }

    /// Names of the programs on the bus, of every domain.
    pub fn programs(&self) -> Vec<String> {
        self.bus.programs()
    }

    /// Frees the shared memory of processes that were killed.
    pub fn clean(&self) -> u64 {
        self.bus.clean_dead_nodes()
    }
}
