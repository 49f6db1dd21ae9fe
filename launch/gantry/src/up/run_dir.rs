//! The folder of one run, `DATA/runs/<start>/`. It holds a log per process, the launch file with
//! all overrides and defaults, and what became of the processes for programs that watch them. Those
//! files of old runs are removed.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::Context as _;
use launch_run::NOTES;

/// Runs whose files are kept, the newest ones.
pub const MAX_KEPT_RUNS: usize = 50;
/// What the name of a run looks like, with 0 for any digit; `_` and a number may follow.
const NAME: &str = "0000-00-00T00-00-00";

/// The folder of a run that goes on.
pub struct RunDir {
    /// Where it is.
    pub path: PathBuf,
    /// Locked, so that no other run removes its files.
    _used: File,
}

/// Makes the folder, points `runs/latest` at it, and removes the files of the oldest runs.
pub fn make(data: Option<&Path>) -> anyhow::Result<RunDir> {
    let runs = launch_cli::data_dir(data)?.join("runs");
    std::fs::create_dir_all(&runs).with_context(|| {
        format!(
            "cannot make the folder {}; choose another with --data",
            runs.display()
        )
    })?;
    let start = utc(SystemTime::now()).replace(':', "-");
    let start = start.split('.').next().unwrap_or_default();
    for attempt in 0..1000 {
        let name = if attempt == 0 {
            start.to_owned()
        } else {
            format!("{start}_{attempt}")
        };
        let folder = runs.join(&name);
        match std::fs::create_dir(&folder) {
            Ok(()) => {
                point_latest(&runs, &name);
                let used = File::open(&folder).and_then(|used| {
                    used.lock()?;
                    Ok(used)
                });
                let used = used.with_context(|| format!("cannot lock {}", folder.display()))?;
                prune(&runs);
                return Ok(RunDir {
                    path: folder,
                    _used: used,
                });
            }
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(error) => {
                return Err(error).with_context(|| {
                    format!(
                        "cannot make the folder {}; choose another with --data",
                        folder.display()
                    )
                });
            }
        }
    }
    anyhow::bail!("{} already holds 1000 runs of this second", runs.display())
}

/// Points `runs/latest` at the folder. Errors are ignored, because a run does not depend on it.
fn point_latest(runs: &Path, name: &str) {
    let latest = runs.join("latest");
    let _ = std::fs::remove_file(&latest);
    let _ = std::os::unix::fs::symlink(name, latest);
}

/// Removes the launcher's files of all runs but the newest, and their folders if nothing else is in
/// them. A run does not depend on it, so errors are ignored.
fn prune(runs: &Path) {
    let Ok(entries) = std::fs::read_dir(runs) else {
        return;
    };
    let names = entries.flatten().map(|entry| entry.file_name());
    let mut all: Vec<(String, u32)> = names.filter_map(|name| order_of(name.to_str()?)).collect();
    all.sort_unstable();
    let n_old = all.len().saturating_sub(MAX_KEPT_RUNS);
    for (start, attempt) in &all[..n_old] {
        let folder = match attempt {
            0 => runs.join(start),
            _ => runs.join(format!("{start}_{attempt}")),
        };
        // A run that goes on has locked its folder.
        let is_over = File::open(&folder).is_ok_and(|used| used.try_lock().is_ok());
        if is_over {
            remove_own(&folder);
        }
    }
}

/// When a run began, and which one of that second it is; `None` if this is the name of none.
fn order_of(name: &str) -> Option<(String, u32)> {
    let (start, attempt) = match name.split_once('_') {
        Some((start, attempt)) => (start, attempt.parse().ok().filter(|n| *n > 0)?),
        None => (name, 0),
    };
    let plain: String = start
        .chars()
        .map(|c| if c.is_ascii_digit() { '0' } else { c })
        .collect();
    (plain == NAME).then(|| (start.to_owned(), attempt))
}

/// Removes what the launcher wrote into a folder; recordings that users put there stay.
fn remove_own(folder: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let is_own = name.to_str().is_some_and(|name| {
            [".log", ".log.1", ".params.json"]
                .iter()
                .any(|end| name.ends_with(end))
                || ["launch.toml", NOTES].contains(&name)
        });
        if is_own {
            let _ = std::fs::remove_file(entry.path());
        }
    }
    // Fails while something else is in it.
    let _ = std::fs::remove_dir(folder);
}

/// `2026-01-31T23:59:59.123` of a time, UTC.
pub fn utc(time: SystemTime) -> String {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO);
    let (secs, millis) = (since.as_secs(), since.subsec_millis());
    let (year, month, day) = civil((secs / 86_400) as i64);
    let (hour, minute, second) = (secs / 3600 % 24, secs / 60 % 60, secs % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{millis:03}")
}

/// Year, month and day of a day count from 1970-01-01 in the Gregorian calendar, by whole 400-year
/// cycles that begin in March.
fn civil(days: i64) -> (i64, i64, i64) {
    let days = days + 719_468;
    let cycle = days.div_euclid(146_097);
    let day_of_cycle = days.rem_euclid(146_097);
    let year_of_cycle = (day_of_cycle - day_of_cycle / 1_460 + day_of_cycle / 36_524
        - day_of_cycle / 146_096)
        / 365;
    let day_of_year =
        day_of_cycle - (365 * year_of_cycle + year_of_cycle / 4 - year_of_cycle / 100);
    let march_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * march_month + 2) / 5 + 1;
    let month = if march_month < 10 {
        march_month + 3
    } else {
        march_month - 9
    };
    (
        cycle * 400 + year_of_cycle + i64::from(month <= 2),
        month,
        day,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_count_leap_years() {
        let at = |secs: u64| utc(UNIX_EPOCH + Duration::from_secs(secs));
        assert_eq!(at(0), "1970-01-01T00:00:00.000");
        assert_eq!(at(951_782_400), "2000-02-29T00:00:00.000");
        assert_eq!(at(1_709_251_199), "2024-02-29T23:59:59.000");
        assert_eq!(at(4_107_542_400), "2100-03-01T00:00:00.000");
    }

    #[test]
    fn two_runs_of_one_second_have_two_folders() {
        let data = tempfile::tempdir().unwrap();
        let (a, b) = (
            make(Some(data.path())).unwrap(),
            make(Some(data.path())).unwrap(),
        );
        assert_ne!(a.path, b.path);
        assert_eq!(
            data.path().join("runs/latest").canonicalize().unwrap(),
            b.path.canonicalize().unwrap()
        );
    }

    #[test]
    fn only_the_newest_runs_are_kept_and_those_that_go_on_and_what_users_put_there() {
        let data = tempfile::tempdir().unwrap();
        let runs = data.path().join("runs");
        let old = |name: &str| {
            let folder = runs.join(name);
            std::fs::create_dir_all(&folder).unwrap();
            for file in [
                "world.log",
                "world.log.1",
                "launch.toml",
                NOTES,
                "a.params.json",
            ] {
                std::fs::write(folder.join(file), "x").unwrap();
            }
            folder
        };
        let with_recording = old("2020-01-01T00-00-00");
        std::fs::write(with_recording.join("drive.mcap"), "x").unwrap();
        let running = old("2020-01-01T00-00-01");
        let lock = File::open(&running).unwrap();
        lock.lock().unwrap();
        let gone = [
            "2020-01-01T00-00-02",
            "2020-01-01T00-00-02_9",
            "2020-01-01T00-00-02_10",
        ]
        .map(old);
        let foreign = old("mine");
        let kept: Vec<PathBuf> = (0..MAX_KEPT_RUNS - 1)
            .map(|n| old(&format!("2021-01-01T00-00-{n:02}")))
            .collect();
        let now = make(Some(data.path())).unwrap();
        assert!(gone.iter().all(|folder| !folder.exists()));
        let left = |folder: &Path| std::fs::read_dir(folder).unwrap().count();
        assert_eq!(
            (left(&with_recording), left(&running), left(&foreign)),
            (1, 5, 5)
        );
        assert!(kept.iter().all(|folder| left(folder) == 5) && now.path.exists());
    }
}
