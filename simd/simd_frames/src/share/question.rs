//! What a worker asks, and how an answer begins.

use serde::{Deserialize, Serialize};

/// A question of a worker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "ask", rename_all = "snake_case", deny_unknown_fields)]
pub enum Question {
    /// For a share. Answered with [`Joined`].
    Join {
        /// Name of the worker; of two of one name the second is refused.
        name: String,
        /// Version of its program, which must be the simulator's.
        version: String,
        /// GPU that it renders with.
        adapter: String,
        /// Size of its share beside the others'.
        weight: f64,
    },
    /// For the newest list of its cameras, see [`super::CameraList`].
    Cameras {
        /// Number of the worker.
        worker: u32,
    },
    /// For the newest list of the still scenery.
    Scenery,
    /// For meshes of that list.
    Meshes {
        /// Their keys.
        keys: Vec<u64>,
    },
}

/// The place of a worker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Joined {
    /// Its number.
    pub worker: u32,
    /// Random number of the simulator's start.
    pub epoch: u64,
    /// Seed of the run.
    pub seed: u64,
    /// Ticks that its frames may stay on the GPU.
    pub frames_in_flight: u32,
}

/// An answer.
pub fn accepted(bytes: &[u8]) -> Vec<u8> {
    [&[1], bytes].concat()
}

/// A refusal with its sentence.
pub fn refused(sentence: &str) -> Vec<u8> {
    [&[0], sentence.as_bytes()].concat()
}

/// An answer that is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AnswerError {
    /// The simulator refuses, and says why.
    #[error("{0}")]
    Refused(String),
    /// It has no bytes.
    #[error("the answer is empty")]
    Empty,
}

/// What an answer says.
///
/// # Errors
/// [`AnswerError`].
pub fn answer_of(bytes: &[u8]) -> Result<&[u8], AnswerError> {
    match bytes {
        [1, answer @ ..] => Ok(answer),
        [_, sentence @ ..] => {
            let sentence = String::from_utf8_lossy(sentence);
            Err(AnswerError::Refused(sentence.into_owned()))
        }
        [] => Err(AnswerError::Empty),
    }
}
