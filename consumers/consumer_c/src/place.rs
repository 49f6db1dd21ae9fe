//! A domain as a program has joined it, its commands and its documents.

use std::ffi::c_char;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use schema_bus::{Bus, CommandClient};
use schema_frames::command::COMMAND_VERSION;
use schema_frames::{CommandReply, ReplyBatch, SCHEMA_VERSION};

use crate::border::{Failure, Out, Status, Text, ask, call, hand_over, keep_text, needed};
use crate::wait::Patience;

/// `GANTRY_ABI_VERSION` of the header that belongs to this library. It is raised when a function or
/// a struct changes; one that is added leaves it as it is.
const ABI_VERSION: u32 = 1;

/// Between two looks for a document, which has no event.
const LOOK_AGAIN: Duration = Duration::from_millis(1);

/// A domain that was joined. Every port keeps it, so that C may close handles in any order.
#[derive(Debug)]
pub struct Place {
    // Before `bus`: ports go before their node.
    commands: Mutex<Option<CommandClient>>,
    pub bus: Bus,
}

/// The handle `gantry_bus`.
#[derive(Debug)]
pub struct BusHandle {
    pub place: Arc<Place>,
}

/// The version of this library.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// The version of the library's functions and structs.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_abi_version() -> u32 {
    ABI_VERSION
}

/// The domain of a program that is told no other.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_default_domain() -> *const c_char {
    ask(c"gantry".as_ptr(), || {
        keep_text(&schema_bus::names::default_domain())
    })
}

/// Joins a domain, if the caller's header is that of this library.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_bus_open_versions(
    abi_version: u32,
    schema_version: u32,
    domain: Text<'_>,
    program: Text<'_>,
    bus: Out<'_, Option<Box<BusHandle>>>,
) -> Status {
    call(|| {
        let bus = needed(bus, "bus")?;
        if abi_version != ABI_VERSION || schema_version != u32::from(SCHEMA_VERSION) {
            return Err(Failure::new(
                Status::SchemaVersion,
                format!(
                    "this program was built with a gantry.h of interface {abi_version} and schema {schema_version}, and libgantry {} has {ABI_VERSION} and {SCHEMA_VERSION}; build the program again",
                    env!("CARGO_PKG_VERSION")
                ),
            ));
        }
        let program = program.needed("program")?;
        let domain = match domain.read("domain")? {
            Some(domain) => domain.to_owned(),
            None => schema_bus::names::default_domain(),
        };
        let place = Arc::new(Place {
            commands: Mutex::new(None),
            bus: Bus::open(&domain, program)?,
        });
        Ok(hand_over(bus, BusHandle { place }))
    })
}

/// Leaves the domain with the last port that is open on it.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_bus_close(bus: Option<Box<BusHandle>>) {
    ask((), || drop(bus));
}

/// Sends commands, and keeps the answer's text for this thread.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_command(
    bus: Option<&BusHandle>,
    commands: Text<'_>,
    timeout_nanos: i64,
    answer: Out<'_, *const c_char>,
) -> Status {
    call(|| {
        let place = &needed(bus, "bus")?.place;
        let commands = commands.needed("commands")?;
        let patience = Patience::new(timeout_nanos);
        let batch = format!("{{\"v\":{COMMAND_VERSION},\"commands\":{commands}}}");
        let text = patience.open(|| {
            let mut client = place.commands.lock();
            let client = match &mut *client {
                Some(client) => client,
                none => none.insert(
                    place
                        .bus
                        .command_client(&format!("c-{}", std::process::id()))?,
                ),
            };
            let wait = patience.left(Duration::MAX);
            Ok(client.request_text(batch.as_bytes(), wait, &mut || true)?)
        })?;
        let text = String::from_utf8_lossy(&text);
        if let Some(answer) = answer {
            answer.write(keep_text(&text));
        }
        let replies: ReplyBatch = serde_json::from_str(&text).map_err(|fault| {
            Failure::new(
                Status::SchemaVersion,
                format!(
                    "the simulator's answer cannot be read ({fault}); rebuild the older of the two"
                ),
            )
        })?;
        for reply in replies.replies {
            if let CommandReply::Refused { error } = reply {
                let sentence = format!("the simulator refused: {error}");
                return Err(Failure::new(Status::Refused, sentence));
            }
        }
        Ok(Status::Ok)
    })
}

/// Waits for the newest text of a document, and keeps it for this thread.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_document(
    bus: Option<&BusHandle>,
    name: Text<'_>,
    timeout_nanos: i64,
    text: Out<'_, *const c_char>,
) -> Status {
    call(|| {
        let place = &needed(bus, "bus")?.place;
        let name = name.needed("name")?;
        let text = needed(text, "text")?;
        let patience = Patience::new(timeout_nanos);
        let mut reader = patience.open(|| Ok(place.bus.document_reader(name)?))?;
        loop {
            if let Some(found) = reader.latest()? {
                text.write(keep_text(&found.text));
                return Ok(Status::Ok);
            }
            if patience.is_over() {
                return Ok(Status::Nothing);
            }
            std::thread::sleep(LOOK_AGAIN);
        }
    })
}
