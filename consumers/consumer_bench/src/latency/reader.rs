//! One reader of the latency bench: the process itself, and its handle in the parent.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail, ensure};
use launch_cli::Exit;
use schema_bus::{Bus, Frame, mono_now};
use schema_types::MonoTime;
use serde::{Deserialize, Serialize};

/// Frames sent before counting begins: page faults, connection set-up, cold branch predictors.
pub const WARM_UP: u64 = 30;
/// A reader that receives nothing for this long gives up, because its writer must be dead.
const PATIENCE: Duration = Duration::from_secs(20);

/// How frames reach a reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Way {
    /// Shared memory; asleep until an event.
    #[value(name = "shm-event")]
    Event,
    /// Shared memory; polls and yields its time slice in between.
    #[value(name = "shm-polled")]
    Polled,
    /// TCP over loopback.
    #[value(name = "tcp")]
    Tcp,
}

impl Way {
    /// Name in tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Way::Event => "shm-event",
            Way::Polled => "shm-polled",
            Way::Tcp => "tcp",
        }
    }
}

#[derive(Debug, clap::Args)]
pub struct ReaderArgs {
    #[arg(long, value_enum)]
    way: Way,
    #[arg(long)]
    size: usize,
    /// Number of the last frame
    #[arg(long)]
    last: u64,
    #[arg(long, required_unless_present = "address")]
    topic: Option<String>,
    #[arg(long)]
    address: Option<String>,
}

/// What one reader saw after the warm-up.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Received {
    /// From the writer's stamp to the frame in hand.
    pub nanos: Vec<u64>,
    /// Frames that never came.
    pub lost: u64,
}

impl Received {
    /// Records a frame; returns whether it was the last.
    fn frame(
        &mut self,
        seq: u64,
        stamp: MonoTime,
        held: MonoTime,
        first_and_last_byte: [u8; 2],
        last: u64,
    ) -> anyhow::Result<bool> {
        ensure!(
            first_and_last_byte == [seq as u8; 2],
            "frame {seq} has the bytes {first_and_last_byte:?}: it was overwritten while it was held"
        );
        if seq > WARM_UP {
            self.nanos.push(held.nanos_since(stamp));
        }
        Ok(seq >= last)
    }
}

/// Reads until the last frame and prints what it saw as one line of JSON.
pub fn run(args: &ReaderArgs, domain: &str) -> anyhow::Result<Exit> {
    let mut received = Received::default();
    match (&args.address, &args.topic) {
        (Some(address), _) => read_tcp(args, address, &mut received)?,
        (None, Some(topic)) => read_shared_memory(args, domain, topic, &mut received)?,
        _ => bail!("a reader needs --address or --topic"),
    }
    received.lost = (args.last - WARM_UP).saturating_sub(received.nanos.len() as u64);
    println!("{}", serde_json::to_string(&received)?);
    Ok(Exit::Done)
}

fn say_ready() -> anyhow::Result<()> {
    println!("ready");
    std::io::stdout().flush().context("the writer hung up")
}

fn read_shared_memory(
    args: &ReaderArgs,
    domain: &str,
    topic: &str,
    received: &mut Received,
) -> anyhow::Result<()> {
    let bus = Bus::open(domain, "gantry-bench-reader")?;
    let mut reader = bus.frame_reader(topic)?;
    let listener = (args.way == Way::Event)
        .then(|| bus.listener(topic))
        .transpose()?;
    say_ready()?;
    let mut heard = Instant::now();
    loop {
        let woken = match &listener {
            Some(listener) => listener.wait(Duration::from_secs(1))?,
            None => true,
        };
        let mut n_frames = 0;
        while woken && let Some(frame) = reader.next()? {
            let held = mono_now();
            n_frames += 1;
            if note(args, received, &frame, held)? {
                return Ok(());
            }
        }
        if n_frames > 0 {
            heard = Instant::now();
        } else {
            ensure!(
                heard.elapsed() < PATIENCE,
                "no frame for {} s",
                PATIENCE.as_secs()
            );
            std::thread::yield_now();
        }
    }
}

fn note(
    args: &ReaderArgs,
    received: &mut Received,
    frame: &Frame,
    held: MonoTime,
) -> anyhow::Result<bool> {
    let header = frame.header();
    ensure!(
        frame.len() == args.size,
        "frame {} has {} bytes instead of {}",
        header.seq,
        frame.len(),
        args.size
    );
    received.frame(
        header.seq,
        MonoTime(header.published_mono_nanos),
        held,
        [frame[0], frame[frame.len() - 1]],
        args.last,
    )
}

fn read_tcp(args: &ReaderArgs, address: &str, received: &mut Received) -> anyhow::Result<()> {
    let mut stream =
        TcpStream::connect(address).with_context(|| format!("cannot connect to {address}"))?;
    stream.set_read_timeout(Some(PATIENCE))?;
    say_ready()?;
    let mut frame = vec![0u8; args.size];
    loop {
        stream
            .read_exact(&mut frame)
            .context("the writer hung up")?;
        let held = mono_now();
        let number = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| frame[at + i]));
        if received.frame(
            number(8),
            MonoTime(number(0)),
            held,
            [frame[16], frame[frame.len() - 1]],
            args.last,
        )? {
            return Ok(());
        }
    }
}

/// The parent's handle of a reader. Dropped before the reader has finished, it kills the reader.
pub struct ReaderProcess {
    child: Child,
    output: BufReader<ChildStdout>,
}

impl ReaderProcess {
    /// Starts this program again as a reader, or a reader in Python.
    pub fn start(python: Option<&Path>, words: &[&str]) -> anyhow::Result<Self> {
        let mut command = match python {
            Some(python) => Command::new(python),
            None => Command::new(launch_cli::programs::own().context("cannot find this program")?),
        };
        match python {
            Some(_) => command.args(["-c", include_str!("reader.py")]),
            None => command.arg("latency-reader"),
        };
        command
            .args(words)
            .stdin(Stdio::null())
            .stdout(Stdio::piped());
        let mut child = command.spawn().context("cannot start a reader")?;
        let output = BufReader::new(
            child
                .stdout
                .take()
                .expect("the reader's stdout is a pipe, see above"),
        );
        Ok(ReaderProcess { child, output })
    }

    /// Waits until the reader listens.
    pub fn wait_until_ready(&mut self) -> anyhow::Result<()> {
        let mut line = String::new();
        self.output.read_line(&mut line)?;
        ensure!(
            line.trim() == "ready",
            "a reader ended before it was ready; its reason stands above"
        );
        Ok(())
    }

    /// Waits for the end and takes what the reader saw.
    pub fn finish(mut self) -> anyhow::Result<Received> {
        let mut text = String::new();
        self.output.read_to_string(&mut text)?;
        let status = self.child.wait()?;
        ensure!(
            status.success(),
            "a reader failed with {status}; its reason stands above"
        );
        serde_json::from_str(&text).context("a reader's answer cannot be read")
    }
}

impl Drop for ReaderProcess {
    fn drop(&mut self) {
        // Both fail for a reader that has already ended, which is the normal case.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn warm_up_is_not_counted_and_an_overwritten_frame_is_an_error() {
        let mut received = Received::default();
        let mut frame = |seq: u64, byte: u8| {
            received.frame(seq, MonoTime(100), MonoTime(150), [byte; 2], WARM_UP + 2)
        };
        assert!(!frame(WARM_UP, WARM_UP as u8).unwrap());
        assert!(!frame(WARM_UP + 1, WARM_UP as u8 + 1).unwrap());
        assert!(
            frame(WARM_UP + 2, 0)
                .unwrap_err()
                .to_string()
                .contains("overwritten")
        );
        assert!(frame(WARM_UP + 2, WARM_UP as u8 + 2).unwrap());
        assert_eq!(received.nanos, [50, 50]);
    }
}
