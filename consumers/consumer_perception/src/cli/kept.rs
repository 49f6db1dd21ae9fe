//! A capture as a file, so that a benchmark that was stopped goes on with the runs that it has.
//!
//! Magic, length and JSON of what is said once; then each result: number of its topic, header,
//! inputs, and body behind its length. Files are of this machine and build: nobody else reads them.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytemuck::Zeroable as _;
use schema_frames::result::MAX_INPUTS;
use schema_frames::{About, InputRecord, ResultHeader};
use schema_types::files::open_plain;
use serde::{Deserialize, Serialize};

use crate::capture::{
    Body, BodyStore, Capture, CapturedResult, Clock, MAX_BODY_BYTES, Mode, SentFrame, Usage,
};

/// How the file begins.
const MAGIC: &[u8; 8] = b"GCAPTUR1";
/// Most bytes of what is said once.
const MAX_HEAD_BYTES: u64 = 1 << 30;
/// In place of a body's length: the body was not kept.
const DROPPED: u64 = u64::MAX;

/// Why a capture cannot be kept or taken up again.
#[derive(Debug, thiserror::Error)]
#[error("the finished run in {path} cannot be {done}: {source}; remove the file to have it run again", path = path.display())]
pub struct KeptError {
    path: PathBuf,
    done: &'static str,
    source: io::Error,
}

/// What is said once.
#[derive(Debug, Serialize, Deserialize)]
struct Head {
    program: String,
    scenario: String,
    mode: Mode,
    speed: f64,
    added_delay_nanos: u64,
    clock: Vec<(u64, u64)>,
    topics: Vec<String>,
    abouts: BTreeMap<String, About>,
    frames: Vec<Frame>,
    n_results: u64,
    n_lost: u64,
    n_refused: u64,
    usage: Vec<Usage>,
    faults: Vec<String>,
    has_crashed: bool,
    drive_recording: Option<PathBuf>,
}

/// A [`SentFrame`] whose topic is a number.
#[derive(Debug, Serialize, Deserialize)]
struct Frame {
    topic: usize,
    tick: u64,
    seq: u64,
    epoch: u64,
    sim_nanos: u64,
    published_mono_nanos: u64,
}

impl Capture {
    /// Writes it into a file, which is there as a whole or not at all.
    ///
    /// # Errors
    /// [`KeptError`] if the disk refuses.
    pub fn keep(&self, path: &Path) -> Result<(), KeptError> {
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        let part = PathBuf::from(part);
        let written = File::create(&part).and_then(|file| {
            let mut out = BufWriter::new(file);
            self.write(&mut out)?;
            out.flush()
        });
        written
            .and_then(|()| launch_cli::files::rename(&part, path))
            .map_err(|source| KeptError {
                path: path.to_owned(),
                done: "kept",
                source,
            })
    }

    /// Reads what [`Capture::keep`] wrote; `None` if there is no such file.
    ///
    /// # Errors
    /// [`KeptError`] if it is damaged.
    pub fn kept(path: &Path) -> Result<Option<Capture>, KeptError> {
        let opened = match open_plain(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            other => other,
        };
        let read = opened.and_then(|(file, _)| read(&mut BufReader::new(file)));
        read.map(Some).map_err(|source| KeptError {
            path: path.to_owned(),
            done: "taken up again",
            source,
        })
    }

    fn write(&self, out: &mut impl Write) -> io::Result<()> {
        let mut topics: Vec<String> = Vec::new();
        let mut numbers: BTreeMap<Arc<str>, usize> = BTreeMap::new();
        let mut number_of = |topic: &Arc<str>| {
            *numbers.entry(topic.clone()).or_insert_with(|| {
                topics.push(topic.to_string());
                topics.len() - 1
            })
        };
        let frame = |frame: &SentFrame| Frame {
            topic: number_of(&frame.topic),
            tick: frame.tick,
            seq: frame.seq,
            epoch: frame.epoch,
            sim_nanos: frame.sim_nanos,
            published_mono_nanos: frame.published_mono_nanos,
        };
        let frames: Vec<Frame> = self.frames.iter().map(frame).collect();
        let of_results = self.results.iter();
        let of_results: Vec<usize> = of_results.map(|it| number_of(&it.topic)).collect();
        let abouts = self.abouts.iter();
        let head = Head {
            program: self.program.clone(),
            scenario: self.scenario.clone(),
            mode: self.mode,
            speed: self.speed,
            added_delay_nanos: self.added_delay_nanos,
            clock: self.clock.points().to_vec(),
            topics,
            abouts: abouts
                .map(|(topic, about)| (topic.to_string(), about.clone()))
                .collect(),
            frames,
            n_results: self.results.len() as u64,
            n_lost: self.n_lost,
            n_refused: self.n_refused,
            usage: self.usage.clone(),
            faults: self.faults.clone(),
            has_crashed: self.has_crashed,
            drive_recording: self.drive_recording.clone(),
        };
        let head = serde_json::to_vec(&head)?;
        out.write_all(MAGIC)?;
        out.write_all(&(head.len() as u64).to_le_bytes())?;
        out.write_all(&head)?;
        for (result, topic) in self.results.iter().zip(of_results) {
            out.write_all(&(topic as u32).to_le_bytes())?;
            out.write_all(&(result.inputs.len() as u32).to_le_bytes())?;
            out.write_all(&result.held_mono_nanos.to_le_bytes())?;
            out.write_all(bytemuck::bytes_of(&result.header))?;
            out.write_all(bytemuck::cast_slice(&result.inputs))?;
            match &result.body {
                Body::Dropped => out.write_all(&DROPPED.to_le_bytes())?,
                body => {
                    let bytes = body.bytes()?;
                    out.write_all(&(bytes.len() as u64).to_le_bytes())?;
                    out.write_all(&bytes)?;
                }
            }
        }
        Ok(())
    }
}

fn read(from: &mut impl Read) -> io::Result<Capture> {
    if array::<8>(from)? != *MAGIC {
        return Err(damaged("it begins otherwise"));
    }
    let head_bytes = u64::from_le_bytes(array(from)?);
    let head = bytes(from, head_bytes, MAX_HEAD_BYTES)?;
    let head: Head = serde_json::from_slice(&head)?;
    let topics: Vec<Arc<str>> = head.topics.iter().map(|it| it.as_str().into()).collect();
    let topic = |number: usize| {
        let found = topics.get(number).cloned();
        found.ok_or_else(|| damaged("it numbers a topic that it does not have"))
    };
    let frame = |frame: &Frame| {
        Ok(SentFrame {
            topic: topic(frame.topic)?,
            tick: frame.tick,
            seq: frame.seq,
            epoch: frame.epoch,
            sim_nanos: frame.sim_nanos,
            published_mono_nanos: frame.published_mono_nanos,
        })
    };
    let frames: io::Result<Vec<SentFrame>> = head.frames.iter().map(frame).collect();
    let mut bodies = BodyStore::default();
    let mut results = Vec::new();
    for _ in 0..head.n_results {
        let number = u32::from_le_bytes(array(from)?);
        let n_inputs = u32::from_le_bytes(array(from)?);
        let held_mono_nanos = u64::from_le_bytes(array(from)?);
        let mut header = ResultHeader::zeroed();
        from.read_exact(bytemuck::bytes_of_mut(&mut header))?;
        if n_inputs as usize > MAX_INPUTS {
            return Err(damaged("a result has more inputs than results have"));
        }
        let mut inputs = vec![InputRecord::zeroed(); n_inputs as usize];
        from.read_exact(bytemuck::cast_slice_mut(&mut inputs))?;
        let body = match u64::from_le_bytes(array(from)?) {
            DROPPED => Body::Dropped,
            n => {
                let body = bytes(from, n, MAX_BODY_BYTES)?;
                let kept = bodies.keep(&body)?;
                kept.ok_or_else(|| damaged("its results are longer than a run's are"))?
            }
        };
        results.push(CapturedResult {
            topic: topic(number as usize)?,
            header,
            body,
            inputs,
            held_mono_nanos,
        });
    }
    let abouts = head.abouts.into_iter();
    Ok(Capture {
        program: head.program,
        scenario: head.scenario,
        mode: head.mode,
        speed: head.speed,
        added_delay_nanos: head.added_delay_nanos,
        clock: Clock::of(head.clock),
        results,
        abouts: abouts.map(|(topic, about)| (topic.into(), about)).collect(),
        frames: frames?,
        n_lost: head.n_lost,
        n_refused: head.n_refused,
        usage: head.usage,
        faults: head.faults,
        has_crashed: head.has_crashed,
        drive_recording: head.drive_recording,
    })
}

fn damaged(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

fn array<const N: usize>(from: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// As many bytes, of which no more memory is taken than there are.
fn bytes(from: &mut impl Read, n: u64, most: u64) -> io::Result<Vec<u8>> {
    if n > most {
        return Err(damaged("a length in it is too large"));
    }
    let mut bytes = Vec::new();
    from.take(n).read_to_end(&mut bytes)?;
    match bytes.len() as u64 == n {
        true => Ok(bytes),
        false => Err(io::ErrorKind::UnexpectedEof.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn capture() -> Capture {
        let mut bodies = BodyStore::default();
        let mut result = |topic: &str, body: Option<&[u8]>| CapturedResult {
            topic: topic.into(),
            header: ResultHeader {
                tick: 7,
                ..ResultHeader::zeroed()
            },
            body: match body {
                Some(bytes) => bodies.keep(bytes).unwrap().unwrap(),
                None => Body::Dropped,
            },
            inputs: vec![InputRecord::new("ego/front/rgb"); 2],
            held_mono_nanos: 9,
        };
        let results = vec![
            result("a/boxes", Some(b"short")),
            result("b/depth", Some(&vec![3; 100_000])),
            result("a/boxes", None),
        ];
        Capture {
            program: "quick".into(),
            scenario: "town".into(),
            mode: Mode::Streaming,
            speed: 0.1,
            added_delay_nanos: 5,
            clock: Clock::of(vec![(1, 2), (3, 4)]),
            results,
            abouts: [("a/boxes".into(), About::default())].into(),
            frames: vec![SentFrame {
                topic: "ego/front/rgb".into(),
                tick: 7,
                seq: 1,
                epoch: u64::MAX,
                sim_nanos: 10,
                published_mono_nanos: 11,
            }],
            n_lost: 1,
            n_refused: 2,
            usage: Vec::new(),
            faults: vec!["slow".into()],
            has_crashed: true,
            drive_recording: None,
        }
    }

    #[test]
    fn a_finished_run_comes_back_as_it_was_and_a_damaged_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run");
        assert!(Capture::kept(&path).unwrap().is_none());
        let before = capture();
        before.keep(&path).unwrap();
        let after = Capture::kept(&path).unwrap().unwrap();
        // Their bodies lie in different files, and everything else is shown alike.
        for (one, other) in before.results.iter().zip(&after.results) {
            assert_eq!(one.body.bytes().unwrap(), other.body.bytes().unwrap());
            assert_eq!((&one.topic, one.header), (&other.topic, other.header));
            assert_eq!(one.inputs, other.inputs);
            assert_eq!(one.held_mono_nanos, other.held_mono_nanos);
        }
        assert!(matches!(after.results[2].body, Body::Dropped));
        let rest = |mut capture: Capture| {
            capture.results.clear();
            format!("{capture:?}")
        };
        assert_eq!(rest(before), rest(after));
        let bytes = std::fs::read(&path).unwrap();
        for len in [0, 7, 12, 40, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..len]).unwrap();
            let error = Capture::kept(&path).unwrap_err().to_string();
            assert!(error.contains("remove the file"), "{len}: {error}");
        }
        let mut long = bytes;
        long[8..16].copy_from_slice(&u64::MAX.to_le_bytes());
        std::fs::write(&path, &long).unwrap();
        let error = Capture::kept(&path).unwrap_err().to_string();
        assert!(error.contains("too large"), "{error}");
    }
}
