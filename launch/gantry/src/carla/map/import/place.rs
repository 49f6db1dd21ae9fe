//! Puts a map into the map folder in one step.

use std::path::Path;

use schema_roads::MAX_TEXT_BYTES;

use crate::carla::map::refusal::Refusal;
use crate::cli::ImportArgs;

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

/// How to put maps into the folder.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wishes {
    /// Whether to take the place of another text.
    pub replaces: bool,
    /// Whether to look only, and write nothing.
    pub is_dry: bool,
}

impl Wishes {
    /// What the command line says.
    pub fn of(args: &ImportArgs) -> Wishes {
        Wishes {
            replaces: args.replace,
            is_dry: args.dry_run,
        }
    }
}

/// Writes `text` as the map `name` of `folder`.
///
/// # Errors
/// If another text has the name and must not be replaced, or the folder cannot be written.
pub(super) fn place(
    folder: &Path,
    name: &str,
    text: &str,
    wishes: Wishes,
) -> Result<Placed, Refusal> {
    let path = folder.join(format!("{name}.xodr"));
    let placed = match launch_cli::files::read_plain(&path, MAX_TEXT_BYTES as u64) {
        Ok(there) if there == text.as_bytes() => return Ok(Placed::Same),
        Ok(_) if !wishes.replaces => {
            return Err(Refusal::NameTaken { path });
        }
        Ok(_) => Placed::Replaced,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Placed::New,
        Err(error) => return Err(Refusal::PlaceUnreadable { path, error }),
    };
    if wishes.is_dry {
        return Ok(placed);
    }
    match launch_cli::files::replace(&path, text.as_bytes()) {
        Ok(()) => Ok(placed),
        Err(error) => Err(Refusal::PlaceUnwritable { path, error }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_takes_its_place_whole_and_another_only_if_asked() {
        let folder = tempfile::tempdir().unwrap();
        let put = |text: &str, replaces| {
            let is_dry = false;
            place(folder.path(), "Town01", text, Wishes { replaces, is_dry })
        };
        assert_eq!(put("one", false).unwrap(), Placed::New);
        assert_eq!(put("one", false).unwrap(), Placed::Same);
        let refusal = put("two", false).unwrap_err().to_string();
        assert!(refusal.contains("--replace"), "{refusal}");
        let there = || std::fs::read_to_string(folder.path().join("Town01.xodr")).unwrap();
        assert_eq!(there(), "one");
        assert_eq!(put("two", true).unwrap(), Placed::Replaced);
        assert_eq!(there(), "two");
        let names = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(names, 1, "nothing is left beside it");
    }
}
