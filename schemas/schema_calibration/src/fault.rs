//! What is wrong with a file, and why a camera cannot be written.

/// What is wrong with a file's text.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Fault {
    /// Line, from 1; `None` if it is the whole file.
    pub line: Option<usize>,
    /// A sentence.
    pub message: String,
}

impl Fault {
    pub(crate) fn new(message: impl Into<String>) -> Fault {
        Fault {
            line: None,
            message: message.into(),
        }
    }

    pub(crate) fn at(line: usize, message: impl Into<String>) -> Fault {
        Fault {
            line: Some(line),
            message: message.into(),
        }
    }

    /// The sentence behind a file's name and the line.
    pub fn of_file(&self, file: &str) -> String {
        match self.line {
            Some(line) => format!("{file}:{line}: {}", self.message),
            None => format!("{file}: {}", self.message),
        }
    }
}

/// Why cameras cannot be written in a format.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CalibrationError {
    /// It has no words for a lens.
    #[error("{camera} has a lens of model {model}, which {format} cannot say; it can say {known}")]
    Lens {
        /// The camera.
        camera: String,
        /// The format.
        format: &'static str,
        /// Model of its lens.
        model: String,
        /// Models that the format can say.
        known: &'static str,
    },
    /// A file of it holds one camera.
    #[error("a file of {format} holds one camera, and there are {}: {}; name one with --sensor", names.len(), names.join(", "))]
    Several {
        /// The format.
        format: &'static str,
        /// The cameras.
        names: Vec<String>,
    },
}
