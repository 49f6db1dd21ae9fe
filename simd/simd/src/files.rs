//! Files that commands name, read, checked and written on one thread beside the ticks.
//!
//! A tick must not wait for a disk, nor for the parser of a map. A request with such commands waits
//! in a queue until the thread has read its files; then all of its commands run between two ticks, as
//! those of any request. The checkpoints that they save are copies of the world, which the thread
//! writes; the request is answered when they are on the disk. Requests take turns: the world that a
//! checkpoint is checked with is that in which everything before it has been run.
//!
//! A journal that is run again is read here, too, ahead of the ticks, with what its commands need;
//! ticks wait for it, but nobody else does.

mod checkpoints;
mod shelf;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;

use anyhow::Context as _;
use schema_bus::{Notifier, Request};
use schema_frames::command::CheckpointPlace;
use schema_frames::{Command, CommandReply, ReplyBatch};
use simd_world::World;

use crate::history::{JournalReader, Stretch};
use crate::world::maps::Maps;
use checkpoints::{CheckpointFiles, Folder};
use shelf::{Finished, Job, Results, Shelf, Task};
pub use shelf::{ReadCheckpoint, ReadMap, Ready, Saving};

/// Most requests that wait for files, the one that is worked on among them.
pub const MAX_FILE_REQUESTS: usize = 16;
/// Most checkpoint files that one request can name.
pub const MAX_CHECKPOINT_FILES: usize = 64;
/// The same as that of a program's first thread, on which maps are built at the start.
const STACK_BYTES: usize = 8 << 20;

/// What the commands of a request need of files before they run.
#[derive(Default)]
pub struct Needs {
    /// Work by the index of its command.
    tasks: Vec<(usize, Task)>,
    /// Why a command is refused, by its index.
    pub refused: BTreeMap<usize, String>,
    /// Indices of commands that save to files.
    saves: Vec<usize>,
}

impl Needs {
    /// Whether nothing has to be read, so that the request can be run at once.
    pub fn nothing(&self) -> bool {
        self.tasks.is_empty()
    }

    /// Indices of the commands for which files are read or written.
    pub fn with_files(&self) -> Vec<usize> {
        let tasks = self.tasks.iter().map(|(idx, _)| *idx);
        tasks.chain(self.saves.iter().copied()).collect()
    }

    /// Refuses a command, so that nothing is done for it.
    pub fn refuse(&mut self, idx: usize, error: &anyhow::Error) {
        self.tasks.retain(|(other, _)| *other != idx);
        self.saves.retain(|other| *other != idx);
        self.refused.insert(idx, format!("{error:#}"));
    }
}

/// What a request is given when its commands run.
#[derive(Default)]
pub struct Given {
    ready: BTreeMap<usize, anyhow::Result<Ready>>,
    /// Checkpoints to be written when all commands have run.
    pub savings: Vec<Saving>,
}

impl Given {
    /// These commands are refused, and for no other has anything been read.
    pub fn refusals(refused: BTreeMap<usize, String>) -> Given {
        let refused = refused.into_iter();
        Given {
            ready: refused
                .map(|(idx, why)| (idx, Err(anyhow::Error::msg(why))))
                .collect(),
            savings: Vec::new(),
        }
    }

    /// Refuses commands whatever was read for them.
    fn refusing(mut self, refused: BTreeMap<usize, String>) -> Given {
        self.ready.extend(Given::refusals(refused).ready);
        self
    }

    fn read(results: Results<Ready>) -> Given {
        Given {
            ready: results.into_iter().collect(),
            savings: Vec::new(),
        }
    }

    /// What was read for command number `idx`; `None` if nothing was.
    ///
    /// # Errors
    /// If it could not be read, or the command is refused.
    pub fn take(&mut self, idx: usize) -> anyhow::Result<Option<Ready>> {
        self.ready.remove(&idx).transpose()
    }

    /// The checkpoint that an earlier command of the request saves to `path`.
    pub fn saved_here(&self, path: &Path) -> Option<&Saving> {
        self.savings.iter().rev().find(|saving| saving.path == path)
    }
}

/// A request that has come from the thread.
pub enum Returned {
    /// Its files are read: its commands run now.
    Read { request: Request, given: Given },
    /// Its files are written: it is answered now.
    Written {
        request: Request,
        answer: ReplyBatch,
    },
}

/// A request that waits for files.
struct Errand {
    request: Request,
    stage: Stage,
}

enum Stage {
    Reading(Needs),
    Writing {
        answer: ReplyBatch,
        savings: Vec<Saving>,
    },
}

/// What becomes of a request when its job is done.
enum After {
    Run(BTreeMap<usize, String>),
    Answer(ReplyBatch),
}

/// What the thread works for.
enum Work {
    Request(Request, After),
    Journal(OfJournal),
}

/// What is done for a journal that is run again. It comes before what is done for requests, because
/// ticks wait for it.
enum OfJournal {
    /// Its next entries are read.
    Entries,
    /// What commands of it need is read.
    Read(Needs),
    /// Checkpoints are written that its commands saved.
    Write(Vec<Saving>),
}

/// Where files are read and written.
pub struct Files {
    folder: Folder,
    queue: VecDeque<Errand>,
    of_journal: VecDeque<OfJournal>,
    /// What the thread works for.
    at_work: Option<Work>,
    /// Requests that have come from the thread.
    returned: VecDeque<Returned>,
    /// Entries of the journal that have.
    stretch: Option<Stretch>,
    /// What has been read for commands of the journal.
    given: Option<Given>,
    jobs: Option<Sender<Job>>,
    finished: Receiver<Finished>,
    thread: Option<JoinHandle<()>>,
}

impl Files {
    /// Starts the thread, which wakes the daemon whenever it has finished something. `journal` is the
    /// rest of one that is run again.
    ///
    /// # Errors
    /// If there can be no thread.
    pub fn start(
        maps: Maps,
        data_folder: &Path,
        seed: u64,
        journal: Option<JournalReader>,
        wake: Notifier,
    ) -> anyhow::Result<Files> {
        let folder = Folder::of(data_folder);
        let mut shelf = Shelf::new(maps, CheckpointFiles::new(folder.clone()), journal, seed);
        let (jobs, to_do) = channel::<Job>();
        let (done, finished) = channel();
        let work = move || {
            for job in to_do {
                if let Some(result) = shelf.work(job)
                    && done.send(result).is_ok()
                {
                    wake.notify();
                }
            }
        };
        let thread = std::thread::Builder::new()
            .name("simd-files".into())
            .stack_size(STACK_BYTES)
            .spawn(work)
            .context("cannot start the thread that reads and writes files")?;
        Ok(Files {
            folder,
            queue: VecDeque::new(),
            of_journal: VecDeque::new(),
            at_work: None,
            returned: VecDeque::new(),
            stretch: None,
            given: None,
            jobs: Some(jobs),
            finished,
            thread: Some(thread),
        })
    }

    /// Path of a checkpoint file.
    ///
    /// # Errors
    /// If it can have no such name.
    pub fn checkpoint(&self, name: &str) -> anyhow::Result<PathBuf> {
        self.folder.file(name)
    }

    /// What these commands need. Texts of maps are taken out of them.
    pub fn needs(&self, commands: &mut [Command]) -> Needs {
        let mut needs = Needs::default();
        let mut saved_here = BTreeSet::new();
        let mut n_checkpoints = 0;
        for (idx, command) in commands.iter_mut().enumerate() {
            if let Command::SaveCheckpoint {
                to: CheckpointPlace::File(_),
            }
            | Command::RestoreCheckpoint {
                from: CheckpointPlace::File(_),
            } = command
            {
                n_checkpoints += 1;
                if n_checkpoints > MAX_CHECKPOINT_FILES {
                    let why = format!(
                        "this request names more than {MAX_CHECKPOINT_FILES} checkpoint files, which is the most; name the others in another one"
                    );
                    needs.refused.insert(idx, why);
                    continue;
                }
            }
            let task = match command {
                Command::ListMaps => Task::List,
                Command::StoreMap(map) => Task::Store(std::mem::take(map)),
                Command::LoadMap { map } => Task::Load(map.clone()),
                Command::SaveCheckpoint {
                    to: CheckpointPlace::File(name),
                } => {
                    needs.saves.push(idx);
                    saved_here.extend(self.folder.file(name).ok());
                    continue;
                }
                Command::RestoreCheckpoint {
                    from: CheckpointPlace::File(name),
                } => {
                    let path = self.folder.file(name).ok();
                    if path.is_some_and(|path| saved_here.contains(&path)) {
                        continue;
                    }
                    Task::Restore(name.clone())
                }
                _ => continue,
            };
            needs.tasks.push((idx, task));
        }
        needs
    }

    /// Requests that wait for files, the one that is worked on among them.
    pub fn n_waiting(&self) -> usize {
        self.queue.len() + usize::from(self.request_at_work().is_some())
    }

    fn request_at_work(&self) -> Option<&Request> {
        match &self.at_work {
            Some(Work::Request(request, _)) => Some(request),
            _ => None,
        }
    }

    /// Whether no further request can wait.
    pub fn is_full(&self) -> bool {
        self.n_waiting() >= MAX_FILE_REQUESTS
    }

    /// Whether a request of the client with this port waits for files.
    pub fn is_busy(&self, client_port: u128) -> bool {
        let waiting = self.queue.iter().map(|errand| &errand.request);
        waiting
            .chain(self.request_at_work())
            .any(|request| request.client_port() == client_port)
    }

    /// Lets a request wait until its files are read.
    pub fn read(&mut self, request: Request, needs: Needs) {
        let stage = Stage::Reading(needs);
        self.queue.push_back(Errand { request, stage });
    }

    /// Lets a request whose commands have run wait until its checkpoints are written. It comes
    /// before those that have not run.
    pub fn write(&mut self, request: Request, answer: ReplyBatch, savings: Vec<Saving>) {
        let stage = Stage::Writing { answer, savings };
        let is_reading = |errand: &Errand| matches!(errand.stage, Stage::Reading(_));
        let at = self.queue.iter().position(is_reading);
        let at = at.unwrap_or(self.queue.len());
        self.queue.insert(at, Errand { request, stage });
    }

    /// Lets the next entries of the journal be read.
    pub fn read_journal(&mut self) {
        self.of_journal.push_back(OfJournal::Entries);
    }

    /// Lets be read what commands of the journal need.
    pub fn read_for_journal(&mut self, needs: Needs) {
        self.of_journal.push_back(OfJournal::Read(needs));
    }

    /// Lets checkpoints be written that commands of the journal saved. Those that cannot be written
    /// are said.
    pub fn write_for_journal(&mut self, savings: Vec<Saving>) {
        if !savings.is_empty() {
            self.of_journal.push_back(OfJournal::Write(savings));
        }
    }

    /// Gives the thread its next work if it has none; `living` is the world as it is now.
    pub fn go_on(&mut self, living: &World) {
        self.hear();
        if self.at_work.is_some() {
            return;
        }
        if let Some(next) = self.of_journal.pop_front() {
            return self.work_for_journal(next, living);
        }
        if !self.returned.is_empty() {
            return;
        }
        let Some(Errand { request, stage }) = self.queue.pop_front() else {
            return;
        };
        let (job, after) = match stage {
            Stage::Reading(Needs { tasks, refused, .. }) => {
                (read_job(tasks, living), After::Run(refused))
            }
            Stage::Writing { answer, savings } => (Job::Write(savings), After::Answer(answer)),
        };
        self.send(job);
        self.at_work = Some(Work::Request(request, after));
    }

    fn work_for_journal(&mut self, work: OfJournal, living: &World) {
        let (job, work) = match work {
            OfJournal::Entries => (Job::ReadJournal, work),
            OfJournal::Read(mut needs) => {
                let tasks = std::mem::take(&mut needs.tasks);
                (read_job(tasks, living), OfJournal::Read(needs))
            }
            OfJournal::Write(savings) => (Job::Write(savings), OfJournal::Write(Vec::new())),
        };
        self.send(job);
        self.at_work = Some(Work::Journal(work));
    }

    /// The next request that has come from the thread.
    pub fn take_returned(&mut self) -> Option<Returned> {
        self.hear();
        self.returned.pop_front()
    }

    /// Entries of the journal that have come from the thread.
    pub fn take_stretch(&mut self) -> Option<Stretch> {
        self.hear();
        self.stretch.take()
    }

    /// What has been read for commands of the journal.
    pub fn take_given(&mut self) -> Option<Given> {
        self.hear();
        self.given.take()
    }

    /// Takes a map of a journal.
    pub fn provide_map(&mut self, name: String, title: String, bytes: Vec<u8>) {
        self.send(Job::ProvideMap { name, title, bytes });
    }

    /// Takes a checkpoint file of a journal.
    pub fn provide_checkpoint(&mut self, name: String, bytes: Vec<u8>) {
        self.send(Job::ProvideCheckpoint { name, bytes });
    }

    /// Waits for the checkpoints of commands that have run, and returns the requests to be answered.
    /// Those whose commands have not run are given up.
    pub fn finish(&mut self) -> Vec<(Request, ReplyBatch)> {
        self.queue
            .retain(|errand| matches!(errand.stage, Stage::Writing { .. }));
        self.of_journal
            .retain(|work| matches!(work, OfJournal::Write(_)));
        let mut answers = Vec::new();
        loop {
            if self.at_work.is_some() {
                let finished = self.receive();
                self.sort(finished);
            }
            while let Some(returned) = self.returned.pop_front() {
                if let Returned::Written { request, answer } = returned {
                    answers.push((request, answer));
                }
            }
            if let Some(OfJournal::Write(savings)) = self.of_journal.pop_front() {
                self.send(Job::Write(savings));
                self.at_work = Some(Work::Journal(OfJournal::Write(Vec::new())));
                continue;
            }
            let Some(Errand { request, stage }) = self.queue.pop_front() else {
                return answers;
            };
            if let Stage::Writing { answer, savings } = stage {
                self.send(Job::Write(savings));
                self.at_work = Some(Work::Request(request, After::Answer(answer)));
            }
        }
    }

    /// Takes what the thread has finished.
    fn hear(&mut self) {
        match self.finished.try_recv() {
            Ok(finished) => self.sort(finished),
            Err(TryRecvError::Empty) => {}
            Err(TryRecvError::Disconnected) => self.pass_panic_on(),
        }
    }

    /// Hands a result to whom the thread worked for.
    fn sort(&mut self, finished: Finished) {
        match (self.at_work.take(), finished) {
            (Some(Work::Request(request, After::Run(refused))), Finished::Read(results)) => {
                self.returned.push_back(Returned::Read {
                    request,
                    given: Given::read(results).refusing(refused),
                });
            }
            (
                Some(Work::Request(request, After::Answer(mut answer))),
                Finished::Written(results),
            ) => {
                for (idx, result) in results {
                    if let (Err(error), Some(reply)) = (result, answer.replies.get_mut(idx)) {
                        let error = schema_frames::limits::cut(format!("{error:#}"));
                        *reply = CommandReply::Refused { error };
                    }
                }
                self.returned
                    .push_back(Returned::Written { request, answer });
            }
            (Some(Work::Journal(OfJournal::Entries)), Finished::Journal(stretch)) => {
                self.stretch = Some(stretch);
            }
            (Some(Work::Journal(OfJournal::Read(needs))), Finished::Read(results)) => {
                self.given = Some(Given::read(results).refusing(needs.refused));
            }
            (Some(Work::Journal(OfJournal::Write(_))), Finished::Written(results)) => {
                for (_, result) in results {
                    if let Err(error) = result {
                        tracing::warn!("a checkpoint of the journal: {error:#}");
                    }
                }
            }
            _ => unreachable!("the thread answers the job that it was given last"),
        }
    }

    fn send(&mut self, job: Job) {
        let jobs = self.jobs.as_ref().expect("it ends with its owner");
        if jobs.send(job).is_err() {
            self.pass_panic_on();
        }
    }

    fn receive(&mut self) -> Finished {
        match self.finished.recv() {
            Ok(finished) => finished,
            Err(_) => self.pass_panic_on(),
        }
    }

    /// The thread only ends early by a panic, which is a panic of the daemon.
    fn pass_panic_on(&mut self) -> ! {
        let ended = self.thread.take().map(JoinHandle::join);
        match ended {
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            _ => unreachable!("the thread works until its daemon drops it"),
        }
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        self.jobs = None;
        if let Some(thread) = self.thread.take() {
            // What it has begun is finished; a panic was said when it came.
            let _ = thread.join();
        }
    }
}

/// A job that reads; it takes a copy of the world along if a checkpoint is to be checked.
fn read_job(tasks: Vec<(usize, Task)>, living: &World) -> Job {
    let needs_world = tasks
        .iter()
        .any(|(_, task)| matches!(task, Task::Restore(_)));
    Job::Read {
        living: needs_world.then(|| Box::new(living.clone())),
        tasks,
    }
}
