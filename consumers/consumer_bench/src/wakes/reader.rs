//! One reader of the benches of wake-ups: the process itself, and its handle in the parent. It
//! sleeps on the events it is told, takes what waits, and ends when its input is closed.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use anyhow::{Context as _, ensure};
use launch_cli::Exit;
use schema_bus::{Bus, FrameReader, WaitSet, mono_now};
use schema_types::MonoTime;
use serde::{Deserialize, Serialize};

/// Longest sleep, after which the reader looks whether it is to end.
const LOOK_EVERY: Duration = Duration::from_millis(50);

#[derive(Debug, clap::Args)]
pub struct WakeReaderArgs {
    /// Topics to read
    #[arg(long, value_delimiter = ',')]
    topics: Vec<String>,
    /// Events to sleep on
    #[arg(long, value_delimiter = ',')]
    events: Vec<String>,
}

/// What one reader saw.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Seen {
    /// From the writer's stamp to the frame in hand, nanoseconds, by topic.
    pub ages_nanos: BTreeMap<String, Vec<u64>>,
    /// How often it was woken.
    pub n_wakes: u64,
    /// Frames that never came.
    pub lost: u64,
}

/// Reads until stdin ends and prints what it saw as one line of JSON.
pub fn run(args: &WakeReaderArgs, domain: &str) -> anyhow::Result<Exit> {
    let bus = Bus::open(domain, "gantry-bench-reader")?;
    let mut events = WaitSet::new();
    for event in &args.events {
        events.add(bus.listener(event)?);
    }
    let open = |topic: &String| bus.frame_reader(topic);
    let mut readers: Vec<FrameReader> = args.topics.iter().map(open).collect::<Result<_, _>>()?;
    let is_over = Arc::new(AtomicBool::new(false));
    let over = is_over.clone();
    std::thread::spawn(move || {
        // The end of input and a failure to read mean the same: the parent is done or gone.
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        over.store(true, Relaxed);
    });
    println!("ready");
    std::io::stdout().flush().context("the bench hung up")?;
    let mut seen = Seen::default();
    while !is_over.load(Relaxed) {
        seen.n_wakes += u64::from(events.wait(LOOK_EVERY)?);
        for reader in &mut readers {
            while let Some(frame) = reader.next()? {
                let held = mono_now();
                let sent = MonoTime(frame.header().published_mono_nanos);
                let ages = seen.ages_nanos.entry(reader.topic().to_owned());
                ages.or_default().push(held.nanos_since(sent));
            }
        }
    }
    seen.lost = readers.iter().map(|reader| reader.counts().lost).sum();
    println!("{}", serde_json::to_string(&seen)?);
    Ok(Exit::Done)
}

/// The parent's handle of a reader. Dropped before [`WakeReader::finish`], it kills the reader.
pub struct WakeReader {
    child: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl WakeReader {
    /// Starts this program again as a reader, and waits until it listens.
    pub fn start(domain: &str, topics: &[String], events: &[String]) -> anyhow::Result<Self> {
        let program = std::env::current_exe().context("cannot find this program's file")?;
        let mut child = Command::new(program)
            .args(["wake-reader", "--domain", domain])
            .args(["--topics", &topics.join(",")])
            .args(["--events", &events.join(",")])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .context("cannot start a reader")?;
        let input = child.stdin.take();
        let output = child.stdout.take().expect("stdout is a pipe, see above");
        let mut reader = WakeReader {
            child,
            input,
            output: BufReader::new(output),
        };
        let mut line = String::new();
        reader.output.read_line(&mut line)?;
        ensure!(
            line.trim() == "ready",
            "a reader ended before it was ready; its reason stands above"
        );
        Ok(reader)
    }

    /// Ends the reader and takes what it saw.
    pub fn finish(mut self) -> anyhow::Result<Seen> {
        drop(self.input.take());
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

impl Drop for WakeReader {
    fn drop(&mut self) {
        // Both fail for a reader that has already ended, which is the normal case.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
