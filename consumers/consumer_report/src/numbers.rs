//! Numbers as tables and pages show them.

/// The text for a value that does not exist.
pub const NONE: &str = "–";

/// A number for a table: three significant digits or more, [`NONE`] if there is none.
pub fn number(value: Option<f64>) -> String {
    match value {
        None => NONE.into(),
        Some(value) => match value.abs() {
            0.0 => "0".into(),
            it if it >= 1e6 => format!("{value:.2e}"),
            it if it >= 100.0 => format!("{value:.0}"),
            it if it >= 10.0 => format!("{value:.1}"),
            it if it >= 1.0 => format!("{value:.2}"),
            it if it >= 0.0005 => format!("{value:.3}"),
            _ => format!("{value:.1e}"),
        },
    }
}

/// A share as percent: `12.3%`.
pub fn percent(value: Option<f64>) -> String {
    match value {
        None => NONE.into(),
        Some(value) => format!("{:.1}%", value * 100.0),
    }
}

/// Bytes as MB or GB.
pub fn bytes(value: u64) -> String {
    match value as f64 {
        it if it >= 1e9 => format!("{:.2} GB", it / 1e9),
        it => format!("{:.0} MB", it / 1e6),
    }
}

/// Microseconds with a sensible number of digits.
pub fn micros(value: f64) -> String {
    match value {
        v if v < 1.0 => format!("{v:.2}"),
        v if v < 100.0 => format!("{v:.1}"),
        v => format!("{v:.0}"),
    }
}

/// A number with a thin gap between thousands.
pub fn grouped(value: u64) -> String {
    thousands(&value.to_string(), '\u{202f}')
}

/// Digits with a gap between thousands.
pub fn thousands(digits: &str, gap: char) -> String {
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(gap);
        }
        text.push(digit);
    }
    text
}

/// A number in at most four characters.
pub fn short(value: u64) -> String {
    match value {
        0..10_000 => value.to_string(),
        10_000..1_000_000 => format!("{}k", value / 1000),
        _ => format!("{}M", value / 1_000_000),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_three_digits() {
        for (value, text) in [
            (None, "–"),
            (Some(0.0), "0"),
            (Some(0.51249), "0.512"),
            (Some(-1.006), "-1.01"),
            (Some(33.333), "33.3"),
            (Some(1234.5), "1234"),
            (Some(0.00012), "1.2e-4"),
            (Some(2.5e7), "2.50e7"),
        ] {
            assert_eq!(number(value), text);
        }
        assert_eq!(percent(Some(0.1234)), "12.3%");
        assert_eq!(
            (bytes(48_600_000), bytes(2_500_000_000)),
            ("49 MB".into(), "2.50 GB".into())
        );
        assert_eq!(
            [micros(0.256), micros(99.0), micros(100.4)],
            ["0.26", "99.0", "100"]
        );
    }

    #[test]
    fn thousands_are_set_apart() {
        assert_eq!(
            [grouped(0), grouped(999), grouped(1_234_567)],
            ["0", "999", "1\u{202f}234\u{202f}567"]
        );
        assert_eq!((short(9_999), short(12_345)), ("9999".into(), "12k".into()));
    }
}
