//! What there is on this machine: the list of the domain's topics, which all ways out share.

use std::time::Duration;

use anyhow::Context as _;
use consumer_kit::{Domain, ListedTopic, Listing, Rhythm, Wish};
use schema_bus::Bus;

use crate::options::Options;

/// Name under which the bridge joins the domain.
const NAME: &str = "gantry-bridge";
/// How often topics are listed.
const LIST: Rhythm = Rhythm::steady(Duration::from_millis(500));

/// Begins to list the topics of the domain.
///
/// # Errors
/// [`schema_bus::BusError`], or if the system gives no thread.
pub fn list(options: &Options) -> anyhow::Result<Listing> {
    let bus = Bus::open_with(&options.domain, NAME, &options.bus)?;
    Listing::start(bus, LIST).context("the system gives no thread")
}

/// Joins the domain whose topics `listing` lists.
///
/// # Errors
/// [`schema_bus::BusError`].
pub fn join(options: &Options, listing: Listing) -> anyhow::Result<Domain> {
    let bus = Bus::open_with(&options.domain, NAME, &options.bus)?;
    Ok(Domain::on(bus, listing))
}

/// As [`Domain::look`]; a list that fails is made again.
pub fn look(domain: &mut Domain, wants: impl FnMut(ListedTopic<'_>) -> Option<Wish>) -> bool {
    domain.look(wants).unwrap_or_else(|error| {
        tracing::debug!(%error, "cannot list the topics");
        false
    })
}
