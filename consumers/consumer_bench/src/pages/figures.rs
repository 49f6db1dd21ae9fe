//! The figures in `raw/*.json`, found by a path such as `cpu_rendering_?/rgb/sets_per_sec`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context as _, bail, ensure};
use launch_cli::files::MAX_NOTES_BYTES;
use serde_json::Value;

/// Keys of lists that a path may leave out: `FILE/rgb` finds the row called `rgb`.
const LISTS: [&str; 4] = ["rows", "topics", "views", "processes"];
/// Keys that name an element of a list.
const NAMES: [&str; 4] = ["name", "topic", "view", "way"];

/// All results, by file name without `.json`.
#[derive(Debug, Default)]
pub struct Figures {
    files: BTreeMap<String, Value>,
}

impl Figures {
    /// Reads every JSON file of a folder.
    pub fn read(folder: &Path) -> anyhow::Result<Figures> {
        let mut files = BTreeMap::new();
        let entries = std::fs::read_dir(folder)
            .with_context(|| format!("cannot list the results in {}", folder.display()))?;
        for entry in entries {
            let path = entry?.path();
            if path.extension().is_none_or(|end| end != "json") {
                continue;
            }
            let text = launch_cli::files::read_text(&path, MAX_NOTES_BYTES)
                .with_context(|| format!("cannot read {}", path.display()))?;
            let value: Value = serde_json::from_str(&text)
                .with_context(|| format!("{} is not JSON", path.display()))?;
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            files.insert(name.into_owned(), value);
        }
        Ok(Figures { files })
    }

    /// Makes figures from values, for tests.
    #[cfg(test)]
    pub fn from_values(files: &[(&str, Value)]) -> Figures {
        let files = files
            .iter()
            .map(|(name, value)| ((*name).to_owned(), value.clone()));
        Figures {
            files: files.collect(),
        }
    }

    /// Names of all files.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.files.keys().map(String::as_str)
    }

    /// A whole file.
    pub fn file(&self, name: &str) -> Option<&Value> {
        self.files.get(name)
    }

    /// Files whose name matches `pattern`, in which `?` stands for any one character.
    pub fn matching(&self, pattern: &str) -> anyhow::Result<Vec<&str>> {
        let fits = |name: &&str| {
            name.len() == pattern.len()
                && name
                    .chars()
                    .zip(pattern.chars())
                    .all(|(c, p)| p == '?' || c == p)
        };
        let found: Vec<&str> = self.names().filter(fits).collect();
        ensure!(!found.is_empty(), "no file raw/{pattern}.json");
        Ok(found)
    }

    /// Values at `path` in every file that its first step matches; the names of those files are
    /// added to `used`.
    pub fn find(&self, path: &str, used: &mut BTreeSet<String>) -> anyhow::Result<Vec<&Value>> {
        let (pattern, rest) = path.split_once('/').unwrap_or((path, ""));
        let mut found = Vec::new();
        for name in self.matching(pattern)? {
            used.insert(name.to_owned());
            let value = walk(&self.files[name], rest)
                .with_context(|| format!("raw/{name}.json has no {rest:?}"))?;
            found.push(value);
        }
        Ok(found)
    }
}

/// Follows the steps of `path` into `value`: keys of objects, places or names in lists.
pub fn walk<'v>(value: &'v Value, path: &str) -> anyhow::Result<&'v Value> {
    let mut at = value;
    for step in path.split('/').filter(|step| !step.is_empty()) {
        at = match at {
            Value::Object(map) if map.contains_key(step) => &map[step],
            Value::Object(map) => LISTS
                .iter()
                .filter_map(|list| map.get(*list))
                .find_map(|list| element(list, step))
                .with_context(|| format!("there is no {step:?}"))?,
            Value::Array(_) => {
                element(at, step).with_context(|| format!("there is no {step:?}"))?
            }
            _ => bail!("{step:?} asks for a part of a single value"),
        };
    }
    Ok(at)
}

/// An element of a list by its name, its place, or `last`.
fn element<'v>(list: &'v Value, step: &str) -> Option<&'v Value> {
    let list = list.as_array()?;
    let is_named = |value: &&Value| {
        NAMES
            .iter()
            .any(|key| value.get(key).and_then(Value::as_str) == Some(step))
    };
    match step {
        "last" => list.last(),
        _ => list
            .iter()
            .find(is_named)
            .or_else(|| list.get(step.parse::<usize>().ok()?)),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_path_goes_through_keys_names_and_places() {
        let figures = Figures::from_values(&[
            (
                "run_1",
                json!({"rows": [{"name": "rgb", "ms": 1.5, "list": [4, 5]}]}),
            ),
            (
                "run_2",
                json!({"rows": [{"name": "rgb", "ms": 2.5, "list": [6]}]}),
            ),
        ]);
        let mut used = BTreeSet::new();
        assert_eq!(
            figures.find("run_1/rgb/ms", &mut used).expect("there"),
            [&json!(1.5)]
        );
        assert_eq!(
            figures
                .find("run_?/rows/rgb/list/last", &mut used)
                .expect("there"),
            [&json!(5), &json!(6)]
        );
        assert_eq!(
            figures.find("run_1/0/ms", &mut used).expect("there"),
            [&json!(1.5)]
        );
        assert_eq!(used.len(), 2);
        for wrong in [
            "run_3/rgb/ms",
            "run_1/depth/ms",
            "run_1/rgb/ms/more",
            "run_2/rgb/list/1",
        ] {
            assert!(figures.find(wrong, &mut used).is_err(), "{wrong}");
        }
    }
}
