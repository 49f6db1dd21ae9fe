//! Errors of the bus as the exceptions of `gantry._errors`, in Python's words.

use consumer_gpu::GpuError;
use consumer_kit::LockstepError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

use schema_bus::{BusError, CommandError, LoanError};
use schema_frames::{FrameError, ResultError, SCHEMA_VERSION};

/// Names of the classes in `gantry._errors`.
#[derive(Clone, Copy, Debug)]
enum Class {
    Gantry,
    NoSuchTopic,
    SchemaVersion,
    TooManyReaders,
    TopicTaken,
    BorrowLimit,
    FrameFormat,
    TimedOut,
}

const NAMES: [&str; 8] = [
    "GantryError",
    "NoSuchTopicError",
    "SchemaVersionError",
    "TooManyReadersError",
    "TopicTakenError",
    "BorrowLimitError",
    "FrameFormatError",
    "TimedOutError",
];

fn error(class: Class, text: impl Into<String>) -> PyErr {
    static CLASSES: PyOnceLock<Vec<Py<PyType>>> = PyOnceLock::new();
    // The Rust side speaks of command lines.
    let text = text
        .into()
        .replace("name its --domain", "pass domain=")
        .replace("choose another with --domain", "choose another name")
        .replace("another --domain", "another domain")
        .replace(
            "rebuild the consumer",
            "install the gantry package of the simulator's version",
        );
    Python::attach(|py| {
        let classes = CLASSES.get_or_try_init(py, || {
            let module = py.import("gantry._errors")?;
            NAMES
                .iter()
                .map(|name| Ok(module.getattr(*name)?.cast_into::<PyType>()?.unbind()))
                .collect::<PyResult<Vec<_>>>()
        });
        match classes {
            Ok(classes) => PyErr::from_type(classes[class as usize].bind(py).clone(), text),
            Err(missing) => missing,
        }
    })
}

/// A `GantryError` with this sentence.
pub fn gantry(text: impl Into<String>) -> PyErr {
    error(Class::Gantry, text)
}

/// A `TimedOutError` with this sentence.
pub fn timed_out(text: impl Into<String>) -> PyErr {
    error(Class::TimedOut, text)
}

/// A `FrameFormatError` with this sentence.
pub fn format(text: impl Into<String>) -> PyErr {
    error(Class::FrameFormat, text)
}

/// A frame that breaks the contract.
pub fn frame(source: &FrameError, prefix: &str) -> PyErr {
    match source {
        FrameError::Version { found } => error(
            Class::SchemaVersion,
            format!(
                "{prefix}frame carries schema {found}, this package reads {SCHEMA_VERSION}; install the gantry package of the simulator's version"
            ),
        ),
        other => error(Class::FrameFormat, format!("{prefix}{other}")),
    }
}

/// A result that breaks the contract.
pub fn result(source: &ResultError, prefix: &str) -> PyErr {
    let class = match source {
        ResultError::Version { .. } => Class::SchemaVersion,
        _ => Class::FrameFormat,
    };
    error(class, format!("{prefix}{source}"))
}

/// An error of the bus.
pub fn bus(cause: BusError) -> PyErr {
    match &cause {
        BusError::NoSuchTopic { .. } => error(Class::NoSuchTopic, cause.to_string()),
        BusError::SchemaSkew {
            service, theirs, ..
        } => error(
            Class::SchemaVersion,
            format!(
                "cannot join service {service:?}: it carries schema {theirs}, this package reads {SCHEMA_VERSION}; install the gantry package of the simulator's version"
            ),
        ),
        BusError::TooManyReaders { .. } => error(Class::TooManyReaders, cause.to_string()),
        BusError::TopicTaken { .. } => error(Class::TopicTaken, cause.to_string()),
        BusError::BorrowLimit { service, limit } => error(
            Class::BorrowLimit,
            format!(
                "cannot take another frame of {service:?}: this reader already holds {limit} (limit {limit}); frames and arrays made from them keep shared memory borrowed: keep frame.copy() instead"
            ),
        ),
        BusError::BadFrame {
            service,
            source: source @ FrameError::Version { .. },
            ..
        } => frame(source, &format!("{service}: ")),
        BusError::BadFrame { .. } => error(Class::FrameFormat, cause.to_string()),
        BusError::BadResult {
            service,
            writer,
            source,
        } => {
            let writer = writer.as_ref().map(|writer| format!(" from {writer}"));
            result(
                source,
                &format!("{service}{}: ", writer.unwrap_or_default()),
            )
        }
        BusError::BadSample { .. } => error(Class::FrameFormat, cause.to_string()),
        _ => gantry(cause.to_string()),
    }
}

/// An error of a command.
pub fn command(cause: CommandError) -> PyErr {
    match cause {
        CommandError::Bus(cause) => bus(cause),
        CommandError::Timeout { .. } => timed_out(cause.to_string()),
        CommandError::NoServer { .. } => error(Class::NoSuchTopic, cause.to_string()),
        other => gantry(other.to_string()),
    }
}

/// An error of joining lockstep.
pub fn lockstep(cause: LockstepError) -> PyErr {
    match cause {
        LockstepError::Bus(cause) => bus(cause),
        LockstepError::Command(CommandError::NoServer { .. }) => {
            error(Class::NoSuchTopic, cause.to_string())
        }
        LockstepError::Command(CommandError::Timeout { .. }) => timed_out(cause.to_string()),
        other => gantry(other.to_string()),
    }
}

/// An error of a GPU.
pub fn gpu(cause: GpuError) -> PyErr {
    match cause {
        GpuError::Bus(cause) => bus(cause),
        GpuError::Loan(cause) => loan(cause),
        other => gantry(other.to_string()),
    }
}

/// A slot that could not be loaned.
pub fn loan(cause: LoanError) -> PyErr {
    match &cause {
        LoanError::NoFreeSlot { topic, .. } => error(
            Class::BorrowLimit,
            format!(
                "cannot loan another result of {topic:?}: all its loans are open; send them or give them back, and keep copies of arrays instead of those whose loan was sent"
            ),
        ),
        _ => gantry(cause.to_string()),
    }
}
