//! The folder of a report: the files that are written into it, and their names.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::hgrm;
use crate::spread::Spread;
use crate::times::HistogramError;

/// Why a file of a report cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// The folder cannot be made.
    #[error("cannot make the folder {}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// The file cannot be written.
    #[error("cannot write {}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// A value is no JSON.
    #[error("cannot write {} as JSON", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        #[source]
        source: serde_json::Error,
    },
    /// A distribution cannot be read.
    #[error(transparent)]
    Histogram(#[from] HistogramError),
}

/// A folder that a report is written into.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    written: Vec<PathBuf>,
}

impl Folder {
    /// The folder at `path`, made if it is not there.
    ///
    /// # Errors
    ///
    /// It cannot be made.
    pub fn make(path: &Path) -> Result<Folder, FolderError> {
        make(path)?;
        Ok(Folder {
            path: path.to_owned(),
            written: Vec::new(),
        })
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a text; `name` may lie in a folder below, which is made.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn text(&mut self, name: &str, text: &str) -> Result<(), FolderError> {
        let path = self.path.join(name);
        make(path.parent().unwrap_or(&self.path))?;
        std::fs::write(&path, text).map_err(|source| FolderError::File {
            path: path.clone(),
            source,
        })?;
        self.written.push(path);
        Ok(())
    }

    /// Writes a value as JSON, with a line for each field.
    ///
    /// # Errors
    ///
    /// The file cannot be written, or the value is no JSON.
    pub fn json(&mut self, name: &str, value: &impl Serialize) -> Result<(), FolderError> {
        let text = serde_json::to_string_pretty(value).map_err(|source| self.no_json(name, source));
        self.text(name, &(text? + "\n"))
    }

    /// Writes a value as JSON in one line, without holding the text.
    ///
    /// # Errors
    ///
    /// See [`Folder::json`].
    pub fn json_line(&mut self, name: &str, value: &impl Serialize) -> Result<(), FolderError> {
        let path = self.path.join(name);
        make(path.parent().unwrap_or(&self.path))?;
        let failed = |source| FolderError::File {
            path: path.clone(),
            source,
        };
        let mut file = BufWriter::new(File::create(&path).map_err(failed)?);
        serde_json::to_writer(&mut file, value).map_err(|source| self.no_json(name, source))?;
        file.write_all(b"\n").map_err(failed)?;
        file.flush().map_err(failed)?;
        self.written.push(path);
        Ok(())
    }

    /// Writes the percentiles of a distribution; nothing if it is empty.
    ///
    /// # Errors
    ///
    /// The file cannot be written, or the distribution cannot be read.
    pub fn percentiles(&mut self, name: &str, spread: &Spread) -> Result<(), FolderError> {
        if spread.n == 0 || spread.histogram.is_empty() {
            return Ok(());
        }
        self.text(name, &hgrm::text(&spread.decode()?))
    }

    /// The files that were written, in their order.
    pub fn into_written(self) -> Vec<PathBuf> {
        self.written
    }

    fn no_json(&self, name: &str, source: serde_json::Error) -> FolderError {
        FolderError::Json {
            path: self.path.join(name),
            source,
        }
    }
}

fn make(path: &Path) -> Result<(), FolderError> {
    std::fs::create_dir_all(path).map_err(|source| FolderError::Folder {
        path: path.to_owned(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_written_in_order_and_a_file_in_the_way_is_named() {
        let place = tempfile::tempdir().unwrap();
        let mut folder = Folder::make(&place.path().join("a")).unwrap();
        folder.json("b/one.json", &[1, 2]).unwrap();
        folder.json_line("two.json", &[1, 2]).unwrap();
        folder.percentiles("none.hgrm", &Spread::default()).unwrap();
        folder.percentiles("c/s.hgrm", &Spread::of([1])).unwrap();
        let read = |name: &str| std::fs::read_to_string(place.path().join("a").join(name)).unwrap();
        assert_eq!(read("b/one.json"), "[\n  1,\n  2\n]\n");
        assert_eq!(read("two.json"), "[1,2]\n");
        assert!(read("c/s.hgrm").contains("Percentile"));
        let said = folder.text("two.json/x", "").unwrap_err().to_string();
        assert!(said.contains("cannot make the folder"), "{said}");
        assert_eq!(folder.into_written().len(), 3);
    }
}
