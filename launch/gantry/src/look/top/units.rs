//! Numbers in the few letters of a table's cell.

/// What stands where a value is not known.
pub const UNKNOWN: &str = "–";

/// `20.0`, `0.25`, `1250`.
pub fn rate(hz: Option<f64>) -> String {
    match hz {
        None => UNKNOWN.into(),
        Some(0.0) => "0".into(),
        Some(hz) if hz < 10.0 => format!("{hz:.2}"),
        Some(hz) if hz < 1000.0 => format!("{hz:.1}"),
        Some(hz) => format!("{hz:.0}"),
    }
}

/// `950 µs`, `12.3 ms`, `1.5 s`, `3 min`, `2 h`.
pub fn time(nanos: Option<u64>) -> String {
    let Some(nanos) = nanos else {
        return UNKNOWN.into();
    };
    let secs = nanos as f64 / 1e9;
    match secs {
        s if s < 1e-3 => format!("{:.0} µs", s * 1e6),
        s if s < 0.1 => format!("{:.1} ms", s * 1e3),
        s if s < 1.0 => format!("{:.0} ms", s * 1e3),
        s if s < 100.0 => format!("{s:.1} s"),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.0} h", s / 3600.0),
    }
}

/// `640 B`, `1.92 MB`, `12.4 GB`, in powers of ten.
pub fn bytes(n: Option<f64>) -> String {
    let Some(n) = n else {
        return UNKNOWN.into();
    };
    let (value, unit) = match n {
        n if n < 1e3 => return format!("{n:.0} B"),
        n if n < 1e6 => (n / 1e3, "kB"),
        n if n < 1e9 => (n / 1e6, "MB"),
        n => (n / 1e9, "GB"),
    };
    match value {
        v if v < 10.0 => format!("{v:.2} {unit}"),
        v if v < 100.0 => format!("{v:.1} {unit}"),
        v => format!("{v:.0} {unit}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_short_and_keep_three_digits() {
        assert_eq!(
            [
                rate(None),
                rate(Some(0.0)),
                rate(Some(0.25)),
                rate(Some(20.0)),
                rate(Some(1250.4))
            ],
            ["–", "0", "0.25", "20.0", "1250"]
        );
        let times = [
            950_000,
            12_340_000,
            250_000_000,
            1_500_000_000,
            180_000_000_000,
            7_200_000_000_000,
        ];
        assert_eq!(
            times.map(|nanos| time(Some(nanos))),
            ["950 µs", "12.3 ms", "250 ms", "1.5 s", "3 min", "2 h"]
        );
        let sizes = [640.0, 1_920_000.0, 38_400_000.0, 12_400_000_000.0, 250e3];
        assert_eq!(
            sizes.map(|n| bytes(Some(n))),
            ["640 B", "1.92 MB", "38.4 MB", "12.4 GB", "250 kB"]
        );
        assert_eq!((time(None), bytes(None)), ("–".into(), "–".into()));
    }
}
