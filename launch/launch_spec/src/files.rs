//! The texts of a launch: files with what they include, and `--set`, laid over one another.

use std::io;
use std::path::{Path, PathBuf};

use schema_types::files::{MAX_SETTINGS_BYTES, read_text};
use toml::Value as Toml;

use crate::error::{Errors, LaunchError, LaunchErrors, Place, Source};
use crate::tree::{Entry, Laying, Table, read, set_as_toml};

/// Version of the launch file format.
pub(crate) const VERSION: i64 = 1;

/// What a caller of [`crate::Launch::load`] read from a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileText {
    /// The file's one true path: two names of one file have the same.
    pub identity: PathBuf,
    /// Folder in which its relative paths begin, absolute.
    pub folder: PathBuf,
    /// The text.
    pub text: String,
}

impl FileText {
    /// Reads a file. Nothing else in this crate touches the disk.
    ///
    /// # Errors
    /// If it cannot be read, or is no UTF-8.
    pub fn read(path: &Path) -> io::Result<FileText> {
        let text = read_text(path, MAX_SETTINGS_BYTES)?;
        let absolute = std::path::absolute(path)?;
        Ok(FileText {
            identity: path.canonicalize()?,
            folder: absolute.parent().unwrap_or(&absolute).to_owned(),
            text,
        })
    }
}

/// Reads a file for [`crate::Launch::load`]: [`FileText::read`], or a test's own.
pub type ReadFile<'r> = dyn FnMut(&Path) -> io::Result<FileText> + 'r;

/// Texts that were read, and what they say together.
pub(crate) struct Texts<'r> {
    /// All texts in the order in which they were found; a [`Place`] counts them so.
    pub sources: Vec<Source>,
    /// The texts laid over one another.
    pub tree: Table,
    pub errors: Errors,
    /// Errors of texts that have no place.
    pub outside: Vec<LaunchError>,
    /// Whether a text is missing, so that checking the others would report what it may well hold.
    pub is_broken: bool,
    read_file: &'r mut ReadFile<'r>,
    identities: Vec<PathBuf>,
    /// The file that is being read, behind those that include it.
    chain: Vec<(PathBuf, String)>,
    n_laid: usize,
}

impl<'r> Texts<'r> {
    pub fn new(read_file: &'r mut ReadFile<'r>) -> Self {
        Texts {
            sources: Vec::new(),
            tree: Table::new(),
            errors: Errors::default(),
            outside: Vec::new(),
            is_broken: false,
            read_file,
            identities: Vec::new(),
            chain: Vec::new(),
            n_laid: 0,
        }
    }

    /// Reads a file that the command line names.
    pub fn add_file(&mut self, path: &Path) {
        match (self.read_file)(path) {
            Ok(file) => self.lay_file(path, file),
            Err(error) => {
                self.is_broken = true;
                self.outside.push(LaunchError {
                    message: format!("cannot read the launch file {}: {error}", path.display()),
                    place: "the command line".into(),
                });
            }
        }
    }

    /// Lays a file over what was read before, behind the files that it includes. A file that was
    /// read already is not read again.
    pub fn lay_file(&mut self, path: &Path, file: FileText) {
        if self.identities.contains(&file.identity) {
            return;
        }
        let name = path.display().to_string();
        self.identities.push(file.identity.clone());
        self.chain.push((file.identity, name.clone()));
        let idx = self.sources.len();
        let tree = read(&file.text, idx, &mut self.errors);
        self.sources.push(Source {
            name,
            text: file.text,
            is_file: true,
            folder: file.folder,
            rank: 0,
        });
        if let Some(mut tree) = tree {
            check_version(&tree, idx, &mut self.errors);
            if let Some(include) = tree.remove("include") {
                self.include(path, &include);
            }
            self.lay(idx, tree);
        } else {
            self.is_broken = true;
        }
        self.chain.pop();
    }

    fn include(&mut self, from: &Path, include: &Entry) {
        let value = include.node.plain();
        let files: Option<Vec<&str>> = value
            .as_array()
            .and_then(|list| list.iter().map(Toml::as_str).collect());
        let Some(files) = files else {
            let message =
                format!("include is {value}, but must be a list of files, e.g. [\"base.toml\"]");
            self.errors.push(include.node.at, message);
            return;
        };
        for file in files {
            self.include_one(from, file, include.node.at);
        }
    }

    fn include_one(&mut self, from: &Path, file: &str, at: Place) {
        let path = from.parent().unwrap_or(Path::new("")).join(file);
        let found = match (self.read_file)(&path) {
            Ok(found) => found,
            Err(error) => {
                self.is_broken = true;
                let message = format!(
                    "include names {file:?}, but {} cannot be read: {error}",
                    path.display()
                );
                return self.errors.push(at, message);
            }
        };
        let first = self
            .chain
            .iter()
            .position(|(identity, _)| *identity == found.identity);
        if let Some(first) = first {
            self.is_broken = true;
            let names: Vec<&str> = self.chain[first..]
                .iter()
                .map(|(_, name)| name.as_str())
                .chain([self.chain[first].1.as_str()])
                .collect();
            let message = format!(
                "include goes in a circle: {}; take one of them out",
                names.join(" → ")
            );
            return self.errors.push(at, message);
        }
        self.lay_file(&path, found);
    }

    /// The text of a file that is no launch file.
    pub fn read(&mut self, path: &Path) -> io::Result<String> {
        (self.read_file)(path).map(|file| file.text)
    }

    /// Takes note of a text that is laid beneath others; returns its number.
    pub fn add_source(&mut self, name: &str, text: String) -> usize {
        self.sources.push(Source {
            name: name.to_owned(),
            text,
            is_file: true,
            folder: PathBuf::new(),
            rank: self.n_laid,
        });
        self.sources.len() - 1
    }

    /// Lays one `key=value` over the files.
    pub fn add_set(&mut self, set: &str, folder: &Path) {
        let text = match set_as_toml(set) {
            Ok(text) => text,
            Err(error) => {
                return self.outside.push(LaunchError {
                    message: error.to_string(),
                    place: "the command line".into(),
                });
            }
        };
        let idx = self.sources.len();
        let tree = read(&text, idx, &mut self.errors);
        self.sources.push(Source {
            name: format!("--set {set}"),
            text,
            is_file: false,
            folder: folder.to_owned(),
            rank: 0,
        });
        let Some(mut tree) = tree else {
            self.is_broken = true;
            return;
        };
        if tree.contains_key("version") {
            check_version(&tree, idx, &mut self.errors);
        }
        if let Some(include) = tree.remove("include") {
            let message = "include can only stand in a file; name the file on the command line";
            self.errors.push(include.key_at, message);
        }
        self.lay(idx, tree);
    }

    fn lay(&mut self, idx: usize, tree: Table) {
        self.sources[idx].rank = self.n_laid;
        self.n_laid += 1;
        let mut laying = Laying {
            errors: &mut self.errors,
            is_file: self.sources[idx].is_file,
        };
        laying.lay(&mut self.tree, tree);
    }

    /// Everything that is wrong, sorted by place.
    pub fn finish(self) -> LaunchErrors {
        let mut all = self.errors.finish(&self.sources).0;
        all.extend(self.outside);
        LaunchErrors(all)
    }
}

/// Every file says for itself which version it is written in.
fn check_version(file: &Table, source: usize, errors: &mut Errors) {
    match file.get("version") {
        None => errors.push(
            Place { source, byte: 0 },
            format!("version is missing; begin the file with version = {VERSION}"),
        ),
        Some(entry) if entry.node.plain() == Toml::Integer(VERSION) => {}
        Some(entry) => errors.push(
            entry.node.at,
            format!(
                "version is {}, but this program reads {VERSION}",
                entry.node.plain()
            ),
        ),
    }
}
