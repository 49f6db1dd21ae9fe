//! Errors of a launch file: sentences with their places, reported together.

use std::fmt;
use std::path::PathBuf;

/// A place in the texts that were read: which text, and which byte of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Place {
    pub source: usize,
    pub byte: usize,
}

/// A text that was read: a launch file, or one `--set`.
#[derive(Debug)]
pub(crate) struct Source {
    pub name: String,
    pub text: String,
    pub is_file: bool,
    /// Folder in which its relative paths begin.
    pub folder: PathBuf,
    /// Number of the texts that it was laid over.
    pub rank: usize,
}

/// One error in a launch file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LaunchError {
    /// What is wrong, the value, and what is allowed.
    pub message: String,
    /// `launch/town.toml:14:1` (line and column count from 1, the column in characters), or the
    /// `--set` it comes from.
    pub place: String,
}

impl fmt::Display for LaunchError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at {}", self.message, self.place)
    }
}

/// All errors of a launch file in the order of their places, one line each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LaunchErrors(pub Vec<LaunchError>);

impl fmt::Display for LaunchErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, error) in self.0.iter().enumerate() {
            write!(f, "{}{error}", if i == 0 { "" } else { "\n" })?;
        }
        Ok(())
    }
}

impl std::error::Error for LaunchErrors {}

/// Collects errors while a tree is read.
#[derive(Debug, Default)]
pub(crate) struct Errors(Vec<(Place, String, Option<Place>)>);

/// Stands in a message for the second place.
pub(crate) const OTHER_PLACE: &str = "{other place}";

impl Errors {
    pub fn push(&mut self, at: Place, message: impl Into<String>) {
        self.0.push((at, message.into(), None));
    }

    /// An error that two places make together. The message names the second as [`OTHER_PLACE`].
    pub fn push_pair(&mut self, at: Place, message: String, other: Place) {
        self.0.push((at, message, Some(other)));
    }

    /// Number of errors so far.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// The errors sorted by place, with line and column.
    pub fn finish(mut self, sources: &[Source]) -> LaunchErrors {
        self.0.sort();
        self.0.dedup();
        let place = |at: Place| describe(&sources[at.source], at.byte);
        LaunchErrors(
            self.0
                .into_iter()
                .map(|(at, message, other)| LaunchError {
                    message: match other {
                        Some(other) => message.replace(OTHER_PLACE, &place(other)),
                        None => message,
                    },
                    place: place(at),
                })
                .collect(),
        )
    }
}

fn describe(source: &Source, byte: usize) -> String {
    if !source.is_file {
        return source.name.clone();
    }
    let before = &source.text[..source.text.floor_char_boundary(byte)];
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    format!(
        "{}:{}:{}",
        source.name,
        before.matches('\n').count() + 1,
        before[line_start..].chars().count() + 1
    )
}

/// Keys that had another name before version 0.1.0.
const RENAMED: [(&str, &str); 1] = [("cpus", "cores")];

/// `, did you mean "x"?`, or a list of the known words if none of them is similar.
pub(crate) fn did_you_mean<'k>(wrong: &str, known: impl IntoIterator<Item = &'k str>) -> String {
    let known: Vec<&str> = known.into_iter().collect();
    let renamed = known.iter().find(|word| RENAMED.contains(&(wrong, word)));
    let near = known
        .iter()
        .map(|word| (strsim::osa_distance(wrong, word), word))
        .filter(|(distance, word)| *distance <= 1 + word.len().min(wrong.len()) / 4)
        .min();
    match renamed.or(near.map(|(_, word)| word)) {
        Some(word) => format!(", did you mean {word:?}?"),
        None if known.is_empty() => String::new(),
        None => format!(", known: {}", known.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_and_column_count_characters_from_one() {
        let source = Source {
            name: "x.toml".into(),
            text: "a\nüü key".into(),
            is_file: true,
            folder: PathBuf::new(),
            rank: 0,
        };
        assert_eq!(describe(&source, 0), "x.toml:1:1");
        assert_eq!(describe(&source, 7), "x.toml:2:4");
        assert_eq!(describe(&source, 999), "x.toml:2:7");
    }

    #[test]
    fn only_near_words_are_suggested() {
        assert_eq!(
            did_you_mean("chanels", ["channels", "columns"]),
            ", did you mean \"channels\"?"
        );
        assert_eq!(
            did_you_mean("zzz", ["channels", "columns"]),
            ", known: channels, columns"
        );
    }
}
