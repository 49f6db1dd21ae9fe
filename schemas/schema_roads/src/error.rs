//! What a text can have wrong: oddities that the map tells, and errors that leave no map.

/// How much is lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The map is what its maker meant, or as good as.
    #[default]
    Warning,
    /// Something that a map needs is missing or cannot be used: the file is broken there.
    Error,
}

/// Something in a map that was left out or read in a certain way.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Warning {
    /// How much is lost.
    pub severity: Severity,
    /// Line in the text, from 1.
    pub line: Option<u32>,
    /// Column in the text, from 1.
    pub column: Option<u32>,
    /// What and why.
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
    /// Not well-formed XML.
    #[error("the map is not well-formed XML: {reason} (line {line}, column {column})")]
    Xml {
        /// Line, from 1.
        line: u32,
        /// Column, from 1.
        column: u32,
        /// What the XML parser says.
        reason: String,
    },
    /// XML, but something else.
    #[error("the file is not OpenDRIVE: its root element is <{0}> and must be <OpenDRIVE>")]
    NotOpenDrive(String),
    /// No road can be used.
    #[error(
        "the map has no usable road: each needs a <planView> with a geometry and <lanes> with a section"
    )]
    Empty,
    /// Beyond a limit.
    #[error("the map is too large: {0}")]
    TooLarge(String),
}
