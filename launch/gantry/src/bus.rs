//! What the launcher needs from the bus: whether a topic has a writer, and cleaning up after
//! processes that were killed.

use anyhow::Context as _;

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
