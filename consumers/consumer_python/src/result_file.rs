//! Writing results into a file of their own: what a program says about the frames of a recording,
//! in the messages that a recorder would have written.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

use parking_lot::Mutex;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use consumer_forms::foxglove::results::ResultConverter;
use consumer_forms::foxglove::snapshots::document;
use consumer_kit::items::ResultParts;
use schema_bus::{BusError, ResultDraft, names};
use schema_frames::document::DOCUMENT_MAGIC;
use schema_frames::{About, DocumentHeader, ResultHeader, SCHEMA_VERSION};
use schema_recording::messages::{Batch, Entry};
use schema_recording::write::{ChunkCompression, Recording};

use crate::errors;
use crate::publish::{Said, format_of, gone, spec_of, tensor_of};
use crate::result::Input;

/// A file of results under construction: `FILE.part` until it is finished.
#[pyclass(frozen, module = "gantry._native")]
pub struct ResultFile {
    state: Mutex<Option<State>>,
    path: PathBuf,
}

struct State {
    file: Recording,
    converter: ResultConverter,
    topics: HashMap<String, Topic>,
    /// Epoch of the run whose recording is read; 0 if it is not known.
    epoch: u64,
}

struct Topic {
    about: About,
    /// Number of the last result.
    seq: u64,
}

fn sentence(error: anyhow::Error) -> PyErr {
    errors::gantry(format!("{error:#}"))
}

impl ResultFile {
    fn with<T>(&self, act: impl FnOnce(&mut State) -> PyResult<T>) -> PyResult<T> {
        match &mut *self.state.lock() {
            Some(state) => act(state),
            None => Err(errors::gantry(format!(
                "{} is finished; nothing can be written to it any more",
                self.path.display()
            ))),
        }
    }
}

impl State {
    fn put(
        &mut self,
        topic: &str,
        seq: u64,
        nanos: (u64, u64),
        entries: Vec<Entry>,
    ) -> PyResult<()> {
        let (log_nanos, publish_nanos) = nanos;
        let batch = Batch {
            source: topic.into(),
            sequence: seq as u32,
            log_nanos,
            publish_nanos,
            entries,
        };
        self.file.write(&batch).map_err(sentence)
    }
}

/// Nanoseconds since 1970.
fn wall_nanos() -> u64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    now.map_or(0, |since| since.as_nanos() as u64)
}

#[pymethods]
impl ResultFile {
    /// Creates `path.part` with these metadata records. `epoch` is that of the recording's run.
    #[new]
    fn create(
        py: Python<'_>,
        path: PathBuf,
        epoch: u64,
        metadata: BTreeMap<String, BTreeMap<String, String>>,
    ) -> PyResult<Self> {
        let created = py.detach(|| {
            let mut file = Recording::create(&path, ChunkCompression::default())?;
            for (name, pairs) in &metadata {
                file.metadata(name, pairs)?;
            }
            anyhow::Ok(file)
        });
        Ok(ResultFile {
            state: Mutex::new(Some(State {
                file: created.map_err(sentence)?,
                converter: ResultConverter::default(),
                topics: HashMap::new(),
                epoch,
            })),
            path,
        })
    }

    /// Begins a topic of results. `about` is its description as JSON.
    fn describe(&self, topic: &str, kind: &str, about: &str) -> PyResult<()> {
        let spec = spec_of(kind, about)?;
        let (kind, about) = (spec.kind, spec.about);
        if names::is_reserved(topic) || topic.is_empty() {
            let topic = topic.to_owned();
            return Err(errors::bus(BusError::Reserved { topic }));
        }
        about
            .check(kind)
            .map_err(|fault| PyValueError::new_err(format!("{topic}: {fault}")))?;
        self.with(|state| {
            if state.topics.contains_key(topic) {
                return Err(errors::gantry(format!(
                    "topic {topic:?} is written to this file already; a topic has one writer"
                )));
            }
            let text = serde_json::to_string(&about)
                .map_err(|error| PyValueError::new_err(format!("{topic}: {error}")))?;
            let header = DocumentHeader {
                magic: DOCUMENT_MAGIC,
                schema_version: SCHEMA_VERSION,
                epoch: state.epoch,
                revision: 1,
                payload_bytes: text.len() as u64,
                ..bytemuck::Zeroable::zeroed()
            };
            let entry = document(&names::about(topic), &header, &text);
            state.put(topic, 1, (0, wall_nanos()), vec![entry])?;
            state
                .topics
                .insert(topic.to_owned(), Topic { about, seq: 0 });
            Ok(())
        })
    }

    /// Writes a result with this body. Its times are those of the frames that it answers: a file is
    /// read without a clock, so that the same frames give the same results.
    fn write(&self, py: Python<'_>, topic: &str, draft: &FileDraft, body: &[u8]) -> PyResult<()> {
        let draft = draft.take()?;
        py.detach(|| {
            self.with(|state| {
                let mut header = *draft.header();
                let inputs = draft.inputs();
                let known = state.topics.get_mut(topic).ok_or_else(|| {
                    errors::gantry(format!("topic {topic:?} was not begun in this file"))
                })?;
                known.seq += 1;
                header.seq = known.seq;
                header.flags |= if known.seq == 1 {
                    ResultHeader::FIRST
                } else {
                    0
                };
                header.writer_epoch = state.epoch.max(1);
                let sent = inputs.iter().map(|input| input.published_mono_nanos);
                header.published_mono_nanos = sent.max().unwrap_or_default();
                header.n_inputs = inputs.len() as u32;
                header.payload_bytes = ResultHeader::payload_for(header.body_bytes, inputs.len());
                let kind = header
                    .check(header.payload_bytes as usize)
                    .map_err(|fault| errors::result(&fault, &format!("{topic}: ")))?;
                if header.body_bytes != body.len() as u64 {
                    return Err(errors::format(format!(
                        "a result of {topic} has {} bytes, its header says {}",
                        body.len(),
                        header.body_bytes
                    )));
                }
                let about = known.about.clone();
                let parts = ResultParts {
                    topic,
                    header: &header,
                    kind,
                    body,
                    inputs,
                    about: &about,
                };
                let fresh = &mut Vec::with_capacity;
                let entries = state.converter.entries(&parts, header.sim_nanos, fresh);
                state.put(topic, header.seq, (header.sim_nanos, wall_nanos()), entries)
            })
        })
    }

    /// Finishes the file and gives it its name. Does nothing the second time.
    fn finish(&self, py: Python<'_>) -> PyResult<()> {
        let state = self.state.lock().take();
        match state {
            Some(state) => py
                .detach(|| state.file.finish().map(drop))
                .map_err(sentence),
            None => Ok(()),
        }
    }

    /// Lets the part file stay as it is, so that it can be rescued.
    fn give_up(&self, py: Python<'_>) {
        let state = self.state.lock().take();
        py.detach(|| {
            if let Some(mut state) = state {
                // What the disk refuses is missing in the rescued file.
                let _ = state.file.flush();
            }
        });
    }
}

/// What a result of a file says of itself.
#[pyclass(frozen, module = "gantry._native")]
pub struct FileDraft {
    draft: Mutex<Option<ResultDraft>>,
}

impl FileDraft {
    fn with<T>(&self, act: impl FnOnce(&mut ResultDraft) -> PyResult<T>) -> PyResult<T> {
        match &mut *self.draft.lock() {
            Some(draft) => act(draft),
            None => Err(gone()),
        }
    }

    fn take(&self) -> PyResult<ResultDraft> {
        self.draft.lock().take().ok_or_else(gone)
    }
}

#[pymethods]
impl FileDraft {
    #[new]
    fn new(kind: &str) -> PyResult<Self> {
        let kind = spec_of(kind, "{}")?.kind;
        Ok(FileDraft {
            draft: Mutex::new(Some(ResultDraft::new(kind))),
        })
    }

    /// Says that the body is a list of records, and behind them a tail.
    fn set_list(&self, n_items: u32, element_bytes: u32, tail_bytes: u64) -> PyResult<()> {
        self.with(|draft| {
            draft
                .header_mut()
                .set_list(n_items, element_bytes, tail_bytes);
            Ok(())
        })
    }

    /// Says that the body is an image in the named format.
    fn set_image(&self, width_px: u32, height_px: u32, format: &str) -> PyResult<()> {
        let format = format_of(format)?;
        self.with(|draft| {
            draft.header_mut().set_image(width_px, height_px, format);
            Ok(())
        })
    }

    /// Says that the body is a tensor of the named elements.
    fn set_tensor(&self, element: &str, sizes: Vec<usize>) -> PyResult<()> {
        let (element, sizes) = tensor_of(element, &sizes)?;
        self.with(|draft| {
            let set = draft.header_mut().set_tensor(element, &sizes);
            set.map_err(|fault| errors::result(&fault, ""))
        })
    }

    /// Names a frame or a result that this result was computed from.
    fn answers(&self, input: Input<'_>) -> PyResult<()> {
        self.with(|draft| input.answered(|of| draft.answers(of)))
    }

    /// Fills in what the inputs do not say; what is `None` stays.
    fn describe(&self, said: PyRef<'_, Said>) -> PyResult<()> {
        self.with(|draft| {
            said.put(draft.header_mut());
            Ok(())
        })
    }

    /// Bytes of the body that it describes.
    fn body_bytes(&self) -> PyResult<u64> {
        self.with(|draft| Ok(draft.header().body_bytes))
    }

    /// Drops it unsent. Does nothing after it was written.
    fn give_back(&self) {
        drop(self.draft.lock().take());
    }
}
