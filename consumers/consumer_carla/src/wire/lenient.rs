//! Reads numbers in attributes as CARLA does: by their leading digits, and as 0 if there are none.
//!
//! The client checks nothing (`'64.0'` is the integer 64, `'90deg'` the number 90, `'abc'` 0), and
//! tutorials rely on this.

/// Length of the number that `text` begins with: sign and digits; with `fraction` also a point,
/// more digits and an exponent.
fn number_len(text: &[u8], fraction: bool) -> usize {
    let digits = |from: usize| {
        text[from..]
            .iter()
            .take_while(|b| b.is_ascii_digit())
            .count()
    };
    let sign = |at: usize| usize::from(matches!(text.get(at), Some(b'+' | b'-')));
    let mut end = sign(0);
    let whole = digits(end);
    end += whole;
    let mut n_digits = whole;
    if fraction && text.get(end) == Some(&b'.') {
        let places = digits(end + 1);
        n_digits += places;
        end += 1 + places;
    }
    if n_digits == 0 {
        return 0;
    }
    if fraction && matches!(text.get(end), Some(b'e' | b'E')) {
        let at = end + 1 + sign(end + 1);
        if digits(at) > 0 {
            end = at + digits(at);
        }
    }
    end
}

/// A finite number; 0 if the text begins with none.
pub fn float(text: &str) -> f64 {
    let text = text.trim_start();
    let value: f64 = text[..number_len(text.as_bytes(), true)]
        .parse()
        .unwrap_or(0.0);
    if value.is_finite() { value } else { 0.0 }
}

/// An integer; 0 if the text begins with none, and the nearest `i64` if it is too large.
pub fn int(text: &str) -> i64 {
    let text = text.trim_start();
    let digits = &text[..number_len(text.as_bytes(), false)];
    digits.parse().unwrap_or(match digits.as_bytes() {
        [] => 0,
        [b'-', ..] => i64::MIN,
        _ => i64::MAX,
    })
}

/// `true` in any case, or `1`.
pub fn bool(text: &str) -> bool {
    text.trim().eq_ignore_ascii_case("true") || text.trim() == "1"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leading_digits_count() {
        for (text, wanted) in [
            ("64.0", 64),
            ("640", 640),
            (" 7px", 7),
            ("abc", 0),
            ("", 0),
            ("-3", -3),
            ("1e3", 1),
            ("99999999999999999999", i64::MAX),
        ] {
            assert_eq!(int(text), wanted, "{text:?}");
        }
        for (text, wanted) in [
            ("90deg", 90.0),
            ("0.05", 0.05),
            (".5", 0.5),
            ("5.", 5.0),
            ("1e-3x", 1e-3),
            ("1e", 1.0),
            ("-", 0.0),
            ("inf", 0.0),
            ("1e999", 0.0),
            ("ü", 0.0),
        ] {
            assert_eq!(float(text), wanted, "{text:?}");
        }
        assert!(bool("True") && bool("1") && !bool("false") && !bool(""));
    }
}
