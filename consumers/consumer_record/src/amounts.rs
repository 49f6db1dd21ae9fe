//! Sizes and times as people write them: `1GB`, `500MB`, `60s`, `1.5m`.

/// A text that is no amount, and what is one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BadAmount {
    /// No size.
    #[error("{0:?} is no size; write e.g. 500MB, 1GB or 2GiB")]
    Size(String),
    /// No time.
    #[error("{0:?} is no time; write e.g. 30s, 1.5m or 250ms")]
    Time(String),
}

/// Bytes of `1GB`, `500MB`, `2GiB`, `4096`.
///
/// # Errors
/// [`BadAmount::Size`].
pub fn parse_size(text: &str) -> Result<u64, BadAmount> {
    let units = [
        ("GiB", 1u64 << 30),
        ("MiB", 1 << 20),
        ("KiB", 1 << 10),
        ("GB", 1_000_000_000),
        ("MB", 1_000_000),
        ("kB", 1_000),
        ("B", 1),
        ("", 1),
    ];
    scaled(text, &units).ok_or_else(|| BadAmount::Size(text.into()))
}

/// Nanoseconds of `60s`, `2m`, `1h`, `250ms`, `1.5s`; without a unit seconds.
///
/// # Errors
/// [`BadAmount::Time`].
pub fn parse_nanos(text: &str) -> Result<u64, BadAmount> {
    let units = [
        ("ms", 1_000_000),
        ("s", 1_000_000_000),
        ("m", 60_000_000_000),
        ("h", 3_600_000_000_000),
        ("", 1_000_000_000),
    ];
    scaled(text, &units).ok_or_else(|| BadAmount::Time(text.into()))
}

/// The number in front of the first unit that `text` ends with, times the unit; more than nothing.
fn scaled(text: &str, units: &[(&str, u64)]) -> Option<u64> {
    let text = text.trim();
    let (number, unit) = units
        .iter()
        .find_map(|(name, unit)| Some((text.strip_suffix(name)?, *unit)))?;
    let amount: f64 = number.trim().parse().ok()?;
    let scaled = amount * unit as f64;
    (1.0..9e18).contains(&scaled).then_some(scaled as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_times_are_read_as_people_write_them() {
        assert_eq!(parse_size("1GB"), Ok(1_000_000_000));
        assert_eq!(parse_size("2 MiB"), Ok(2 << 20));
        assert_eq!(parse_size("4096"), Ok(4096));
        assert_eq!(parse_nanos("30s"), Ok(30_000_000_000));
        assert_eq!(parse_nanos("1.5m"), Ok(90_000_000_000));
        assert_eq!(parse_nanos("250ms"), Ok(250_000_000));
        assert_eq!(parse_nanos("2"), Ok(2_000_000_000));
        for wrong in ["", "GB", "-1GB", "0s", "NaN", "1e30s", "10 parsecs"] {
            assert!(parse_size(wrong).is_err(), "{wrong}");
            assert!(parse_nanos(wrong).is_err(), "{wrong}");
        }
    }
}
