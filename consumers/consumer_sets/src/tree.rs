//! The folder that an export writes: whole files only, so that a killed export can go on.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use launch_cli::files::{open_plain, read_plain};

/// Folder inside the export that holds its state while it runs.
pub const STATE_FOLDER: &str = ".gantry-export";
/// Ending of files that are not finished.
const PART: &str = ".part";

/// The folder of an export. Paths given to it are relative, with `/` between segments; folders are
/// made as needed. A file appears under its name when it is complete and is never changed then.
#[derive(Debug)]
pub struct Tree {
    root: PathBuf,
}

impl Tree {
    /// The tree at `root`, which exists.
    pub fn new(root: PathBuf) -> Tree {
        Tree { root }
    }

    /// Full path of a file or folder of the tree.
    pub fn path(&self, relative: &str) -> PathBuf {
        self.root.join(relative)
    }

    /// Writes a file from the bytes that `make` returns, unless it is there already.
    ///
    /// # Errors
    /// What `make` returns, or a sentence with the path if the disk refuses.
    pub fn write(
        &self,
        relative: &str,
        make: impl FnOnce() -> anyhow::Result<Vec<u8>>,
    ) -> anyhow::Result<()> {
        if self.path(relative).exists() {
            return Ok(());
        }
        let bytes = make()?;
        let mut part = self.begin(relative)?;
        part.write_all(&bytes).with_context(|| cannot(&part.path))?;
        part.finish()
    }

    /// Writes several files at once, each as [`Tree::write`] does; encoders run on all processors.
    ///
    /// # Errors
    /// The first of them.
    pub fn write_all(&self, jobs: Vec<Job<'_>>) -> anyhow::Result<()> {
        use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};
        jobs.into_par_iter()
            .map(|job| self.write(&job.path, job.make))
            .collect()
    }

    /// Begins a file that grows over many ticks; it appears at [`PartFile::finish`]. What an earlier
    /// run left of it is dropped.
    ///
    /// # Errors
    /// A sentence with the path.
    pub fn begin(&self, relative: &str) -> anyhow::Result<PartFile> {
        let path = self.path(relative);
        let folder = path.parent().unwrap_or(&self.root);
        fs::create_dir_all(folder).with_context(|| cannot(folder))?;
        let mut part = path.clone().into_os_string();
        part.push(PART);
        let part = PathBuf::from(part);
        let file = File::create(&part).with_context(|| cannot(&part))?;
        Ok(PartFile {
            file: BufWriter::with_capacity(1 << 16, file),
            part,
            path,
        })
    }

    /// Makes `relative` another name of the file `of`, or a copy where the disk has no such names;
    /// nothing if it is there already.
    ///
    /// # Errors
    /// A sentence with the path.
    pub fn link(&self, of: &str, relative: &str) -> anyhow::Result<()> {
        let (from, to) = (self.path(of), self.path(relative));
        if to.exists() {
            return Ok(());
        }
        let folder = to.parent().unwrap_or(&self.root);
        fs::create_dir_all(folder).with_context(|| cannot(folder))?;
        if fs::hard_link(&from, &to).is_ok() {
            return Ok(());
        }
        self.write(relative, || {
            read_plain(&from, u64::MAX).with_context(|| cannot(&from))
        })
    }

    /// Calls `each` with every line of a file of the tree; one line is in memory at a time.
    ///
    /// # Errors
    /// What `each` returns, or a sentence with the path.
    pub fn each_line(
        &self,
        relative: &str,
        each: &mut dyn FnMut(&str) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        use std::io::BufRead as _;
        let path = self.path(relative);
        let cannot = || format!("cannot read {}", path.display());
        let (file, _) = open_plain(&path).with_context(cannot)?;
        for line in std::io::BufReader::new(file).lines() {
            each(&line.with_context(cannot)?)?;
        }
        Ok(())
    }

    /// A file of the export's state, which is gone once the export is complete: lines that scenarios
    /// leave for [`crate::exporter::Exporter::finish`].
    pub fn state(name: &str) -> String {
        format!("{STATE_FOLDER}/{name}")
    }
}

/// A file to write: its path and what makes its bytes.
pub struct Job<'a> {
    path: String,
    make: Box<dyn FnOnce() -> anyhow::Result<Vec<u8>> + Send + 'a>,
}

impl<'a> Job<'a> {
    /// A file at `path` whose bytes `make` returns.
    pub fn new(
        path: impl Into<String>,
        make: impl FnOnce() -> anyhow::Result<Vec<u8>> + Send + 'a,
    ) -> Job<'a> {
        Job {
            path: path.into(),
            make: Box::new(make),
        }
    }
}

/// A file that grows. It vanishes if it is dropped before [`PartFile::finish`].
#[derive(Debug)]
pub struct PartFile {
    file: BufWriter<File>,
    part: PathBuf,
    path: PathBuf,
}

impl PartFile {
    /// The file is complete: gives it its name.
    ///
    /// # Errors
    /// A sentence with the path.
    pub fn finish(mut self) -> anyhow::Result<()> {
        self.file
            .flush()
            // An export that goes on after a loss of power takes what has its name as whole.
            .and_then(|()| self.file.get_ref().sync_data())
            .with_context(|| cannot(&self.path))?;
        fs::rename(&self.part, &self.path).with_context(|| cannot(&self.path))
    }

    /// Path of the unfinished file, for libraries that open files themselves.
    pub fn part_path(&self) -> &Path {
        &self.part
    }
}

impl Write for PartFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

impl std::io::Seek for PartFile {
    fn seek(&mut self, to: std::io::SeekFrom) -> std::io::Result<u64> {
        self.file.seek(to)
    }
}

impl Drop for PartFile {
    fn drop(&mut self) {
        // After a finish there is no such file any more.
        let _ = fs::remove_file(&self.part);
    }
}

fn cannot(path: &Path) -> String {
    format!("cannot write {}", path.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_appears_whole_or_not_at_all_and_is_made_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let tree = Tree::new(folder.path().to_owned());
        let mut part = tree.begin("a/b.txt").expect("a file");
        part.write_all(b"half").expect("room");
        assert!(!tree.path("a/b.txt").exists());
        drop(part);
        assert_eq!(fs::read_dir(tree.path("a")).expect("a folder").count(), 0);
        tree.write("a/b.txt", || Ok(b"whole".to_vec()))
            .expect("room");
        tree.write("a/b.txt", || panic!("it is there"))
            .expect("nothing to do");
        tree.link("a/b.txt", "c.txt").expect("a name");
        assert_eq!(fs::read(tree.path("c.txt")).expect("a file"), b"whole");
        assert!(tree.write("c.txt/d", || Ok(vec![])).is_err());
    }
}
