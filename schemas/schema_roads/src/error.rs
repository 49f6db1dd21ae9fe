//! What can be wrong with a text: warnings, with which there is a map, and errors, without one.

/// How much is lost by it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The map is what its maker meant, or very nearly.
    #[default]
    Warning,
    /// Something that a map needs is missing or cannot be used: the file is broken at this place.
    Error,
}

/// A part of a text that was left out, or that needed an interpretation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Warning {
    /// How much is lost by it.
    pub severity: Severity,
    /// Line in the text, from 1.
    pub line: Option<u32>,
    /// Column in the text, from 1.
    pub column: Option<u32>,
    /// What was left out or how it was read, and why.
    pub text: String,
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.line, self.column) {
            (Some(line), Some(column)) => write!(f, "line {line}, column {column}: {}", self.text),
            _ => f.write_str(&self.text),
        }
    }
}

/// Why a text is not a usable map.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MapError {
    /// The text is not well-formed XML.
    #[error("the map is not well-formed XML: {reason} (line {line}, column {column})")]
    Xml {
        /// Line, from 1.
        line: u32,
        /// Column, from 1.
        column: u32,
        /// The XML parser's message.
        reason: String,
    },
    /// The text is XML, but not OpenDRIVE.
    #[error("the file is not OpenDRIVE: its root element is <{0}> and must be <OpenDRIVE>")]
    NotOpenDrive(String),
    /// No road can be used.
    #[error(
        "the map has no usable road: each needs a <planView> with a geometry and <lanes> with a section"
    )]
    Empty,
    /// The text is beyond a limit.
    #[error("the map is too large: {0}")]
    TooLarge(String),
}
