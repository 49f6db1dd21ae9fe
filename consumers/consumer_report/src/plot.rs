//! Plots as SVG, to be put into a page: axes, lines with marks and names at their ends, and bars.
//!
//! Colours come from the page's style: series `n` has the class `s{n}`, beside a shape of its mark
//! and a pattern of its line, so that no plot needs colour to be read.

mod axis;
mod bars;

use std::fmt::Write as _;

use crate::words::{escape, shortened};

pub use axis::{Axis, Scale};
pub use bars::{Bar, columns, rows};

/// Colours of the style; further series repeat them with another pattern.
pub const N_COLOURS: usize = 8;

/// Half as wide as a page.
const HALF: Size = Size {
    width: 560.0,
    height: 300.0,
};
/// As wide as a page.
const WIDE: Size = Size {
    width: 1140.0,
    height: 380.0,
};
const LEFT: f64 = 54.0;
const RIGHT: f64 = 118.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 42.0;
/// Least distance of two names at the ends of lines.
const NAME_STEP: f64 = 14.0;
/// Longest name at the end of a line, characters.
const NAME_LENGTH: usize = 17;

/// Size of a plot, pixels.
#[derive(Clone, Copy)]
struct Size {
    width: f64,
    height: f64,
}

/// Two axes and the size of what they span.
struct Area<'a> {
    x_axis: &'a Axis,
    y_axis: &'a Axis,
    size: Size,
}

impl Area<'_> {
    fn x(&self, value: f64) -> f64 {
        LEFT + self.x_axis.share(value) * (self.right() - LEFT)
    }

    fn y(&self, value: f64) -> f64 {
        self.ground() - self.y_axis.share(value) * (self.ground() - TOP)
    }

    fn right(&self) -> f64 {
        self.size.width - RIGHT
    }

    fn ground(&self) -> f64 {
        self.size.height - BOTTOM
    }
}

/// A line of a plot.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// Its name, beside its end.
    pub name: String,
    /// Which colour, pattern and mark.
    pub style: usize,
    /// Values over values, in order of the first.
    pub points: Vec<(f64, f64)>,
    /// A value apart from the line, left of it, joined by dots: where the line begins from.
    pub origin: Option<Origin>,
    /// What is said when the pointer rests on a point, in their order.
    pub notes: Vec<String>,
    /// Whether points have marks.
    pub has_marks: bool,
    /// Whether values hold until the next, as in distributions.
    pub is_stepped: bool,
}

/// A hollow mark, apart from the line that begins from it.
#[derive(Clone, Debug)]
pub struct Origin {
    /// Its place.
    pub point: (f64, f64),
    /// Text that is shown when the pointer rests on it.
    pub note: String,
}

/// A plot of lines, half as wide as a page. `label` says what it shows, for readers that do not see
/// it.
pub fn lines(label: &str, x: &Axis, y: &Axis, series: &[Series]) -> String {
    sized(label, x, y, series, HALF)
}

/// The same, as wide as a page.
pub fn wide_lines(label: &str, x: &Axis, y: &Axis, series: &[Series]) -> String {
    sized(label, x, y, series, WIDE)
}

fn sized(label: &str, x: &Axis, y: &Axis, series: &[Series], size: Size) -> String {
    let area = Area {
        x_axis: x,
        y_axis: y,
        size,
    };
    let mut svg = open(label, size);
    frame(&mut svg, &area);
    for one in series {
        line(&mut svg, &area, one);
    }
    names(&mut svg, &area, series);
    svg + "</svg>"
}

fn open(label: &str, Size { width, height }: Size) -> String {
    format!(
        "<svg role=\"img\" aria-label=\"{}\" viewBox=\"0 0 {width} {height:.0}\" width=\"{width}\" height=\"{height:.0}\">",
        escape(label)
    )
}

fn frame(svg: &mut String, area: &Area<'_>) {
    let (x, y) = (area.x_axis, area.y_axis);
    let (right, ground) = (area.right(), area.ground());
    for (value, text) in y.ticks() {
        let at = area.y(*value);
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{LEFT}\" y1=\"{at:.1}\" x2=\"{right}\" y2=\"{at:.1}\"/>\
             <text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 7.0,
            at + 4.0,
            escape(text)
        );
    }
    for (value, text) in x.ticks() {
        let at = area.x(*value);
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{at:.1}\" y1=\"{TOP}\" x2=\"{at:.1}\" y2=\"{ground}\"/>\
             <text class=\"tick\" x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            ground + 16.0,
            escape(text)
        );
    }
    let _ = write!(
        svg,
        "<line class=\"ground\" x1=\"{LEFT}\" y1=\"{ground}\" x2=\"{right}\" y2=\"{ground}\"/>\
         <text class=\"axis\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
         <text class=\"axis\" transform=\"translate(12 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        f64::midpoint(LEFT, right),
        area.size.height - 6.0,
        escape(&x.label),
        f64::midpoint(TOP, ground),
        escape(&y.label)
    );
}

fn line(svg: &mut String, area: &Area<'_>, series: &Series) {
    let style = format!(
        "s{} p{}",
        series.style % N_COLOURS,
        series.style / N_COLOURS % 3
    );
    let _ = write!(svg, "<g class=\"{style}\">");
    if let (Some(origin), Some((first_at, first))) = (&series.origin, series.points.first()) {
        let (at, value) = origin.point;
        let _ = write!(
            svg,
            "<line class=\"origin\" x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\"/>",
            area.x(at),
            area.y(value),
            area.x(*first_at),
            area.y(*first)
        );
    }
    let mut path = String::new();
    for (at, (px, py)) in series
        .points
        .iter()
        .map(|(a, b)| (area.x(*a), area.y(*b)))
        .enumerate()
    {
        if at == 0 {
            let _ = write!(path, "M{px:.1} {py:.1}");
        } else if series.is_stepped {
            let _ = write!(path, "H{px:.1}V{py:.1}");
        } else {
            let _ = write!(path, "L{px:.1} {py:.1}");
        }
    }
    let _ = write!(svg, "<path class=\"line\" d=\"{path}\"/>");
    if let Some(origin) = &series.origin {
        let (at, value) = origin.point;
        mark(
            svg,
            "hollow",
            series.style,
            area.x(at),
            area.y(value),
            &origin.note,
        );
    }
    if series.has_marks {
        for (at, (a, b)) in series.points.iter().enumerate() {
            let note = series.notes.get(at).cloned().unwrap_or_default();
            mark(svg, "mark", series.style, area.x(*a), area.y(*b), &note);
        }
    }
    *svg += "</g>";
}

/// A mark: circle, square, triangle or diamond by the style.
fn mark(svg: &mut String, class: &str, style: usize, x: f64, y: f64, note: &str) {
    let shape = match style % 4 {
        0 => format!(
            "M{:.1} {y:.1}a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0 -7 0z",
            x - 3.5
        ),
        1 => format!("M{:.1} {:.1}h6.4v6.4h-6.4z", x - 3.2, y - 3.2),
        2 => format!("M{x:.1} {:.1}l4.2 7h-8.4z", y - 4.4),
        _ => format!("M{x:.1} {:.1}l4.4 4.4l-4.4 4.4l-4.4 -4.4z", y - 4.4),
    };
    let _ = write!(svg, "<path class=\"{class}\" d=\"{shape}\">");
    if !note.is_empty() {
        let _ = write!(svg, "<title>{}</title>", escape(note));
    }
    *svg += "</path>";
}

/// Names at the ends of lines, apart from each other.
fn names(svg: &mut String, area: &Area<'_>, series: &[Series]) {
    let mut ends: Vec<(f64, f64, &Series)> = series
        .iter()
        .filter_map(|one| {
            let (at, value) = one.points.last()?;
            Some((area.y(*value), area.x(*at), one))
        })
        .collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let wanted: Vec<f64> = ends.iter().map(|end| end.0).collect();
    let places = apart(&wanted, NAME_STEP, TOP + 4.0, area.ground() - 4.0);
    let right = area.right();
    for ((own, end_x, one), place) in ends.into_iter().zip(places) {
        let style = one.style % N_COLOURS;
        let name = shortened(&one.name, NAME_LENGTH);
        let _ = write!(
            svg,
            "<g class=\"s{style}\"><path class=\"lead\" d=\"M{:.1} {own:.1}L{:.1} {place:.1}\"/>\
             <text class=\"end\" x=\"{:.1}\" y=\"{:.1}\">{}</text></g>",
            end_x + 5.0,
            right + 9.0,
            right + 11.0,
            place + 4.0,
            escape(&name)
        );
    }
}

/// Places in ascending order near the wanted ones, at least `step` apart, between `lo` and `hi` if
/// they fit there.
fn apart(wanted: &[f64], step: f64, lo: f64, hi: f64) -> Vec<f64> {
    // Neighbours that are too close form a block around the mean of what they want.
    let mut blocks: Vec<(f64, usize)> = Vec::new();
    for want in wanted {
        let mut block = (*want, 1_usize);
        loop {
            let half = (block.1 - 1) as f64 * step / 2.0;
            block.0 = block.0.min(hi - half).max(lo + half);
            let close = blocks.pop_if(|(middle, n)| {
                block.0 - half - (*middle + (*n - 1) as f64 * step / 2.0) < step - 1e-9
            });
            let Some((middle, n)) = close else { break };
            let sum = middle * n as f64 + block.0 * block.1 as f64;
            block = (sum / (n + block.1) as f64, n + block.1);
        }
        blocks.push(block);
    }
    blocks
        .into_iter()
        .flat_map(|(middle, n)| {
            let first = middle - (n - 1) as f64 * step / 2.0;
            (0..n).map(move |at| first + at as f64 * step)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_keep_their_distance_and_their_order() {
        let places = apart(&[50.0, 52.0, 53.0, 200.0], 14.0, 10.0, 250.0);
        assert_eq!(places.len(), 4);
        assert!(
            places.windows(2).all(|it| it[1] - it[0] >= 14.0 - 1e-9),
            "{places:?}"
        );
        assert_eq!(places[3], 200.0);
        let low = apart(&[225.0, 249.0, 250.0, 250.0], 14.0, 10.0, 250.0);
        assert!(
            low.windows(2).all(|it| it[1] - it[0] >= 14.0 - 1e-9),
            "{low:?}"
        );
        assert!(low.iter().all(|it| *it <= 250.0 + 1e-9), "{low:?}");
    }

    #[test]
    fn a_plot_says_its_values_and_escapes_names() {
        let axis = Axis::linear("delay <ms>", 0.0, 10.0);
        let series = Series {
            name: "a & b".into(),
            style: 9,
            points: vec![(0.0, 1.0), (10.0, 2.0)],
            origin: Some(Origin {
                point: (0.0, 3.0),
                note: "begin".into(),
            }),
            notes: vec!["first".into(), "second".into()],
            has_marks: true,
            is_stepped: false,
        };
        let svg = lines("x & y", &axis, &axis, &[series]);
        for part in [
            "x &amp; y",
            "a &amp; b",
            "delay &lt;ms&gt;",
            "<title>second</title>",
            "<title>begin</title>",
            "s1 p1",
        ] {
            assert!(svg.contains(part), "{part}");
        }
        assert_eq!(svg.matches("<g ").count(), svg.matches("</g>").count());
    }
}
