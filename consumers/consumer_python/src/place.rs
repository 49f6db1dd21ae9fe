//! A domain as this process has joined it: one bus, and the ports that all calls share.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyTuple};

use schema_bus::{Bus, BusOptions, CommandClient, CommandError, TopicDetails, TopicKind};

use crate::fork::{self, Owned};
use crate::wait::Timeout;
use crate::{errors, wait};

/// A domain that this process has joined.
#[derive(Debug)]
pub struct Place {
    // Before `bus`: ports go before their node.
    commands: Mutex<Option<Owned<CommandClient>>>,
    bus: Owned<Bus>,
}

static PLACES: Mutex<BTreeMap<String, Arc<Place>>> = Mutex::new(BTreeMap::new());
/// Where iceoryx2's files of private domains are.
static PRIVATE: Mutex<BTreeMap<String, BusOptions>> = Mutex::new(BTreeMap::new());
static PROGRAM: Mutex<String> = Mutex::new(String::new());

impl Place {
    /// The place in `domain`, which the first call makes.
    pub fn of(domain: &str) -> PyResult<Arc<Place>> {
        fork::check()?;
        let program = PROGRAM.lock().clone();
        let mut places = PLACES.lock();
        if let Some(place) = places.get(domain) {
            return Ok(place.clone());
        }
        let options = PRIVATE.lock().get(domain).cloned().unwrap_or_default();
        let opened = Bus::open_with(domain, &program, &options);
        match opened {
            Ok(bus) => {
                let place = Arc::new(Place {
                    commands: Mutex::new(None),
                    bus: Owned::new(bus),
                });
                places.insert(domain.to_owned(), place.clone());
                Ok(place)
            }
            Err(error) => {
                drop(places);
                Err(errors::bus(error))
            }
        }
    }

    /// The bus.
    pub fn bus(&self) -> &Bus {
        &self.bus
    }
}

/// The domain of a program that is told no other: `GANTRY_DOMAIN`, else `gantry`.
#[pyfunction]
pub fn default_domain() -> String {
    schema_bus::names::default_domain()
}

/// Name under which this process appears on the bus, for lists and messages.
#[pyfunction]
pub fn set_program(name: &str) {
    *PROGRAM.lock() = name.to_owned();
}

/// Says where iceoryx2's files of `domain` are: its folder, and the start of its names in
/// `/dev/shm`. Call it before anything of the domain is opened.
#[pyfunction]
pub fn set_private(domain: &str, root: PathBuf, prefix: &str) {
    let options = BusOptions {
        iceoryx_root: Some(root),
        prefix: Some(prefix.to_owned()),
    };
    PRIVATE.lock().insert(domain.to_owned(), options);
}

/// Removes what killed processes left, as which they seem to live; returns how many these were.
#[pyfunction]
pub fn clean(py: Python<'_>, domain: &str) -> PyResult<u64> {
    let place = Place::of(domain)?;
    Ok(py.detach(|| place.bus.clean_dead_nodes()))
}

/// Removes what killed processes left in `domain`, leaves it, and forgets where its files are.
/// Returns whether nothing of it is held any more.
#[pyfunction]
pub fn leave(py: Python<'_>, domain: &str) -> PyResult<bool> {
    let place = Place::of(domain)?;
    Ok(py.detach(|| {
        place.bus.clean_dead_nodes();
        PLACES.lock().remove(domain);
        PRIVATE.lock().remove(domain);
        Arc::try_unwrap(place).is_ok()
    }))
}

/// Leaves all domains; what ports are open leave with their objects. Called when Python ends.
#[pyfunction]
pub fn close_all(py: Python<'_>) {
    let places = std::mem::take(&mut *PLACES.lock());
    py.detach(|| drop(places));
}

/// Sends a batch of commands as JSON, and returns the answer's JSON.
#[pyfunction]
pub fn command<'py>(
    py: Python<'py>,
    domain: &str,
    batch: &str,
    timeout: Option<f64>,
) -> PyResult<Bound<'py, PyBytes>> {
    let place = Place::of(domain)?;
    let timeout = Timeout::new(timeout)?;
    let limit = timeout.left().unwrap_or(Duration::MAX);
    let mut interrupted = Ok(());
    let answer = py.detach(|| -> Result<Vec<u8>, CommandError> {
        let mut commands = place.commands.lock();
        let client = match &mut *commands {
            Some(client) => client,
            none => none.insert(Owned::new(
                place
                    .bus
                    .command_client(&format!("python-{}", std::process::id()))?,
            )),
        };
        client.request_text(batch.as_bytes(), limit, &mut || {
            interrupted = wait::signals();
            interrupted.is_ok()
        })
    });
    interrupted?;
    Ok(PyBytes::new(py, &answer.map_err(errors::command)?))
}

/// Whether a living process publishes this document.
#[pyfunction]
pub fn publisher_alive(py: Python<'_>, domain: &str, document: &str) -> PyResult<bool> {
    let place = Place::of(domain)?;
    py.detach(|| place.bus.publisher_alive(document))
        .map_err(errors::bus)
}

/// All topics of a domain as tuples: name, kind, modality, writers, readers, most readers, longest
/// payload in bytes, schema, type of results.
#[pyfunction]
pub fn topics<'py>(py: Python<'py>, domain: &str) -> PyResult<Vec<Bound<'py, PyTuple>>> {
    let place = Place::of(domain)?;
    let found = py.detach(|| place.bus.topics()).map_err(errors::bus)?;
    found.iter().map(|topic| row(py, topic)).collect()
}

fn row<'py>(py: Python<'py>, topic: &TopicDetails) -> PyResult<Bound<'py, PyTuple>> {
    let kind = match topic.kind {
        TopicKind::Frames => "frame",
        TopicKind::Snapshot => "snapshot",
        TopicKind::Document => "document",
        TopicKind::Controls => "control",
        TopicKind::Results => "result",
        TopicKind::Other => "other",
    };
    (
        &topic.name,
        kind,
        topic.modality.map(|modality| modality.name()),
        topic.publishers,
        topic.subscribers,
        topic.max_subscribers,
        topic.payload_bytes,
        &topic.schema,
        topic.result.map(|result| result.name()),
    )
        .into_pyobject(py)
}
