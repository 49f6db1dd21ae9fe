//! What the launcher wants from the bus: whether a topic has a writer, and cleaning up after the
//! dead.

use anyhow::Context as _;

/// The launcher's place on the bus.
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

    /// Frees what killed processes held.
    pub fn clean(&self) -> u64 {
        self.bus.clean_dead_nodes()
    }
}
