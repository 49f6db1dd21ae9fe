//! The folder of recordings within a limit: those that were not used for longest go first.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use super::hidden::MAKING;

/// Age after which a recording that was never finished is rubbish of a benchmark that was killed.
const UNFINISHED_AGE: Duration = Duration::from_secs(24 * 3600);

/// A recording that is kept.
#[derive(Debug)]
struct Kept {
    used: SystemTime,
    n_bytes: u64,
    /// The description, whose lock says that a benchmark uses the recording.
    described: PathBuf,
    recording: PathBuf,
}

/// Marks a recording as used from now on, for as long as the file is open.
///
/// # Errors
/// If the description cannot be opened or locked.
pub(super) fn use_it(described: &Path) -> std::io::Result<File> {
    let file = File::options().read(true).append(true).open(described)?;
    file.lock_shared()?;
    // Best effort: on a disk that is read only the order is that of making.
    let _ = file.set_modified(SystemTime::now());
    Ok(file)
}

/// Removes recordings that no benchmark uses, the one that was not used for longest first, until all
/// together have at most `limit_bytes`; and what killed benchmarks left unfinished. Returns how many
/// bytes are left.
pub(super) fn keep_below(cache: &Path, limit_bytes: u64) -> u64 {
    let mut all = Vec::new();
    for entry in fs::read_dir(cache).into_iter().flatten().flatten() {
        let path = entry.path();
        let name = entry.file_name();
        let Ok(about) = entry.metadata() else {
            continue;
        };
        let used = about.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        if about.is_dir() {
            let is_old = used.elapsed().is_ok_and(|age| age > UNFINISHED_AGE);
            if name.to_string_lossy().contains(MAKING) && is_old {
                let _ = fs::remove_dir_all(&path);
            }
            continue;
        }
        if path.extension().is_none_or(|ending| ending != "json") {
            continue;
        }
        let recording = path.with_extension("mcap");
        let of_recording = fs::metadata(&recording).map_or(0, |about| about.len());
        all.push(Kept {
            used,
            n_bytes: about.len() + of_recording,
            described: path,
            recording,
        });
    }
    let mut n_bytes: u64 = all.iter().map(|kept| kept.n_bytes).sum();
    all.sort_by(|a, b| (a.used, &a.described).cmp(&(b.used, &b.described)));
    for kept in all {
        if n_bytes <= limit_bytes {
            break;
        }
        let is_free = File::open(&kept.described).is_ok_and(|file| file.try_lock().is_ok());
        // Without its description a recording is not taken for whole.
        if is_free && fs::remove_file(&kept.described).is_ok() {
            let _ = fs::remove_file(&kept.recording);
            n_bytes = n_bytes.saturating_sub(kept.n_bytes);
            tracing::debug!(path = %kept.recording.display(), "left the cache, which is full");
        }
    }
    n_bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_one_that_was_not_used_for_longest_goes_first_and_one_in_use_stays() {
        let cache = tempfile::tempdir().unwrap();
        let path = |name: &str| cache.path().join(name);
        let hour = Duration::from_secs(3600);
        for (name, age) in [("a", 4), ("b", 3), ("c", 2), ("d", 1)] {
            fs::write(path(&format!("{name}.mcap")), vec![0; 98]).unwrap();
            fs::write(path(&format!("{name}.json")), "{}").unwrap();
            let file = File::options()
                .append(true)
                .open(path(&format!("{name}.json")));
            file.unwrap()
                .set_modified(SystemTime::now() - hour * age)
                .unwrap();
        }
        let left = || {
            let names = ["a", "b", "c", "d"];
            let is_there = |name: &&str| path(&format!("{name}.mcap")).exists();
            names.into_iter().filter(is_there).collect::<String>()
        };
        assert_eq!(
            (keep_below(cache.path(), 400), left().as_str()),
            (400, "abcd")
        );
        let used = use_it(&path("a.json")).unwrap();
        assert_eq!(
            (keep_below(cache.path(), 399), left().as_str()),
            (300, "acd")
        );
        assert_eq!((keep_below(cache.path(), 0), left().as_str()), (100, "a"));
        drop(used);
        assert_eq!((keep_below(cache.path(), 0), left().as_str()), (0, ""));
    }

    #[test]
    fn what_a_killed_benchmark_left_goes_after_a_day() {
        let cache = tempfile::tempdir().unwrap();
        for (name, age) in [("x-making-1", 25), ("y-making-2", 1)] {
            fs::create_dir(cache.path().join(name)).unwrap();
            let folder = File::open(cache.path().join(name)).unwrap();
            let age = Duration::from_secs(age * 3600);
            folder.set_modified(SystemTime::now() - age).unwrap();
        }
        keep_below(cache.path(), u64::MAX);
        let left = |name: &str| cache.path().join(name).exists();
        assert!(!left("x-making-1") && left("y-making-2"));
    }
}
