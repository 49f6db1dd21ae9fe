//! Why a suite cannot be used.

/// A mistake of a suite: a sentence with the key, its value and what is allowed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct SuiteFault(String);

impl From<String> for SuiteFault {
    fn from(sentence: String) -> SuiteFault {
        SuiteFault(sentence)
    }
}

impl From<&str> for SuiteFault {
    fn from(sentence: &str) -> SuiteFault {
        SuiteFault(sentence.to_owned())
    }
}

impl From<SuiteFault> for String {
    fn from(fault: SuiteFault) -> String {
        fault.0
    }
}
