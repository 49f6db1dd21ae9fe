//! Reading a topic of frames or of results.

use std::ffi::{CString, c_char, c_int};
use std::os::fd::{AsFd as _, AsRawFd as _};
use std::ptr::{from_ref, null};
use std::sync::Arc;

use consumer_kit::{Sample as Found, SampleReader, Take};
use schema_bus::{Answerable, Listener};
use schema_frames::{FrameHeader, InputRecord, ResultHeader};

use crate::border::{Failure, Out, Status, Text, ask, c_text, call, hand_over, needed};
use crate::place::{BusHandle, Place};
use crate::wait::Patience;

/// The handle `gantry_reader`.
#[derive(Debug)]
pub struct Reader {
    // Ports go before their node.
    port: SampleReader,
    event: Listener,
    topic: Arc<CString>,
    /// Type of the results; `None` for frames.
    kind: Option<CString>,
    place: Arc<Place>,
}

/// The handle `gantry_sample`.
#[derive(Debug)]
pub struct Sample {
    found: Found,
    topic: Arc<CString>,
    _place: Arc<Place>,
}

/// `gantry_counts`.
#[repr(C)]
#[derive(Debug)]
pub struct Counts {
    struct_bytes: u32,
    reserved: u32,
    taken: u64,
    skipped: u64,
    lost: u64,
    refused: u64,
    restarts: u64,
}
const _: () = assert!(size_of::<Counts>() == 48);

/// `gantry_which`: the oldest sample that waits.
const OLDEST: c_int = 0;
/// `gantry_which`: the newest; older ones are skipped.
const NEWEST: c_int = 1;

impl Sample {
    /// As an input of a result.
    pub fn answerable(&self) -> &dyn Answerable {
        match &self.found {
            Found::Frame(frame) => frame,
            Found::Result(result) => result,
        }
    }

    fn bytes(&self) -> &[u8] {
        match &self.found {
            Found::Frame(frame) => frame,
            Found::Result(result) => result,
        }
    }
}

/// Opens a topic, and waits until it is there.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_reader_open(
    bus: Option<&BusHandle>,
    topic: Text<'_>,
    timeout_nanos: i64,
    reader: Out<'_, Option<Box<Reader>>>,
) -> Status {
    call(|| {
        let place = needed(bus, "bus")?.place.clone();
        let topic = topic.needed("topic")?;
        let reader = needed(reader, "reader")?;
        let patience = Patience::new(timeout_nanos);
        let port = patience.open(|| Ok(SampleReader::open(&place.bus, topic)?))?;
        let kind = match &port {
            SampleReader::Frames(_) => None,
            SampleReader::Results(results) => Some(c_text(results.kind().name())),
        };
        let made = Reader {
            port,
            event: place.bus.listener(topic)?,
            topic: Arc::new(c_text(topic)),
            kind,
            place,
        };
        Ok(hand_over(reader, made))
    })
}

/// Stops reading.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_reader_close(reader: Option<Box<Reader>>) {
    ask((), || drop(reader));
}

/// Takes a sample, and waits for it if there is none.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_reader_take(
    reader: Option<&mut Reader>,
    which: c_int,
    timeout_nanos: i64,
    sample: Out<'_, Option<Box<Sample>>>,
) -> Status {
    call(|| {
        let reader = needed(reader, "reader")?;
        let sample = needed(sample, "sample")?;
        let take = match which {
            OLDEST => Take::All,
            NEWEST => Take::Newest,
            other => {
                return Err(Failure::new(
                    Status::Argument,
                    format!("which is {other}; it is GANTRY_OLDEST or GANTRY_NEWEST"),
                ));
            }
        };
        sample.write(None);
        let patience = Patience::new(timeout_nanos);
        let Reader { port, event, .. } = reader;
        let Some(found) = patience.look(event, || Ok(port.take(take)?))? else {
            return Ok(Status::Nothing);
        };
        let taken = Sample {
            found,
            topic: reader.topic.clone(),
            _place: reader.place.clone(),
        };
        Ok(hand_over(sample, taken))
    })
}

/// Fills in what a reader has counted.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_reader_counts(
    reader: Option<&Reader>,
    counts: Option<&mut Counts>,
) -> Status {
    call(|| {
        let reader = needed(reader, "reader")?;
        let counts = needed(counts, "counts")?;
        let found = counts.struct_bytes;
        if found as usize != size_of::<Counts>() {
            return Err(Failure::new(
                Status::Argument,
                format!(
                    "counts.struct_bytes is {found}; set it to sizeof(gantry_counts), which is {}",
                    size_of::<Counts>()
                ),
            ));
        }
        let of = reader.port.counts();
        *counts = Counts {
            struct_bytes: found,
            reserved: 0,
            taken: of.taken,
            skipped: of.skipped,
            lost: of.lost,
            refused: of.refused,
            restarts: of.restarts,
        };
        Ok(Status::Ok)
    })
}

/// Whether a process writes the topic.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_reader_has_writer(reader: Option<&Reader>) -> bool {
    ask(false, || reader.is_some_and(|it| it.port.has_writer()))
}

/// A descriptor that can be read when a sample may wait; −1 for null.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_reader_fd(reader: Option<&Reader>) -> c_int {
    ask(-1, || reader.map_or(-1, |it| it.event.as_fd().as_raw_fd()))
}

/// Type of a topic's results; null for a topic of frames.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_reader_result_type(reader: Option<&Reader>) -> *const c_char {
    let kind = reader.and_then(|it| it.kind.as_ref());
    kind.map_or(null(), |it| it.as_ptr())
}

/// Gives a sample's memory back.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_sample_release(sample: Option<Box<Sample>>) {
    ask((), || drop(sample));
}

/// Header of a frame; null for a result.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_sample_frame(sample: Option<&Sample>) -> *const FrameHeader {
    match sample.map(|it| &it.found) {
        Some(Found::Frame(frame)) => from_ref(frame.header()),
        _ => null(),
    }
}

/// Header of a result; null for a frame.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_sample_result(sample: Option<&Sample>) -> *const ResultHeader {
    match sample.map(|it| &it.found) {
        Some(Found::Result(result)) => from_ref(result.header()),
        _ => null(),
    }
}

/// The payload of a frame or the body of a result, where it lies in shared memory.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_sample_bytes(sample: Option<&Sample>, len: Out<'_, usize>) -> *const u8 {
    ask(null(), || {
        let bytes = sample.map(Sample::bytes);
        if let Some(len) = len {
            len.write(bytes.map_or(0, <[u8]>::len));
        }
        bytes.map_or(null(), <[u8]>::as_ptr)
    })
}

/// The frames and results that a result answers.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_sample_inputs(
    sample: Option<&Sample>,
    len: Out<'_, usize>,
) -> *const InputRecord {
    ask(null(), || {
        let inputs = match sample.map(|it| &it.found) {
            Some(Found::Result(result)) => result.inputs(),
            _ => &[],
        };
        if let Some(len) = len {
            len.write(inputs.len());
        }
        inputs.as_ptr()
    })
}

/// Topic of a sample, without the domain.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_sample_topic(sample: Option<&Sample>) -> *const c_char {
    sample.map_or(null(), |it| it.topic.as_ptr())
}

/// `CLOCK_MONOTONIC` at which the reader took the sample, nanoseconds.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_sample_taken_mono_nanos(sample: Option<&Sample>) -> u64 {
    match sample.map(|it| &it.found) {
        Some(Found::Frame(frame)) => frame.taken().0,
        Some(Found::Result(result)) => result.taken().0,
        None => 0,
    }
}

const _: () = {
    const fn moves<T: Send>() {}
    moves::<Reader>();
    moves::<Sample>();
};
