//! Tables of the page: captions, heads that say what they mean, the first cell of a row as its head.

use std::fmt::Write as _;

use crate::numbers::NONE;
use crate::plot::N_COLOURS;
use crate::words::escape;

/// The head of a column.
#[derive(Clone, Debug)]
pub struct Head {
    text: String,
    is_text: bool,
    note: &'static str,
}

impl Head {
    /// A column of numbers.
    pub fn new(text: impl Into<String>) -> Head {
        Head {
            text: text.into(),
            is_text: false,
            note: "",
        }
    }

    /// A column of words.
    pub fn words(text: impl Into<String>) -> Head {
        Head {
            is_text: true,
            ..Head::new(text)
        }
    }

    /// What the column means, said when the pointer rests on it.
    pub fn note(self, note: &'static str) -> Head {
        Head { note, ..self }
    }
}

/// A cell.
#[derive(Clone, Debug, Default)]
pub struct Cell {
    text: String,
    is_best: bool,
    style: Option<usize>,
}

impl Cell {
    /// A cell that is the best of its column.
    pub fn best(mut self, is_best: bool) -> Cell {
        self.is_best = is_best;
        self
    }

    /// A cell with the colour of a series before it.
    pub fn swatch(mut self, style: usize) -> Cell {
        self.style = Some(style);
        self
    }
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Cell {
        Cell {
            text: text.into(),
            ..Cell::default()
        }
    }
}

/// A table.
#[derive(Clone, Debug)]
pub struct Table {
    caption: String,
    heads: Vec<Head>,
    body: String,
    n_rows: usize,
}

impl Table {
    /// A table without rows.
    pub fn new(caption: impl Into<String>, heads: Vec<Head>) -> Table {
        Table {
            caption: caption.into(),
            heads,
            body: String::new(),
            n_rows: 0,
        }
    }

    /// Adds a row.
    pub fn row(&mut self, cells: impl IntoIterator<Item = Cell>) {
        self.n_rows += 1;
        self.body += "<tr>";
        for (at, cell) in cells.into_iter().enumerate() {
            let text = escape(&cell.text);
            let swatch = cell.style.map_or(String::new(), |style| {
                format!("<span class=\"swatch s{}\"></span>", style % N_COLOURS)
            });
            let class = match &self.heads[at] {
                _ if cell.is_best => " class=\"best\"",
                head if head.is_text => " class=\"t\"",
                _ if text == NONE => " class=\"no\"",
                _ => "",
            };
            let _ = if at == 0 {
                write!(self.body, "<th scope=\"row\">{swatch}{text}</th>")
            } else {
                write!(self.body, "<td{class}>{swatch}{text}</td>")
            };
        }
        self.body += "</tr>\n";
    }

    /// Whether it has no row.
    pub fn is_empty(&self) -> bool {
        self.n_rows == 0
    }

    /// The table as HTML.
    pub fn html(&self) -> String {
        let mut html = String::from("<div class=\"scroll\"><table>");
        if !self.caption.is_empty() {
            let _ = write!(html, "<caption>{}</caption>", escape(&self.caption));
        }
        html += "<thead><tr>";
        for head in &self.heads {
            let class = if head.is_text { " class=\"t\"" } else { "" };
            let note = match head.note {
                "" => String::new(),
                note => format!(" title=\"{}\"", escape(note)),
            };
            let _ = write!(
                html,
                "<th scope=\"col\"{class}{note}>{}</th>",
                escape(&head.text)
            );
        }
        let _ = write!(
            html,
            "</tr></thead>\n<tbody>\n{}</tbody></table></div>\n",
            self.body
        );
        html
    }
}

/// Something that is opened by a click.
pub fn details(summary: &str, html: &str) -> String {
    format!(
        "<details><summary>{}</summary>{html}</details>\n",
        escape(summary)
    )
}
