//! Files that commands name, read, checked and written on one thread beside the ticks.
//!
//! A tick must not wait for a disk, nor for the parser of a map. A request with such commands waits
//! in a queue until the thread has read its files; then all of its commands run between two ticks, as
//! those of any request. The checkpoints that they save are copies of the world, which the thread
//! writes; the request is answered when they are on the disk. Requests take turns: the world that a
//! checkpoint is checked with is that in which everything before it has been run.

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

/// Where files are read and written.
pub struct Files {
    folder: Folder,
    queue: VecDeque<Errand>,
    /// The request that the thread works for.
    at_work: Option<(Request, After)>,
    /// Requests that came back while somebody waited for the thread.
    returned: VecDeque<Returned>,
    jobs: Option<Sender<Job>>,
    finished: Receiver<Finished>,
    thread: Option<JoinHandle<()>>,
}

impl Files {
    /// Starts the thread, which wakes the daemon whenever it has finished something.
    ///
    /// # Errors
    /// If there can be no thread.
    pub fn start(
        maps: Maps,
        data_folder: &Path,
        seed: u64,
        wake: Notifier,
    ) -> anyhow::Result<Files> {
        let folder = Folder::of(data_folder);
        let mut shelf = Shelf::new(maps, CheckpointFiles::new(folder.clone()), seed);
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
            at_work: None,
            returned: VecDeque::new(),
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
        self.queue.len() + usize::from(self.at_work.is_some())
    }

    /// Whether no further request can wait.
    pub fn is_full(&self) -> bool {
        self.n_waiting() >= MAX_FILE_REQUESTS
    }

    /// Whether a request of the client with this port waits for files.
    pub fn is_busy(&self, client_port: u128) -> bool {
        let waiting = self.queue.iter().map(|errand| &errand.request);
        let at_work = self.at_work.iter().map(|(request, _)| request);
        waiting
            .chain(at_work)
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

    /// Gives the thread the next request if it has none; `living` is the world as it is now.
    pub fn go_on(&mut self, living: &World) {
        if self.at_work.is_some() || !self.returned.is_empty() {
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
        self.at_work = Some((request, after));
    }

    /// The next request that has come from the thread.
    pub fn take_returned(&mut self) -> Option<Returned> {
        if let Some(returned) = self.returned.pop_front() {
            return Some(returned);
        }
        match self.finished.try_recv() {
            Ok(finished) => Some(self.returned_with(finished)),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => self.pass_panic_on(),
        }
    }

    /// Reads what commands of a journal need, and waits for it.
    pub fn read_now(&mut self, needs: Needs, living: &World) -> Given {
        if needs.nothing() {
            return Given::refusals(needs.refused);
        }
        self.wait_until_idle();
        self.send(read_job(needs.tasks, living));
        match self.receive() {
            Finished::Read(results) => Given::read(results).refusing(needs.refused),
            Finished::Written(_) => unreachable!("the thread was idle and was told to read"),
        }
    }

    /// Writes checkpoints of a journal's commands, and waits for it. Those that cannot be written are
    /// said.
    pub fn write_now(&mut self, savings: Vec<Saving>) {
        if savings.is_empty() {
            return;
        }
        self.wait_until_idle();
        self.send(Job::Write(savings));
        if let Finished::Written(results) = self.receive() {
            for (_, result) in results {
                if let Err(error) = result {
                    tracing::warn!("a checkpoint of the journal: {error:#}");
                }
            }
        }
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
        let mut answers = Vec::new();
        loop {
            self.wait_until_idle();
            while let Some(returned) = self.returned.pop_front() {
                if let Returned::Written { request, answer } = returned {
                    answers.push((request, answer));
                }
            }
            let Some(Errand { request, stage }) = self.queue.pop_front() else {
                return answers;
            };
            if let Stage::Writing { answer, savings } = stage {
                self.send(Job::Write(savings));
                self.at_work = Some((request, After::Answer(answer)));
            }
        }
    }

    /// Waits until the thread has no work, and keeps what it returns.
    fn wait_until_idle(&mut self) {
        if self.at_work.is_some() {
            let finished = self.receive();
            let returned = self.returned_with(finished);
            self.returned.push_back(returned);
        }
    }

    /// The request that the thread worked for, with its result.
    fn returned_with(&mut self, finished: Finished) -> Returned {
        let at_work = self.at_work.take();
        match (at_work, finished) {
            (Some((request, After::Run(refused))), Finished::Read(results)) => Returned::Read {
                request,
                given: Given::read(results).refusing(refused),
            },
            (Some((request, After::Answer(mut answer))), Finished::Written(results)) => {
                for (idx, result) in results {
                    if let (Err(error), Some(reply)) = (result, answer.replies.get_mut(idx)) {
                        let error = schema_frames::limits::cut(format!("{error:#}"));
                        *reply = CommandReply::Refused { error };
                    }
                }
                Returned::Written { request, answer }
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
