//! The terminal: taken over for the screen, and given back whatever happens.

use std::io::IsTerminal as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use launch_cli::{Shutdown, wrong_usage};
use ratatui::crossterm::event::{self, Event, KeyEventKind};

use super::app::{App, Wish};
use super::sampler::Sampler;
use super::screen::{self, Style};

/// Time between two glances at the writers, and longest wait for a key.
const GLANCE: Duration = Duration::from_millis(10);

/// A terminal that is given back when this is dropped; a panic gives it back before its message is
/// printed.
struct Screen {
    terminal: ratatui::DefaultTerminal,
}

impl Screen {
    fn open() -> anyhow::Result<Screen> {
        let terminal = ratatui::try_init()
            .context("cannot use this terminal; `gantry top --once` prints plain text")?;
        Ok(Screen { terminal })
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        ratatui::restore();
    }
}

/// Fails with a sentence if there is no terminal to draw on.
pub fn check() -> anyhow::Result<()> {
    if !std::io::stdout().is_terminal() {
        return Err(wrong_usage(
            "stdout is no terminal, so there is no screen to draw on; use `gantry top --once`, or --json for programs",
        ));
    }
    Ok(())
}

/// Shows the screen until q, Ctrl-C or a signal.
pub fn run(sampler: &mut Sampler, app: &mut App, style: Style) -> anyhow::Result<()> {
    let shutdown = Shutdown::install()?;
    // A terminal that is closed, and the keyboard's other way to end a program.
    let ended = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGHUP, signal_hook::consts::SIGQUIT] {
        signal_hook::flag::register(signal, ended.clone())
            .with_context(|| format!("cannot listen for signal {signal}"))?;
    }
    let mut screen = Screen::open()?;
    let mut looked = Instant::now();
    let mut stale = true;
    while !shutdown.requested() && !ended.load(Ordering::Acquire) {
        if stale {
            screen
                .terminal
                .draw(|frame| screen::draw(frame, app, style))
                .context("cannot draw on the terminal")?;
            stale = false;
        }
        if event::poll(GLANCE).context("cannot read the keyboard")? {
            match event::read().context("cannot read the keyboard")? {
                Event::Key(key) if key.kind != KeyEventKind::Release => match app.key(key) {
                    Wish::Quit => break,
                    Wish::Measure {
                        topic,
                        even_if_unread,
                    } => app.notice = sampler.toggle_measuring(&topic, even_if_unread)?,
                    Wish::None => {}
                },
                _ => {}
            }
            stale = true;
        }
        sampler.glance();
        if looked.elapsed() >= app.every {
            looked = Instant::now();
            app.update(sampler.look()?);
            stale = true;
        }
    }
    Ok(())
}
