//! Marked regions of a page: `<!-- table: NAME -->` … `<!-- /table -->`.

use anyhow::{Context as _, ensure};

const BEGIN: &str = "<!-- table: ";
const BEGIN_END: &str = " -->\n";
const END: &str = "<!-- /table -->";

/// `page` with the text of `table(NAME)` in each region.
pub fn fill(
    page: &str,
    mut table: impl FnMut(&str) -> anyhow::Result<String>,
) -> anyhow::Result<String> {
    let mut filled = String::new();
    let mut rest = page;
    while let Some(at) = rest.find(BEGIN) {
        let after = &rest[at + BEGIN.len()..];
        let (name, behind) = after
            .split_once(BEGIN_END)
            .context("a table's mark has no end")?;
        let end = behind
            .find(END)
            .with_context(|| format!("table {name} has no {END}"))?;
        ensure!(
            !behind[..end].contains(BEGIN),
            "table {name} begins another table before its {END}"
        );
        let text = table(name).with_context(|| format!("table {name}"))?;
        filled += &rest[..at];
        filled += &format!("{BEGIN}{name}{BEGIN_END}{text}");
        rest = &behind[end..];
    }
    Ok(filled + rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_filled_and_the_rest_is_kept() {
        let page =
            "# A\n<!-- table: x -->\nold\n<!-- /table -->\nB\n<!-- table: y -->\n<!-- /table -->\n";
        let once = fill(page, |name| Ok(format!("new {name}\n"))).expect("the marks are right");
        assert_eq!(
            once,
            "# A\n<!-- table: x -->\nnew x\n<!-- /table -->\nB\n<!-- table: y -->\nnew y\n<!-- /table -->\n"
        );
        assert_eq!(
            fill(&once, |name| Ok(format!("new {name}\n"))).expect("again"),
            once
        );
    }

    #[test]
    fn marks_without_an_end_are_refused() {
        let give = |_: &str| Ok(String::new());
        for page in [
            "<!-- table: x -->\n",
            "<!-- table: x",
            "<!-- table: x -->\n<!-- table: y -->\n<!-- /table -->\n",
        ] {
            assert!(fill(page, give).is_err(), "{page:?}");
        }
    }
}
