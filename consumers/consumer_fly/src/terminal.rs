//! A terminal that shows the image in coloured half blocks: it works over SSH and needs no display.

use std::collections::BTreeMap;
use std::io::{IsTerminal as _, Write};
use std::time::{Duration, Instant};

use anyhow::{Context as _, ensure};
use crossterm::cursor::{Hide, MoveTo, Show};
use crossterm::event::{
    self, DisableMouseCapture, EnableMouseCapture, Event, KeyCode, KeyEvent, KeyEventKind,
    KeyModifiers, KeyboardEnhancementFlags, MouseEvent, MouseEventKind,
    PopKeyboardEnhancementFlags, PushKeyboardEnhancementFlags,
};
use crossterm::style::{Color, Colors, Print, ResetColor, SetColors};
use crossterm::terminal::{
    Clear, ClearType, EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode,
    enable_raw_mode, size, supports_keyboard_enhancement,
};
use crossterm::{execute, queue};

use crate::input::{Held, Input, of_letter};
use crate::scale::{fit, scaled};
use crate::screen::{Picture, Screen};

/// Least time between two images: a line to a distant machine is narrow.
const SHOW_EVERY: Duration = Duration::from_millis(66);
/// How long a key counts as held where the terminal does not say that it went up. Keys repeat
/// faster than this.
const HOLD: Duration = Duration::from_millis(350);
/// Turn of the view per cell that the mouse is dragged, radians.
const TURN_PER_CELL: f64 = 0.03;

/// A cell: the colours of its upper and of its lower half, red, green, blue.
type Cell = [[u8; 3]; 2];

/// A terminal in raw mode; dropping it gives it back.
#[derive(Debug)]
pub struct Terminal<W: Write> {
    out: W,
    /// Whether the terminal says when keys go up.
    tells_releases: bool,
    /// Whether it has colours of 24 bits.
    has_all_colours: bool,
    /// Keys that went down and when they count as up again.
    held: BTreeMap<Held, Instant>,
    dragged_from: Option<[u16; 2]>,
    /// Columns and rows.
    size: [u16; 2],
    /// What stands there.
    cells: Vec<Cell>,
    shown: Option<Instant>,
    line: String,
}

impl Terminal<std::io::Stdout> {
    /// Takes over the terminal that this program was started in.
    ///
    /// # Errors
    /// If there is none.
    pub fn open() -> anyhow::Result<Self> {
        ensure!(
            std::io::stdout().is_terminal() && std::io::stdin().is_terminal(),
            "flying needs a display (set DISPLAY) or a terminal; here is neither. Without both, --save FILE.rrd --spectator writes the spectator's images into a file"
        );
        enable_raw_mode().context("the terminal cannot be switched to single keys")?;
        let tells_releases = supports_keyboard_enhancement().unwrap_or(false);
        let colours = std::env::var("COLORTERM").unwrap_or_default();
        let (columns, rows) = size().unwrap_or((80, 24));
        let mut terminal = Terminal {
            out: std::io::stdout(),
            tells_releases,
            has_all_colours: colours.contains("truecolor") || colours.contains("24bit"),
            held: BTreeMap::new(),
            dragged_from: None,
            size: [columns, rows],
            cells: Vec::new(),
            shown: None,
            line: String::new(),
        };
        execute!(terminal.out, EnterAlternateScreen, Hide, EnableMouseCapture)?;
        if tells_releases {
            let flags = KeyboardEnhancementFlags::REPORT_EVENT_TYPES
                | KeyboardEnhancementFlags::DISAMBIGUATE_ESCAPE_CODES;
            execute!(terminal.out, PushKeyboardEnhancementFlags(flags))?;
        }
        Ok(terminal)
    }
}

impl<W: Write> Drop for Terminal<W> {
    fn drop(&mut self) {
        // Nobody is left to hear of a failure.
        if self.tells_releases {
            let _ = execute!(self.out, PopKeyboardEnhancementFlags);
        }
        let _ = execute!(
            self.out,
            DisableMouseCapture,
            ResetColor,
            Show,
            LeaveAlternateScreen
        );
        let _ = disable_raw_mode();
    }
}

impl<W: Write> Terminal<W> {
    fn take(&mut self, event: Event, now: Instant, inputs: &mut Vec<Input>) {
        match event {
            Event::Key(key) => self.key(&key, now, inputs),
            Event::Mouse(mouse) => self.mouse(&mouse, inputs),
            Event::FocusLost => inputs.push(Input::ReleaseAll),
            Event::Resize(columns, rows) => {
                self.size = [columns, rows];
                self.cells.clear();
                self.line.clear();
            }
            _ => {}
        }
    }

    fn key(&mut self, key: &KeyEvent, now: Instant, inputs: &mut Vec<Input>) {
        let down = key.kind != KeyEventKind::Release;
        let input = match key.code {
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => {
                Some(Input::Close)
            }
            KeyCode::Char(letter) => of_letter(letter, down),
            KeyCode::Left => Some(Input::Hold(Held::TurnLeft, down)),
            KeyCode::Right => Some(Input::Hold(Held::TurnRight, down)),
            KeyCode::Up => Some(Input::Hold(Held::LookUp, down)),
            KeyCode::Down => Some(Input::Hold(Held::LookDown, down)),
            KeyCode::PageUp => down.then_some(Input::Wheel(1.0)),
            KeyCode::PageDown => down.then_some(Input::Wheel(-1.0)),
            KeyCode::Esc => Some(Input::Close),
            _ => None,
        };
        let Some(input) = input else { return };
        inputs.push(input);
        if let Input::Hold(held, down) = input {
            let shift = key.modifiers.contains(KeyModifiers::SHIFT)
                || matches!(key.code, KeyCode::Char(letter) if letter.is_ascii_uppercase());
            inputs.push(Input::Hold(Held::Fast, shift && down));
            if down && !self.tells_releases {
                self.held.insert(held, now + HOLD);
            }
        }
    }

    fn mouse(&mut self, mouse: &MouseEvent, inputs: &mut Vec<Input>) {
        let now = [mouse.column, mouse.row];
        match mouse.kind {
            MouseEventKind::Down(_) => self.dragged_from = Some(now),
            MouseEventKind::Up(_) => self.dragged_from = None,
            MouseEventKind::Drag(_) => {
                let before = self.dragged_from.replace(now).unwrap_or(now);
                let by = |i: usize| f64::from(now[i]) - f64::from(before[i]);
                inputs.push(Input::Turn {
                    yaw_rad: -by(0) * TURN_PER_CELL,
                    // A cell is twice as high as wide.
                    pitch_rad: by(1) * 2.0 * TURN_PER_CELL,
                });
            }
            MouseEventKind::ScrollUp => inputs.push(Input::Wheel(1.0)),
            MouseEventKind::ScrollDown => inputs.push(Input::Wheel(-1.0)),
            _ => {}
        }
    }

    /// Lets go of keys that were not hit again.
    fn release(&mut self, now: Instant, inputs: &mut Vec<Input>) {
        let up: Vec<Held> = self
            .held
            .iter()
            .filter(|(_, until)| **until <= now)
            .map(|(held, _)| *held)
            .collect();
        for held in up {
            self.held.remove(&held);
            inputs.push(Input::Hold(held, false));
        }
    }

    /// Columns and rows of the image: all but the last row.
    fn room(&self) -> [u32; 2] {
        let [columns, rows] = self.size.map(u32::from);
        [columns.max(1), rows.saturating_sub(1).max(1)]
    }

    fn colour(&self, [r, g, b]: [u8; 3]) -> Color {
        if self.has_all_colours {
            Color::Rgb { r, g, b }
        } else {
            Color::AnsiValue(of_cube([r, g, b]))
        }
    }

    /// Writes the cells that differ from what stands there.
    fn write(&mut self, cells: Vec<Cell>) -> anyhow::Result<()> {
        let [columns, _] = self.room();
        let known = self.cells.len() == cells.len();
        let mut next_at = None;
        for (idx, cell) in cells.iter().enumerate() {
            if known && self.cells[idx] == *cell {
                continue;
            }
            if next_at != Some(idx) {
                let (row, column) = (idx as u32 / columns, idx as u32 % columns);
                queue!(self.out, MoveTo(column as u16, row as u16))?;
            }
            let [upper, lower] = cell.map(|half| self.colour(half));
            queue!(self.out, SetColors(Colors::new(upper, lower)), Print('▀'))?;
            // The cursor does not go on from the last column.
            next_at = (!(idx as u32 + 1).is_multiple_of(columns)).then_some(idx + 1);
        }
        queue!(self.out, ResetColor)?;
        self.out.flush()?;
        self.cells = cells;
        Ok(())
    }
}

impl<W: Write> Screen for Terminal<W> {
    fn poll(&mut self) -> anyhow::Result<Vec<Input>> {
        let (mut inputs, now) = (Vec::new(), Instant::now());
        while event::poll(Duration::ZERO).context("the terminal has gone")? {
            let event = event::read().context("the terminal has gone")?;
            self.take(event, now, &mut inputs);
        }
        self.release(now, &mut inputs);
        Ok(inputs)
    }

    fn show(&mut self, picture: &Picture<'_>) -> anyhow::Result<()> {
        if self.shown.is_some_and(|at| at.elapsed() < SHOW_EVERY) {
            return Ok(());
        }
        let room = self.room();
        if let Some(cells) = cells(picture, room) {
            self.shown = Some(Instant::now());
            self.write(cells)?;
        }
        Ok(())
    }

    fn say(&mut self, line: &str) -> anyhow::Result<()> {
        let [columns, rows] = self.size;
        let line: String = line.chars().take(usize::from(columns)).collect();
        if line != self.line {
            queue!(
                self.out,
                MoveTo(0, rows.saturating_sub(1)),
                ResetColor,
                Clear(ClearType::CurrentLine),
                Print(&line)
            )?;
            self.out.flush()?;
            self.line = line;
        }
        Ok(())
    }
}

/// The image in cells, black around it.
fn cells(picture: &Picture<'_>, [columns, rows]: [u32; 2]) -> Option<Vec<Cell>> {
    let halves = [columns, 2 * rows];
    let (size, [left, top]) = fit([picture.width_px, picture.height_px], halves);
    let pixels = scaled(picture, size)?;
    let at = |x: u32, y: u32| {
        let inside = (left..left + size[0]).contains(&x) && (top..top + size[1]).contains(&y);
        if !inside {
            return [0; 3];
        }
        let [b, g, r, _] = pixels[((y - top) * size[0] + x - left) as usize];
        [r, g, b]
    };
    let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
    Some(
        places
            .map(|(column, row)| [at(column, 2 * row), at(column, 2 * row + 1)])
            .collect(),
    )
}

/// The nearest colour of the cube of 6 × 6 × 6 that terminals with 256 colours have.
fn of_cube(rgb: [u8; 3]) -> u8 {
    // Levels are 0, 95, 135, 175, 215, 255.
    let [r, g, b] = rgb.map(|level| match level {
        0..48 => 0,
        48..115 => 1,
        _ => (level - 35) / 40,
    });
    16 + 36 * r + 6 * g + b
}

#[cfg(test)]
mod tests {
    use super::*;

    fn terminal(size: [u16; 2]) -> Terminal<Vec<u8>> {
        Terminal {
            out: Vec::new(),
            tells_releases: false,
            has_all_colours: true,
            held: BTreeMap::new(),
            dragged_from: None,
            size,
            cells: Vec::new(),
            shown: None,
            line: String::new(),
        }
    }

    #[test]
    fn halves_of_cells_are_pixels_and_only_changes_are_written() {
        // A red row over a blue one, in a terminal with one row for the image and one for the text.
        let red = [0, 0, 200, 255].repeat(4);
        let blue = [100, 0, 0, 255].repeat(4);
        let bytes = [red, blue].concat();
        let picture = Picture {
            width_px: 4,
            height_px: 2,
            stride_bytes: 16,
            bgra: &bytes,
        };
        assert_eq!(
            cells(&picture, [4, 1]),
            Some(vec![[[200, 0, 0], [0, 0, 100]]; 4])
        );
        let mut screen = terminal([4, 2]);
        screen.show(&picture).unwrap();
        let text = String::from_utf8(std::mem::take(&mut screen.out)).unwrap();
        assert_eq!(text.matches('▀').count(), 4, "{text:?}");
        assert!(
            text.contains("38;2;200;0;0") && text.contains("48;2;0;0;100"),
            "{text:?}"
        );
        screen.shown = None;
        screen.show(&picture).unwrap();
        assert_eq!(String::from_utf8_lossy(&screen.out).matches('▀').count(), 0);
    }

    #[test]
    fn colours_of_256_are_the_nearest_of_the_cube() {
        assert_eq!(of_cube([0, 0, 0]), 16);
        assert_eq!(of_cube([255, 255, 255]), 231);
        assert_eq!(of_cube([95, 135, 175]), 16 + 36 + 12 + 3);
    }

    #[test]
    fn keys_are_let_go_of_where_the_terminal_does_not_say_so() {
        let mut screen = terminal([80, 24]);
        let (now, mut inputs) = (Instant::now(), Vec::new());
        let key = KeyEvent::new(KeyCode::Char('W'), KeyModifiers::SHIFT);
        screen.key(&key, now, &mut inputs);
        let forward = |down| Input::Hold(Held::Forward, down);
        assert_eq!(inputs, [forward(true), Input::Hold(Held::Fast, true)]);
        inputs.clear();
        screen.release(now, &mut inputs);
        assert!(inputs.is_empty());
        screen.release(now + HOLD, &mut inputs);
        assert_eq!(inputs, [forward(false)]);
    }
}
