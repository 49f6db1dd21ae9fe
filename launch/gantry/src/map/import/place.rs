//! Puts a map into the map folder in one step.

use std::path::Path;

/// How a map came into the folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Placed {
    /// There was none of its name.
    New,
    /// It took the place of another text.
    Replaced,
    /// The same text was there already.
    Same,
}

impl Placed {
    /// One word for the report.
    pub fn word(self) -> &'static str {
        match self {
            Placed::New => "imported",
            Placed::Replaced => "replaced",
            Placed::Same => "unchanged",
        }
    }
}

/// Writes `text` as the map `name` of `folder`. With `dry` nothing is written.
///
/// # Errors
/// A sentence if another text has the name and `replace` is not set, or the folder cannot be
/// written.
pub(super) fn place(
    folder: &Path,
    name: &str,
    text: &str,
    replace: bool,
    dry: bool,
) -> Result<Placed, String> {
    let path = folder.join(format!("{name}.xodr"));
    let placed = match std::fs::read(&path) {
        Ok(there) if there == text.as_bytes() => return Ok(Placed::Same),
        Ok(_) if !replace => {
            return Err(format!(
                "{} has this name and other contents; --replace puts the new map in its place, --name gives the new map another name",
                path.display()
            ));
        }
        Ok(_) => Placed::Replaced,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Placed::New,
        Err(error) => return Err(format!("{} cannot be read: {error}", path.display())),
    };
    if dry {
        return Ok(placed);
    }
    launch_cli::files::replace(&path, text.as_bytes())
        .map(|()| placed)
        .map_err(|error| format!("{} cannot be written: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_takes_its_place_whole_and_another_only_if_asked() {
        let folder = tempfile::tempdir().unwrap();
        let put = |text: &str, replace| place(folder.path(), "Town01", text, replace, false);
        assert_eq!(put("one", false), Ok(Placed::New));
        assert_eq!(put("one", false), Ok(Placed::Same));
        assert!(put("two", false).unwrap_err().contains("--replace"));
        let there = || std::fs::read_to_string(folder.path().join("Town01.xodr")).unwrap();
        assert_eq!(there(), "one");
        assert_eq!(put("two", true), Ok(Placed::Replaced));
        assert_eq!(there(), "two");
        let names = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(names, 1, "nothing is left beside it");
    }
}
