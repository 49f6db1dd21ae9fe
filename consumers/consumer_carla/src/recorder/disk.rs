//! The thread that brings a recording's frames to the disk. The world's thread hands it frames and
//! never waits: neither for the disk, nor for the simulator's answers that a frame still lacks.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::JoinHandle;

use consumer_kit::WorldAt;
use crossbeam_channel::{Receiver, Sender, bounded, unbounded};
use schema_frames::ActorRecord;
use schema_frames::document::Weather;

use crate::recorder::changes::{Changes, StreetLight};
use crate::recorder::frame::Frame;
use crate::recorder::watch::{Asked, Watch};

/// Most memory of frames that wait for a disk, bytes; a recording whose disk falls further behind
/// ends.
pub const MAX_WAITING_BYTES: usize = 256 << 20;

/// A frame that is whole but for what changed.
#[derive(Debug)]
pub struct Unfinished {
    /// The frame, without changes.
    pub frame: Frame,
    /// What it was made from.
    pub snapshot: Arc<WorldAt>,
    /// Weather in force.
    pub weather: Option<Weather>,
    /// Street lights that were set.
    pub street_lights: BTreeMap<u32, StreetLight>,
    /// What the simulator was asked for.
    pub asked: Asked,
}

impl Unfinished {
    /// Memory that it takes, about.
    fn n_bytes(&self) -> usize {
        1024 + 2 * self.snapshot.records.len() * size_of::<ActorRecord>()
    }
}

enum Job {
    Frame(Box<Unfinished>),
    /// Answered when all before it is written.
    Mark(Sender<()>),
}

/// Why a frame was not taken.
#[derive(Debug)]
pub enum Refused {
    /// Too much waits already.
    Behind,
    /// The file could not be written; [`Disk::finish`] says why.
    Ended,
}

/// The way to a file, and the thread that writes it.
#[derive(Debug)]
pub struct Disk {
    jobs: Sender<Job>,
    n_waiting_bytes: Arc<AtomicUsize>,
    thread: JoinHandle<io::Result<()>>,
}

impl Disk {
    /// Begins with a file whose head is written.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn new(file: BufWriter<File>) -> io::Result<Disk> {
        let (jobs, queue) = unbounded();
        let n_waiting_bytes = Arc::new(AtomicUsize::new(0));
        let waiting = n_waiting_bytes.clone();
        let thread = std::thread::Builder::new()
            .name("recording".into())
            .spawn(move || write_all(file, &queue, &waiting))?;
        Ok(Disk {
            jobs,
            n_waiting_bytes,
            thread,
        })
    }

    /// Hands a frame over without waiting.
    ///
    /// # Errors
    /// [`Refused`]; the recording is over then.
    pub fn put(&self, frame: Unfinished) -> Result<(), Refused> {
        let n_bytes = frame.n_bytes();
        if self.n_waiting_bytes.fetch_add(n_bytes, Ordering::AcqRel) > MAX_WAITING_BYTES {
            return Err(Refused::Behind);
        }
        let sent = self.jobs.send(Job::Frame(Box::new(frame)));
        sent.map_err(|_| Refused::Ended)
    }

    /// What ends when all frames that were handed over so far are written, or when the thread has
    /// ended. Not for the world's thread to wait on.
    pub fn mark(&self) -> Receiver<()> {
        let (done, is_done) = bounded(1);
        // If the thread has ended, the other end is dropped with the job, which ends the wait.
        let _ = self.jobs.send(Job::Mark(done));
        is_done
    }

    /// Waits until all is written, and ends.
    ///
    /// # Errors
    /// The first error of the file.
    pub fn finish(self) -> io::Result<()> {
        drop(self.jobs);
        match self.thread.join() {
            Ok(result) => result,
            Err(_) => Err(io::Error::other(
                "the thread that writes the recording panicked",
            )),
        }
    }
}

fn write_all(
    mut file: BufWriter<File>,
    queue: &Receiver<Job>,
    n_waiting_bytes: &AtomicUsize,
) -> io::Result<()> {
    let mut watch = Watch::default();
    let mut bytes = Vec::new();
    for job in queue {
        match job {
            Job::Mark(done) => drop(done.send(())),
            Job::Frame(unfinished) => {
                let n_bytes = unfinished.n_bytes();
                bytes.clear();
                whole(*unfinished, &mut watch).write(&mut bytes);
                file.write_all(&bytes)?;
                file.flush()?;
                n_waiting_bytes.fetch_sub(n_bytes, Ordering::AcqRel);
            }
        }
    }
    Ok(())
}

fn whole(unfinished: Unfinished, watch: &mut Watch) -> Frame {
    let mut changes = Changes {
        street_lights: unfinished.street_lights,
        ..Changes::default()
    };
    unfinished.asked.answer(&mut changes);
    watch.note(&unfinished.snapshot, unfinished.weather, &mut changes);
    Frame {
        changes,
        ..unfinished.frame
    }
}

#[cfg(test)]
mod tests {
    use std::os::fd::OwnedFd;
    use std::os::unix::net::UnixStream;

    use super::*;

    fn frame() -> Unfinished {
        Unfinished {
            frame: Frame::default(),
            snapshot: Arc::new(WorldAt {
                header: bytemuck::Zeroable::zeroed(),
                records: vec![bytemuck::Zeroable::zeroed(); 10_000],
            }),
            weather: None,
            street_lights: BTreeMap::new(),
            asked: Asked::default(),
        }
    }

    /// A disk that takes no byte: a full socket that nobody reads. The world's thread goes on, and
    /// what waits is bounded.
    #[test]
    fn a_disk_that_hangs_holds_nobody() {
        let (mut full, _unread) = UnixStream::pair().unwrap();
        full.set_nonblocking(true).unwrap();
        while full.write(&[0; 1024]).is_ok() {}
        full.set_nonblocking(false).unwrap();
        let file = File::from(OwnedFd::from(full));
        let disk = Disk::new(BufWriter::new(file)).unwrap();
        let mut n_taken = 0;
        let refused = loop {
            match disk.put(frame()) {
                Ok(()) => n_taken += 1,
                Err(refused) => break refused,
            }
            assert!(n_taken < 1000, "what waits has no end");
        };
        assert!(matches!(refused, Refused::Behind), "{refused:?}");
        assert!(n_taken > 10, "{n_taken} frames were taken");
        assert!(disk.mark().try_recv().is_err(), "nothing is written");
    }

    #[test]
    fn all_is_written_when_it_is_finished() {
        let path = std::env::temp_dir().join(format!("gantry-disk-{}", std::process::id()));
        let disk = Disk::new(BufWriter::new(File::create(&path).unwrap())).unwrap();
        for _ in 0..3 {
            disk.put(frame()).unwrap();
        }
        disk.mark().recv().unwrap();
        let n_bytes = std::fs::metadata(&path).unwrap().len();
        disk.put(frame()).unwrap();
        disk.finish().unwrap();
        let mut one = Vec::new();
        Frame::default().write(&mut one);
        assert!(
            n_bytes > 0 && n_bytes.is_multiple_of(3),
            "{n_bytes} of frames of {}",
            one.len()
        );
        assert_eq!(std::fs::metadata(&path).unwrap().len(), n_bytes / 3 * 4);
        std::fs::remove_file(&path).unwrap();
    }
}
