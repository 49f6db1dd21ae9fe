//! Tables for people.

use consumer_report::terminal::TextTable;

/// A table of lines, with a head for each column.
pub fn table(heads: &[&str], rows: &[Vec<String>]) -> String {
    TextTable::new(heads).rows(rows.iter().cloned()).text()
}
