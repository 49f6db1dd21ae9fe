//! Latency on the page: whole distributions over their percentiles, and tables of all four kinds.

use super::names::style_of;
use crate::capture::Mode;
use crate::report::types::{Report, Run};
use consumer_report::Spread;
use consumer_report::numbers::{grouped, number};
use consumer_report::page::{Cell, Head, Table, details};
use consumer_report::plot::{Axis, Scale, Series, lines};
use consumer_report::words::escape;

/// A kind of latency.
#[derive(Clone, Copy)]
struct Kind {
    name: &'static str,
    meaning: &'static str,
}

/// The four kinds, in the order of [`crate::report::types::Latency::named`].
const KINDS: [Kind; 4] = [
    Kind {
        name: "End to end",
        meaning: "From the oldest frame behind a result to the result",
    },
    Kind {
        name: "Answer",
        meaning: "From the answered frame to the result",
    },
    Kind {
        name: "Work",
        meaning: "From the moment the program had the frame to the result",
    },
    Kind {
        name: "Age at use",
        meaning: "From the frame to the moment the program had it",
    },
];

/// A run's distribution of one kind, and how it is drawn.
#[derive(Clone, Copy)]
struct Drawn<'a> {
    run: &'a Run,
    style: usize,
    spread: &'a Spread,
}

/// Percentile steps per halving of the distance to 100 %.
const TICKS_PER_HALF: u32 = 5;

/// The section.
pub fn section(report: &Report) -> String {
    let runs: Vec<(&Run, usize)> = report
        .runs
        .iter()
        .filter(|run| run.mode != Mode::Offline)
        .map(|run| (run, style(report, run)))
        .collect();
    let mut html = String::from(
        "<section><h2 id=\"latency\">Latency</h2>\n<p class=\"soft\">Milliseconds of the wall clock between publications, of runs in real time and constant streams. The axis to the right takes equal steps for each further nine: a line that rises there has a long tail.</p>\n",
    );
    if runs
        .iter()
        .all(|(run, _)| run.latency.named().iter().all(|(_, it)| it.n == 0))
    {
        return html + "<p>No run in real time has a result.</p></section>\n";
    }
    let of_kind = |at: usize| -> Vec<Drawn<'_>> {
        let all = runs.iter().map(|(run, style)| Drawn {
            run,
            style: *style,
            spread: run.latency.named()[at].1,
        });
        all.filter(|it| it.spread.n > 0).collect()
    };
    html += &table(KINDS[0], &of_kind(0));
    html += "<div class=\"charts\">";
    for (at, kind) in KINDS.into_iter().enumerate() {
        let spreads = of_kind(at);
        if spreads.is_empty() {
            continue;
        }
        html += &format!(
            "<section><h3>{}</h3>\n<p class=\"soft\">{}.</p>\n{}",
            kind.name,
            escape(kind.meaning),
            plot(kind, &spreads)
        );
        if at > 0 {
            html += &details("Values", &table(kind, &spreads));
        }
        html += "</section>\n";
    }
    html + "</div></section>\n"
}

/// Colour by program, pattern by which of its runs it is.
pub(super) fn style(report: &Report, run: &Run) -> usize {
    let of_program = report.runs.iter().filter(|it| it.program == run.program);
    let timed = of_program.filter(|it| it.mode != Mode::Offline);
    let nth = timed.take_while(|it| !std::ptr::eq(*it, run)).count();
    style_of(report, &run.program, nth)
}

/// A name that is short where the mode goes without saying.
pub(super) fn name(run: &Run) -> String {
    run.label().replacen(" streaming", "", 1)
}

fn plot(kind: Kind, spreads: &[Drawn<'_>]) -> String {
    let mut series = Vec::new();
    let (mut lo, mut hi, mut most) = (f64::INFINITY, 0.0_f64, 10.0_f64);
    for Drawn { run, style, spread } in spreads {
        let Ok(histogram) = spread.decode() else {
            continue;
        };
        let n = histogram.len() as f64;
        let mut points = Vec::new();
        for step in histogram.iter_quantiles(TICKS_PER_HALF) {
            let ms = step.value_iterated_to() as f64 / 1e6;
            let beyond = 1.0 - step.quantile_iterated_to();
            // Beyond one in n nothing is known.
            let at = if beyond > 0.0 {
                (1.0 / beyond).min(n)
            } else {
                n
            };
            points.push((at.max(1.0), ms));
            (lo, hi) = (lo.min(ms), hi.max(ms));
        }
        most = most.max(n);
        series.push(Series {
            name: name(run),
            style: *style,
            points,
            is_stepped: true,
            ..Series::default()
        });
    }
    let named = [
        (1.0, "0"),
        (2.0, "50"),
        (10.0, "90"),
        (100.0, "99"),
        (1e3, "99.9"),
        (1e4, "99.99"),
        (1e5, "99.999"),
        (1e6, "99.9999"),
    ];
    let ticks = named.iter().filter(|(at, _)| *at <= most);
    let ticks = ticks.map(|(at, text)| (*at, (*text).to_owned())).collect();
    let x = Axis::with_ticks("percentile", Scale::Log, 1.0, most, ticks);
    let y = Axis::log("ms", lo.max(1e-3), hi);
    let label = format!("{}: latency over percentile", kind.name);
    lines(&label, &x, &y, &series)
}

fn table(kind: Kind, spreads: &[Drawn<'_>]) -> String {
    let heads = ["n", "mean", "p50", "p90", "p99", "p99.9", "max"];
    let caption = format!(
        "{}, milliseconds: {}",
        kind.name,
        kind.meaning.to_lowercase()
    );
    let heads = heads.into_iter().map(Head::new);
    let mut html = Table::new(
        caption,
        std::iter::once(Head::words("run")).chain(heads).collect(),
    );
    for Drawn {
        run,
        style,
        spread: it,
    } in spreads
    {
        let (p99, p999) = (it.shown_p99(), it.shown_p999());
        let cells = [
            Some(it.mean),
            Some(it.p50),
            Some(it.p90),
            p99,
            p999,
            Some(it.max),
        ];
        let cells = cells.into_iter().map(|value| Cell::from(number(value)));
        let head = [Cell::from(name(run)).swatch(*style), grouped(it.n).into()];
        html.row(head.into_iter().chain(cells));
    }
    html.html()
}
