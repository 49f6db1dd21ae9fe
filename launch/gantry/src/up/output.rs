//! The output of the processes: on the terminal with a coloured prefix, and with the time in one log
//! file per process.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read, Write as _};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use anyhow::Context as _;
use launch_cli::{BasicArgs, LogFormat};

use super::run_dir::utc;

/// Colours of the prefixes in turn; red is left to errors.
const COLOURS: [&str; 6] = ["36", "32", "35", "33", "34", "96"];
/// Longest line that is not cut, bytes.
const MAX_LINE_BYTES: u64 = 64 * 1024;
const OWN_NAME: &str = "gantry";

/// The pipe that a line came through. The launcher writes the line to the same one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    Stdout,
    Stderr,
}

/// The terminal, which all processes share. Lines are written whole.
#[derive(Clone)]
pub struct Output {
    width: usize,
    coloured: bool,
    json: bool,
    quiet: bool,
    gate: Arc<Mutex<()>>,
}

/// Where the lines of one process go.
#[derive(Clone)]
pub struct Sink {
    output: Output,
    name: String,
    colour: &'static str,
    file: Arc<Mutex<File>>,
}

impl Output {
    pub fn new(names: &[&str], basic: &BasicArgs) -> Self {
        Output {
            width: names
                .iter()
                .map(|name| name.len())
                .chain([OWN_NAME.len()])
                .max()
                .unwrap_or(0),
            coloured: basic.color.on_stderr(),
            json: basic.log_format == LogFormat::Json,
            quiet: basic.quiet > 0,
            gate: Arc::default(),
        }
    }

    /// Prints what the launcher itself does; silent with `-q`.
    pub fn say(&self, text: &str) {
        if !self.quiet {
            self.write(OWN_NAME, "1", Stream::Stderr, text);
        }
    }

    /// Prints a warning of the launcher itself.
    pub fn warn(&self, text: &str) {
        self.write(OWN_NAME, "1;31", Stream::Stderr, text);
    }

    /// The sink of the `idx`th process, with its log file.
    pub fn sink(&self, idx: usize, name: &str, folder: &Path) -> anyhow::Result<Sink> {
        let path = folder.join(format!("{name}.log"));
        let file = File::options()
            .create(true)
            .append(true)
            .open(&path)
            .with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Sink {
            output: self.clone(),
            name: name.to_owned(),
            colour: COLOURS[idx % COLOURS.len()],
            file: Arc::new(Mutex::new(file)),
        })
    }

    fn write(&self, name: &str, colour: &str, stream: Stream, text: &str) {
        let line = if self.json {
            let stream = if stream == Stream::Stdout {
                "stdout"
            } else {
                "stderr"
            };
            let text = without_colours(text);
            serde_json::json!({"time": utc(SystemTime::now()), "process": name, "stream": stream, "line": text}).to_string() + "\n"
        } else if self.coloured {
            format!(
                "\x1b[{colour}m{name:width$} │\x1b[0m {text}\n",
                width = self.width
            )
        } else {
            format!("{name:width$} │ {text}\n", width = self.width)
        };
        let gate = self.gate.lock().unwrap_or_else(PoisonError::into_inner);
        // If the terminal is gone, the processes go on: the log files have everything.
        let _ = match stream {
            Stream::Stdout => std::io::stdout().write_all(line.as_bytes()),
            Stream::Stderr => std::io::stderr().write_all(line.as_bytes()),
        };
        drop(gate);
    }
}

impl Sink {
    fn line(&self, stream: Stream, text: &str) {
        self.output.write(&self.name, self.colour, stream, text);
        self.note(&without_colours(text));
    }

    /// Writes a line into the log file only.
    pub fn note(&self, text: &str) {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let _ = file.write_all(format!("{} {text}\n", utc(SystemTime::now())).as_bytes());
    }

    /// Copies a pipe until it closes. `seen` looks at every line.
    pub fn pump(&self, pipe: impl Read, stream: Stream, mut seen: impl FnMut(&str)) {
        let mut reader = BufReader::new(pipe);
        let mut bytes = Vec::new();
        while reader
            .by_ref()
            .take(MAX_LINE_BYTES)
            .read_until(b'\n', &mut bytes)
            .is_ok_and(|n| n > 0)
        {
            while bytes
                .last()
                .is_some_and(|byte| matches!(byte, b'\n' | b'\r'))
            {
                bytes.pop();
            }
            let text = String::from_utf8_lossy(&bytes);
            seen(&text);
            self.line(stream, &text);
            bytes.clear();
        }
    }
}

/// The line without the escape sequences that set colours.
fn without_colours(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut parts = text.split("\x1b[");
    plain.push_str(parts.next().unwrap_or_default());
    for part in parts {
        let end = part
            .find(|c: char| !c.is_ascii_digit() && c != ';')
            .map_or(part.len(), |end| end + 1);
        plain.push_str(part.get(end..).unwrap_or_default());
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_stay_on_the_terminal() {
        assert_eq!(without_colours("\x1b[32mINFO\x1b[0m up"), "INFO up");
        assert_eq!(without_colours("\x1b["), "");
        assert_eq!(without_colours("a\x1b[1;31é"), "a");
    }

    #[test]
    fn a_pipe_is_cut_into_lines_that_survive_any_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let basic = BasicArgs {
            log_format: LogFormat::Json,
            ..Default::default()
        };
        let sink = Output::new(&["a"], &basic)
            .sink(0, "a", folder.path())
            .unwrap();
        let mut lines = Vec::new();
        sink.pump(&b"one\r\n\xff\xfe\n\nlast"[..], Stream::Stderr, |line| {
            lines.push(line.to_owned())
        });
        assert_eq!(lines, ["one", "\u{fffd}\u{fffd}", "", "last"]);
        let log = std::fs::read_to_string(folder.path().join("a.log")).unwrap();
        assert_eq!(log.lines().count(), 4);
        assert!(log.lines().all(|line| line.starts_with("20")), "{log}");
    }
}
