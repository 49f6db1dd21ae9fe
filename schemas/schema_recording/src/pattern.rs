//! Patterns that choose topics.

/// Whether `text` is what `pattern` says: `*` stands for any characters, `?` for one.
pub fn matches(pattern: &str, text: &str) -> bool {
    let (pattern, text): (Vec<char>, Vec<char>) =
        (pattern.chars().collect(), text.chars().collect());
    let (mut p, mut t) = (0, 0);
    // Where to go on after the last `*`: the pattern behind it, and one character further.
    let mut retry = None;
    while t < text.len() {
        match pattern.get(p) {
            Some('*') => {
                retry = Some((p + 1, t + 1));
                p += 1;
            }
            Some(symbol) if *symbol == '?' || *symbol == text[t] => (p, t) = (p + 1, t + 1),
            _ => {
                let Some((after_star, next)) = retry else {
                    return false;
                };
                (p, t) = (after_star, next);
                retry = Some((after_star, next + 1));
            }
        }
    }
    pattern[p..].iter().all(|symbol| *symbol == '*')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_match_as_in_a_shell() {
        for (pattern, text) in [
            ("ego/*", "ego/front/rgb"),
            ("*/rgb", "ego/front/rgb"),
            ("ego/f?ont/*", "ego/front/rgb"),
            ("*a*b*", "xxaxxaxbx"),
            ("*", ""),
            ("", ""),
        ] {
            assert!(matches(pattern, text), "{pattern} {text}");
        }
        for (pattern, text) in [
            ("*/rgb", "ego/front/rgbx"),
            ("ego/?/rgb", "ego/front/rgb"),
            ("", "a"),
            ("a*b", "acbd"),
        ] {
            assert!(!matches(pattern, text), "{pattern} {text}");
        }
    }
}
