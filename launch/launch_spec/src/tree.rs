//! A TOML text as a tree that keeps the place of every key and value, and how one text is laid over
//! another.

use std::collections::BTreeMap;

use toml::de::{DeTable, DeValue};

use crate::error::{Errors, OTHER_PLACE, Place};

/// Keys of a table by name.
pub(crate) type Table = BTreeMap<String, Entry>;

/// A key with its place, and its value.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub key_at: Place,
    pub node: Node,
}

/// A value and its place.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub at: Place,
    pub value: Value,
}

#[derive(Clone, Debug)]
pub(crate) enum Value {
    Table(Table),
    Leaf(toml::Value),
}

impl Node {
    pub fn table(&self) -> Option<&Table> {
        match &self.value {
            Value::Table(table) => Some(table),
            Value::Leaf(_) => None,
        }
    }

    pub fn table_mut(&mut self) -> Option<&mut Table> {
        match &mut self.value {
            Value::Table(table) => Some(table),
            Value::Leaf(_) => None,
        }
    }

    /// The value without places.
    pub fn plain(&self) -> toml::Value {
        match &self.value {
            Value::Leaf(leaf) => leaf.clone(),
            Value::Table(table) => toml::Value::Table(
                table
                    .iter()
                    .map(|(key, entry)| (key.clone(), entry.node.plain()))
                    .collect(),
            ),
        }
    }
}

/// Place of the value at a dotted path, if the text has one.
pub(crate) fn place_of(table: &Table, path: &str) -> Option<Place> {
    let (head, rest) = path
        .split_once('.')
        .map_or((path, None), |(head, rest)| (head, Some(rest)));
    let entry = table.get(head)?;
    match rest {
        None => Some(entry.node.at),
        Some(rest) => place_of(entry.node.table()?, rest),
    }
}

/// Reads a whole text; `None` after a syntax error.
pub(crate) fn read(text: &str, source: usize, errors: &mut Errors) -> Option<Table> {
    let (document, wrong) = DeTable::parse_recoverable(text);
    for error in &wrong {
        let byte = error.span().map_or(text.len(), |span| span.start);
        errors.push(Place { source, byte }, error.message().replace('\n', ", "));
    }
    wrong
        .is_empty()
        .then(|| table(document.get_ref(), source, errors))
}

fn table(read: &DeTable<'_>, source: usize, errors: &mut Errors) -> Table {
    let entries = read.iter().map(|(key, value)| {
        let key_at = Place {
            source,
            byte: key.span().start,
        };
        let at = Place {
            source,
            byte: value.span().start,
        };
        let value = match value.get_ref() {
            DeValue::Table(inner) => Value::Table(table(inner, source, errors)),
            leaf => Value::Leaf(plain(leaf, at, errors)),
        };
        (
            key.get_ref().to_string(),
            Entry {
                key_at,
                node: Node { at, value },
            },
        )
    });
    entries.collect()
}

fn plain(value: &DeValue<'_>, at: Place, errors: &mut Errors) -> toml::Value {
    match value {
        DeValue::String(text) => toml::Value::String(text.to_string()),
        DeValue::Boolean(flag) => toml::Value::Boolean(*flag),
        DeValue::Datetime(time) => toml::Value::Datetime(*time),
        DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix())
            .map_or_else(
                |_| {
                    errors.push(at, format!("{number} is beyond what 64 bits hold"));
                    toml::Value::Integer(0)
                },
                toml::Value::Integer,
            ),
        DeValue::Float(number) => toml::Value::Float(number.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Array(list) => {
            let elements = list.iter().map(|element| {
                plain(
                    element.get_ref(),
                    Place {
                        byte: element.span().start,
                        ..at
                    },
                    errors,
                )
            });
            toml::Value::Array(elements.collect())
        }
        DeValue::Table(inner) => {
            let entries = inner.iter().map(|(key, value)| {
                let value_at = Place {
                    byte: value.span().start,
                    ..at
                };
                (
                    key.get_ref().to_string(),
                    plain(value.get_ref(), value_at, errors),
                )
            });
            toml::Value::Table(entries.collect())
        }
    }
}

/// A `--set` that is none.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BadSet {
    #[error("--set {0:?} has no \"=\"; write --set key=value, e.g. --set scenario.seed=7")]
    NoEquals(String),
    #[error(
        "--set {0:?} has a key that is no dotted name; write --set key=value, e.g. --set scenario.seed=7"
    )]
    Key(String),
}

/// The text of one `--set key=value` as TOML. A value that is not TOML, such as `Town02`, counts as
/// a string.
pub(crate) fn set_as_toml(set: &str) -> Result<String, BadSet> {
    let Some((key, value)) = set.split_once('=') else {
        return Err(BadSet::NoEquals(set.into()));
    };
    let (key, value) = (key.trim(), value.trim());
    let typed = format!("{key} = {value}\n");
    if DeTable::parse(&typed).is_ok_and(|table| table.get_ref().len() == 1) {
        return Ok(typed);
    }
    let text = format!("{key} = {}\n", toml::Value::String(value.into()));
    match DeTable::parse(&text) {
        Ok(table) if table.get_ref().len() == 1 => Ok(text),
        _ => Err(BadSet::Key(set.into())),
    }
}

/// Lays one text over another: tables merge, everything else is replaced.
pub(crate) struct Laying<'e> {
    /// Where contradictions are reported.
    pub errors: &'e mut Errors,
    /// Whether the upper text is a file. Files may not contradict one another about what a thing
    /// is; a `--set` may.
    pub is_file: bool,
}

impl Laying<'_> {
    pub fn lay(&mut self, base: &mut Table, over: Table) {
        self.lay_at(base, over, &mut Vec::new());
    }

    fn lay_at(&mut self, base: &mut Table, over: Table, path: &mut Vec<String>) {
        for (key, above) in over {
            path.push(key.clone());
            match base.get_mut(&key) {
                Some(below) => self.lay_entry(below, above, path),
                None => {
                    base.insert(key, above);
                }
            }
            path.pop();
        }
    }

    fn lay_entry(&mut self, below: &mut Entry, above: Entry, path: &mut Vec<String>) {
        let (was, is) = (&mut below.node, above.node);
        match (&mut was.value, is.value) {
            (Value::Table(inner), Value::Table(table)) => self.lay_at(inner, table, path),
            (Value::Table(_), Value::Leaf(leaf)) if self.is_file => {
                let message = format!(
                    "{} is {leaf}, but a table at {OTHER_PLACE}; one of them must go",
                    path.join(".")
                );
                self.errors.push_pair(is.at, message, was.at);
            }
            (Value::Leaf(leaf), Value::Table(_)) if self.is_file => {
                let message = format!(
                    "{} is a table, but {leaf} at {OTHER_PLACE}; one of them must go",
                    path.join(".")
                );
                self.errors.push_pair(is.at, message, was.at);
            }
            (Value::Leaf(first), Value::Leaf(second))
                if self.is_file && first != &second && says_what_it_is(path) =>
            {
                let what = path[..2].join(".");
                let message = format!(
                    "{} is {second}, but {first} at {OTHER_PLACE}; {what} can only be one of them: give the second a name of its own",
                    path.join(".")
                );
                self.errors.push_pair(is.at, message, was.at);
            }
            (_, value) => {
                *below = Entry {
                    node: Node { value, ..is },
                    ..above
                };
            }
        }
    }
}

/// Whether the key decides which other keys its table has.
fn says_what_it_is(path: &[String]) -> bool {
    matches!(path, [section, _, key]
        if section == "sensor" && (key == "kind" || key == "sensor") || section == "topic" && key == "type")
}
