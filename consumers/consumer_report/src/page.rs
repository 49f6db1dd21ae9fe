//! A report as one page of HTML that needs nothing from elsewhere: plots are SVG, pictures stand
//! within it, and there is no script.

use std::fmt::Write as _;

mod style;
mod table;

use crate::words::escape;

pub use style::STYLE;
pub use table::{Cell, Head, Table, details};

/// What the browser must never fetch: anything.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";

/// A whole document with the style of all pages, and the rules that its own pictures need.
pub fn document(title: &str, own_style: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <title>{}</title>\n<style>{STYLE}{own_style}</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        escape(title)
    )
}

/// The figures at the head of a page, each under its name.
pub fn figures<'a>(rows: impl IntoIterator<Item = (&'a str, String)>) -> String {
    let mut html = String::from("<dl class=\"figures\">");
    for (name, value) in rows {
        let _ = write!(
            html,
            "<div><dt>{name}</dt><dd>{}</dd></div>",
            escape(&value)
        );
    }
    html + "</dl>\n"
}

/// The sentences that a reader must know before believing a figure; nothing without any.
pub fn warnings(sentences: &[String]) -> String {
    if sentences.is_empty() {
        return String::new();
    }
    let mut html = String::from(
        "<div class=\"warnings\" role=\"note\"><strong>Read before you believe a figure</strong><ul>",
    );
    for one in sentences {
        let _ = write!(html, "<li>{}</li>", escape(one));
    }
    html + "</ul></div>\n"
}

/// Words with their meanings, or names with their values.
pub fn definitions<'a>(rows: impl IntoIterator<Item = (&'a str, &'a str)>) -> String {
    let mut html = String::from("<dl class=\"words\">");
    for (word, meaning) in rows {
        let _ = write!(
            html,
            "<dt>{}</dt><dd>{}</dd>",
            escape(word),
            escape(meaning)
        );
    }
    html + "</dl>"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_whole_and_needs_nothing_from_elsewhere() {
        let body = figures([("n", "<1>".to_owned())]) + &warnings(&["a & b".into()]);
        let page = document("x & y", "", &body);
        assert!(page.contains("<title>x &amp; y</title>") && page.ends_with("</html>\n"));
        assert!(page.contains("<dd>&lt;1&gt;</dd>") && page.contains("<li>a &amp; b</li>"));
        assert!(!page.contains("http://") && !page.contains("https://"));
        assert_eq!(warnings(&[]), "");
    }
}
