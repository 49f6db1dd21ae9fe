//! What the screen shows of a [`View`], and what the keys do to it.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use std::time::Duration;

use super::view::{ProcessRow, TopicRow, View};
use crate::cli::Column;

/// Which table the keys move in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Panel {
    /// Processes.
    Processes,
    /// Topics.
    Topics,
}

/// What is shown in the tables' place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Page {
    /// The tables.
    Tables,
    /// Everything about the selected topic or process.
    Details,
    /// Who reads what.
    Graph,
    /// What the keys do.
    Help,
}

/// What a key asks of the program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wish {
    /// Nothing beyond the screen.
    None,
    /// The end.
    Quit,
    /// Begin or end reading a topic; `even_if_unread` also one that nobody reads.
    Measure { topic: String, even_if_unread: bool },
}

/// The screen's state.
#[derive(Clone, Debug)]
pub struct App {
    /// What is shown.
    pub view: View,
    /// Whether processes are shown.
    pub with_processes: bool,
    pub page: Page,
    pub panel: Panel,
    pub sort: Column,
    pub reversed: bool,
    pub filter: String,
    /// Whether keys go into the filter.
    pub typing: bool,
    pub paused: bool,
    /// Time between looks.
    pub every: Duration,
    /// The newest sentence for the user.
    pub notice: String,
    /// Selected topic and process, by name and pid, so that they stay while rows move.
    topic: Option<String>,
    pid: Option<u32>,
    /// First line of a page that is longer than the screen.
    pub scroll: usize,
}

/// Rows that PgUp and PgDn move by.
const PAGE: isize = 10;
const PACES_MS: [u64; 8] = [100, 200, 500, 1000, 2000, 5000, 10_000, 60_000];

impl App {
    pub fn new(
        view: View,
        with_processes: bool,
        sort: Column,
        filter: &str,
        every: Duration,
    ) -> Self {
        App {
            view,
            with_processes,
            page: Page::Tables,
            panel: Panel::Topics,
            sort,
            reversed: false,
            filter: filter.to_owned(),
            typing: false,
            paused: false,
            every,
            notice: String::new(),
            topic: None,
            pid: None,
            scroll: 0,
        }
    }

    /// Takes in a newer view.
    pub fn update(&mut self, view: View) {
        if !self.paused {
            self.view = view;
        }
    }

    /// Topics in the order of the screen.
    pub fn topics(&self) -> Vec<&TopicRow> {
        let mut rows: Vec<&TopicRow> = self
            .view
            .topics
            .iter()
            .filter(|row| row.fits(&self.filter))
            .collect();
        // Greatest first; what is not known last.
        let down = |a: Option<f64>, b: Option<f64>| b.unwrap_or(-1.0).total_cmp(&a.unwrap_or(-1.0));
        let of = |n: Option<u64>| n.map(|n| n as f64);
        rows.sort_by(|a, b| match self.sort {
            Column::Name => a.topic.cmp(&b.topic),
            Column::Type => (&a.type_name, &a.topic).cmp(&(&b.type_name, &b.topic)),
            Column::Rate => down(a.rate_hz, b.rate_hz),
            Column::Age => down(of(a.age_nanos), of(b.age_nanos)),
            Column::Bw => down(a.bytes_per_sec, b.bytes_per_sec),
            Column::Lost => down(of(a.lost()), of(b.lost())),
            Column::Readers => b.n_readers.cmp(&a.n_readers),
        });
        if self.reversed {
            rows.reverse();
        }
        rows
    }

    /// Processes in the order of the screen: by pid.
    pub fn processes(&self) -> Vec<&ProcessRow> {
        let rows = self.view.processes.iter();
        rows.filter(|row| row.fits(&self.filter)).collect()
    }

    /// Index of the selected topic among [`App::topics`].
    pub fn selected_topic(&self) -> Option<usize> {
        let wanted = self.topic.as_deref()?;
        self.topics().iter().position(|row| row.topic == wanted)
    }

    /// Index of the selected process among [`App::processes`].
    pub fn selected_process(&self) -> Option<usize> {
        self.processes()
            .iter()
            .position(|row| Some(row.pid) == self.pid)
    }

    /// The selected topic.
    pub fn topic(&self) -> Option<&TopicRow> {
        self.topics().get(self.selected_topic()?).copied()
    }

    /// The selected process.
    pub fn process(&self) -> Option<&ProcessRow> {
        self.processes().get(self.selected_process()?).copied()
    }

    /// Does what a key stands for.
    pub fn key(&mut self, key: KeyEvent) -> Wish {
        let ctrl = key.modifiers.contains(KeyModifiers::CONTROL);
        if ctrl && matches!(key.code, KeyCode::Char('c' | 'd')) {
            return Wish::Quit;
        }
        self.notice.clear();
        if self.typing {
            self.type_filter(key.code);
            return Wish::None;
        }
        match key.code {
            KeyCode::Char('q') => return Wish::Quit,
            KeyCode::Esc => self.back(),
            KeyCode::Char('?' | 'h') => self.toggle(Page::Help),
            KeyCode::Char('g') => self.toggle(Page::Graph),
            KeyCode::Enter => self.open_details(),
            KeyCode::Tab | KeyCode::BackTab => self.next_panel(),
            KeyCode::Down | KeyCode::Char('j') => self.step(1),
            KeyCode::Up | KeyCode::Char('k') => self.step(-1),
            KeyCode::PageDown => self.step(PAGE),
            KeyCode::PageUp => self.step(-PAGE),
            KeyCode::Home => self.step(isize::MIN / 2),
            KeyCode::End => self.step(isize::MAX / 2),
            KeyCode::Char('s') => self.sort = self.sort.next(),
            KeyCode::Char('r') => self.reversed = !self.reversed,
            KeyCode::Char('/') => self.typing = true,
            KeyCode::Char('p' | ' ') => self.paused = !self.paused,
            KeyCode::Char('+') => self.pace(-1),
            KeyCode::Char('-') => self.pace(1),
            KeyCode::Char(m @ ('m' | 'M')) => return self.measure(m == 'M'),
            _ => {}
        }
        Wish::None
    }

    fn type_filter(&mut self, code: KeyCode) {
        match code {
            KeyCode::Enter => self.typing = false,
            KeyCode::Esc => {
                self.typing = false;
                self.filter.clear();
            }
            KeyCode::Backspace => drop(self.filter.pop()),
            KeyCode::Char(c) => self.filter.push(c),
            _ => {}
        }
    }

    /// Esc goes back to the tables, and from there gives up the filter.
    fn back(&mut self) {
        match self.page {
            Page::Tables => self.filter.clear(),
            _ => self.show(Page::Tables),
        }
    }

    fn toggle(&mut self, page: Page) {
        let to = if self.page == page {
            Page::Tables
        } else {
            page
        };
        self.show(to);
    }

    fn show(&mut self, page: Page) {
        self.page = page;
        self.scroll = 0;
    }

    fn open_details(&mut self) {
        if self.page == Page::Details {
            return self.show(Page::Tables);
        }
        let selected = match self.panel {
            Panel::Topics => self.selected_topic(),
            Panel::Processes => self.selected_process(),
        };
        if selected.is_none() {
            self.step(0);
        }
        self.show(Page::Details);
    }

    fn next_panel(&mut self) {
        if self.with_processes {
            self.panel = match self.panel {
                Panel::Topics => Panel::Processes,
                Panel::Processes => Panel::Topics,
            };
        }
    }

    /// Moves the selection, or the lines of a page without one.
    fn step(&mut self, by: isize) {
        if matches!(self.page, Page::Graph | Page::Help) {
            self.scroll = self.scroll.saturating_add_signed(by);
            return;
        }
        let to = |at: Option<usize>, n: usize| {
            let at = at.map_or(if by > 0 { -1 } else { 0 }, |at| at as isize);
            at.saturating_add(by).clamp(0, n.saturating_sub(1) as isize) as usize
        };
        match self.panel {
            Panel::Topics => {
                let rows = self.topics();
                let row = rows.get(to(self.selected_topic(), rows.len()));
                self.topic = row.map(|row| row.topic.clone());
            }
            Panel::Processes => {
                let rows = self.processes();
                let row = rows.get(to(self.selected_process(), rows.len()));
                self.pid = row.map(|row| row.pid);
            }
        }
    }

    fn pace(&mut self, by: isize) {
        let now = self.every.as_millis() as u64;
        let at = PACES_MS
            .iter()
            .position(|pace| *pace >= now)
            .unwrap_or(PACES_MS.len() - 1);
        let at = at.saturating_add_signed(by).min(PACES_MS.len() - 1);
        self.every = Duration::from_millis(PACES_MS[at]);
        self.notice = format!("every {} s", PACES_MS[at] as f64 / 1e3);
    }

    fn measure(&mut self, even_if_unread: bool) -> Wish {
        match self.topic() {
            Some(row) => Wish::Measure {
                topic: row.topic.clone(),
                even_if_unread,
            },
            None => {
                self.notice = "select a topic first, with the arrow keys".into();
                Wish::None
            }
        }
    }
}
