//! Sections of a launch file by name, and the place of a dotted key.

use crate::error::{Errors, Place};
use crate::fill::table_or_error;
use crate::tree::{Entry, Table, place_of};

/// The tables `[section.NAME]`. Wrong names are reported.
pub(super) fn named<'t>(
    file: &'t Table,
    section: &str,
    errors: &mut Errors,
) -> Vec<(&'t str, &'t Entry)> {
    let Some(entry) = file.get(section) else {
        return Vec::new();
    };
    let Some(table) = table_or_error(entry, section, errors) else {
        return Vec::new();
    };
    for (name, entry) in table.iter().filter(|(name, _)| !is_name(name)) {
        errors.push(
            entry.key_at,
            format!("[{section}.{name}] has a name that is not 1 to 32 lower-case letters, digits or '_', a letter first"),
        );
    }
    table
        .iter()
        .map(|(name, entry)| (name.as_str(), entry))
        .collect()
}

/// Names become parts of topic names and of file names, so few characters are allowed.
fn is_name(name: &str) -> bool {
    let rest = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    name.len() <= 32 && name.starts_with(|c: char| c.is_ascii_lowercase()) && name.chars().all(rest)
}

/// The place of a dotted key, or of the nearest table around it that the file has.
pub(super) fn nearest_place(file: &Table, path: &str) -> Place {
    let mut path = path;
    loop {
        if let Some(at) = place_of(file, path) {
            return at;
        }
        let Some((shorter, _)) = path.rsplit_once('.') else {
            return Place::default();
        };
        path = shorter;
    }
}
