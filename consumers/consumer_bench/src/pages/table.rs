//! Tables as `docs/benchmarks/tables.toml` describes them, and the line of sources below each.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context as _, ensure};
use serde::Deserialize;
use serde_json::Value;

use super::cell::{Context, fill};
use super::figures::Figures;

/// Description of one table.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// Heads of the columns.
    heads: Vec<String>,
    /// Rows written out, cell by cell.
    #[serde(default)]
    rows: Vec<Vec<String>>,
    /// A list in the results, `FILE/PATH`: one row per element.
    each: Option<String>,
    /// Cells of those rows.
    #[serde(default)]
    cells: Vec<String>,
}

/// All tables by name.
pub type Tables = BTreeMap<String, Table>;

/// Reads `tables.toml`.
pub fn parse(text: &str) -> anyhow::Result<Tables> {
    toml::from_str(text).context("tables.toml does not describe tables")
}

impl Table {
    /// The table as Markdown with its sources.
    pub fn markdown(
        &self,
        figures: &Figures,
        used: &mut BTreeSet<String>,
    ) -> anyhow::Result<String> {
        let mut own = BTreeSet::new();
        let mut text = line(&self.heads);
        text += &line(&vec!["---".to_owned(); self.heads.len()]);
        let context = Context {
            figures,
            element: None,
        };
        for row in &self.rows {
            text += &self.row(row, &context, &mut own)?;
        }
        if let Some(each) = &self.each {
            for list in figures.find(each, &mut own)? {
                let list = list
                    .as_array()
                    .with_context(|| format!("{each} is no list"))?;
                for element in list {
                    let context = Context {
                        figures,
                        element: Some(element),
                    };
                    text += &self.row(&self.cells, &context, &mut own)?;
                }
            }
        }
        text += "\n";
        text += &sources(figures, &own);
        used.extend(own);
        Ok(text)
    }

    fn row(
        &self,
        cells: &[String],
        context: &Context,
        used: &mut BTreeSet<String>,
    ) -> anyhow::Result<String> {
        ensure!(
            cells.len() == self.heads.len(),
            "a row has {} cells under {} heads: {cells:?}",
            cells.len(),
            self.heads.len()
        );
        let cells: anyhow::Result<Vec<String>> =
            cells.iter().map(|cell| fill(cell, context, used)).collect();
        Ok(line(&cells?))
    }
}

fn line(cells: &[String]) -> String {
    let cell = |cell: &String| match cell.as_str() {
        "" => " |".to_owned(),
        text => format!(" {text} |"),
    };
    format!("|{}\n", cells.iter().map(cell).collect::<String>())
}

/// Results that one command gave at one commit, named together in the list below a table.
struct Run<'a> {
    text: String,
    names: Vec<&'a str>,
}

/// Where the figures come from: machines, and below each one line per commit and command.
fn sources(figures: &Figures, used: &BTreeSet<String>) -> String {
    let mut machines: Vec<(String, Vec<Run<'_>>)> = Vec::new();
    for name in used {
        let result = figures.file(name).unwrap_or(&Value::Null);
        let (machine, text) = (machine_text(result), run_text(result));
        let place = machines.iter().position(|(known, _)| *known == machine);
        let place = place.unwrap_or_else(|| {
            machines.push((machine, Vec::new()));
            machines.len() - 1
        });
        let runs = &mut machines[place].1;
        match runs.iter_mut().find(|run| run.text == text) {
            Some(run) => run.names.push(name),
            None => runs.push(Run {
                text,
                names: vec![name],
            }),
        }
    }
    let mut text = String::new();
    for (machine, runs) in machines {
        text += &format!("{machine}:\n\n");
        for run in runs {
            let links: Vec<String> = run
                .names
                .iter()
                .map(|name| format!("[{name}](raw/{name}.json)"))
                .collect();
            text += &format!("- {}: {}\n", links.join(", "), run.text);
        }
        text += "\n";
    }
    text
}

/// A text of the machine's description that says something.
fn told(result: &Value, key: &str) -> Option<String> {
    result["machine"][key]
        .as_str()
        .filter(|text| !["", "none", "unknown"].contains(text))
        .map(str::to_owned)
}

/// What the result was measured on.
fn machine_text(result: &Value) -> String {
    let cores = result["machine"]["n_cores"].as_u64();
    let cores = cores.map(|n| format!("{n} cores"));
    let parts = [told(result, "gpu"), told(result, "cpu"), cores];
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    if parts.is_empty() {
        return "Machine unknown".to_owned();
    }
    parts.join(", ")
}

/// Date, load, commit and command.
fn run_text(result: &Value) -> String {
    let load = told(result, "load_1min").map(|load| format!("load {load}"));
    let commit = told(result, "commit").map(|commit| format!("commit {commit}"));
    let command = told(result, "command").map(|command| format!("`{command}`"));
    let parts = [told(result, "date"), load, commit, command];
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    if parts.is_empty() {
        return "run unknown".to_owned();
    }
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn figures() -> Figures {
        let machine = json!({"cpu": "Some CPU", "n_cores": 2, "commit": "abc", "command": "bench"});
        Figures::from_values(&[(
            "run",
            json!({"machine": machine, "rows": [{"name": "a", "ms": 1.0}, {"name": "b", "ms": 2.0}]}),
        )])
    }

    fn check(toml: &str, expected: &str) {
        let tables = parse(toml).expect("the description is right");
        let mut used = BTreeSet::new();
        let text = tables["t"]
            .markdown(&figures(), &mut used)
            .expect("the table is right");
        assert_eq!(text, expected);
        assert_eq!(used.len(), 1);
    }

    #[test]
    fn rows_are_written_out_or_made_from_a_list() {
        let source = "\nSome CPU, 2 cores:\n\n- [run](raw/run.json): commit abc, `bench`\n\n";
        check(
            "[t]\nheads = ['', 'ms']\nrows = [['first', '{run/a/ms|1}']]",
            &format!("| | ms |\n| --- | --- |\n| first | 1.0 |\n{source}"),
        );
        check(
            "[t]\nheads = ['what', 'ms']\neach = 'run/rows'\ncells = ['{./name}', '{./ms|0}']",
            &format!("| what | ms |\n| --- | --- |\n| a | 1 |\n| b | 2 |\n{source}"),
        );
    }

    #[test]
    fn rows_have_as_many_cells_as_there_are_heads() {
        let tables = parse("[t]\nheads = ['a', 'b']\nrows = [['one']]").expect("it is TOML");
        let error = tables["t"].markdown(&figures(), &mut BTreeSet::new());
        assert!(
            error
                .expect_err("one cell is missing")
                .to_string()
                .contains("1 cells under 2")
        );
        assert!(parse("[t]\nheads = []\ncolour = 'red'").is_err());
    }
}
