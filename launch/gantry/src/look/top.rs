//! `gantry top`: processes and topics on a screen, as text, or as JSON.
//!
//! In reading order: [`sampler`] looks at bus and machine and makes a [`view`], for which
//! [`history`] keeps rates, [`stages`] what processes spend their time in, and [`measure`] has
//! readers of its own; [`app`] is the screen's state and its keys, [`screen`] draws it, [`terminal`]
//! takes the terminal over and gives it back.

mod app;
mod history;
mod measure;
mod sampler;
mod screen;
mod stages;
mod terminal;
#[cfg(test)]
mod tests;
mod units;
mod view;

use std::time::{Duration, Instant};

use launch_cli::{ColorWhen, CommonArgs, Exit, Shutdown};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::Buffer;

use crate::cli::TopArgs;
use crate::look::census::nothing_runs;
use app::App;
use sampler::Sampler;
use screen::Style;

/// Which tables there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tables {
    /// Processes and topics.
    Both,
    /// Topics alone.
    Topics,
}

/// Width of the plain-text screen where stdout is no terminal, characters.
const PLAIN_WIDTH: u16 = 140;
/// Time between two glances at the writers.
const GLANCE: Duration = Duration::from_millis(10);

pub fn run(args: &TopArgs, tables: Tables, common: &CommonArgs) -> anyhow::Result<Exit> {
    let is_screen = !args.once && !args.json;
    if is_screen {
        terminal::check()?;
    } else {
        common.init_logging();
    }
    let mut sampler = Sampler::new(&common.domain)?;
    for topic in &args.measure {
        let start = format!("{}/", common.domain);
        let topic = topic.strip_prefix(&start).unwrap_or(topic);
        sampler.measure(topic)?;
    }
    let every = args.every.duration();
    if is_screen {
        let view = sampler.look()?;
        let with_processes = tables == Tables::Both;
        let mut app = App::new(view, with_processes, args.sort, &args.filter, every);
        let coloured = common.color != ColorWhen::Never;
        terminal::run(&mut sampler, &mut app, Style { coloured })?;
        return Ok(Exit::Done);
    }
    let shutdown = Shutdown::install()?;
    loop {
        let start = Instant::now();
        while start.elapsed() < every && !shutdown.wait(GLANCE) {
            sampler.glance();
        }
        if shutdown.requested() {
            return Ok(Exit::Done);
        }
        let view = sampler.look()?;
        if args.once && view.topics.is_empty() {
            eprintln!("{}", nothing_runs(&common.domain));
        }
        let app = App::new(view, tables == Tables::Both, args.sort, &args.filter, every);
        if args.json {
            println!("{}", json(&app)?);
        } else if !app.view.topics.is_empty() {
            println!("{}", plain(&app, width())?);
        }
        if args.once {
            return Ok(Exit::Done);
        }
    }
}

/// The view as JSON, filtered and sorted as on the screen.
fn json(app: &App) -> anyhow::Result<String> {
    let mut value = serde_json::to_value(&app.view)?;
    value["processes"] = serde_json::to_value(app.processes())?;
    value["topics"] = serde_json::to_value(app.topics())?;
    Ok(value.to_string())
}

/// The screen as plain text, as many lines as it needs.
fn plain(app: &App, width: u16) -> anyhow::Result<String> {
    let lines = u16::try_from(screen::needed_lines(app)).unwrap_or(u16::MAX);
    let lines = lines.max(screen::LEAST.1);
    let mut terminal = Terminal::new(TestBackend::new(width.max(screen::LEAST.0), lines))?;
    terminal.draw(|frame| screen::draw(frame, app, Style { coloured: false }))?;
    let mut text = text_of(terminal.backend().buffer());
    // The last line says what keys do.
    text.truncate(text.rfind('\n').unwrap_or(text.len()));
    Ok(text)
}

/// A buffer's lines without trailing blanks.
fn text_of(buffer: &Buffer) -> String {
    let width = buffer.area.width.max(1) as usize;
    let line = |cells: &[ratatui::buffer::Cell]| {
        let text: String = cells.iter().map(|cell| cell.symbol()).collect();
        text.trim_end().to_owned()
    };
    let lines: Vec<String> = buffer.content.chunks(width).map(line).collect();
    lines.join("\n").trim_end().to_owned()
}

/// Width of the terminal, if stdout is one.
fn width() -> u16 {
    use std::io::IsTerminal as _;
    let terminal = std::io::stdout().is_terminal();
    let size = terminal
        .then(|| ratatui::crossterm::terminal::size().ok())
        .flatten();
    size.map_or(PLAIN_WIDTH, |(width, _)| width)
}
