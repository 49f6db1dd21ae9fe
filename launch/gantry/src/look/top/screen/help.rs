//! What the keys do, and what the columns mean.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Text};
use ratatui::widgets::{Block, Paragraph};

use crate::look::top::app::App;

const LINES: [&str; 28] = [
    "q, Ctrl-C    quit",
    "↑ ↓ j k      select; also PgUp, PgDn, Home, End",
    "Tab          between processes and topics",
    "Enter        details of the selected row, such as the stages that a process spends its",
    "             time in; again, or Esc: back",
    "g            who reads what",
    "s, r         sort topics by the next column, reverse",
    "/            filter by topic, type or process; Esc clears it",
    "m            read the selected topic for losses, jitter and delay; again: stop",
    "M            the same for a topic that nobody reads, which starts its sensor",
    "p, space     pause",
    "+ -          look more or less often",
    "",
    "Hz           samples per second by the numbers that the writer gives them; 0: silent",
    "AGE          time since the newest sample was published",
    "PER SEC      bytes per second: rate times mean payload",
    "LOST         gaps that top's own reader saw (●); what other readers lose cannot be seen",
    "             from outside, they report it themselves",
    "READERS      places taken and places there are; red: full",
    "CPU %        of one core; MEMORY is resident, with mapped shared memory",
    "–            not known: no header with a number, another user's, or seen only once",
    "",
    "Hz, AGE and PER SEC are read from the headers in the writers' memory. That starts no",
    "sensor, takes no reader's place and costs the writers nothing. A writer that fills its",
    "next sample in the place of the last hides it meanwhile, so an AGE can be a little too",
    "high; gantry topic delay measures as a reader.",
    "",
    "Controls (to the simulator) are magenta, sensors green, results of programs yellow.",
];

pub fn draw(frame: &mut Frame, app: &App, area: Rect) {
    let most = LINES
        .len()
        .saturating_sub(area.height.saturating_sub(2) as usize);
    let from = app.scroll.min(most);
    let text = Text::from(
        LINES[from..]
            .iter()
            .map(|line| Line::raw(*line))
            .collect::<Vec<_>>(),
    );
    frame.render_widget(
        Paragraph::new(text).block(Block::bordered().title(" Help ")),
        area,
    );
}
