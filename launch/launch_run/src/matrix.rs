//! Scenarios that shall run: combinations of values, their seeds, and their names.

use std::collections::HashSet;

use serde::{Deserialize, Serialize};

/// Seeds: a list, or so many from one on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Seeds {
    /// These.
    List(Vec<u64>),
    /// `{ from = 1, count = 8 }`
    Range(SeedRange),
}

/// So many seeds from one on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeedRange {
    /// The first.
    pub from: u64,
    /// How many.
    pub count: u64,
}

impl Seeds {
    /// All of them, in order.
    pub fn list(&self) -> Vec<u64> {
        match self {
            Seeds::List(seeds) => seeds.clone(),
            Seeds::Range(range) => (0..range.count)
                .map(|i| range.from.saturating_add(i))
                .collect(),
        }
    }
}

/// Every combination of one index below each length; the last varies fastest.
pub fn combinations<const N: usize>(lengths: [usize; N]) -> impl Iterator<Item = [usize; N]> {
    let n = lengths.iter().product::<usize>();
    (0..n).map(move |mut number| {
        let mut indices = [0; N];
        for (index, length) in indices.iter_mut().zip(lengths).rev() {
            *index = number % length;
            number /= length;
        }
        indices
    })
}

/// The words of a scenario's name: its map, without folder and ending, and what else it varies. They
/// are safe in paths.
pub fn name(map: &str, words: &[&str]) -> String {
    let map = map.rsplit('/').next().unwrap_or(map);
    let map = map.strip_suffix(".xodr").unwrap_or(map);
    let tame = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
    let words = [map].into_iter().chain(words.iter().copied());
    let words = words.map(|word| word.chars().map(tame).collect());
    words.collect::<Vec<String>>().join("_")
}

/// Values that are listed twice, and maps of one name in two folders, get numbers.
pub fn number_doubles<'a>(names: impl IntoIterator<Item = &'a mut String>) {
    let mut used = HashSet::new();
    for name in names {
        let base = name.clone();
        let mut number = 1;
        while !used.insert(name.clone()) {
            number += 1;
            *name = format!("{base}_{number}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_index_varies_fastest() {
        let all: Vec<_> = combinations([2, 1, 2]).collect();
        assert_eq!(all, [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1]]);
        assert_eq!(combinations([2, 0]).count(), 0);
    }

    #[test]
    fn names_are_safe_in_paths_and_different() {
        assert_eq!(name("a/My town.xodr", &["clear", "s1"]), "My-town_clear_s1");
        let mut names = ["a", "a", "b", "a"].map(str::to_owned);
        number_doubles(&mut names);
        assert_eq!(names, ["a", "a_2", "b", "a_3"]);
    }
}
