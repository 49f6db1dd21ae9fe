//! Sections of a launch file by name, the place of a dotted key, and values that several sections
//! have.

use std::path::{Path, PathBuf};

use toml::Value as Toml;

use crate::error::{Errors, Place, Source, did_you_mean};
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

/// Names that `${…}` may hold in every text that has such variables.
const VARIABLES: [&str; 4] = ["run_dir", "name", "domain", "launch"];

/// Reports `${…}` with a name that the launcher does not replace: it is a spelling mistake.
pub(super) fn check_variables(
    text: &str,
    further: &[&str],
    at: Place,
    path: &str,
    errors: &mut Errors,
) {
    let known = || VARIABLES.iter().chain(further).copied();
    for part in text.split("${").skip(1) {
        let name = part.split('}').next().unwrap_or_default();
        if !part.contains('}') || !known().any(|known| known == name) {
            let hint = did_you_mean(name, known());
            errors.push(
                at,
                format!("{path} has \"${{{name}}}\", which is nothing the launcher replaces{hint}"),
            );
        }
    }
}

/// A whole number in a range; `None` if the key is missing or wrong.
pub(super) fn whole_number(
    entry: Option<&Entry>,
    path: &str,
    (least, most): (i64, i64),
    errors: &mut Errors,
) -> Option<i64> {
    let node = &entry?.node;
    match node.plain() {
        Toml::Integer(number) if (least..=most).contains(&number) => Some(number),
        other => {
            let message =
                format!("{path} is {other}, but must be a whole number from {least} to {most}");
            errors.push(node.at, message);
            None
        }
    }
}

/// A path, which begins in the folder of the text that says it.
pub(super) fn path_in_folder(
    entry: Option<&Entry>,
    path: &str,
    sources: &[Source],
    errors: &mut Errors,
) -> Option<PathBuf> {
    let node = &entry?.node;
    match node.plain() {
        Toml::String(text) if !text.is_empty() && !text.contains('\0') => {
            let joined = sources[node.at.source].folder.join(text);
            // Without this, "." would stay in the middle of a path.
            Some(match joined.components().collect::<PathBuf>() {
                empty if empty.as_os_str().is_empty() => Path::new(".").to_owned(),
                clean => clean,
            })
        }
        other => {
            let message = format!("{path} is {other}, but must be the path of a folder in quotes");
            errors.push(node.at, message);
            None
        }
    }
}
