//! The output of the processes: on the terminal with a coloured prefix, and with the time in one log
//! file per process, of which the newest part is kept.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use anyhow::Context as _;
use launch_cli::{BasicArgs, LogFormat};
use parking_lot::Mutex;

use super::run_dir::utc;

/// Colours of the prefixes in turn; red is left to errors.
const COLOURS: [&str; 6] = ["36", "32", "35", "33", "34", "96"];
/// Longest line that is not cut, bytes.
const MAX_LINE_BYTES: u64 = 64 * 1024;
const OWN_NAME: &str = "gantry";
/// Longest log of one process; when it is full, it becomes `NAME.log.1` in place of the one before.
pub const MAX_LOG_BYTES: u64 = 64 << 20;

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
    log: Arc<Mutex<Log>>,
}

/// The log of one process.
struct Log {
    path: PathBuf,
    file: File,
    n_bytes: u64,
    most: u64,
}

impl Log {
    fn open(path: PathBuf, most: u64) -> std::io::Result<Log> {
        let file = File::options().create(true).append(true).open(&path)?;
        let n_bytes = file.metadata()?.len();
        Ok(Log {
            path,
            file,
            n_bytes,
            most,
        })
    }

    /// Writes a line. A disk that is full does not end the processes.
    fn write(&mut self, line: &str) {
        if self.n_bytes > 0 && self.n_bytes + line.len() as u64 > self.most {
            self.turn_over();
        }
        if self.file.write_all(line.as_bytes()).is_ok() {
            self.n_bytes += line.len() as u64;
        }
    }

    /// Begins the log anew, and keeps what it had beside it.
    fn turn_over(&mut self) {
        let before = self.path.with_extension("log.1");
        let renamed = std::fs::rename(&self.path, &before);
        let Ok(next) = renamed.and_then(|()| Log::open(self.path.clone(), self.most)) else {
            // Without a new file it is this one that is written on, from its beginning.
            let _ = self.file.set_len(0);
            self.n_bytes = 0;
            return;
        };
        *self = next;
        let most = self.most >> 20;
        let now = utc(SystemTime::now());
        self.write(&format!(
            "{now} the log had {most} MiB and begins anew; what came before is in {}\n",
            before.display()
        ));
    }
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
        let cannot = format!("cannot write {}", path.display());
        let log = Log::open(path, MAX_LOG_BYTES).context(cannot)?;
        Ok(Sink {
            output: self.clone(),
            name: name.to_owned(),
            colour: COLOURS[idx % COLOURS.len()],
            log: Arc::new(Mutex::new(log)),
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
        let gate = self.gate.lock();
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
        let mut log = self.log.lock();
        log.write(&format!("{} {text}\n", utc(SystemTime::now())));
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
    fn a_log_keeps_its_newest_part() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.log");
        let mut log = Log::open(path.clone(), 1000).unwrap();
        for n in 0..1000 {
            log.write(&format!("line {n:04}\n"));
        }
        let (now, before) = (path.clone(), folder.path().join("a.log.1"));
        let all = [&before, &now].map(|file| std::fs::read_to_string(file).unwrap());
        assert!(all.iter().all(|text| text.len() <= 1000), "{all:?}");
        assert!(
            all[1].lines().next().unwrap().contains("begins anew"),
            "{all:?}"
        );
        assert!(all[1].ends_with("line 0999\n"), "{all:?}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
        // A log that is there already is written on.
        let again = Log::open(path, 1000).unwrap();
        assert_eq!(again.n_bytes, all[1].len() as u64);
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
