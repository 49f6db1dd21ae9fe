//! Why coded bytes are refused.

/// Why coded bytes are no payload.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CodecError(pub String);

impl std::fmt::Display for CodecError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for CodecError {}

impl From<&str> for CodecError {
    fn from(why: &str) -> Self {
        CodecError(why.to_string())
    }
}
