//! Tables of text for a terminal.

use crate::words::shortened;

/// A kind of text that a terminal sets apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A title.
    Bold,
    /// Heads and remarks.
    Soft,
    /// The best, or for the better.
    Good,
    /// For the worse.
    Bad,
    /// To be noticed.
    Warn,
}

/// Colours of a terminal, if it has any.
#[derive(Clone, Copy, Debug)]
pub struct Paint {
    /// Whether texts are coloured.
    pub is_on: bool,
}

impl Paint {
    /// The text, set apart if the terminal has colours.
    pub fn set(self, mark: Mark, text: &str) -> String {
        if !self.is_on {
            return text.to_owned();
        }
        let code = match mark {
            Mark::Bold => "1",
            Mark::Soft => "2",
            Mark::Good => "32",
            Mark::Bad => "31",
            Mark::Warn => "33",
        };
        format!("\x1b[{code}m{text}\x1b[0m")
    }
}

/// A cell.
#[derive(Clone, Debug, Default)]
pub struct TextCell {
    text: String,
    is_best: bool,
}

impl TextCell {
    /// A cell that is the best of its column.
    pub fn best(self, is_best: bool) -> TextCell {
        TextCell { is_best, ..self }
    }
}

impl<T: Into<String>> From<T> for TextCell {
    fn from(text: T) -> TextCell {
        TextCell {
            text: text.into(),
            is_best: false,
        }
    }
}

/// The width that a table keeps to, in columns of the terminal.
#[derive(Clone, Copy, Debug)]
struct Limit {
    /// Most columns of a line.
    line: usize,
    /// Columns that names always have.
    name: usize,
}

/// A table: columns as wide as their widest cell, the first to the left, the others to the right.
#[derive(Clone, Debug)]
pub struct TextTable {
    heads: Vec<String>,
    rows: Vec<Vec<TextCell>>,
    paint: Paint,
    indent: usize,
    limit: Option<Limit>,
}

impl TextTable {
    /// A table without rows.
    pub fn new(heads: &[&str]) -> TextTable {
        TextTable {
            heads: heads.iter().map(|head| (*head).to_owned()).collect(),
            rows: Vec::new(),
            paint: Paint { is_on: false },
            indent: 0,
            limit: None,
        }
    }

    /// With colours: soft heads, and the best of a column set apart.
    pub fn painted(self, paint: Paint) -> TextTable {
        TextTable { paint, ..self }
    }

    /// With so many spaces before each line.
    pub fn indented(self, indent: usize) -> TextTable {
        TextTable { indent, ..self }
    }

    /// With names in the first column cut so that lines have at most `line` columns; `name` columns
    /// remain for them.
    pub fn within(self, line: usize, name: usize) -> TextTable {
        TextTable {
            limit: Some(Limit { line, name }),
            ..self
        }
    }

    /// Adds a row, which has a cell for each head.
    pub fn row<T: Into<TextCell>>(&mut self, cells: impl IntoIterator<Item = T>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// The table with these rows.
    pub fn rows<T: Into<TextCell>, R: IntoIterator<Item = T>>(
        mut self,
        rows: impl IntoIterator<Item = R>,
    ) -> TextTable {
        rows.into_iter().for_each(|row| self.row(row));
        self
    }

    /// The lines.
    pub fn text(&self) -> String {
        let n_columns = self.heads.len();
        let widest = |at: usize, most: usize| {
            let cells = self.rows.iter().filter_map(|row| row.get(at));
            cells
                .map(|cell| cell.text.chars().count().min(most))
                .chain([self.heads[at].chars().count()])
                .max()
                .unwrap_or(0)
        };
        let mut widths: Vec<usize> = (0..n_columns).map(|at| widest(at, usize::MAX)).collect();
        let others: usize = widths.iter().skip(1).map(|width| 2 + width).sum();
        let most_of_name = self.limit.map_or(usize::MAX, |limit| {
            limit.name.max(limit.line.saturating_sub(others))
        });
        if let Some(first) = widths.first_mut() {
            *first = widest(0, most_of_name);
        }
        let padded = |at: usize, text: &str| {
            let space = " ".repeat(widths[at].saturating_sub(text.chars().count()));
            if at == 0 {
                format!("{text}{space}")
            } else {
                format!("{space}{text}")
            }
        };
        let indent = " ".repeat(self.indent);
        let heads: Vec<String> = self
            .heads
            .iter()
            .enumerate()
            .map(|(at, head)| padded(at, head))
            .collect();
        let heads = self.paint.set(Mark::Soft, heads.join("  ").trim_end());
        let mut text = format!("{indent}{heads}\n");
        for row in &self.rows {
            let cells: Vec<String> = row
                .iter()
                .enumerate()
                .take(n_columns)
                .map(|(at, cell)| {
                    let text = match at {
                        0 => padded(at, &shortened(&cell.text, most_of_name)),
                        _ => padded(at, &cell.text),
                    };
                    if cell.is_best {
                        self.paint.set(Mark::Good, &text)
                    } else {
                        text
                    }
                })
                .collect();
            let line = format!("{indent}{}", cells.join("  "));
            text += line.trim_end();
            text.push('\n');
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let rows = [["a", "1"], ["longer", "1000"]];
        let table = TextTable::new(&["name", "n"]).rows(rows);
        assert_eq!(table.text(), "name       n\na          1\nlonger  1000\n");
        assert_eq!(
            table.indented(2).text(),
            "  name       n\n  a          1\n  longer  1000\n"
        );
    }

    #[test]
    fn names_are_cut_to_the_width_and_the_best_is_coloured() {
        let rows = [[
            TextCell::from("a long name"),
            TextCell::from("12").best(true),
        ]];
        let table = TextTable::new(&["name", "n"]).rows(rows).within(10, 4);
        assert_eq!(table.text(), "name     n\na lon…  12\n");
        let painted = table.painted(Paint { is_on: true }).text();
        assert!(painted.contains("\x1b[32m12\x1b[0m"), "{painted}");
    }
}
