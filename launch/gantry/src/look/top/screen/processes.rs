//! The table of processes.

use ratatui::Frame;
use ratatui::layout::{Constraint, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Cell, Row, Table, TableState};

use super::Style;
use crate::look::top::app::{App, Panel};
use crate::look::top::units::{UNKNOWN, bytes, time};
use crate::look::top::view::ProcessRow;

pub fn draw(frame: &mut Frame, app: &App, style: Style, area: Rect) {
    let rows = app.processes();
    let head = [
        "    PID",
        "NAME",
        " CPU %",
        "   MEMORY",
        "     UP",
        "WRITES",
        "READS",
    ];
    let widths = [
        Constraint::Length(7),
        Constraint::Fill(2),
        Constraint::Length(6),
        Constraint::Length(9),
        Constraint::Length(7),
        Constraint::Fill(3),
        Constraint::Fill(3),
    ];
    let title = format!(" Processes: {} ", rows.len());
    let mut block = Block::bordered().title(title);
    if app.panel == Panel::Processes {
        block = block.border_style(style.active());
    }
    let table = Table::new(rows.iter().map(|row| cells(row, style)), widths)
        .header(Row::new(head).style(style.head()))
        .row_highlight_style(style.selected())
        .block(block);
    let mut state = TableState::new().with_selected(app.selected_process());
    frame.render_stateful_widget(table, area, &mut state);
}

fn cells(row: &ProcessRow, style: Style) -> Row<'static> {
    let right = |text: String| Cell::from(Line::from(text).right_aligned());
    let cpu = row
        .cpu_percent
        .map_or(UNKNOWN.into(), |cpu| format!("{cpu:.0}"));
    let name = match row.stopped {
        true => Line::from(vec![
            Span::raw(row.name.clone()),
            Span::styled(" stopped", style.alarm()),
        ]),
        false => Line::raw(row.name.clone()),
    };
    Row::new([
        right(row.pid.to_string()),
        Cell::from(name),
        right(cpu),
        right(bytes(row.resident_bytes.map(|n| n as f64))),
        right(time(row.uptime_secs.map(|secs| secs * 1_000_000_000))),
        Cell::from(some(&row.writes)),
        Cell::from(some(&row.reads)),
    ])
}

/// `3: a, b, c`; the cell cuts what is too long.
fn some(topics: &[String]) -> String {
    match topics.is_empty() {
        true => UNKNOWN.into(),
        false => format!("{}: {}", topics.len(), topics.join(", ")),
    }
}
