//! Everything about the selected topic or process.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Sparkline, Wrap};

use super::Style;
use crate::look::census::Member;
use crate::look::top::app::{App, Panel};
use crate::look::top::units::{UNKNOWN, bytes, rate, time};
use crate::look::top::view::{ProcessRow, TopicRow};

/// Lines of the picture of past rates.
const HISTORY_LINES: u16 = 6;

pub fn draw(frame: &mut Frame, app: &App, style: Style, area: Rect) {
    match (app.panel, app.topic(), app.process()) {
        (Panel::Topics, Some(row), _) => topic(frame, row, style, area),
        (Panel::Processes, _, Some(row)) => process(frame, row, style, area),
        (panel, _, _) => {
            let what = if panel == Panel::Topics {
                "topic"
            } else {
                "process"
            };
            let text = format!("There is no {what} here to show. Esc goes back.");
            frame.render_widget(Paragraph::new(text).block(Block::bordered()), area);
        }
    }
}

fn topic(frame: &mut Frame, row: &TopicRow, style: Style, area: Rect) {
    let [above, below] =
        Layout::vertical([Constraint::Min(0), Constraint::Length(HISTORY_LINES)]).areas(area);
    let mut lines = vec![
        field(
            "type",
            format!("{} ({})", row.type_name, row.kind.name()),
            style,
        ),
        field(
            "rate",
            format!(
                "{} Hz, {} a second, by the numbers and times in the headers",
                rate(row.rate_hz),
                bytes(row.bytes_per_sec)
            ),
            style,
        ),
        field(
            "newest",
            format!(
                "number {}, tick {}, {}, published {} ago",
                row.seq.map_or(UNKNOWN.into(), |seq| seq.to_string()),
                row.tick.map_or(UNKNOWN.into(), |tick| tick.to_string()),
                bytes(row.payload_bytes.map(|n| n as f64)),
                time(row.age_nanos)
            ),
            style,
        ),
    ];
    if row.since_sensor_nanos.is_some() {
        let text = format!(
            "{} from the oldest sensor frame behind it to its publishing",
            time(row.since_sensor_nanos)
        );
        lines.push(field("latency", text, style));
    }
    lines.push(field(
        "largest",
        bytes(Some(row.max_payload_bytes as f64)),
        style,
    ));
    lines.push(field("written by", members(&row.writers), style));
    let places = format!(
        "{} of {} places: {}",
        row.n_readers,
        row.max_readers,
        members(&row.readers)
    );
    lines.push(field("read by", places, style));
    match &row.measured {
        None => lines.push(field("measured", "not read by top: no losses, jitter or delay; m reads it (takes a reader's place)".into(), style)),
        Some(of) if !of.fault.is_empty() => lines.push(field("measured", of.fault.clone(), style)),
        Some(of) => lines.push(field(
            "measured",
            format!(
                "by top's own reader: {} samples, {} lost, {} refused, jitter {}, delay p50 {} p99 {}",
                of.samples, of.lost, of.refused, time(of.jitter_nanos), time(of.delay_nanos_p50), time(of.delay_nanos_p99)
            ),
            style,
        )),
    }
    let text = Paragraph::new(lines)
        .wrap(Wrap { trim: false })
        .block(Block::bordered().title(format!(" {} ", row.topic)));
    frame.render_widget(text, above);
    let width = below.width.saturating_sub(2) as usize;
    let from = row.rate_history.len().saturating_sub(width);
    let shown = &row.rate_history[from..];
    let most = shown.iter().copied().fold(0.0, f64::max);
    // Hundredths, because a bar's height is a whole number.
    let bars = Sparkline::default()
        .data(shown.iter().map(|hz| (hz * 100.0) as u64))
        .max(((most * 100.0) as u64).max(1))
        .style(style.frames())
        .block(
            Block::bordered().title(format!(" Rate over time, at most {} Hz ", rate(Some(most)))),
        );
    frame.render_widget(bars, below);
}

fn process(frame: &mut Frame, row: &ProcessRow, style: Style, area: Rect) {
    let cpu = row
        .cpu_percent
        .map_or(UNKNOWN.into(), |cpu| format!("{cpu:.1} % of a core"));
    let up = time(row.uptime_secs.map(|secs| secs * 1_000_000_000));
    let mut lines = vec![
        field("pid", row.pid.to_string(), style),
        field("load", cpu, style),
        field(
            "memory",
            format!(
                "{} resident, with the shared memory that it has mapped",
                bytes(row.resident_bytes.map(|n| n as f64))
            ),
            style,
        ),
        field(
            "up",
            format!("{up}{}", if row.stopped { ", stopped" } else { "" }),
            style,
        ),
    ];
    for (name, topics) in [("writes", &row.writes), ("reads", &row.reads)] {
        let text = match topics.is_empty() {
            true => UNKNOWN.into(),
            false => topics.join(", "),
        };
        lines.push(field(name, text, style));
    }
    for (i, stage) in row.stages.iter().enumerate() {
        let of_tick = stage.cpu_ms_per_tick.map_or(String::new(), |ms| {
            format!(", {ms:.2} ms of processors a tick")
        });
        let text = format!(
            "{:<16} {:5.1} % of a core{of_tick}",
            stage.stage, stage.cpu_percent
        );
        lines.push(field(if i == 0 { "stages" } else { "" }, text, style));
    }
    let text = Paragraph::new(lines)
        .wrap(Wrap { trim: false })
        .block(Block::bordered().title(format!(" {} ", row.name)));
    frame.render_widget(text, area);
}

fn field(name: &str, text: String, style: Style) -> Line<'static> {
    Line::from(vec![
        Span::styled(format!("{name:<11}"), style.head()),
        Span::raw(text),
    ])
}

fn members(members: &[Member]) -> String {
    let one = |member: &Member| match member.pid {
        Some(pid) => format!("{} ({pid})", member.name),
        None => member.name.clone(),
    };
    match members.is_empty() {
        true => "nobody".into(),
        false => members.iter().map(one).collect::<Vec<_>>().join(", "),
    }
}
