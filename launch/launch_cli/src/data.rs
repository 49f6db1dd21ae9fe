//! The data folder, in which programs keep logs, recordings and checkpoints.

use std::path::{Path, PathBuf};

use anyhow::Context as _;

use crate::logging::cut;

/// Longest file name that a client may choose, bytes.
const MAX_NAME: usize = 100;

/// The folder given with `--data`, else `gantry/` in the user's XDG data folder.
///
/// # Errors
/// If neither `XDG_DATA_HOME` nor `HOME` is set.
pub fn data_dir(data: Option<&Path>) -> anyhow::Result<PathBuf> {
    if let Some(data) = data {
        return Ok(data.to_owned());
    }
    let from = |name: &str| {
        std::env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    let xdg = from("XDG_DATA_HOME").or_else(|| Some(from("HOME")?.join(".local/share")));
    Ok(xdg
        .context("neither XDG_DATA_HOME nor HOME is set; give a folder with --data")?
        .join("gantry"))
}

/// A file name that a client chose and that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadFileName(String);

impl std::fmt::Display for BadFileName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "file name {:?} cannot be used: give 1 to {MAX_NAME} letters, digits, '_', '-' or dots, none of them in front",
            cut(&self.0)
        )
    }
}

impl std::error::Error for BadFileName {}

/// The path of a file in `folder` under a name that a client chose. `.kind` is appended if it is
/// missing. No name leads out of the folder.
///
/// # Errors
/// [`BadFileName`] for a name that is not a plain one.
pub fn file_in(folder: &Path, name: &str, kind: &str) -> Result<PathBuf, BadFileName> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    if name.is_empty()
        || name.len() > MAX_NAME
        || name.starts_with('.')
        || !name.chars().all(allowed)
    {
        return Err(BadFileName(name.to_owned()));
    }
    let ending = format!(".{kind}");
    Ok(folder.join(if name.ends_with(&ending) {
        name.to_owned()
    } else {
        format!("{name}{ending}")
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_leads_out_of_the_folder() {
        let folder = Path::new("data/checkpoints");
        assert_eq!(
            file_in(folder, "rush_hour", "gckp").unwrap(),
            folder.join("rush_hour.gckp")
        );
        assert_eq!(
            file_in(folder, "rush.hour.gckp", "gckp").unwrap(),
            folder.join("rush.hour.gckp")
        );
        for name in [
            "",
            "..",
            "../x",
            "a/b",
            "/etc/passwd",
            ".hidden",
            "a\\b",
            "a\0b",
            "ä",
            &"x".repeat(101),
        ] {
            assert!(file_in(folder, name, "gckp").is_err(), "{name:?}");
        }
    }
}
