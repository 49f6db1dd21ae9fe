//! The table of topics.

use ratatui::Frame;
use ratatui::layout::{Constraint, Rect};
use ratatui::text::Line;
use ratatui::widgets::{Block, Cell, Row, Table, TableState};

use super::Style;
use crate::cli::Column;
use crate::look::census::{Kind, names};
use crate::look::top::app::{App, Panel};
use crate::look::top::units::{UNKNOWN, bytes, rate, time};
use crate::look::top::view::TopicRow;

pub fn draw(frame: &mut Frame, app: &App, style: Style, area: Rect) {
    let rows = app.topics();
    let name_width = rows
        .iter()
        .map(|row| row.topic.chars().count())
        .max()
        .unwrap_or(5)
        .clamp(5, 40);
    let type_width = rows
        .iter()
        .map(|row| row.type_name.chars().count())
        .max()
        .unwrap_or(4)
        .clamp(4, 14);
    let heads = [
        (Column::Name, "TOPIC", name_width as u16, false),
        (Column::Type, "TYPE", type_width as u16, false),
        (Column::Rate, "Hz", 6, true),
        (Column::Age, "AGE", 7, true),
        (Column::Bw, "PER SEC", 8, true),
        (Column::Lost, "LOST", 6, true),
        (Column::Readers, "READERS", 7, true),
    ];
    let arrow = if app.reversed { "▲" } else { "▼" };
    let head = |(column, name, _, right): &(Column, &str, u16, bool)| {
        let mark = if *column == app.sort { arrow } else { "" };
        let line = Line::from(format!("{name}{mark}"));
        Cell::from(if *right { line.right_aligned() } else { line })
    };
    let mut head: Vec<Cell> = heads.iter().map(head).collect();
    head.extend(["WRITTEN BY", "READ BY"].map(Cell::from));
    let mut widths: Vec<Constraint> = heads
        .iter()
        .map(|(_, _, width, _)| Constraint::Length(*width))
        .collect();
    widths.extend([Constraint::Fill(1), Constraint::Fill(2)]);
    let filter = match app.filter.as_str() {
        "" => String::new(),
        text => format!("with {text:?} "),
    };
    let mut block = Block::bordered().title(format!(" Topics: {} {filter}", rows.len()));
    if app.panel == Panel::Topics {
        block = block.border_style(style.active());
    }
    let table = Table::new(rows.iter().map(|row| cells(row, style)), widths)
        .header(Row::new(head).style(style.head()))
        .row_highlight_style(style.selected())
        .block(block);
    let mut state = TableState::new().with_selected(app.selected_topic());
    frame.render_stateful_widget(table, area, &mut state);
}

fn cells(row: &TopicRow, style: Style) -> Row<'static> {
    let right = |text: String| Line::from(text).right_aligned();
    let lost = match row.lost() {
        None => right(UNKNOWN.into()),
        Some(0) => right("0●".into()),
        Some(n) => right(format!("{n}●")).style(style.alarm()),
    };
    let mut readers = right(format!("{}/{}", row.n_readers, row.max_readers));
    if row.n_readers >= row.max_readers {
        readers = readers.style(style.alarm());
    }
    let look = match row.kind {
        Kind::Frames => style.frames(),
        Kind::Results => style.results(),
        kind if kind.is_control() => style.controls(),
        _ => ratatui::style::Style::new(),
    };
    let lines = [
        Line::styled(row.topic.clone(), look),
        Line::raw(row.type_name.clone()),
        right(rate(row.rate_hz)),
        right(time(row.age_nanos)),
        right(bytes(row.bytes_per_sec)),
        lost,
        readers,
        Line::raw(names(&row.writers)),
        Line::raw(names(&row.readers)),
    ];
    Row::new(lines.map(Cell::from))
}
