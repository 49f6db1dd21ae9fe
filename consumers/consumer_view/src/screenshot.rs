//! A picture of the window, without a display: a short recording, drawn by rerun into a file.

use std::collections::BTreeSet;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use nix::sys::signal::{Signal, killpg};
use nix::unistd::Pid;

/// How long drawing may take.
const DRAW_TIMEOUT: Duration = Duration::from_secs(120);

/// How often drawing is tried.
const MAX_TRIES: usize = 6;
/// Rows along the lower edge that the time line has.
const LINE_ROWS: usize = 30;
/// Fewest colours of it, with its buttons and numbers.
const LINE_COLOURS: usize = 20;

/// Size of a window, points; its picture has two pixels for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Points along a row.
    pub width: u32,
    /// Points along a column.
    pub height: u32,
}

/// A text that is no size of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("must be WIDTHxHEIGHT, each 320 to 4096, e.g. 1600x1000")]
pub struct BadSize;

impl std::str::FromStr for Size {
    type Err = BadSize;

    fn from_str(text: &str) -> Result<Size, BadSize> {
        let sides = text.split_once('x').and_then(|(width, height)| {
            let side = |text: &str| {
                let side = text.parse::<u32>().ok()?;
                (320..=4096).contains(&side).then_some(side)
            };
            Some((side(width)?, side(height)?))
        });
        let (width, height) = sides.ok_or(BadSize)?;
        Ok(Size { width, height })
    }
}

/// Recordings that are removed again, beside the picture that is made of them.
#[derive(Debug)]
pub struct Scratch {
    /// What is shown is written there.
    recording: PathBuf,
    /// The same with an index, so that it is open before the picture is taken.
    indexed: PathBuf,
}

impl Scratch {
    /// Nothing is there yet.
    pub fn beside(picture: &Path) -> Scratch {
        let name =
            |suffix: &str| picture.with_extension(format!("{}{suffix}.rrd", std::process::id()));
        Scratch {
            recording: name(""),
            indexed: name(".indexed"),
        }
    }

    /// Where the recording is written.
    pub fn path(&self) -> &Path {
        &self.recording
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // One that was never begun is not there.
        let _ = std::fs::remove_file(&self.recording);
        let _ = std::fs::remove_file(&self.indexed);
    }
}

/// Draws what was recorded, by a blueprint if there is one, with `program` into the new PNG
/// `picture`.
///
/// # Errors
/// If rerun fails or draws nothing in time, or `stop` says so before it has.
pub fn draw(
    program: &Path,
    scratch: &Scratch,
    blueprint: Option<&Path>,
    picture: &Path,
    size: Size,
    stop: &dyn Fn() -> bool,
) -> anyhow::Result<()> {
    crate::viewer::decline_analytics(program);
    let mut index = Command::new(program);
    index.args(["rrd", "optimize"]).arg(&scratch.recording);
    index.arg("-o").arg(&scratch.indexed).stdout(Stdio::null());
    let indexed = run_to_end(&mut index, stop)?;
    if !scratch.indexed.is_file() {
        bail!("rerun cannot read what was recorded ({indexed})");
    }
    for _ in 0..MAX_TRIES {
        let mut command = Command::new(program);
        command
            .args(["--headless", "--bind", "127.0.0.1", "--port", "auto"])
            .arg("--window-size")
            .arg(format!("{}x{}", size.width, size.height))
            .arg("--screenshot-to")
            .arg(picture)
            .arg(&scratch.indexed)
            .args(blueprint);
        let drawn = run_to_end(&mut command, stop)?;
        if !picture.is_file() {
            bail!("rerun drew no picture ({drawn}); it needs a GPU or Mesa's Vulkan drivers");
        }
        if has_time_line(picture)? {
            return Ok(());
        }
        std::fs::remove_file(picture)?;
    }
    bail!(
        "rerun drew its picture {MAX_TRIES} times before it had read the recording; try again when the machine has less to do"
    )
}

/// Whether the window was drawn with a recording, which has a time line along its lower edge. Rerun
/// draws after some time, whether it has read the recording by then or not.
fn has_time_line(picture: &Path) -> anyhow::Result<bool> {
    let file = std::io::BufReader::new(launch_cli::files::open_plain(picture)?.0);
    let mut reader = png::Decoder::new(file).read_info()?;
    let n_bytes = reader
        .output_buffer_size()
        .context("the picture is too large")?;
    let mut pixels = vec![0; n_bytes];
    let info = reader.next_frame(&mut pixels)?;
    let last = &pixels[info.line_size * (info.height as usize).saturating_sub(LINE_ROWS)..];
    let colours: BTreeSet<&[u8]> = last.chunks_exact(info.color_type.samples()).collect();
    Ok(colours.len() >= LINE_COLOURS)
}

/// Runs a command of rerun, and ends it with all that it started if it takes too long or `stop` says
/// so. It hears no Ctrl-C itself.
fn run_to_end(command: &mut Command, stop: &dyn Fn() -> bool) -> anyhow::Result<ExitStatus> {
    if std::env::var_os("RUST_LOG").is_none() {
        // It logs that it was not fast enough for its own taste.
        command.env("RUST_LOG", "off");
    }
    command.env("DO_NOT_TRACK", "1");
    command.stdin(Stdio::null()).process_group(0);
    let start = Instant::now();
    let mut child = command.spawn().context("cannot start rerun")?;
    let group = Pid::from_raw(child.id() as i32);
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        let is_late = start.elapsed() > DRAW_TIMEOUT;
        if is_late || stop() {
            let _ = killpg(group, Signal::SIGKILL);
            child.wait()?;
            match is_late {
                true => bail!("rerun did not end in {} s", DRAW_TIMEOUT.as_secs()),
                false => bail!("interrupted before the picture was drawn"),
            }
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    // The program is a wrapper; what it started may still be there.
    let _ = killpg(group, Signal::SIGKILL);
    Ok(status)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawing_ends_when_it_is_told_to() {
        let began = Instant::now();
        let mut sleeper = Command::new("sleep");
        let ended = run_to_end(sleeper.arg("60"), &|| true).unwrap_err();
        assert!(ended.to_string().contains("interrupted"), "{ended}");
        assert!(began.elapsed() < Duration::from_secs(30));
    }

    #[test]
    fn a_size_is_two_sides() {
        let size: Size = "1600x1000".parse().unwrap();
        assert_eq!((size.width, size.height), (1600, 1000));
        for wrong in [
            "",
            "1600",
            "x",
            "1600x",
            "10x1000",
            "1600x99999",
            "1600×1000",
        ] {
            assert!(wrong.parse::<Size>().is_err(), "{wrong}");
        }
    }
}
