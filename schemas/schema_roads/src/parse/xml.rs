//! Reading attributes with defaults, ranges and warnings that name the place in the file.

use roxmltree::{Document, Node};

use crate::error::{MapError, Severity, Warning};

/// Longest text that is read, bytes.
pub const MAX_TEXT_BYTES: usize = 128 << 20;
/// Most XML nodes.
const MAX_NODES: u32 = 8_000_000;
/// Most warnings that are kept. Finding the position of one costs a pass over the text, so a broken
/// file must not cause thousands.
const MAX_WARNINGS: usize = 100;
/// Largest magnitude of any number in a map.
const MAX_NUMBER: f64 = 1e9;

/// The document, and the warnings about it so far.
pub(crate) struct Reader<'d, 'i> {
    doc: &'d Document<'i>,
    warnings: Vec<Warning>,
    dropped: usize,
    broken: bool,
    /// Whether RoadRunner wrote the file, as it did CARLA's towns. Its orientations and headings of
    /// signals and objects mean something else than OpenDRIVE's: `+` is for the lanes with positive
    /// ids, and a heading counts from the road's direction whatever the orientation is.
    pub by_road_runner: bool,
}

/// Parses the XML within limits.
pub(crate) fn document(text: &str) -> Result<Document<'_>, MapError> {
    if text.len() > MAX_TEXT_BYTES {
        return Err(MapError::TooLarge(format!(
            "the map has {} bytes; at most {MAX_TEXT_BYTES} are read",
            text.len()
        )));
    }
    let options = roxmltree::ParsingOptions {
        allow_dtd: false,
        nodes_limit: MAX_NODES,
        ..Default::default()
    };
    Document::parse_with_options(text, options).map_err(|error| {
        let pos = error.pos();
        MapError::Xml {
            line: pos.row,
            column: pos.col,
            reason: error.to_string(),
        }
    })
}

impl<'d, 'i> Reader<'d, 'i> {
    pub fn new(doc: &'d Document<'i>) -> Self {
        Reader {
            doc,
            warnings: Vec::new(),
            dropped: 0,
            broken: false,
            by_road_runner: false,
        }
    }

    /// Adds a warning about `node`.
    pub fn warn(&mut self, node: Node, text: impl Into<String>) {
        self.note(Severity::Warning, node, text.into());
    }

    /// Adds an error about `node`: the file is broken there.
    pub fn error(&mut self, node: Node, text: impl Into<String>) {
        self.broken = true;
        self.note(Severity::Error, node, text.into());
    }

    fn note(&mut self, severity: Severity, node: Node, text: String) {
        if self.warnings.len() >= MAX_WARNINGS {
            self.dropped += 1;
            return;
        }
        let pos = self.doc.text_pos_at(node.range().start);
        self.warnings.push(Warning {
            severity,
            line: Some(pos.row),
            column: Some(pos.col),
            text,
        });
    }

    /// All warnings; beyond the limit, the last one says how many more there were.
    pub fn into_warnings(mut self) -> Vec<Warning> {
        if self.dropped > 0 {
            let text = format!("{} further warnings are not listed", self.dropped);
            let severity = if self.broken {
                Severity::Error
            } else {
                Severity::Warning
            };
            self.warnings.push(Warning {
                severity,
                line: None,
                column: None,
                text,
            });
        }
        self.warnings
    }

    /// A number; `default` if it is absent, unreadable, not finite or absurdly large.
    pub fn number(&mut self, node: Node, name: &str, default: f64) -> f64 {
        self.optional_number(node, name).unwrap_or(default)
    }

    /// A number, if there is a usable one.
    pub fn optional_number(&mut self, node: Node, name: &str) -> Option<f64> {
        let text = node.attribute(name)?.trim();
        match text.parse::<f64>() {
            Ok(x) if x.is_finite() && x.abs() <= MAX_NUMBER => Some(x),
            _ => {
                let shown: String = text.chars().take(40).collect();
                self.error(node, format!("<{}> has {name}=\"{shown}\", which is not a number within ±1e9; it is left out", tag(node)));
                None
            }
        }
    }

    /// Four coefficients.
    pub fn coefficients(&mut self, node: Node, names: [&str; 4]) -> [f64; 4] {
        names.map(|name| self.number(node, name, 0.0))
    }
}

/// Local name of an element.
pub(crate) fn tag<'a>(node: Node<'a, '_>) -> &'a str {
    node.tag_name().name()
}

/// Child elements called `name`.
pub(crate) fn children<'a, 'i>(
    node: Node<'a, 'i>,
    name: &'static str,
) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children()
        .filter(move |child| child.is_element() && tag(*child) == name)
}

/// First child element called `name`.
pub(crate) fn child<'a, 'i>(node: Node<'a, 'i>, name: &'static str) -> Option<Node<'a, 'i>> {
    children(node, name).next()
}

/// An attribute without surrounding blanks, empty if absent.
pub(crate) fn text<'a>(node: Node<'a, '_>, name: &str) -> &'a str {
    node.attribute(name).unwrap_or("").trim()
}
