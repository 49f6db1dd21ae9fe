//! What a recording says of its run: the head, the entries of its journal and the topics whose
//! frames can be compared.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, bail};
use schema_frames::command::COMMAND_VERSION;
use schema_frames::journal::JOURNAL_VERSION;
use schema_frames::{CommandReply, JournalAct, JournalEntry, JournalHead};
use schema_recording::journal::Piece;
use schema_recording::read::{RecordingFile, TopicKind, What};

use crate::cli::TimedCommand;

/// The run of a recording, ready to be made again.
#[derive(Debug)]
pub struct Script {
    /// What the run began with.
    pub head: JournalHead,
    /// The journal as lines for the simulator.
    pub journal: PathBuf,
    /// The launch file that was in force.
    pub launch: PathBuf,
    /// The last tick up to which the journal is complete.
    pub complete_to: u64,
    /// Simulated time of that tick, or of the last recorded one before it.
    pub end_nanos: u64,
    /// Topics of frames in the recording.
    pub topics: Vec<Arc<str>>,
    /// Topics of sensors that commands made, by the edge at which they were made.
    pub made_at: BTreeMap<u64, Vec<String>>,
}

/// Reads the run out of a recording into files of `folder`.
///
/// # Errors
/// If the recording cannot be run again, with the reason.
pub fn read(
    file: &RecordingFile,
    folder: &Path,
    commands: &[TimedCommand],
) -> anyhow::Result<Script> {
    let name = file.path().display();
    let said = file
        .metadata("run")?
        .and_then(|mut run| run.remove("rerun"))
        .filter(|said| said.starts_with("cannot"));
    if !file.topics().iter().any(|t| t.kind == TopicKind::Journal) {
        let why = match said {
            Some(said) => said.trim_start_matches("cannot be run again: ").to_owned(),
            None if !file.is_complete() => {
                "it is cut off or damaged, and what is left holds no journal".to_owned()
            }
            None => "it holds no journal, so it is of an older Gantry, of a replay or of another program; gantry replay plays it".to_owned(),
        };
        bail!("{name} cannot be run again: {why}");
    }
    let mut added = edges_of(file, commands)?;
    let journal = folder.join("journal.jsonl");
    let mut lines = BufWriter::new(
        std::fs::File::create(&journal)
            .with_context(|| format!("cannot write {}", journal.display()))?,
    );
    let mut head = None;
    let mut last = 0;
    let mut complete_to = 0;
    let mut made_at: BTreeMap<u64, Vec<String>> = BTreeMap::new();
    let mut samples = file.samples_of((0, u64::MAX), |topic| topic.kind == TopicKind::Journal);
    while let Some(sample) = samples.next()? {
        let What::Journal { text } = sample.what else {
            continue;
        };
        let piece: Piece = serde_json::from_str(text)
            .with_context(|| format!("{name} cannot be run again: its journal cannot be read"))?;
        if let (None, Some(found)) = (&head, piece.head) {
            check_head(&found, file)?;
            writeln!(lines, "{}", serde_json::to_string(&found)?)?;
            head = Some(found);
        }
        complete_to = complete_to.max(piece.tick);
        for entry in piece.entries {
            if entry.n <= last {
                continue;
            }
            if entry.n != last + 1 || head.is_none() {
                let said = said.as_deref().map_or_else(
                    || format!(
                        "cannot be run again: entries {} to {} of its journal are missing; the file is damaged, or its beginning is gone",
                        last + 1,
                        entry.n - 1
                    ),
                    str::to_owned,
                );
                bail!("{name} {said}");
            }
            last = entry.n;
            while let Some((edge, text)) = added.pop_if(|(edge, _)| *edge < entry.edge) {
                writeln!(lines, "{}", added_line(edge, text)?)?;
            }
            note_topics(&entry, &mut made_at);
            writeln!(lines, "{}", serde_json::to_string(&entry)?)?;
        }
    }
    while let Some((edge, text)) = added.pop() {
        writeln!(lines, "{}", added_line(edge, text)?)?;
    }
    lines.flush()?;
    let Some(head) = head else {
        bail!(
            "{name} cannot be run again: its journal has no head, which its first message holds; the file is damaged"
        );
    };
    let launch = folder.join("launch.toml");
    std::fs::write(&launch, &head.launch)
        .with_context(|| format!("cannot write {}", launch.display()))?;
    let topics: BTreeSet<Arc<str>> = file
        .topics()
        .iter()
        .filter(|topic| topic.kind == TopicKind::Frame)
        .map(|topic| topic.name.clone())
        .collect();
    Ok(Script {
        head,
        journal,
        launch,
        complete_to,
        end_nanos: end_nanos(file, complete_to)?,
        topics: topics.into_iter().collect(),
        made_at,
    })
}

fn check_head(head: &JournalHead, file: &RecordingFile) -> anyhow::Result<()> {
    if head.v > JOURNAL_VERSION {
        bail!(
            "{} cannot be run again by this Gantry: its journal has version {}, this one reads up to {JOURNAL_VERSION}; use Gantry {}",
            file.path().display(),
            head.v,
            head.version
        );
    }
    Ok(())
}

/// Edges and requests of the user's own commands, the last one first.
fn edges_of(file: &RecordingFile, commands: &[TimedCommand]) -> anyhow::Result<Vec<(u64, String)>> {
    let mut edges = Vec::new();
    for command in commands {
        let edge = last_snapshot(file, |_, nanos| nanos <= command.at_nanos, command.at_nanos)?
            .map_or(0, |(tick, _)| tick);
        let text = format!(
            "{{\"v\":{COMMAND_VERSION},\"commands\":[{}]}}",
            command.json
        );
        edges.push((edge, text));
    }
    // A stable sort keeps those of one edge in the order of the command line.
    edges.reverse();
    edges.sort_by_key(|(edge, _)| std::cmp::Reverse(*edge));
    Ok(edges)
}

/// A line of the journal for a command that was not in the run. Its outcome is compared with none.
fn added_line(edge: u64, text: String) -> anyhow::Result<String> {
    Ok(serde_json::to_string(&JournalEntry {
        n: 0,
        edge,
        act: JournalAct::Commands {
            client: "gantry-rerun".into(),
            seq: 0,
            text,
            outcomes: Vec::new(),
            is_last_of_round: true,
        },
    })?)
}

/// Notes the topics of sensors that a request made.
fn note_topics(entry: &JournalEntry, made_at: &mut BTreeMap<u64, Vec<String>>) {
    let JournalAct::Commands { outcomes, .. } = &entry.act else {
        return;
    };
    for outcome in outcomes {
        if let Ok(CommandReply::Spawned { topics, .. }) = serde_json::from_str(outcome) {
            made_at.entry(entry.edge).or_default().extend(topics);
        }
    }
}

/// Simulated time of the last recorded tick up to `complete_to`.
fn end_nanos(file: &RecordingFile, complete_to: u64) -> anyhow::Result<u64> {
    let until = file.span().map_or(0, |(_, last)| last);
    Ok(
        last_snapshot(file, |tick, _| tick <= complete_to, until)?
            .map_or(until, |(_, nanos)| nanos),
    )
}

/// Tick and time of the last recorded snapshot before or about `near_nanos` that `fits`.
fn last_snapshot(
    file: &RecordingFile,
    fits: impl Fn(u64, u64) -> bool,
    near_nanos: u64,
) -> anyhow::Result<Option<(u64, u64)>> {
    // Back from there, further and further: snapshots are close to one another in most runs.
    for back_nanos in [2_000_000_000, 60_000_000_000, u64::MAX] {
        let from = near_nanos.saturating_sub(back_nanos);
        let to = near_nanos.saturating_add(1);
        let mut samples = file.samples_of((from, to), |t| t.kind == TopicKind::Snapshot);
        let mut found = None;
        while let Some(sample) = samples.next()? {
            if let What::Snapshot { header, .. } = sample.what
                && fits(header.tick, header.sim_nanos)
            {
                found = Some((header.tick, header.sim_nanos));
            }
        }
        if found.is_some() || from == 0 {
            return Ok(found);
        }
    }
    Ok(None)
}
