//! The run of the file, tick by tick: frames and snapshots in the order in which they were recorded.

use std::sync::Arc;

use schema_frames::{ActorRecord, FrameHeader, SnapshotHeader};
use schema_recording::read::{PayloadError, RecordingFile, Samples, TopicKind, What};

/// A recorded frame or snapshot.
pub enum Recorded<'a> {
    /// A frame with its payload, or why that cannot be read.
    Frame {
        topic: &'a str,
        header: &'a FrameHeader,
        payload: Result<&'a [u8], Arc<PayloadError>>,
    },
    /// A snapshot.
    Snapshot {
        header: &'a SnapshotHeader,
        records: &'a [ActorRecord],
    },
}

impl Recorded<'_> {
    fn tick(&self) -> u64 {
        match self {
            Recorded::Frame { header, .. } => header.tick,
            Recorded::Snapshot { header, .. } => header.tick,
        }
    }
}

/// What was read, but belongs to a later tick.
enum Ahead {
    Frame(
        Arc<str>,
        Box<FrameHeader>,
        Result<Vec<u8>, Arc<PayloadError>>,
    ),
    Snapshot(Box<SnapshotHeader>, Vec<ActorRecord>),
}

impl Ahead {
    fn of(recorded: &Recorded<'_>) -> Ahead {
        match recorded {
            Recorded::Frame {
                topic,
                header,
                payload,
            } => Ahead::Frame(
                (*topic).into(),
                Box::new(**header),
                payload.clone().map(<[u8]>::to_vec),
            ),
            Recorded::Snapshot { header, records } => {
                Ahead::Snapshot(Box::new(**header), records.to_vec())
            }
        }
    }

    fn recorded(&self) -> Recorded<'_> {
        match self {
            Ahead::Frame(topic, header, payload) => Recorded::Frame {
                topic,
                header,
                payload: match payload {
                    Ok(bytes) => Ok(bytes),
                    Err(error) => Err(error.clone()),
                },
            },
            Ahead::Snapshot(header, records) => Recorded::Snapshot { header, records },
        }
    }
}

/// Reads a recording tick by tick.
pub struct Reader {
    samples: Samples,
    ahead: Option<Ahead>,
    buffer: Vec<u8>,
    is_at_end: bool,
}

impl Reader {
    /// From the beginning.
    pub fn new(file: &RecordingFile) -> Reader {
        Reader {
            samples: file.samples_of((0, u64::MAX), |topic| {
                matches!(topic.kind, TopicKind::Frame | TopicKind::Snapshot)
            }),
            ahead: None,
            buffer: Vec::new(),
            is_at_end: false,
        }
    }

    /// Whether everything was read.
    pub fn is_at_end(&self) -> bool {
        self.is_at_end && self.ahead.is_none()
    }

    /// Sentences about what of the file is damaged.
    pub fn damage(&self) -> Vec<String> {
        self.samples.damage().sentences().to_vec()
    }

    /// Hands out everything up to the first sample of a later tick than `tick`.
    ///
    /// # Errors
    /// If the file cannot be read, or `see` fails.
    pub fn up_to(
        &mut self,
        tick: u64,
        mut see: impl FnMut(&Recorded<'_>) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        if let Some(ahead) = self.ahead.take() {
            let recorded = ahead.recorded();
            if recorded.tick() > tick {
                self.ahead = Some(ahead);
                return Ok(());
            }
            see(&recorded)?;
        }
        while let Some(sample) = self.samples.next()? {
            let recorded = match sample.what {
                What::Frame {
                    topic,
                    ref header,
                    mut payload,
                } => {
                    self.buffer.resize(payload.len(), 0);
                    let read = payload.read_into(&mut self.buffer);
                    Recorded::Frame {
                        topic,
                        header,
                        payload: match read {
                            Ok(_) => Ok(&self.buffer[..]),
                            Err(error) => Err(error.into()),
                        },
                    }
                }
                What::Snapshot {
                    ref header,
                    records,
                } => Recorded::Snapshot { header, records },
                _ => continue,
            };
            if recorded.tick() > tick {
                self.ahead = Some(Ahead::of(&recorded));
                return Ok(());
            }
            see(&recorded)?;
        }
        self.is_at_end = true;
        Ok(())
    }
}
