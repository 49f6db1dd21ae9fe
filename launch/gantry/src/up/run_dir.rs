//! The folder of one run, `DATA/runs/<start>/`. It holds a log per process, the launch file with
//! all overrides and defaults, and what became of the processes for programs that watch them.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::Context as _;

/// Makes the folder and points `runs/latest` at it.
pub fn make(data: Option<&Path>) -> anyhow::Result<PathBuf> {
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
                return Ok(folder);
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
        assert_ne!(a, b);
        assert_eq!(
            data.path().join("runs/latest").canonicalize().unwrap(),
            b.canonicalize().unwrap()
        );
    }
}
