//! Numbers in the form of CARLA's texts about recordings: as C++ streams print them, with six
//! significant digits.

use crate::recorder::frame::Origin;

pub const ROOM: &str = "a text always has room";

/// Significant digits.
const N_DIGITS: i32 = 6;

/// A number as C's `%g` has it.
pub fn general(number: f64) -> String {
    if number.is_nan() {
        let sign = if number.is_sign_negative() { "-" } else { "" };
        return format!("{sign}nan");
    }
    if number == 0.0 || number.is_infinite() {
        return format!("{}", number + 0.0);
    }
    let rounded = format!("{number:.*e}", (N_DIGITS - 1) as usize);
    let (digits, exponent) = rounded
        .split_once('e')
        .map(|(digits, exponent)| (digits, exponent.parse().unwrap_or(0)))
        .unwrap_or((&rounded, 0));
    if (-4..N_DIGITS).contains(&exponent) {
        let n_decimals = (N_DIGITS - 1 - exponent) as usize;
        return without_zeros(&format!("{number:.n_decimals$}")).to_owned();
    }
    let sign = if exponent < 0 { '-' } else { '+' };
    format!("{}e{sign}{:02}", without_zeros(digits), exponent.abs())
}

fn without_zeros(decimals: &str) -> &str {
    if decimals.contains('.') {
        decimals.trim_end_matches('0').trim_end_matches('.')
    } else {
        decimals
    }
}

/// A number in single precision.
pub fn single(number: f32) -> String {
    general(f64::from(number))
}

/// Three numbers.
pub fn vector([x, y, z]: [f64; 3]) -> String {
    format!("({}, {}, {})", general(x), general(y), general(z))
}

/// A place in centimetres.
pub fn centimetres(location_m: [f64; 3]) -> String {
    vector(location_m.map(|metres| metres * 100.0))
}

/// A rotation in Unreal's order: degrees about x, y, z.
pub fn turn([pitch, yaw, roll]: [f64; 3]) -> String {
    vector([roll, pitch, yaw])
}

/// A time: in CARLA's recordings with six digits as CARLA prints it, in Gantry's to the
/// microsecond.
pub fn seconds(origin: Origin, secs: f64) -> String {
    match origin {
        Origin::Carla => general(secs),
        Origin::Gantry => format!("{}", (secs * 1e6).round() / 1e6 + 0.0),
    }
}

/// Year, month and day, and the time as `23:59:59`, of seconds since 1970, UTC.
pub fn date(unix_secs: i64) -> ([i64; 3], String) {
    let (days, second) = (unix_secs.div_euclid(86_400), unix_secs.rem_euclid(86_400));
    // The civil date from whole 400-year cycles that begin in March.
    let shifted = days + 719_468;
    let cycle = shifted.div_euclid(146_097);
    let day_of_cycle = shifted.rem_euclid(146_097);
    let year_of_cycle =
        (day_of_cycle - day_of_cycle / 1460 + day_of_cycle / 36_524 - day_of_cycle / 146_096) / 365;
    let day_of_year =
        day_of_cycle - (365 * year_of_cycle + year_of_cycle / 4 - year_of_cycle / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 {
        month_from_march + 3
    } else {
        month_from_march - 9
    };
    let year = year_of_cycle + cycle * 400 + i64::from(month <= 2);
    let time = format!(
        "{:02}:{:02}:{:02}",
        second / 3600,
        second / 60 % 60,
        second % 60
    );
    ([year, month, day], time)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values are those of `printf("%g")`.
    #[test]
    fn numbers_are_those_of_printf() {
        for (number, expected) in [
            (0.0, "0"),
            (-0.0, "0"),
            (1.0, "1"),
            (-49_882.335_937_5, "-49882.3"),
            (10_847.75, "10847.8"),
            (0.025_425_3, "0.0254253"),
            (1_000_000.0, "1e+06"),
            (999_999.5, "1e+06"),
            (123_456.4, "123456"),
            (0.000_1, "0.0001"),
            (0.000_012_345_67, "1.23457e-05"),
            (1e100, "1e+100"),
            (f64::INFINITY, "inf"),
            (f64::NEG_INFINITY, "-inf"),
        ] {
            assert_eq!(general(number), expected);
        }
        assert!(general(f64::NAN).ends_with("nan"));
    }

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (secs, day, time) in [
            (0, [1970, 1, 1], "00:00:00"),
            (951_782_400, [2000, 2, 29], "00:00:00"),
            (1_798_761_599, [2026, 12, 31], "23:59:59"),
            (-1, [1969, 12, 31], "23:59:59"),
        ] {
            assert_eq!(date(secs), (day, time.to_owned()));
        }
        // Whatever a damaged file claims.
        date(i64::MIN);
        date(i64::MAX);
    }
}
