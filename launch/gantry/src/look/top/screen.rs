//! Draws the screen.

mod details;
mod help;
mod processes;
mod style;
mod topics;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span, Text};
use ratatui::widgets::{Block, Paragraph, Wrap};

use super::app::{App, Page};
use super::units::{bytes, rate};
use crate::look::graph::tree;
pub use style::Style;

/// Least size that holds a table and its title.
pub const LEAST: (u16, u16) = (50, 12);

/// Which figures come from where; on the screen, because a rate without its source misleads.
const SOURCES: &str = "Hz, age and bytes: from the writers' memory, nothing is read. Lost: only of topics that top reads itself (m), marked ●";
const KEYS: &str =
    "q quit  ↑↓ select  Enter details  g graph  s sort  / filter  m measure  p pause  ? help";

/// Draws everything.
pub fn draw(frame: &mut Frame, app: &App, style: Style) {
    let area = frame.area();
    if area.width < LEAST.0 || area.height < LEAST.1 {
        let sentence = format!(
            "The terminal has {} × {} characters, gantry top needs {} × {}: enlarge it, or use gantry top --once. q quits.",
            area.width, area.height, LEAST.0, LEAST.1
        );
        let text = Paragraph::new(sentence).wrap(Wrap { trim: true });
        return frame.render_widget(text, area);
    }
    let [title, body, sources, keys] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Min(0),
        Constraint::Length(1),
        Constraint::Length(1),
    ])
    .areas(area);
    frame.render_widget(Paragraph::new(title_line(app, style)), title);
    match app.page {
        Page::Tables => tables(frame, app, style, body),
        Page::Details => details::draw(frame, app, style, body),
        Page::Graph => graph(frame, app, body),
        Page::Help => help::draw(frame, app, body),
    }
    frame.render_widget(Paragraph::new(Line::styled(SOURCES, style.dim())), sources);
    frame.render_widget(Paragraph::new(last_line(app, style)), keys);
}

/// Lines that the tables of `app` need.
pub fn needed_lines(app: &App) -> usize {
    // Title, sources and keys; frame and head of each table.
    let processes = if app.with_processes {
        app.processes().len().max(1) + 3
    } else {
        0
    };
    3 + processes + app.topics().len().max(1) + 3
}

fn title_line(app: &App, style: Style) -> Line<'static> {
    let view = &app.view;
    let mut text = format!(" · domain {}", view.domain);
    match &view.world {
        Some(world) => {
            let speed = world
                .speed
                .map_or(String::new(), |speed| format!(" · ×{speed:.2}"));
            text += &format!(
                " · tick {} · {:.2} s simulated{speed}",
                world.tick, world.sim_secs
            );
        }
        None => text += " · no simulator",
    }
    let memory = view.shared_memory;
    text += &format!(
        " · /dev/shm {} of {} free",
        bytes(Some(memory.free_bytes as f64)),
        bytes(Some(memory.size_bytes as f64))
    );
    let mut spans = vec![Span::styled("gantry top", style.title()), Span::raw(text)];
    if app.paused {
        spans.push(Span::styled(" · PAUSED", style.alarm()));
    }
    Line::from(spans)
}

fn last_line(app: &App, style: Style) -> Line<'static> {
    if app.typing {
        return Line::styled(
            format!("filter: {}▏ Enter keeps it, Esc clears it", app.filter),
            style.title(),
        );
    }
    if !app.notice.is_empty() {
        return Line::styled(app.notice.clone(), style.title());
    }
    Line::styled(KEYS, style.dim())
}

fn tables(frame: &mut Frame, app: &App, style: Style, area: Rect) {
    if !app.with_processes {
        return topics::draw(frame, app, style, area);
    }
    // Processes take what they need, but at most two fifths where topics lack room.
    let wanted = app.processes().len().max(1) + 3;
    let room = (area.height as usize).saturating_sub(app.topics().len().max(1) + 3);
    let share = wanted.min(room.max(area.height as usize * 2 / 5)).max(4);
    let share = Constraint::Length(share as u16);
    let [above, below] = Layout::vertical([share, Constraint::Min(0)]).areas(area);
    processes::draw(frame, app, style, above);
    topics::draw(frame, app, style, below);
}

/// Who reads what, as `gantry graph` prints it, with rates.
fn graph(frame: &mut Frame, app: &App, area: Rect) {
    let rows = app.topics();
    let ends = rows.iter().map(|row| tree::Ends {
        topic: &row.topic,
        type_name: &row.type_name,
        note: row
            .rate_hz
            .map(|hz| format!("{} Hz", rate(Some(hz))))
            .unwrap_or_default(),
        writers: &row.writers,
        readers: &row.readers,
    });
    let lines = tree::lines(&ends.collect::<Vec<_>>());
    let most = lines
        .len()
        .saturating_sub(area.height.saturating_sub(2) as usize);
    let from = app.scroll.min(most);
    let text = Text::from(
        lines[from..]
            .iter()
            .map(|line| Line::raw(line.clone()))
            .collect::<Vec<_>>(),
    );
    frame.render_widget(
        Paragraph::new(text).block(Block::bordered().title(" Who reads what ")),
        area,
    );
}
