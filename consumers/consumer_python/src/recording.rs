//! Recordings: what a file holds, and its samples as Python's objects.

use std::path::PathBuf;
use std::time::Duration;

use parking_lot::{Mutex, MutexGuard};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyString};

use schema_frames::InputRecord;
use schema_recording::pattern::matches;
use schema_recording::read::{
    Payload, PayloadError, RecordingFile, Sample, Samples, TopicKind, What,
};

use crate::errors;
use crate::frame::sample_from_bytes;
use crate::result::outcome_from_bytes;

/// Wait between two looks whether another thread has let go of the reader.
const LOOK_AGAIN: Duration = Duration::from_micros(50);

/// A recording that is open for reading.
#[pyclass(frozen, module = "gantry._native")]
pub struct Recording {
    file: RecordingFile,
}

/// Name, kind, schema, encoding of the messages, and number of messages if the file tells it.
type TopicFacts = (String, &'static str, String, String, Option<u64>);

/// Topic, revision, tick, simulated nanoseconds and text.
type DocumentFacts = (String, u64, u64, u64, String);

fn sentence(error: anyhow::Error) -> PyErr {
    errors::gantry(format!("{error:#}"))
}

fn kind_name(kind: TopicKind) -> &'static str {
    match kind {
        TopicKind::Frame => "frame",
        TopicKind::Result => "result",
        TopicKind::Snapshot => "snapshot",
        TopicKind::Document => "document",
        TopicKind::Journal => "journal",
        TopicKind::Derived => "derived",
        TopicKind::Foreign => "foreign",
    }
}

#[pymethods]
impl Recording {
    #[new]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let file = py.detach(|| RecordingFile::open(&path)).map_err(sentence)?;
        Ok(Recording { file })
    }

    /// Topics by kind and name, without what is there for other programs only.
    fn topics(&self) -> Vec<TopicFacts> {
        let topics = self.file.topics().iter();
        topics
            .filter(|topic| topic.kind != TopicKind::Derived)
            .map(|topic| {
                (
                    topic.name.to_string(),
                    kind_name(topic.kind),
                    topic.schema.clone(),
                    topic.encoding.clone(),
                    topic.n_messages,
                )
            })
            .collect()
    }

    /// First and last simulated time, nanoseconds.
    fn span(&self) -> Option<(u64, u64)> {
        self.file.span()
    }

    /// Whether the file ends as a whole one does.
    #[getter]
    fn is_complete(&self) -> bool {
        self.file.is_complete()
    }

    /// Names of the metadata records.
    fn metadata_names(&self) -> Vec<&str> {
        self.file.metadata_names()
    }

    /// A metadata record.
    fn metadata<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(pairs) = self.file.metadata(name).map_err(sentence)? else {
            return Ok(None);
        };
        let found = PyDict::new(py);
        for (key, value) in pairs {
            found.set_item(key, value)?;
        }
        Ok(Some(found))
    }

    /// Names of the attachments.
    fn attachment_names(&self) -> Vec<&str> {
        self.file.attachment_names()
    }

    /// The bytes of an attachment.
    fn attachment<'py>(
        &self,
        py: Python<'py>,
        name: &str,
    ) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let found = py.detach(|| self.file.attachment(name)).map_err(sentence)?;
        Ok(found.map(|bytes| PyBytes::new(py, &bytes)))
    }

    /// The documents in force at a simulated time.
    fn documents_at(&self, py: Python<'_>, nanos: u64) -> PyResult<Vec<DocumentFacts>> {
        let found = py
            .detach(|| self.file.documents_at(nanos))
            .map_err(sentence)?;
        let facts = found.into_iter().map(|document| {
            let header = document.header;
            (
                document.topic.to_string(),
                header.revision,
                header.tick,
                document.log_nanos,
                document.text,
            )
        });
        Ok(facts.collect())
    }

    /// Reads the samples of these kinds from one simulated time up to another. The patterns choose
    /// frames, results and messages of others.
    fn read(
        &self,
        from_nanos: u64,
        to_nanos: u64,
        kinds: Vec<String>,
        topics: Vec<String>,
    ) -> Cursor {
        let samples = self.file.samples_of((from_nanos, to_nanos), |topic| {
            let is_chosen = match topic.kind {
                TopicKind::Frame | TopicKind::Result | TopicKind::Foreign => {
                    topics.is_empty() || topics.iter().any(|of| matches(of, &topic.name))
                }
                _ => true,
            };
            is_chosen && kinds.iter().any(|kind| kind == kind_name(topic.kind))
        });
        Cursor {
            samples: Mutex::new(samples),
            undecoded: Mutex::default(),
        }
    }
}

/// A place in a recording.
#[pyclass(frozen, module = "gantry._native")]
pub struct Cursor {
    samples: Mutex<Samples>,
    /// Samples whose bytes could not be decoded: how many, and the first sentence.
    undecoded: Mutex<(u64, Option<String>)>,
}

/// Kind, topic, simulated nanoseconds, the sample, and what else belongs to it.
type Item = (&'static str, String, u64, Py<PyAny>, Option<Py<PyAny>>);

impl Cursor {
    /// The reader, once no other thread uses it. Whoever has it reads without Python's global lock
    /// and takes that again, so nobody waits for the reader with that lock held.
    fn reader(&self, py: Python<'_>) -> MutexGuard<'_, Samples> {
        loop {
            match self.samples.try_lock() {
                Some(samples) => return samples,
                None => py.detach(|| std::thread::sleep(LOOK_AGAIN)),
            }
        }
    }
}

#[pymethods]
impl Cursor {
    /// The next sample; `None` at the end. One whose bytes cannot be decoded is passed over and
    /// counted.
    fn next(&self, py: Python<'_>) -> PyResult<Option<Item>> {
        let mut guard = self.reader(py);
        let samples: &mut Samples = &mut guard;
        loop {
            let found = py.detach(|| samples.next()).map_err(sentence)?;
            let Some(sample) = found else {
                return Ok(None);
            };
            match item(py, sample)? {
                Ok(item) => return Ok(Some(item)),
                Err(fault) => {
                    let mut undecoded = self.undecoded.lock();
                    undecoded.0 += 1;
                    undecoded.1.get_or_insert(fault);
                }
            }
        }
    }

    /// Goes on at a simulated time.
    fn skip_to(&self, py: Python<'_>, nanos: u64) {
        self.reader(py).skip_to(nanos);
    }

    /// What could not be read so far: how often by kind, and the first sentences.
    fn damage<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyDict>, Vec<String>)> {
        let samples = self.reader(py);
        let damage = samples.damage();
        let counts = PyDict::new(py);
        for (kind, n) in damage.counts() {
            counts.set_item(kind, n)?;
        }
        let mut sentences = damage.sentences().to_vec();
        let (n, first) = &*self.undecoded.lock();
        if *n > 0 {
            counts.set_item("codec", n)?;
            sentences.extend(first.clone());
        }
        Ok((counts, sentences))
    }
}

/// A sample as Python's objects, or why its bytes cannot be decoded.
fn item(py: Python<'_>, sample: Sample<'_>) -> PyResult<Result<Item, String>> {
    let nanos = sample.log_nanos;
    Ok(Ok(match sample.what {
        What::Frame {
            topic,
            header,
            payload,
        } => {
            let bytes = match with_payload(py, bytemuck::bytes_of(&header), payload, None)? {
                Ok(bytes) => bytes,
                Err(fault) => return Ok(Err(format!("{topic}: {fault}"))),
            };
            let name = PyString::new(py, topic);
            let frame = sample_from_bytes(bytes, name)?;
            ("frame", topic.to_string(), nanos, frame, None)
        }
        What::Result {
            topic,
            header,
            body,
            inputs,
        } => {
            let head = bytemuck::bytes_of(&header);
            let bytes = match with_payload(py, head, body, Some(inputs))? {
                Ok(bytes) => bytes,
                Err(fault) => return Ok(Err(format!("{topic}: {fault}"))),
            };
            let outcome = Py::new(py, outcome_from_bytes(bytes, topic)?)?.into_any();
            ("result", topic.to_string(), nanos, outcome, None)
        }
        What::Snapshot { header, records } => {
            let records = PyBytes::new(py, bytemuck::cast_slice(records));
            let header = PyBytes::new(py, bytemuck::bytes_of(&header));
            (
                "snapshot",
                schema_bus::names::WORLD_SNAPSHOT.to_string(),
                nanos,
                header.into_any().unbind(),
                Some(records.into_any().unbind()),
            )
        }
        What::Document {
            topic,
            header,
            text,
        } => {
            let numbers = (header.revision, header.tick).into_pyobject(py)?;
            let text = PyString::new(py, text).into_any().unbind();
            (
                "document",
                topic.to_string(),
                nanos,
                text,
                Some(numbers.into_any().unbind()),
            )
        }
        What::Journal { text } => {
            let text = PyString::new(py, text).into_any().unbind();
            ("journal", String::new(), nanos, text, None)
        }
        What::Foreign {
            topic,
            schema,
            encoding,
            bytes,
        } => {
            let bytes = PyBytes::new(py, bytes).into_any().unbind();
            let of = (schema, encoding).into_pyobject(py)?.into_any().unbind();
            ("foreign", topic.to_string(), nanos, bytes, Some(of))
        }
    }))
}

/// Header, payload and the inputs of a result in one object, into which the file is read directly.
/// What cannot be decoded is told inside; a disk that cannot be read is an error.
fn with_payload<'py>(
    py: Python<'py>,
    header: &[u8],
    mut payload: Payload<'_>,
    inputs: Option<&[InputRecord]>,
) -> PyResult<Result<Bound<'py, PyBytes>, PayloadError>> {
    let body_bytes = payload.len();
    let (padded, tail): (usize, &[u8]) = match inputs {
        Some(inputs) => (body_bytes.next_multiple_of(8), bytemuck::cast_slice(inputs)),
        None => (body_bytes, &[]),
    };
    let mut fault = None;
    let bytes = PyBytes::new_with(py, header.len() + padded + tail.len(), |out| {
        let (head, rest) = out.split_at_mut(header.len());
        head.copy_from_slice(header);
        let (body, rest) = rest.split_at_mut(body_bytes);
        let (padding, end) = rest.split_at_mut(padded - body_bytes);
        padding.fill(0);
        end.copy_from_slice(tail);
        match py.detach(|| payload.read_into(body)) {
            Err(PayloadError::Io(error)) => Err(errors::gantry(format!(
                "the recording cannot be read: {error}"
            ))),
            other => {
                fault = other.err();
                Ok(())
            }
        }
    })?;
    Ok(fault.map_or(Ok(bytes), Err))
}
