//! Which topics are recorded: patterns that take them in, and patterns that leave them out.

/// Patterns of topics with `*` and `?`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Select {
    /// Topics to take; empty means all.
    pub topics: Vec<String>,
    /// Topics to leave out of those.
    pub exclude: Vec<String>,
}

impl Select {
    /// Whether `topic` is taken.
    pub fn takes(&self, topic: &str) -> bool {
        let any = |patterns: &[String]| patterns.iter().any(|pattern| matches(pattern, topic));
        (self.topics.is_empty() || any(&self.topics)) && !any(&self.exclude)
    }
}

/// `*` stands for any characters, `?` for one.
pub fn matches(pattern: &str, text: &str) -> bool {
    let (pattern, text): (Vec<char>, Vec<char>) =
        (pattern.chars().collect(), text.chars().collect());
    let mut reachable = vec![false; text.len() + 1];
    reachable[0] = true;
    for symbol in pattern {
        let mut next = vec![false; text.len() + 1];
        for at in 0..=text.len() {
            next[at] = match symbol {
                '*' => reachable[at] || (at > 0 && next[at - 1]),
                '?' => at > 0 && reachable[at - 1],
                _ => at > 0 && reachable[at - 1] && text[at - 1] == symbol,
            };
        }
        reachable = next;
    }
    reachable[text.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_match_as_in_a_shell() {
        assert!(
            matches("ego/*", "ego/front/rgb")
                && matches("*/rgb", "ego/front/rgb")
                && matches("ego/f?ont/*", "ego/front/rgb")
        );
        assert!(matches("*", "") && matches("ego/front/rgb", "ego/front/rgb"));
        assert!(
            !matches("*/rgb", "ego/front/rgbx")
                && !matches("ego/?/rgb", "ego/front/rgb")
                && !matches("", "a")
        );
    }

    #[test]
    fn what_is_excluded_is_not_taken() {
        let select = Select {
            topics: vec!["ego/*".into()],
            exclude: vec!["*/dvs".into(), "ego/rear/*".into()],
        };
        assert!(select.takes("ego/front/rgb"));
        assert!(!select.takes("ego/front/dvs") && !select.takes("ego/rear/rgb"));
        assert!(!select.takes("other/front/rgb"));
        assert!(Select::default().takes("anything"));
    }
}
