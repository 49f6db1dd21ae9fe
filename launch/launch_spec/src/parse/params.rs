//! `[process.NAME.params]`: a process's own settings, which it is given as JSON.

use toml::Value as Toml;

use super::sections::check_variables;
use crate::error::{Errors, Place};
use crate::fill::table_or_error;
use crate::tree::{Entry, Table};

/// The settings, checked to be values that JSON has.
pub(super) fn read(entry: Option<&Entry>, path: &str, errors: &mut Errors) -> Option<toml::Table> {
    let table = table_or_error(entry?, path, errors)?;
    check(table, path, errors);
    match entry?.node.plain() {
        Toml::Table(params) => Some(params),
        _ => None,
    }
}

fn check(table: &Table, path: &str, errors: &mut Errors) {
    for (key, entry) in table {
        let path = format!("{path}.{key}");
        match entry.node.table() {
            Some(inner) => check(inner, &path, errors),
            None => check_value(&entry.node.plain(), entry.node.at, &path, errors),
        }
    }
}

fn check_value(value: &Toml, at: Place, path: &str, errors: &mut Errors) {
    match value {
        Toml::Float(number) if !number.is_finite() => {
            errors.push(
                at,
                format!("{path} is {value}, but JSON has no such number"),
            );
        }
        Toml::String(text) => check_variables(text, &[], at, path, errors),
        Toml::Array(list) => list
            .iter()
            .for_each(|element| check_value(element, at, path, errors)),
        Toml::Table(table) => table
            .iter()
            .for_each(|(key, inner)| check_value(inner, at, &format!("{path}.{key}"), errors)),
        _ => {}
    }
}
