//! Patterns that choose topics.

/// Whether `text` is what `pattern` says: `*` stands for any characters, `?` for one.
pub fn matches(pattern: &str, text: &str) -> bool {
    let (pattern, text): (Vec<char>, Vec<char>) =
        (pattern.chars().collect(), text.chars().collect());
    let (mut p, mut t) = (0, 0);
    // Where to go on after the last `*`: the pattern behind it, and one character further.
    let mut retry = None;
    let after = |at: usize| at.saturating_add(1);
    while t < text.len() {
        match pattern.get(p) {
            Some('*') => {
                retry = Some((after(p), after(t)));
                p = after(p);
            }
            Some(symbol) if *symbol == '?' || *symbol == text[t] => (p, t) = (after(p), after(t)),
            _ => {
                let Some((after_star, next)) = retry else {
                    return false;
                };
                (p, t) = (after_star, next);
                retry = Some((after_star, after(next)));
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
