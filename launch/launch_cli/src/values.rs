//! Values of command lines that several programs read: numbers between bounds, sizes, and lengths of
//! time.

use std::ops::RangeInclusive;
use std::time::Duration;

/// Why a text is no such value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} is no {what}; say {allowed}")]
pub struct WrongValue {
    text: String,
    what: &'static str,
    allowed: String,
}

impl WrongValue {
    /// The sentence of a `text` that is no `what`, with what is allowed.
    pub fn new(text: &str, what: &'static str, allowed: impl Into<String>) -> WrongValue {
        WrongValue {
            text: text.to_owned(),
            what,
            allowed: allowed.into(),
        }
    }
}

/// A parser of numbers from one bound to the other, both of which are allowed.
///
/// ```
/// let percent = launch_cli::values::number("share in percent", 0.0..=100.0);
/// assert_eq!(percent("12.5"), Ok(12.5));
/// assert_eq!(
///     percent("200").unwrap_err().to_string(),
///     "\"200\" is no share in percent; say 0 to 100"
/// );
/// ```
pub fn number(
    what: &'static str,
    range: RangeInclusive<f64>,
) -> impl Fn(&str) -> Result<f64, WrongValue> + Clone + Send + Sync {
    move |text| {
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| {
            let allowed = format!("{} to {}", range.start(), range.end());
            WrongValue::new(text, what, allowed)
        })
    }
}

/// Bytes of `1GB`, `500MB`, `2GiB`, `4096`: at least one.
///
/// # Errors
/// [`WrongValue`].
pub fn bytes(text: &str) -> Result<u64, WrongValue> {
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
    let read = || {
        let text = text.trim();
        let unit = |(name, unit): &(&str, u64)| Some((text.strip_suffix(name)?, *unit));
        let (number, unit) = units.iter().find_map(unit)?;
        let bytes = number.trim().parse::<f64>().ok()? * unit as f64;
        (1.0..9e18).contains(&bytes).then_some(bytes as u64)
    };
    read().ok_or_else(|| WrongValue::new(text, "size", "it like 500MB, 1GB or 2GiB"))
}

/// A length of time: `12s`, `1m30s`, `250ms`, `1.5h`; without a unit seconds. At most 10⁹ seconds.
///
/// # Errors
/// [`WrongValue`].
pub fn span(text: &str) -> Result<Duration, WrongValue> {
    let read = || {
        let mut rest = text.trim();
        let mut secs = 0.0;
        while !rest.is_empty() || text.trim().is_empty() {
            let is_of_number = |c: char| c.is_ascii_digit() || c == '.';
            let digits = rest.find(|c| !is_of_number(c)).unwrap_or(rest.len());
            let number: f64 = rest[..digits].parse().ok()?;
            rest = rest[digits..].trim_start();
            let letters = rest.find(|c: char| !c.is_ascii_alphabetic());
            let (unit, behind) = rest.split_at(letters.unwrap_or(rest.len()));
            secs += number
                * match unit {
                    "" | "s" => 1.0,
                    "ms" => 1e-3,
                    "m" | "min" => 60.0,
                    "h" => 3600.0,
                    _ => return None,
                };
            rest = behind.trim_start();
        }
        (secs <= 1e9).then(|| Duration::from_nanos((secs * 1e9).round() as u64))
    };
    read().ok_or_else(|| WrongValue::new(text, "time", "it like 12s, 1m30s, 250ms or 1h"))
}

/// As [`span`], but not 0.
///
/// # Errors
/// [`WrongValue`].
pub fn some_span(text: &str) -> Result<Duration, WrongValue> {
    match span(text)? {
        Duration::ZERO => Err(WrongValue::new(text, "time of more than 0", "1ms or more")),
        span => Ok(span),
    }
}

/// As [`span`], in nanoseconds.
///
/// # Errors
/// [`WrongValue`].
pub fn span_nanos(text: &str) -> Result<u64, WrongValue> {
    span(text).map(|span| span.as_nanos() as u64)
}

/// As [`some_span`], in nanoseconds.
///
/// # Errors
/// [`WrongValue`].
pub fn some_span_nanos(text: &str) -> Result<u64, WrongValue> {
    some_span(text).map(|span| span.as_nanos() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_of_time_are_read_as_people_write_them() {
        for (text, millis) in [
            ("12s", 12_000),
            ("1m30s", 90_000),
            ("1.5m", 90_000),
            ("250ms", 250),
            ("0.25", 250),
            ("2", 2000),
            (" 1h ", 3_600_000),
            ("1 min 1 s", 61_000),
            ("0s", 0),
        ] {
            assert_eq!(span(text), Ok(Duration::from_millis(millis)), "{text}");
        }
        assert_eq!(span_nanos("1.5s"), Ok(1_500_000_000));
        for wrong in [
            "",
            " ",
            "s",
            "-1s",
            "2e9s",
            "NaN",
            "inf",
            "1e30s",
            "..s",
            "1x",
            "10 parsecs",
            "s1",
        ] {
            let error = span(wrong).unwrap_err().to_string();
            assert!(
                error.contains("12s, 1m30s, 250ms or 1h"),
                "{wrong}: {error}"
            );
        }
        assert!(some_span("0").is_err() && some_span_nanos("1ms") == Ok(1_000_000));
    }

    #[test]
    fn sizes_are_read_as_people_write_them() {
        for (text, n) in [
            ("1GB", 1_000_000_000),
            ("2 MiB", 2 << 20),
            ("4096", 4096),
            ("1.5kB", 1500),
        ] {
            assert_eq!(bytes(text), Ok(n), "{text}");
        }
        for wrong in ["", "GB", "-1GB", "0", "NaN", "1e30GB", "10 parsecs"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn numbers_are_those_between_the_bounds() {
        let rate = number("rate in Hz", 0.01..=1000.0);
        assert_eq!([rate("0.01"), rate("1000")], [Ok(0.01), Ok(1000.0)]);
        for wrong in ["", "0.001", "1000.1", "NaN", "inf", "-1", "ten"] {
            let error = rate(wrong).unwrap_err().to_string();
            assert!(
                error.ends_with("is no rate in Hz; say 0.01 to 1000"),
                "{error}"
            );
        }
    }
}
