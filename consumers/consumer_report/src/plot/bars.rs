//! Bar charts as SVG, to be put into a page.

use std::fmt::Write as _;

use crate::numbers::{grouped, short};
use crate::words::escape;

/// A bar: its name and its height or length.
#[derive(Clone, Debug, PartialEq)]
pub struct Bar {
    /// Name.
    pub name: String,
    /// Value.
    pub value: u64,
}

impl Bar {
    /// A bar.
    pub fn new(name: impl Into<String>, value: u64) -> Bar {
        Bar {
            name: name.into(),
            value,
        }
    }
}

const WIDTH: f64 = 560.0;
const NAME_WIDTH: f64 = 150.0;
const VALUE_WIDTH: f64 = 80.0;
const ROW: f64 = 24.0;
const HEIGHT: f64 = 190.0;
const FOOT: f64 = 34.0;
const HEAD: f64 = 18.0;

/// Horizontal bars with a name on the left and the value behind each.
pub fn rows(label: &str, bars: &[Bar]) -> String {
    let most = bars.iter().map(|bar| bar.value).max().unwrap_or(0).max(1) as f64;
    let height = bars.len() as f64 * ROW + 4.0;
    let mut svg = open(label, height);
    for (at, bar) in bars.iter().enumerate() {
        let y = at as f64 * ROW + 4.0;
        let length = (WIDTH - NAME_WIDTH - VALUE_WIDTH) * bar.value as f64 / most;
        let (name, value) = (escape(&bar.name), grouped(bar.value));
        let _ = write!(
            svg,
            "<g class=\"s0\"><title>{name}: {value}</title><text class=\"tick\" x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{name}</text>\
             <rect class=\"mark\" x=\"{NAME_WIDTH}\" y=\"{y:.1}\" width=\"{length:.1}\" height=\"16\" rx=\"2\"/>\
             <text class=\"end\" x=\"{:.1}\" y=\"{:.1}\">{value}</text></g>",
            NAME_WIDTH - 8.0,
            y + 12.5,
            NAME_WIDTH + length + 6.0,
            y + 12.5
        );
    }
    svg + "</svg>"
}

/// Columns of a histogram, with a name under each and the value above.
pub fn columns(label: &str, bars: &[Bar]) -> String {
    let most = bars.iter().map(|bar| bar.value).max().unwrap_or(0).max(1) as f64;
    let step = WIDTH / bars.len().max(1) as f64;
    let mut svg = open(label, HEIGHT + FOOT);
    let ground = HEIGHT;
    for (at, bar) in bars.iter().enumerate() {
        let x = at as f64 * step;
        let height = (HEIGHT - HEAD) * bar.value as f64 / most;
        let middle = x + step / 2.0;
        let (name, value) = (escape(&bar.name), grouped(bar.value));
        let _ = write!(
            svg,
            "<g class=\"s0\"><title>{name}: {value}</title><rect class=\"mark\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{height:.1}\" rx=\"2\"/>",
            x + 2.0,
            ground - height,
            (step - 4.0).max(1.0)
        );
        if bar.value > 0 {
            let _ = write!(
                svg,
                "<text class=\"end\" x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                ground - height - 4.0,
                short(bar.value)
            );
        }
        let _ = write!(
            svg,
            "<text class=\"tick\" x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{name}</text></g>",
            ground + 16.0
        );
    }
    let _ = write!(
        svg,
        "<line class=\"ground\" x1=\"0\" y1=\"{ground}\" x2=\"{WIDTH}\" y2=\"{ground}\"/></svg>"
    );
    svg
}

fn open(label: &str, height: f64) -> String {
    format!(
        "<svg role=\"img\" aria-label=\"{}\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\">",
        escape(label)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_is_well_formed_and_says_its_values() {
        let bars = [Bar::new("a <b>", 12_345), Bar::new("\"c\"", 0)];
        for svg in [rows("x & y", &bars), columns("x & y", &bars)] {
            assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>"));
            assert!(svg.contains("a &lt;b&gt;: 12\u{202f}345") && svg.contains("x &amp; y"));
            assert_eq!(svg.matches("<g ").count(), svg.matches("</g>").count());
        }
        assert!(columns("none", &[]).ends_with("</svg>"));
    }
}
