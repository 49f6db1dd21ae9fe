//! Tables for people, and durations on the command line.

use std::time::Duration;

use consumer_report::terminal::TextTable;

/// A table of lines, with a head for each column.
pub fn table(heads: &[&str], rows: &[Vec<String>]) -> String {
    TextTable::new(heads).rows(rows.iter().cloned()).text()
}

/// `500ms`, `20s`, `10m`, `1h`.
pub fn duration(text: &str) -> Result<Duration, String> {
    let wrong =
        || format!("{text:?} is no duration; write a number and ms, s, m or h, such as 20s");
    let digits = text
        .find(|c: char| !c.is_ascii_digit() && c != '.')
        .ok_or_else(wrong)?;
    let number: f64 = text[..digits].parse().map_err(|_| wrong())?;
    let unit_secs = match &text[digits..] {
        "ms" => 1e-3,
        "s" => 1.0,
        "m" => 60.0,
        "h" => 3600.0,
        _ => return Err(wrong()),
    };
    Duration::try_from_secs_f64(number * unit_secs)
        .ok()
        .filter(|d| !d.is_zero())
        .ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_read_and_nonsense_is_refused() {
        let secs = |text: &str| duration(text).map(|d| d.as_secs_f64());
        assert_eq!(
            [secs("500ms"), secs("20s"), secs("1.5m"), secs("1h")],
            [Ok(0.5), Ok(20.0), Ok(90.0), Ok(3600.0)]
        );
        for bad in [
            "",
            "20",
            "s",
            "-1s",
            "0s",
            "1e9s",
            "99999999999999999999h",
            "1 s",
            "..s",
        ] {
            assert!(duration(bad).is_err(), "{bad:?}");
        }
    }
}
