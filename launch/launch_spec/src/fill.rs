//! Applies a TOML table to a value key by key, so that every wrong key is reported with its own
//! place.
//!
//! The known keys are those that the value has when it is serialised. Each key is tried alone on the
//! otherwise unchanged value. This works for any serde type that serialises all its fields and whose
//! fields do not depend on one another.

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::Value as Toml;

use crate::error::{Errors, did_you_mean};
use crate::tree::{Entry, Node, Table};

/// `value` as a TOML table with all its keys. It goes through text, because an `f32` is written
/// there with its own few digits and not with those of an `f64`.
pub(crate) fn table_of<T: Serialize>(value: &T) -> toml::Table {
    let text = toml::to_string(value).expect("launch types are tables of TOML values");
    text.parse().expect("what toml wrote, it reads")
}

/// `base` with the keys of `table` applied. The caller reads the keys in `elsewhere` itself.
pub(crate) fn fill<T: Serialize + DeserializeOwned>(
    base: &T,
    table: &Table,
    path: &str,
    elsewhere: &[&str],
    errors: &mut Errors,
) -> T {
    let fits = |candidate: &toml::Table| candidate.clone().try_into::<T>().map(drop);
    let mut filling = Filling {
        root: table_of(base),
        fits: &fits,
        errors,
    };
    filling.fill_at(&[], table, path, elsewhere);
    filling.root.try_into().expect("every key fitted alone")
}

/// `base` with the keys of an entry applied that must be a table. Without an entry, `base`.
pub(crate) fn fill_entry<T: Serialize + DeserializeOwned>(
    base: &T,
    entry: Option<&Entry>,
    path: &str,
    elsewhere: &[&str],
    errors: &mut Errors,
) -> T {
    let empty = Table::new();
    let table = match entry {
        None => &empty,
        Some(entry) => table_or_error(entry, path, errors).unwrap_or(&empty),
    };
    fill(base, table, path, elsewhere, errors)
}

/// The entry's table; reports an error if the entry is something else.
pub(crate) fn table_or_error<'t>(
    entry: &'t Entry,
    path: &str,
    errors: &mut Errors,
) -> Option<&'t Table> {
    let table = entry.node.table();
    if table.is_none() {
        errors.push(
            entry.node.at,
            format!("{path} is {}, but must be a table", entry.node.plain()),
        );
    }
    table
}

/// Reports every key that is not known.
pub(crate) fn refuse_unknown(table: &Table, known: &[&str], path: &str, errors: &mut Errors) {
    for (key, entry) in table
        .iter()
        .filter(|(key, _)| !known.contains(&key.as_str()))
    {
        let inside = if path.is_empty() {
            "at the top".to_owned()
        } else {
            format!("in [{path}]")
        };
        errors.push(
            entry.key_at,
            format!(
                "unknown key {key:?} {inside}{}",
                did_you_mean(key, known.iter().copied())
            ),
        );
    }
}

/// Why a key cannot have a value, as the second half of a sentence.
#[derive(Debug, thiserror::Error)]
enum Misfit {
    /// The value is of another kind than the default.
    #[error("must be {0}")]
    Kind(&'static str),
    /// serde's message, rephrased.
    #[error("{0}")]
    Value(String),
}

/// A value as a table, while keys are applied to it.
struct Filling<'a> {
    root: toml::Table,
    /// Whether a table can be read as the value.
    fits: &'a dyn Fn(&toml::Table) -> Result<(), toml::de::Error>,
    errors: &'a mut Errors,
}

impl Filling<'_> {
    /// Applies the keys of `table` to the table at the place `at` of the value. `path` is that place
    /// in the launch file.
    fn fill_at(&mut self, at: &[&str], table: &Table, path: &str, elsewhere: &[&str]) {
        let template = inner(&self.root, at).clone();
        let known: Vec<&str> = elsewhere
            .iter()
            .copied()
            .chain(template.keys().map(String::as_str))
            .collect();
        refuse_unknown(table, &known, path, self.errors);
        for (key, entry) in table {
            let Some(default) = template.get(key) else {
                continue;
            };
            let key_path = format!("{path}.{key}");
            let below: Vec<&str> = at.iter().copied().chain([key.as_str()]).collect();
            let node = &entry.node;
            if let Toml::Table(_) = default {
                if let Some(inner) = node.table() {
                    self.fill_at(&below, inner, &key_path, &[]);
                } else {
                    self.errors.push(
                        node.at,
                        format!("{key_path} is {}, but must be a table", node.plain()),
                    );
                }
                continue;
            }
            match self.replaced(at, key, default, node) {
                Ok(next) => self.root = next,
                Err(reason) => self.errors.push(
                    node.at,
                    format!("{key_path} is {}, but {reason}", node.plain()),
                ),
            }
        }
    }

    /// The value with one key replaced, or why it cannot be.
    fn replaced(
        &self,
        at: &[&str],
        key: &str,
        default: &Toml,
        node: &Node,
    ) -> Result<toml::Table, Misfit> {
        let value = node.plain();
        let same_kind = default.same_type(&value) || (default.is_float() && value.is_integer());
        if !same_kind {
            return Err(Misfit::Kind(kind_of(default)));
        }
        let mut next = self.root.clone();
        inner_mut(&mut next, at).insert(key.to_owned(), value);
        (self.fits)(&next)
            .map_err(|error| Misfit::Value(as_sentence(error.message(), &node.plain())))
            .map(|()| next)
    }
}

fn inner<'t>(root: &'t toml::Table, at: &[&str]) -> &'t toml::Table {
    at.iter().fold(root, |table, key| {
        table[*key].as_table().expect("path was walked before")
    })
}

fn inner_mut<'t>(root: &'t mut toml::Table, at: &[&str]) -> &'t mut toml::Table {
    at.iter().fold(root, |table, key| {
        table[*key].as_table_mut().expect("path was walked before")
    })
}

fn kind_of(value: &Toml) -> &'static str {
    match value {
        Toml::String(_) => "text in quotes",
        Toml::Integer(_) => "a whole number",
        Toml::Float(_) => "a number",
        Toml::Boolean(_) => "true or false",
        Toml::Array(_) => "a list in brackets",
        Toml::Datetime(_) => "a date",
        Toml::Table(_) => "a table",
    }
}

/// serde's message about a wrong value, rephrased as the second half of our sentence.
fn as_sentence(message: &str, value: &Toml) -> String {
    let message = message.lines().next().unwrap_or_default();
    let between_backticks: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    if let ([wrong, names @ ..], true) = (
        &between_backticks[..],
        message.starts_with("unknown variant"),
    ) {
        let hint = did_you_mean(wrong, names.iter().copied());
        let hint = if hint.contains("did you mean") {
            hint
        } else {
            String::new()
        };
        return format!("must be one of {}{hint}", names.join(", "));
    }
    if let Some((_, expected)) = message.split_once("expected ") {
        let expected = match expected {
            "u32" => "a whole number from 0 to 4294967295",
            "u64" | "i64" if value.is_integer() => "a whole number from 0 up",
            "f32" | "f64" => "a number",
            "a string" => "text in quotes",
            other => other,
        };
        return format!("must be {expected}");
    }
    if message.starts_with("must") {
        message.to_owned()
    } else {
        format!("must be right: {message}")
    }
}
