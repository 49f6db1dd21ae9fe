//! Log lines on stderr: `INFO  message key=value`, or JSON.
//!
//! Text lines carry no time, and no module except at debug level: the launcher prefixes them with
//! the process's name, and adds the time in its log files.
//!
//! Texts that come from outside are logged through [`cut`], so that nobody fills a disk with a name.

use std::borrow::Cow;
use std::io::{self, IsTerminal as _, Write};

use clap::ValueEnum;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

/// Crates of others that log unimportant things at a high level.
const CHATTY: [&str; 8] = [
    "wgpu_core",
    "wgpu_hal",
    "naga",
    "iceoryx2",
    "h2",
    "tonic",
    "re_grpc_client",
    "zenoh",
];

/// Most bytes of a text from outside that are logged.
pub const MAX_LOGGED_BYTES: usize = 200;
/// Longest line of the log, bytes: for texts from outside that reach it by a way of their own, as
/// within an error of a library.
pub const MAX_LINE_BYTES: usize = 8 << 10;

/// A text from outside as it is logged: its beginning, and how long it is if that is not all.
///
/// ```
/// assert_eq!(launch_cli::logging::cut("town"), "town");
/// let long = "a".repeat(1000);
/// assert_eq!(launch_cli::logging::cut(&long), format!("{}… (1000 bytes)", "a".repeat(200)));
/// ```
pub fn cut(text: &str) -> Cow<'_, str> {
    if text.len() <= MAX_LOGGED_BYTES {
        return Cow::Borrowed(text);
    }
    let end = text.floor_char_boundary(MAX_LOGGED_BYTES);
    Cow::Owned(format!("{}… ({} bytes)", &text[..end], text.len()))
}

/// When terminal output is coloured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ColorWhen {
    /// On a terminal, unless `NO_COLOR` is set.
    #[default]
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

impl ColorWhen {
    /// Whether stderr gets colours.
    pub fn on_stderr(self) -> bool {
        match self {
            ColorWhen::Always => true,
            ColorWhen::Never => false,
            ColorWhen::Auto => {
                std::io::stderr().is_terminal()
                    && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
            }
        }
    }
}

/// How log lines are written to stderr.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// One readable line each.
    #[default]
    Text,
    /// One JSON object per line, with a timestamp.
    Json,
}

/// How a program logs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LogOptions {
    /// Number of `-v`.
    pub verbose: u8,
    /// Number of `-q`.
    pub quiet: u8,
    pub color: ColorWhen,
    pub format: LogFormat,
}

/// Starts logging to stderr.
pub(crate) fn init(options: &LogOptions) {
    let filter = EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| EnvFilter::new(directives(options.verbose, options.quiet)));
    let builder = tracing_subscriber::fmt().with_env_filter(filter);
    // A second call in the same process, as tests make, keeps the first subscriber.
    let _ = match options.format {
        LogFormat::Json => builder
            .with_writer(io::stderr)
            .json()
            .flatten_event(true)
            .try_init(),
        LogFormat::Text => builder
            .with_writer(|| Lines(io::stderr()))
            .with_ansi(options.color.on_stderr())
            .event_format(Line)
            .try_init(),
    };
}

fn directives(verbose: u8, quiet: u8) -> String {
    let (ours, others) = match (verbose, quiet) {
        (0, 0) => ("info", "warn"),
        (0, 1) => ("warn", "error"),
        (0, _) => ("error", "error"),
        (1, _) => ("debug", "warn"),
        (_, _) => ("trace", "debug"),
    };
    CHATTY.iter().fold(ours.to_owned(), |all, name| {
        format!("{all},{name}={others}")
    })
}

/// Writes lines of at most [`MAX_LINE_BYTES`].
struct Lines<W>(W);

impl<W: Write> Write for Lines<W> {
    /// Takes one whole line, as the subscriber writes them.
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        let Some((kept, _)) = line.split_at_checked(MAX_LINE_BYTES) else {
            self.0.write_all(line)?;
            return Ok(line.len());
        };
        let kept = String::from_utf8_lossy(kept);
        let kept = kept.trim_end_matches(char::REPLACEMENT_CHARACTER);
        writeln!(self.0, "{kept}… ({} bytes)", line.len())?;
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// Writes one event as one line.
struct Line;

impl<S, N> FormatEvent<S, N> for Line
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut out: Writer<'_>,
        event: &Event<'_>,
    ) -> std::fmt::Result {
        let meta = event.metadata();
        let (name, colour) = match *meta.level() {
            Level::ERROR => ("ERROR", "31"),
            Level::WARN => ("WARN ", "33"),
            Level::INFO => ("INFO ", "32"),
            Level::DEBUG => ("DEBUG", "34"),
            Level::TRACE => ("TRACE", "35"),
        };
        if out.has_ansi_escapes() {
            write!(out, "\x1b[{colour}m{name}\x1b[0m ")?;
        } else {
            write!(out, "{name} ")?;
        }
        if *meta.level() >= Level::DEBUG {
            write!(out, "{}: ", meta.target())?;
        }
        context.field_format().format_fields(out.by_ref(), event)?;
        writeln!(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_and_long_lines_say_how_long_they_are() {
        assert_eq!(cut(&"é".repeat(100)), "é".repeat(100));
        assert_eq!(
            cut(&"é".repeat(101)),
            format!("{}… (202 bytes)", "é".repeat(100))
        );
        let mut out = Vec::new();
        let long = format!("WARN  {}\n", "ü".repeat(1 << 20));
        for line in [&b"WARN  short\n"[..], long.as_bytes()] {
            Lines(&mut out).write_all(line).unwrap();
        }
        let text = String::from_utf8(out).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!((lines.len(), lines[0]), (2, "WARN  short"));
        assert!(lines[1].ends_with("ü… (2097159 bytes)") && lines[1].len() < 9000);
    }

    #[test]
    fn flags_choose_the_level_and_the_filter_parses() {
        for (verbose, quiet, first) in [
            (0, 0, "info"),
            (0, 1, "warn"),
            (0, 2, "error"),
            (1, 0, "debug"),
            (3, 0, "trace"),
        ] {
            let text = directives(verbose, quiet);
            assert_eq!(text.split(',').next(), Some(first));
            EnvFilter::try_new(text).unwrap();
        }
    }
}
