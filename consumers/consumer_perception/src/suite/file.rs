//! Files of suites: read, turned into tables, and refused with their name.

use std::path::{Path, PathBuf};

use launch_cli::files::{MAX_SETTINGS_BYTES, read_text};
use launch_cli::wrong_usage;
use serde::de::DeserializeOwned;

use super::fault::SuiteFault;

/// Version of all suites that this build reads.
pub const SUITE_VERSION: u32 = 1;

/// A suite's file.
#[derive(Clone, Debug)]
pub struct SuiteFile {
    path: PathBuf,
    /// Its text.
    pub text: String,
}

impl SuiteFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`wrong_usage`] if it cannot be read.
    pub fn read(path: &Path) -> anyhow::Result<SuiteFile> {
        let text = read_text(path, MAX_SETTINGS_BYTES).map_err(|error| {
            wrong_usage(format!("cannot read the suite {}: {error}", path.display()))
        })?;
        Ok(SuiteFile {
            path: path.to_owned(),
            text,
        })
    }

    /// The name of a suite that says none.
    pub fn stem(&self) -> String {
        let stem = self.path.file_stem().unwrap_or_default();
        stem.to_string_lossy().into_owned()
    }

    /// The folder in which relative paths of the suite begin, as the file was named.
    pub fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// The error for mistakes in this file.
    pub fn refused(&self, faults: &[SuiteFault]) -> anyhow::Error {
        let faults: Vec<String> = faults.iter().map(SuiteFault::to_string).collect();
        wrong_usage(format!("{}: {}", self.path.display(), faults.join("; ")))
    }
}

/// The tables of a suite; keys that the type does not have are a mistake.
///
/// # Errors
/// The place and the mistake, as TOML's reader says them.
pub fn tables<T: DeserializeOwned>(text: &str) -> Result<T, SuiteFault> {
    toml::from_str(text).map_err(|error| error.to_string().trim_end().into())
}

/// Checks the version that a suite names.
///
/// # Errors
/// It is another than [`SUITE_VERSION`].
pub fn check_version(version: u32) -> Result<(), SuiteFault> {
    match version {
        SUITE_VERSION => Ok(()),
        other => Err(format!("version is {other}, this build reads {SUITE_VERSION}").into()),
    }
}
